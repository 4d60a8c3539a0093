// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/view_state.h"

#include <Eigen/Geometry>
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
      panorama_(painter_.domain()),
      light_picture_(std::size_t{4} * panorama_.shown().width * panorama_.shown().height),
      kernel_picture_(light_picture_.size()) {
  reset_lamps();
  outputs_ = &relighter_.relight(painter_.light());
  painter_.take_changed();
  if (!field_.mesh.empty()) view_ = std::make_unique<FreeView>(field_);
  look(true);
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
  look(relight());
  const double exposure = exposure_to_white(radiance());
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
  return shown == Shown::picture || shown == Shown::false_colour || (!view_ && !error_map(shown).empty());
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
  outputs_ =
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
    outputs_ = &relighter_.relight(painter_.light());
    return true;
  }
  if (changed) outputs_ = &relighter_.update(painter_.light(), *changed);
  return changed.has_value();
}

/// Makes the camera's picture anew where the light or the camera is another. Whether there is a new picture.
bool ViewState::look(bool relit) {
  if (!view_) return relit;
  const bool moved = view_->update();
  if (!moved && !relit) return false;
  seen_ = view_->seen().show(*outputs_);
  if (moved) place_mark();
  return true;
}

ViewState::Refreshed ViewState::refresh() {
  Refreshed done;
  if (outputs_ == nullptr) return done;
  auto start = std::chrono::steady_clock::now();
  const bool relit = relight();
  if (relit) done.relight_ms = milliseconds_since(start);
  start = std::chrono::steady_clock::now();
  if (look(relit)) {
    if (view_) done.view_ms = milliseconds_since(start);
    is_picture_old_ |= shown_ == Shown::picture || shown_ == Shown::false_colour;
  }
  done.picture = std::exchange(is_picture_old_, false);
  done.light = std::exchange(is_light_old_, false);
  done.kernels = std::exchange(are_kernels_old_, false);
  start = std::chrono::steady_clock::now();
  if (done.picture) draw_picture();
  if (done.light) {
    if (panorama_.is_cube()) shown_light_ = panorama_.show(painter_.light().radiance);
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
