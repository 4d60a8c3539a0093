// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/view_state.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "core/auto_exposure.h"
#include "core/errors.h"
#include "core/false_colour.h"

namespace refield {

namespace {

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

/// Weights of 16 bits are exact to the last level of a screen, those of 8 to three levels in the dark; but
/// beside a field of more entries they would take more memory than half of its file.
constexpr std::uint64_t most_fine_entries = 8'000'000;

void require_content(const ReflectanceField& field) {
  if (field.width < 1 || field.height < 1 || field.basis.domain.width < 1 || field.basis.domain.height < 1)
    throw InputError("the field is empty; there is nothing to show");
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
      field.transfer.entries() <= most_fine_entries ? RelightPrecision::fine : RelightPrecision::fast;
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

ViewState::ViewState(Loaded loaded)
    : field_(std::move(loaded.field)),
      relighter_(std::move(loaded.relighter)),
      painter_(field_.basis.domain),
      probe_light_{Image(painter_.domain().width, painter_.domain().height, 3),
                   painter_.domain().parameterisation},
      picture_(std::size_t{4} * field_.width * field_.height),
      light_picture_(probe_light_.radiance.pixel_count() * 4),
      kernel_picture_(light_picture_.size()) {
  reset_lamps();
  radiance_ = &relighter_.relight(painter_.light());
  painter_.take_changed();
  expose_picture();
}

void ViewState::reset_lamps() {
  painter_.remove_all();
  painter_.set_ambient(0.03);
  painter_.add({Lamp::Shape::spot, 0.3, 0.35, 0.2, {1.0f, 0.72f, 0.42f}, 1.0, true});
  painter_.add({Lamp::Shape::spot, 0.75, 0.6, 0.14, {0.3f, 0.55f, 1.0f}, 1.0, true});
  is_light_old_ = true;
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
  relight();
  const double exposure = exposure_to_white(*radiance_);
  if (probed_)
    probe_exposure_ = exposure;
  else
    tone_.exposure = exposure;
  is_picture_old_ = true;
}

void ViewState::expose_light() {
  set_light_exposure(exposure_to_white(painter_.light().radiance));
}

const std::vector<float>& ViewState::error_map(Shown shown) const {
  if (shown == Shown::predicted_error) return field_.predicted_error;
  return shown == Shown::photograph_noise ? field_.photograph_noise : field_.training_error;
}

bool ViewState::has(Shown shown) const {
  return shown == Shown::picture || shown == Shown::false_colour || !error_map(shown).empty();
}

void ViewState::show(Shown shown) {
  if (!has(shown))
    throw InputError("the field holds no map of that error; fields that 'refield estimate' made do");
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
  if (pixel && (pixel->x < 0 || pixel->y < 0 || pixel->x >= field_.width || pixel->y >= field_.height))
    pixel.reset();
  if (pixel == picked_) return;
  picked_ = pixel;
  are_kernels_old_ = true;
}

void ViewState::probe(std::optional<Box> part) {
  if (part && !part->inside(painter_.domain().width, painter_.domain().height)) part.reset();
  if (part == probed_) return;
  const bool begins = part && !probed_;
  if (part.has_value() != probed_.has_value()) is_picture_old_ = true;
  probed_ = part;
  if (begins) expose_picture();
}

void ViewState::relight_probe() {
  const auto fill = [this](const Box& box, float radiance) {
    for (int y = box.y0; y < box.y1; ++y)
      std::ranges::fill(probe_light_.radiance.row(y).subspan(static_cast<std::size_t>(box.x0) * 3,
                                                             static_cast<std::size_t>(box.width()) * 3),
                        radiance);
  };
  if (lit_) fill(*lit_, 0.0f);
  fill(*probed_, 1.0f);
  radiance_ =
      lit_ ? &relighter_.update(probe_light_, *united(lit_, probed_)) : &relighter_.relight(probe_light_);
  lit_ = probed_;
}

/// Whether the image changed.
bool ViewState::relight() {
  const auto changed = painter_.take_changed();
  if (changed) is_light_old_ = true;
  if (probed_) {
    if (probed_ == lit_) return false;
    relight_probe();
    return true;
  }
  if (lit_) {
    // Emptied for the next probe.
    std::ranges::fill(probe_light_.radiance.values, 0.0f);
    lit_.reset();
    radiance_ = &relighter_.relight(painter_.light());
    return true;
  }
  if (changed) radiance_ = &relighter_.update(painter_.light(), *changed);
  return changed.has_value();
}

ViewState::Refreshed ViewState::refresh() {
  Refreshed done;
  if (radiance_ == nullptr) return done;
  auto start = std::chrono::steady_clock::now();
  if (relight()) {
    done.relight_ms = milliseconds_since(start);
    is_picture_old_ |= shown_ == Shown::picture || shown_ == Shown::false_colour;
  }
  done.picture = std::exchange(is_picture_old_, false);
  done.light = std::exchange(is_light_old_, false);
  done.kernels = std::exchange(are_kernels_old_, false);
  start = std::chrono::steady_clock::now();
  if (done.picture) draw_picture();
  if (done.light)
    tone_map_rgba(painter_.light().radiance, light_tone_.table({light_exposure_, ToneOperator::clip}),
                  light_picture_);
  if (done.picture || done.light) done.tone_ms = milliseconds_since(start);
  if (done.kernels) draw_kernels();
  return done;
}

void ViewState::draw_picture() {
  if (shown_ == Shown::picture)
    return tone_map_rgba(*radiance_, picture_tone_.table(tone_in_use()), picture_);
  if (shown_ == Shown::false_colour) {
    const double white = -std::log2(tone_in_use().exposure);
    return false_colour_rgba(*radiance_, stop_levels(white - stops_below_white, white + stops_above_white),
                             picture_);
  }
  Image map(field_.width, field_.height, 1);
  map.values = error_map(shown_);
  false_colour_rgba(map, linear_levels(error_range_), picture_);
}

void ViewState::draw_kernels() {
  kernels_.clear();
  std::ranges::fill(kernel_picture_, std::uint8_t{0});
  if (!picked_) return;
  const std::size_t pixel = static_cast<std::size_t>(picked_->y) * field_.width + picked_->x;
  kernels_ = kernels_of_pixel(relighter_.transfer(), field_.basis, pixel);
  const Image density = kernel_density(field_.basis, kernels_);
  const double high = *std::ranges::max_element(density.values);
  if (!(high > 0.0)) return;
  // Densities of a mirror's reflection and of the dim rest lie far apart.
  constexpr double stops = 9.0;
  false_colour_rgba(density, stop_levels(std::log2(high) - stops, std::log2(high)), kernel_picture_);
}

}  // namespace refield
