// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/field/view_state.h"

#include <Eigen/Geometry>

#include "core/field/light_error.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

const std::vector<float>& error_map_of(const FieldOutline& field, Shown shown) {
  if (shown == Shown::predicted_error) return field.quality.predicted_error;
  return shown == Shown::photograph_noise ? field.quality.photograph_noise : field.quality.training_error;
}

bool is_relit_image(Shown shown) {
  return shown == Shown::picture || shown == Shown::false_colour;
}

}  // namespace

bool FieldPicture::has(Shown shown) const {
  return is_relit_image(shown) || (!field_->mesh && !error_map_of(*field_, shown).empty());
}

void FieldPicture::show(Shown shown) {
  if (!has(shown))
    throw InputError("the field contains no map of this error; fields written by 'refield estimate' do");
  shown_ = shown;
  is_old_ = true;
  error_range_ = 0.0;
  if (is_relit_image(shown)) return;
  set_range(error_map_of(*field_, shown));
}

void FieldPicture::replace(const FieldOutline& field) {
  field_ = &field;
  show(shown_);
}

void FieldPicture::set_range(std::vector<float> errors) {
  std::erase_if(errors, [](float v) { return !std::isfinite(v); });
  const double high = errors.empty() ? 0.0 : quantile(std::move(errors), 0.98);
  error_range_ = high > 0.0 ? high : 1.0;
}

bool FieldPicture::depends_on_light() const {
  return is_relit_image(shown_) || (shown_ == Shown::predicted_error && knows_light_error(*field_));
}

void FieldPicture::set_tone(const ToneMapping& tone) {
  if (tone == tone_) return;
  tone_ = tone;
  is_old_ = true;
}

void FieldPicture::set_relit() {
  is_old_ |= depends_on_light();
}

bool FieldPicture::draw(const Image& radiance, double exposure, const Image* light) {
  if (!std::exchange(is_old_, false)) return false;
  levels_.resize(std::size_t{4} * radiance.pixel_count());
  if (shown_ == Shown::picture) {
    tone_map_rgba(radiance, tone_table_.table({exposure, tone_.curve}), levels_);
  } else if (shown_ == Shown::false_colour) {
    const double white = -std::log2(exposure);
    false_colour_rgba(radiance, stop_levels(white - stops_below_white, white + stops_above_white), levels_);
  } else {
    Image map(field_->width, field_->height, 1);
    map.values = error_map_of(*field_, shown_);
    if (light != nullptr && depends_on_light()) {
      map.values = predicted_error_under(*field_, *light, radiance);
      set_range(map.values);
    }
    false_colour_rgba(map, linear_levels(error_range_), levels_);
  }
  return true;
}

KernelPicture::KernelPicture(const LightPanorama& panorama)
    : panorama_(panorama), levels_(std::size_t{4} * panorama.shown().width * panorama.shown().height) {}

void KernelPicture::pick(std::optional<PixelPosition> pixel, const PixelGrid& shown, const FreeView* view) {
  if (pixel) pixel = shown.position_of(*pixel);
  if (pixel) pixel = {shown.x_of(pixel->x), shown.y_of(pixel->y)};
  std::optional<std::uint32_t> vertex;
  if (pixel && view != nullptr) {
    vertex = view->seen().vertex_at(pixel->x, pixel->y);
    if (!vertex) pixel.reset();
  }
  if (pixel == picked_ && vertex == picked_vertex_) return;
  picked_ = pixel;
  picked_vertex_ = vertex;
  is_old_ = true;
}

void KernelPicture::follow(const PinholeCamera& camera, const OutputMesh& mesh) {
  if (!picked_vertex_) return;
  const auto place = camera.image_point(mesh.positions[*picked_vertex_]);
  picked_.reset();
  if (place && Eigen::AlignedBox2f(Eigen::Vector2f::Zero(), Eigen::Vector2f(camera.width, camera.height))
                   .contains(*place))
    picked_ = PixelPosition{std::min(static_cast<int>(place->x()), camera.width - 1),
                            std::min(static_cast<int>(place->y()), camera.height - 1)};
}

/// The number of the picked pixel among these, or of the picked vertex.
std::optional<std::size_t> KernelPicture::picked_output(const FieldPixels& pixels) const {
  if (picked_vertex_) {
    const OutputMesh& mesh = *pixels.field.mesh;
    return pixel_of_output(*picked_vertex_ * (mesh.outputs() / mesh.positions.size()));
  }
  const auto at = picked_ ? pixels.grid.position_of(*picked_) : std::nullopt;
  if (!at) return std::nullopt;
  return static_cast<std::size_t>(at->y) * pixels.field.width + at->x;
}

bool KernelPicture::draw(const FieldPixels& pixels) {
  if (!std::exchange(is_old_, false)) return false;
  kernels_.clear();
  std::ranges::fill(levels_, std::uint8_t{0});
  const auto output = picked_output(pixels);
  if (!output) return true;
  const LightBasis& basis = pixels.field.basis;
  kernels_ = kernels_of_pixel(pixels.relighter.transfer(), basis, *output);
  Image density = kernel_density(basis, kernels_);
  if (panorama_.is_cube()) density = panorama_.show(density);
  const double high = *std::ranges::max_element(density.values);
  if (!(high > 0.0)) return true;
  // Densities of a mirror's reflection and of the dim rest lie far apart.
  constexpr double stops = 9.0;
  false_colour_rgba(density, stop_levels(std::log2(high) - stops, std::log2(high)), levels_);
  return true;
}

}  // namespace refield
