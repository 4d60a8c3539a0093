// SPDX-License-Identifier: Apache-2.0
#include "refield/field.h"

#include "core/base/output_lock.h"
#include "core/field/field_statistics.h"
#include "core/field/light_error.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "library/data.h"
#include "relight/field_pictures.h"
#include "relight/pack/pack.h"

namespace refield {

namespace {

/// From this radiance on, the sum of a pixel may exceed the range of 32-bit floats.
constexpr float bright_light = 1e20f;

/// Whether a texel is so bright, that pictures may not be finite.
bool is_bright(const ImageView& light) {
  for (int y = 0; y < light.height; ++y)
    for (int x = 0; x < light.width; ++x)
      for (int c = 0; c < light.channels; ++c)
        if (std::abs(light.at(x, y, c)) > bright_light) return true;
  return false;
}

std::shared_ptr<const Field::Data> read(const fs::path& file, const RunContext& run) {
  auto either = read_either_field(file, run);
  if (auto* packed = std::get_if<PackedField>(&either))
    return std::make_shared<const Field::Data>(std::move(*packed), file.string());
  return std::make_shared<const Field::Data>(std::get<ReflectanceField>(std::move(either)), file.string());
}

std::size_t pixel_of(const FieldOutline& outline, int x, int y) {
  if (outline.mesh) throw InputError("the field is of a mesh and has no pixels");
  if (x < 0 || y < 0 || x >= outline.width || y >= outline.height)
    throw InputError("pixel (", x, ", ", y, ") is outside the ", outline.width, "×", outline.height,
                     " image");
  return static_cast<std::size_t>(y) * outline.width + x;
}

Image quality_map(const FieldOutline& outline, const std::vector<float>& values) {
  if (values.empty()) return {};
  Image map(outline.width, outline.height, 1);
  map.values = values;
  return map;
}

/// As quality_map(), of what is predicted: NaN where the field predicts nothing.
Image predicted_map(const FieldOutline& outline, const std::vector<float>& values) {
  Image map = quality_map(outline, values);
  const std::vector<float>& predicted = outline.quality.predicted_error;
  for (std::size_t p = 0; p < map.values.size(); ++p)
    if (predicted[p] == 0.0f) map.values[p] = std::numeric_limits<float>::quiet_NaN();
  return map;
}

}  // namespace

// ---- Data

std::shared_ptr<const ReflectanceField> Field::Data::rows() const {
  const std::scoped_lock lock(mutex_);
  if (!rows_) rows_ = std::make_shared<const ReflectanceField>(expand(PackedField(*packed_)));
  return rows_;
}

TileRelighter Field::Data::relighter(RelightPrecision precision) const {
  if (packed_) return TileRelighter(PackedField(*packed_));
  return TileRelighter(*rows_, precision);
}

std::shared_ptr<const TileRelighter> Field::Data::laid_out() const {
  const std::scoped_lock lock(mutex_);
  if (!laid_out_) laid_out_ = std::make_shared<const TileRelighter>(relighter(RelightPrecision::fine));
  return laid_out_;
}

void Field::Data::relight(std::span<const LightMapView> lights, std::span<float> pictures,
                          const RunContext& run) const {
  const LightDomain& domain = outline().basis.domain;
  std::optional<MeshRenderer> view;
  if (outline().mesh) view.emplace(outline(), standard_camera(outline()));
  const std::size_t values = lights.empty() ? 0 : pictures.size() / lights.size();
  const bool is_small = domain.width <= small_box_limit && domain.height <= small_box_limit;
  const bool lays_out = is_small && lights.size() >= min_pictures_for_layout;
  std::optional<TileRelighter> relighter;
  std::shared_ptr<const ReflectanceField> plain;
  if (lays_out)
    relighter.emplace(*laid_out());
  else
    plain = rows();
  Progress progress(run, "relight", lights.size());
  LightShares shares;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    run.throw_if_stopped();
    const std::span<float> picture = pictures.subspan(i * values, values);
    const std::string light_name = lights.size() > 1 ? "light[" + std::to_string(i) + "]" : "light";
    const LightMap light = copied(lights[i]);
    require_finite(light.radiance, light_name, true, "replace it");
    if (lays_out && !view) {
      relighter->relight_into(lights[i], picture);
    } else {
      const Image outputs = lays_out ? relighter->relight(light) : Image();
      if (view)
        std::ranges::copy(view->show(lays_out ? outputs : plain->relight(light)).values, picture.begin());
      else
        plain->apply(plain->basis.project(light), picture);
    }
    if (is_bright(lights[i].radiance) &&
        !std::ranges::all_of(picture, [](float v) { return std::isfinite(v); }))
      throw InputError(light_name, ": is too bright for pictures of 32-bit floats; scale it down");
    if (!outline().observed_light.empty()) {
      const LightShares of_light = outline().light_shares(light.radiance);
      shares.interpolated = std::max(shares.interpolated, of_light.interpolated);
      shares.unobserved = std::max(shares.unobserved, of_light.unobserved);
    }
    progress.advance();
  }
  if (const std::string warning = unobserved_light_warning(shares); !warning.empty()) run.note(warning);
}

// ---- Field

Field::Field(const fs::path& file, const RunContext& run)
    : data_(guarded(run, [&] { return read(file, run); })) {}

void Field::write(const fs::path& file) const {
  const OutputLock lock(file, {}, ".rfield");
  if (data_->packed())
    write_packed_field(file, *data_->packed());
  else
    write_reflectance_field(file, *data_->rows());
}

int Field::width() const {
  const FieldOutline& outline = data_->outline();
  return outline.mesh ? standard_camera(outline).width : outline.width;
}

int Field::height() const {
  const FieldOutline& outline = data_->outline();
  return outline.mesh ? standard_camera(outline).height : outline.height;
}

LightDomain Field::light_domain() const {
  return data_->outline().basis.domain;
}

std::vector<MonitorPlacement> Field::monitors() const {
  return data_->outline().monitors;
}

ColourSpace Field::colour_space() const {
  return data_->outline().colour_space;
}

bool Field::has_mesh() const {
  return data_->outline().mesh.has_value();
}

int Field::bits() const {
  return data_->packed() ? data_->packed()->bits() : 32;
}

const std::string& Field::provenance() const {
  return data_->outline().provenance;
}

Image Field::relight(const LightMapView& light, const RunContext& run) const {
  Image picture(width(), height(), 3);
  relight({&light, 1}, picture.values, run);
  return picture;
}

void Field::relight(std::span<const LightMapView> lights, std::span<float> pictures,
                    const RunContext& run) const {
  for (const LightMapView& light : lights) require_domain(light, light_domain());
  const std::size_t values = std::size_t{3} * width() * height() * lights.size();
  if (pictures.size() != values)
    throw InputError("there is room for ", pictures.size(), " values of pictures, which have ", values);
  guarded(run, [&] { data_->relight(lights, pictures, run); });
}

std::vector<std::uint8_t> Field::thumbnail() const {
  const LightDomain domain = light_domain();
  const LightMap white{Image(domain.width, domain.height, 3, 1.0f), domain.parameterisation};
  Image image = relight(white);
  constexpr int max_side = 640;
  const int side = std::max(image.width, image.height);
  return guarded({}, [&] {
    if (side > max_side)
      image = resample_area(image, std::max(1, image.width * max_side / side),
                            std::max(1, image.height * max_side / side));
    return encode_png(image, {exposure_to_white(image)});
  });
}

Image Field::transport(int x, int y) const {
  const std::size_t pixel = pixel_of(data_->outline(), x, y);
  const auto rows = data_->rows();
  const LightBasis& basis = rows->basis;
  Image response(basis.domain.width, basis.domain.height, 3);
  const SparseTransfer& transfer = rows->transfer;
  for (std::uint64_t e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e) {
    const Box box = basis.support(transfer.column[e]);
    for (int v = box.y0; v < box.y1; ++v)
      for (int u = box.x0; u < box.x1; ++u) {
        const float value = basis.value(transfer.column[e], u, v);
        for (int c = 0; c < 3; ++c) response.at(u, v, c) += transfer.weight[3 * e + c] * value;
      }
  }
  return response;
}

std::vector<PixelKernel> Field::kernels(int x, int y) const {
  return kernels_of_pixel(*data_->rows(), pixel_of(data_->outline(), x, y));
}

Image Field::training_error() const {
  return quality_map(data_->outline(), data_->outline().quality.training_error);
}

Image Field::predicted_error() const {
  return predicted_map(data_->outline(), data_->outline().quality.predicted_error);
}

Image Field::photograph_noise() const {
  return predicted_map(data_->outline(), data_->outline().quality.photograph_noise);
}

Image Field::predicted_error(const LightMapView& light) const {
  const FieldOutline& outline = data_->outline();
  const LightMap map = copied(light);
  require_domain(map, outline.basis.domain);
  if (outline.quality.predicted_error.empty()) return {};
  const Image relit = relight(light);
  return predicted_map(outline,
                       guarded({}, [&] { return predicted_error_under(outline, map.radiance, relit); }));
}

Field v0_2::pack(const Field& field, double max_error, const RunContext& run) {
  if (field.internal().packed())
    throw InputError("the field is already packed, and the errors would accumulate; give the full field");
  return guarded(run,
                 [&] { return public_field(pack_field(*field.internal().rows(), max_error, run).field); });
}

}  // namespace refield
