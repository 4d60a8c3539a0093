// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

#include <tbb/parallel_for.h>

#include "core/base/units.h"
#include "relight/viewer/gui/background_job.h"

namespace refield {

namespace {

using Clock = std::chrono::steady_clock;

void add_image(double factor, const Image& from, Image& to) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, to.values.size(), 1 << 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i)
      to.values[i] += static_cast<float>(factor) * from.values[i];
  });
}

/// Weights of 16 bits are exact to the last level of a screen, those of 8 to three levels in the dark; but
/// beside a field of more entries they would take more memory than half of its file.
constexpr std::uint64_t max_fine_entries = 8'000'000;

RelightPrecision precision_for(const ReflectanceField& field) {
  return field.transfer.entries() <= max_fine_entries ? RelightPrecision::fine : RelightPrecision::fast;
}

void require_content(const FieldOutline& field) {
  if (field.width < 1 || field.height < 1 || field.basis.domain.width < 1 || field.basis.domain.height < 1)
    throw InputError("the field is empty; there is nothing to show");
}

TileRelighter relighter_of(ReflectanceField& field) {
  require_content(field);
  const RelightPrecision precision = precision_for(field);
  std::optional<TileRelighter> relighter;
  run_uncancelled([&] { relighter.emplace(std::move(field), precision); });
  // NOLINTNEXTLINE(bugprone-use-after-move): the transfer alone is gone.
  field.basis.boxes = {};
  return *std::move(relighter);
}

/// Leaves the outline.
TileRelighter relighter_of(PackedField& packed) {
  require_content(packed.outline);
  return TileRelighter(std::move(packed));
}

PixelGrid whole_image(const FieldOutline& field) {
  return {{0, 0, field.width, field.height}, 1};
}

}  // namespace

FieldPixels::FieldPixels(ReflectanceField pixels, const std::optional<PixelGrid>& part)
    : relighter(relighter_of(pixels)), field(std::move(pixels)), grid(part.value_or(whole_image(field))) {}

FieldPixels::FieldPixels(PackedField pixels)
    : relighter(relighter_of(pixels)), field(std::move(pixels.outline)), grid(whole_image(field)) {}

ViewRelighter::ViewRelighter(std::shared_ptr<FieldPixels> pixels, const RunContext& run)
    : run_(run),
      panorama_(pixels->relighter.domain()),
      pixels_(std::move(pixels)),
      painter_(pixels_->relighter.domain()),
      relit_by_{LightSetup(pixels_->relighter.domain()), std::nullopt, pixels_},
      probe_light_{Image(relit_by_.setup.domain.width, relit_by_.setup.domain.height, 3),
                   relit_by_.setup.domain.parameterisation} {
  const TileRelighter& relighter = pixels_->relighter;
  auto boxes = relighter.box_projector();
  if (!boxes || !panorama_.is_cube()) return;
  summed_.emplace(SummedEnvironment{.relighter = relighter,
                                    .boxes = std::move(*boxes),
                                    .shown = EnvironmentProjector(panorama_.shown(), {}, run),
                                    .of = std::nullopt,
                                    .straight = {},
                                    .outputs = {},
                                    .panorama = {}});
}

bool ViewRelighter::is_summed(const LightSetup& setup) const {
  return summed_ && setup.environment && setup.environment->has_path_sums();
}

/// Returns how long relighting took, in milliseconds.
double ViewRelighter::sum_environment(const LightSetup& setup) {
  SummedEnvironment& summed = *summed_;
  const bool is_same = summed.of && summed.of->environment == setup.environment;
  if (is_same && summed.of->turns == setup.turns) return 0.0;
  if (!is_same) {
    summed.of.reset();
    summed.straight = summed.shown.project(*setup.environment, {}, run_).light;
  }
  const std::vector<float> sums = summed.boxes.project(*setup.environment, setup.turn(), run_);
  run_.throw_if_stopped();  // else they may be incomplete
  double relight_ms = 0.0;
  run_uncancelled([&] {
    summed.panorama = rotated(summed.straight, setup.turns).radiance;
    const auto start = Clock::now();
    summed.outputs = summed.relighter.relight(sums);
    relight_ms = 1e3 * seconds_since(start);
  });
  summed.of = setup;
  return relight_ms;
}

FrameTime ViewRelighter::relight(const ViewLight& wanted) {
  FrameTime times;
  const auto start = Clock::now();
  if (wanted.pixels != pixels_) {
    pixels_ = wanted.pixels;
    relit_ = nullptr;
  }
  const bool has_summed = is_summed(wanted.setup);
  LightSetup painted = wanted.setup;
  if (has_summed) {
    painted.set_map(std::nullopt);
    times.relight_ms = sum_environment(wanted.setup);
  } else {
    painter_.turn_map(painted, run_);
  }
  run_uncancelled([&] {
    is_dark_ = has_summed && painted.ambient == 0.0 && painted.light_sources.empty();
    std::optional<Box> changed;
    if (!is_dark_) changed = painter_.paint(painted, run_);
    changed_ = united(changed_, changed);
    times.light_ms = 1e3 * seconds_since(start) - times.relight_ms;
    const auto begun = Clock::now();
    relight_painted(wanted.probe, changed);
    times.relight_ms += 1e3 * seconds_since(begun);
    relit_by_ = wanted;
  });
  return times;
}

/// `changed`: what was painted just now.
void ViewRelighter::relight_painted(const std::optional<Box>& probe, const std::optional<Box>& changed) {
  if (probe) {
    relit_ = &relight_probe(*probe);
  } else if (is_dark_) {
    relit_ = nullptr;
  } else if (lit_ || !relit_) {
    std::ranges::fill(probe_light_.radiance.values, 0.0f);  // for the next probe
    lit_.reset();
    relit_ = &pixels_->relighter.relight(painter_.light());
  } else if (changed) {
    relit_ = &pixels_->relighter.update(painter_.light(), *changed);
  }
}

const Image& ViewRelighter::relight_probe(const Box& probe) {
  const auto fill = [this](const Box& box, float radiance) {
    for (int y = box.y0; y < box.y1; ++y)
      std::ranges::fill(probe_light_.radiance.row(y).subspan(static_cast<std::size_t>(box.x0) * 3,
                                                             static_cast<std::size_t>(box.width()) * 3),
                        radiance);
  };
  if (lit_) fill(*lit_, 0.0f);
  fill(probe, 1.0f);
  const Image& outputs = lit_ && relit_ ? pixels_->relighter.update(probe_light_, *united(*lit_, probe))
                                        : pixels_->relighter.relight(probe_light_);
  lit_ = probe;
  return outputs;
}

bool ViewRelighter::show(RelitField& shown) {
  if (relit_ != nullptr)
    shown.outputs = *relit_;
  else
    shown.outputs = Image(summed_->outputs.width, summed_->outputs.height, 3);
  shown.share = painter_.share();
  if (is_summed(relit_by_.setup) && !relit_by_.probe) {
    shown.share = {};
    add_image(relit_by_.setup.map_gain, summed_->outputs, shown.outputs);
  }
  return show_light(shown.light);
}

bool ViewRelighter::show_light(Image& shown) {
  const Image& light = painter_.light().radiance;
  const auto changed = std::exchange(changed_, std::nullopt);
  const bool has_summed = is_summed(relit_by_.setup);
  if (!changed && !has_summed && !showed_summed_) return false;
  showed_summed_ = has_summed;
  if (panorama_.is_cube()) {
    shown = is_dark_ ? Image(panorama_.shown().width, panorama_.shown().height, 3) : panorama_.show(light);
    if (has_summed) add_image(relit_by_.setup.map_gain, summed_->panorama, shown);
  } else if (!shown.same_shape(light)) {
    shown = light;
  } else {
    const auto first = static_cast<std::size_t>(changed->x0) * 3,
               count = static_cast<std::size_t>(changed->width()) * 3;
    for (int y = changed->y0; y < changed->y1; ++y)
      std::ranges::copy(light.row(y).subspan(first, count), shown.row(y).subspan(first).begin());
  }
  return true;
}

LightMap ViewRelighter::light() const {
  LightMap light = painter_.light();
  if (is_dark_) std::ranges::fill(light.radiance.values, 0.0f);
  const LightSetup& setup = relit_by_.setup;
  if (is_summed(setup))
    add_image(setup.map_gain, setup.projector->project(*setup.environment, setup.turn(), run_).light.radiance,
              light.radiance);
  return light;
}

}  // namespace refield
