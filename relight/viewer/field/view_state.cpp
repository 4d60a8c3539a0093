// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "core/base/errors.h"
#include "core/base/run_context.h"
#include "core/image/false_colour.h"
#include "core/image/tone_map.h"
#include "relight/sequence.h"

namespace refield {

namespace {

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// Weights of 16 bits are exact to the last level of a screen, those of 8 to three levels in the dark; but
/// beside a field of more entries they would take more memory than half of its file.
constexpr std::uint64_t max_fine_entries = 8'000'000;

void require_content(const ReflectanceField& field) {
  if (field.width < 1 || field.height < 1 || field.basis.domain.width < 1 || field.basis.domain.height < 1)
    throw InputError("the field is empty; there is nothing to show");
}

void add(double factor, const Image& from, Image& to) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, to.values.size(), 1 << 16), [&](const auto& range) {
    for (std::size_t i = range.begin(); i != range.end(); ++i)
      to.values[i] += static_cast<float>(factor) * from.values[i];
  });
}

}  // namespace

std::string_view name_of(Shown shown) {
  switch (shown) {
    case Shown::picture:
      return "picture";
    case Shown::false_colour:
      return "false-colour";
    case Shown::predicted_error:
      return "error";
    case Shown::photograph_noise:
      return "noise";
    case Shown::training_error:
      return "training-error";
  }
  throw InputError("unknown view");
}

Shown shown_from_name(std::string_view name) {
  for (const Shown shown : all_shown)
    if (name == name_of(shown)) return shown;
  throw InputError("unknown view '" + std::string(name) +
                   "'; use picture, false-colour, error, noise or training-error");
}

ViewState::Loaded ViewState::load(ReflectanceField field) {
  require_content(field);
  const auto precision =
      field.transfer.entries() <= max_fine_entries ? RelightPrecision::fine : RelightPrecision::fast;
  Relighter relighter(std::move(field), precision);
  // NOLINTNEXTLINE(bugprone-use-after-move): the transfer alone is gone; rectangles it has its own.
  field.basis.boxes = {};
  return {std::move(field), std::move(relighter)};
}

ViewState::Loaded ViewState::load(PackedField packed) {
  require_content(packed.outline);
  ReflectanceField outline = packed.outline;
  return {std::move(outline), Relighter(std::move(packed))};
}

ViewState::ViewState(Loaded loaded, const RunContext& run)
    : run_(run),
      field_(std::move(loaded.field)),
      setup_(field_.basis.domain),
      panorama_(field_.basis.domain),
      light_picture_(std::size_t{4} * panorama_.shown().width * panorama_.shown().height),
      kernel_picture_(light_picture_.size()),
      done_{setup_, std::nullopt},
      running_(done_),
      relighter_(std::move(loaded.relighter)),
      painter_(field_.basis.domain),
      probe_light_{Image(setup_.domain().width, setup_.domain().height, 3),
                   setup_.domain().parameterisation} {
  if (const auto boxes = relighter_.summed_boxes(); !boxes.empty() && panorama_.is_cube())
    summed_.emplace(SummedEnvironment{.relighter = relighter_,
                                      .boxes = BoxProjector(setup_.domain().width, boxes),
                                      .shown = EnvironmentProjector(panorama_.shown(), {}, run),
                                      .of = std::nullopt,
                                      .straight = {},
                                      .outputs = {},
                                      .panorama = {}});
  reset_light_sources();
  if (!field_.mesh.empty()) view_ = std::make_unique<FreeView>(field_);
  expose_picture();
  refresh();
  is_picture_old_ = is_light_old_ = true;
}

void ViewState::reset_light_sources() {
  setup_.remove_all();
  setup_.set_ambient(0.03);
  setup_.add({PaintedLight::Shape::spot, 0.3, 0.35, 0.2, {1.0f, 0.72f, 0.42f}, 1.0, true});
  setup_.add({PaintedLight::Shape::spot, 0.75, 0.6, 0.14, {0.3f, 0.55f, 1.0f}, 1.0, true});
}

void ViewState::set_tone(const ToneMapping& tone) {
  if (tone == tone_) return;
  tone_ = tone;
  is_picture_old_ = true;
}

void ViewState::set_light_exposure(double exposure) {
  if (exposure == light_exposure_) return;
  light_exposure_ = exposure;
  is_light_old_ = true;
}

void ViewState::expose_picture() {
  wants_picture_exposure_ = true;
  expose_if_current();
}

void ViewState::expose_light() {
  wants_light_exposure_ = true;
  expose_if_current();
}

void ViewState::expose_if_current() {
  if (!is_current()) return;
  if (std::exchange(wants_picture_exposure_, false)) {
    look(false);
    (done_.probe ? probe_exposure_ : tone_.exposure) = exposure_to_white(radiance());
    is_picture_old_ = true;
  }
  if (std::exchange(wants_light_exposure_, false)) set_light_exposure(exposure_to_white(shown_light_));
}

const std::vector<float>& ViewState::error_map(Shown shown) const {
  if (shown == Shown::predicted_error) return field_.predicted_error;
  return shown == Shown::photograph_noise ? field_.photograph_noise : field_.training_error;
}

bool ViewState::has(Shown shown) const {
  return shown == Shown::picture || shown == Shown::false_colour || (!view_ && !error_map(shown).empty());
}

void ViewState::show(Shown shown) {
  if (!has(shown))
    throw InputError("the field contains no map of this error; fields written by 'refield estimate' do");
  shown_ = shown;
  is_picture_old_ = true;
  error_range_ = 0.0;
  if (shown == Shown::picture || shown == Shown::false_colour) return;
  std::vector<float> known;
  std::ranges::copy_if(error_map(shown), std::back_inserter(known), [](float v) { return std::isfinite(v); });
  const double high = known.empty() ? 0.0 : quantile(std::move(known), 0.98);
  error_range_ = high > 0.0 ? high : 1.0;
}

void ViewState::pick(std::optional<PixelPosition> pixel) {
  if (pixel &&
      (pixel->x < 0 || pixel->y < 0 || pixel->x >= radiance().width || pixel->y >= radiance().height))
    pixel.reset();
  std::optional<std::uint32_t> vertex;
  if (pixel && view_) {
    vertex = view_->seen().vertex_at(pixel->x, pixel->y);
    if (!vertex) pixel.reset();
  }
  if (pixel == picked_ && vertex == picked_vertex_) return;
  picked_ = pixel;
  picked_vertex_ = vertex;
  are_kernels_old_ = true;
}

/// The number of the picked pixel among the field's.
std::size_t ViewState::picked_output() const {
  if (!picked_vertex_) return static_cast<std::size_t>(picked_->y) * field_.width + picked_->x;
  return pixel_of_output(*picked_vertex_ * (field_.mesh_outputs() / field_.mesh.positions.size()));
}

/// Where the picked vertex is seen now.
void ViewState::place_mark() {
  if (!picked_vertex_) return;
  const auto place = view_->camera().image_point(field_.mesh.positions[*picked_vertex_]);
  picked_.reset();
  if (place && Eigen::AlignedBox2f(Eigen::Vector2f::Zero(), Eigen::Vector2f(seen_.width, seen_.height))
                   .contains(*place))
    picked_ = PixelPosition{std::min(static_cast<int>(place->x()), seen_.width - 1),
                            std::min(static_cast<int>(place->y()), seen_.height - 1)};
}

void ViewState::probe(std::optional<Box> part) {
  if (part && !part->inside(setup_.domain().width, setup_.domain().height)) part.reset();
  if (part == probed_) return;
  const bool begins = part && !probed_;
  probed_ = part;
  if (begins) expose_picture();
}

const Image& ViewState::relight_probe(const Box& probe) {
  const auto fill = [this](const Box& box, float radiance) {
    for (int y = box.y0; y < box.y1; ++y)
      std::ranges::fill(probe_light_.radiance.row(y).subspan(static_cast<std::size_t>(box.x0) * 3,
                                                             static_cast<std::size_t>(box.width()) * 3),
                        radiance);
  };
  if (lit_) fill(*lit_, 0.0f);
  fill(probe, 1.0f);
  const Image& outputs =
      lit_ ? relighter_.update(probe_light_, *united(*lit_, probe)) : relighter_.relight(probe_light_);
  lit_ = probe;
  return outputs;
}

bool ViewState::is_summed(const LightSetup& light) const {
  return summed_ && light.has_environment() && light.environment()->has_path_sums();
}

/// Returns how long relighting took, in milliseconds.
double ViewState::sum_environment(const LightSetup& light) {
  SummedEnvironment& summed = *summed_;
  const bool is_same = summed.of && summed.of->environment() == light.environment();
  if (is_same && summed.of->turns() == light.turns()) return 0.0;
  if (!is_same) {
    summed.of.reset();
    summed.straight = summed.shown.project(*light.environment(), {}, run_).light;
  }
  const std::vector<float> sums = summed.boxes.project(*light.environment(), light.turn(), run_);
  run_.throw_if_stopped();  // else they may be incomplete
  double relight_ms = 0.0;
  run_uncancelled([&] {
    summed.panorama = rotated(summed.straight, light.turns()).radiance;
    const auto start = std::chrono::steady_clock::now();
    summed.outputs = summed.relighter.relight(sums);
    relight_ms = milliseconds_since(start);
  });
  summed.of = light;
  return relight_ms;
}

/// In the job. What can be cancelled is projecting alone, which takes long and leaves all as it was.
ViewState::JobTimes ViewState::relight(const Request& request) {
  JobTimes times;
  const auto start = std::chrono::steady_clock::now();
  const bool is_summed_one = is_summed(request.light);
  LightSetup painted = request.light;
  if (is_summed_one) {
    painted.set_map(std::nullopt);
    times.relight_ms = sum_environment(request.light);
  } else {
    painter_.turn_map(painted, run_);
  }
  run_uncancelled([&] {
    // Beside a summed environment nothing else may shine; then there is nothing to paint.
    const bool is_dark = is_summed_one && painted.ambient() == 0.0 && painted.light_sources().empty();
    std::optional<Box> changed;
    if (!is_dark) changed = painter_.paint(painted, run_);
    changed_ = united(changed_, changed);
    times.light_ms = milliseconds_since(start) - times.relight_ms;
    const auto begun = std::chrono::steady_clock::now();
    if (request.probe) {
      relit_ = &relight_probe(*request.probe);
    } else if (is_dark) {
      relit_ = nullptr;
    } else if (lit_ || !relit_) {
      std::ranges::fill(probe_light_.radiance.values, 0.0f);  // for the next probe
      lit_.reset();
      relit_ = &relighter_.relight(painter_.light());
    } else if (changed) {
      relit_ = &relighter_.update(painter_.light(), *changed);
    }
    adds_summed_ = is_summed_one && !request.probe;
    is_dark_ = is_dark;
    times.relight_ms += milliseconds_since(begun);
  });
  return times;
}

void ViewState::start_job() {
  running_ = wanted();
  job_ = std::make_unique<BackgroundJob<JobTimes>>([this, request = running_] { return relight(request); });
}

/// Of a job that has ended.
void ViewState::take_result(Refreshed& done) {
  const auto job = std::exchange(job_, nullptr);
  done_ = running_;  // also where it failed: it would fail again
  const JobTimes times = job->take();
  share_ = painter_.share();
  if (relit_)
    outputs_ = *relit_;
  else
    outputs_ = Image(field_.width, field_.height, 3);
  if (adds_summed_) {
    share_ = {};
    add(done_.light.map_gain(), summed_->outputs, outputs_);
  }
  show_light(std::exchange(changed_, std::nullopt));
  ++relit_count_;
  done.light_ms += times.light_ms;
  done.relight_ms += times.relight_ms;
}

void ViewState::show_light(const std::optional<Box>& changed) {
  const Image& light = painter_.light().radiance;
  const bool is_summed_one = is_summed(done_.light);
  if (!changed && !is_summed_one && !was_summed_) return;
  is_light_old_ = true;
  was_summed_ = is_summed_one;
  if (panorama_.is_cube()) {
    if (is_dark_)
      shown_light_ = Image(panorama_.shown().width, panorama_.shown().height, 3);
    else
      shown_light_ = panorama_.show(light);
    if (is_summed_one) add(done_.light.map_gain(), summed_->panorama, shown_light_);
    return;
  }
  if (!shown_light_.same_shape(light)) {
    shown_light_ = light;
    return;
  }
  const auto first = static_cast<std::size_t>(changed->x0) * 3,
             count = static_cast<std::size_t>(changed->width()) * 3;
  for (int y = changed->y0; y < changed->y1; ++y)
    std::ranges::copy(light.row(y).subspan(first, count), shown_light_.row(y).subspan(first).begin());
}

LightMap ViewState::light() const {
  LightMap light = painter_.light();
  if (is_dark_) std::ranges::fill(light.radiance.values, 0.0f);
  const LightSetup& setup = done_.light;
  if (is_summed(setup))
    add(setup.map_gain(), setup.projector()->project(*setup.environment(), setup.turn(), run_).light.radiance,
        light.radiance);
  return light;
}

/// Makes the camera's picture anew where the light or the camera is another. Whether there is a new picture.
bool ViewState::look(bool relit) {
  if (!view_) return relit;
  const bool moved = view_->update();
  if (!moved && !relit) return false;
  seen_ = view_->seen().show(outputs_);
  if (moved) place_mark();
  return true;
}

ViewState::Refreshed ViewState::refresh(std::optional<std::chrono::milliseconds> patience) {
  Refreshed done;
  auto start = std::chrono::steady_clock::now();
  bool relit = false;
  while (!is_current()) {
    if (!job_) start_job();
    const std::chrono::duration<double, std::milli> waited(milliseconds_since(start));
    if (!patience)
      job_->wait();
    else if (!job_->wait_for(std::chrono::duration_cast<std::chrono::microseconds>(*patience - waited)))
      break;
    take_result(done);
    relit = true;
  }
  done.wait_ms = milliseconds_since(start);
  start = std::chrono::steady_clock::now();
  if (look(relit)) {
    if (view_) done.view_ms = milliseconds_since(start);
    is_picture_old_ |= shown_ == Shown::picture || shown_ == Shown::false_colour;
  }
  expose_if_current();
  done.picture = std::exchange(is_picture_old_, false);
  done.light = std::exchange(is_light_old_, false);
  done.kernels = std::exchange(are_kernels_old_, false);
  start = std::chrono::steady_clock::now();
  if (done.picture) draw_picture();
  if (done.light) {
    tone_map_rgba(shown_light(), light_tone_.table({light_exposure_, ToneOperator::clip}), light_picture_);
  }
  if (done.picture || done.light) done.tone_ms = milliseconds_since(start);
  if (done.kernels) draw_kernels();
  return done;
}

void ViewState::draw_picture() {
  picture_.resize(std::size_t{4} * radiance().pixel_count());
  if (shown_ == Shown::picture)
    return tone_map_rgba(radiance(), picture_tone_.table(tone_in_use()), picture_);
  if (shown_ == Shown::false_colour) {
    const double white = -std::log2(tone_in_use().exposure);
    return false_colour_rgba(radiance(), stop_levels(white - stops_below_white, white + stops_above_white),
                             picture_);
  }
  Image map(field_.width, field_.height, 1);
  map.values = error_map(shown_);
  false_colour_rgba(map, linear_levels(error_range_), picture_);
}

void ViewState::draw_kernels() {
  kernels_.clear();
  std::ranges::fill(kernel_picture_, std::uint8_t{0});
  if (!picked_ && !picked_vertex_) return;
  kernels_ = kernels_of_pixel(relighter_.transfer(), field_.basis, picked_output());
  Image density = kernel_density(field_.basis, kernels_);
  if (panorama_.is_cube()) density = panorama_.show(density);
  const double high = *std::ranges::max_element(density.values);
  if (!(high > 0.0)) return;
  // Densities of a mirror's reflection and of the dim rest lie far apart.
  constexpr double stops = 9.0;
  false_colour_rgba(density, stop_levels(std::log2(high) - stops, std::log2(high)), kernel_picture_);
}

}  // namespace refield
