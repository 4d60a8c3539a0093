// SPDX-License-Identifier: Apache-2.0
// Estimation, fields and relighting.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <span>
#include <utility>

#include "core/base/output_lock.h"
#include "core/field/field_statistics.h"
#include "core/field/light_error.h"
#include "python/binding.h"
#include "python/field.h"
#include "refield/estimate.h"
#include "refield/relight.h"
#include "relight/field_pictures.h"

namespace refield::python {

namespace {

/// From as many pictures on, laying the field out for speed takes less time than it saves.
constexpr std::size_t min_pictures_for_layout = 12;

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

LightMap light_of(const ImageView& view, const LightDomain& domain) {
  return {image_of(view), domain.parameterisation};
}

RelightPrecision precision_from_name(const std::string& name) {
  if (name == "fast") return RelightPrecision::fast;
  if (name == "fine") return RelightPrecision::fine;
  throw InputError("precision is '" + name + "'; give 'fast' or 'fine'");
}

}  // namespace

// ---- Field

Field::Field(ReflectanceField&& rows) : rows_(std::make_shared<const ReflectanceField>(std::move(rows))) {}
Field::Field(PackedField&& packed) : packed_(std::make_shared<const PackedField>(std::move(packed))) {}

const FieldOutline& Field::outline() const {
  return packed_ ? packed_->outline : *rows_;
}

std::shared_ptr<const ReflectanceField> Field::rows() const {
  require_own_threads();
  const std::scoped_lock lock(mutex_);
  if (!rows_) rows_ = std::make_shared<const ReflectanceField>(expand(PackedField(*packed_)));
  return rows_;
}

Relighter Field::relighter(RelightPrecision precision) const {
  if (packed_) return Relighter(PackedField(*packed_));
  return Relighter(*rows_, precision);
}

std::shared_ptr<const Relighter> Field::laid_out() const {
  const std::scoped_lock lock(mutex_);
  if (!laid_out_) laid_out_ = std::make_shared<const Relighter>(relighter(RelightPrecision::fine));
  return laid_out_;
}

std::vector<py::ssize_t> Field::shape() const {
  if (outline().mesh) {
    const PinholeCamera camera = standard_camera(outline());
    return {camera.height, camera.width, 3};
  }
  return {outline().height, outline().width, 3};
}

void Field::relight(std::span<const ImageView> lights, float* out, const RunContext& run) const {
  const LightDomain& domain = outline().basis.domain;
  const std::vector<py::ssize_t> size = shape();
  const auto values = static_cast<std::size_t>(size[0] * size[1] * size[2]);
  const bool is_small = domain.width <= small_box_limit && domain.height <= small_box_limit;
  const bool lays_out = is_small && lights.size() >= min_pictures_for_layout;
  std::optional<Relighter> relighter;
  std::shared_ptr<const ReflectanceField> plain;
  if (lays_out)
    relighter.emplace(*laid_out());
  else
    plain = rows();
  std::optional<MeshView> view;
  if (outline().mesh) view.emplace(outline(), standard_camera(outline()));
  Progress progress(run, "relight", lights.size());
  LightShares shares;
  for (std::size_t i = 0; i < lights.size(); ++i) {
    run.throw_if_stopped();
    const std::span<float> picture(out + i * values, values);
    const std::string name = lights.size() > 1 ? "light[" + std::to_string(i) + "]" : "light";
    const LightMap light = light_of(lights[i], domain);
    require_finite(light.radiance, name, true, "replace it");
    if (lays_out && !view) {
      relighter->relight_into({lights[i], domain.parameterisation}, picture);
    } else {
      const Image outputs = lays_out ? relighter->relight(light) : Image();
      if (view)
        std::ranges::copy(view->show(lays_out ? outputs : plain->relight(light)).values, picture.begin());
      else
        plain->apply(plain->basis.project(light), picture);
    }
    if (is_bright(lights[i]) && !std::ranges::all_of(picture, [](float v) { return std::isfinite(v); }))
      throw InputError(name + ": is too bright for pictures of 32-bit floats; scale it down");
    if (!outline().observed_light.empty()) {
      const LightShares of_light = outline().light_shares(light.radiance);
      shares.interpolated = std::max(shares.interpolated, of_light.interpolated);
      shares.unobserved = std::max(shares.unobserved, of_light.unobserved);
    }
    progress.advance();
  }
  if (const std::string warning = unobserved_light_warning(shares); !warning.empty()) {
    const py::gil_scoped_acquire with_lock;
    log_note(warning);
  }
}

namespace {

// ---- of a field, for Python

py::array relight(const Field& field, const Floats& light, const std::optional<py::array>& out,
                  py::object progress, std::optional<int> threads) {
  const bool is_batch = light.ndim() == 4;
  const std::vector<ImageView> lights =
      is_batch ? views_of(light, "light") : std::vector<ImageView>{view_of(light, "light")};
  const LightDomain& domain = field.outline().basis.domain;
  for (const ImageView& view : lights)
    if (view.width != domain.width || view.height != domain.height) {
      LightMap given{{}, domain.parameterisation};
      given.radiance.width = view.width;
      given.radiance.height = view.height;
      require_domain(given, domain);
    }
  std::vector<py::ssize_t> shape = field.shape();
  if (is_batch) shape.insert(shape.begin(), static_cast<py::ssize_t>(lights.size()));
  py::array result = out ? *out : py::array_t<float>(shape);
  float* target = target_of(result, shape);
  if (lights.size() == 1 && progress.is_none()) {
    RunContext run;
    run.max_threads = threads.value_or(0);
    const ThreadLimit limit(run);
    unlocked([&] { field.relight(lights, target, run); });
  } else {
    LongCall(std::move(progress), threads)([&](const RunContext& run) {
      const ThreadLimit limit(run);
      field.relight(lights, target, run);
    });
  }
  return result;
}

std::size_t pixel_of(const Field& field, int x, int y) {
  const FieldOutline& outline = field.outline();
  if (outline.mesh) throw InputError("the field is of a mesh and has no pixels");
  if (x < 0 || y < 0 || x >= outline.width || y >= outline.height)
    throw InputError("pixel (" + std::to_string(x) + ", " + std::to_string(y) + ") is outside the " +
                     std::to_string(outline.width) + "×" + std::to_string(outline.height) + " image");
  return static_cast<std::size_t>(y) * outline.width + x;
}

py::array transport(const Field& field, int x, int y) {
  const std::size_t pixel = pixel_of(field, x, y);
  const auto rows = field.rows();
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
  return array_of(std::move(response));
}

py::array lit_by(const Field& field, int u, int v) {
  const LightDomain& domain = field.outline().basis.domain;
  if (u < 0 || v < 0 || u >= domain.width || v >= domain.height)
    throw InputError("texel (" + std::to_string(u) + ", " + std::to_string(v) + ") is outside the " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) + " light map");
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int c = 0; c < 3; ++c) light.radiance.at(u, v, c) = 1.0f;
  const std::vector<py::ssize_t> shape = field.shape();
  py::array_t<float> result(shape);
  float* target = result.mutable_data();
  const ImageView view(light.radiance);
  unlocked([&] { field.relight({&view, 1}, target, {}); });
  return result;
}

py::list kernels(const Field& field, int x, int y) {
  const std::size_t pixel = pixel_of(field, x, y);
  py::list result;
  for (const PixelKernel& kernel : kernels_of_pixel(*field.rows(), pixel)) {
    const Box& box = kernel.support;
    result.append(py::make_tuple(kernel.hat ? "hat" : "box", py::make_tuple(box.x0, box.y0, box.x1, box.y1),
                                 py::make_tuple(kernel.weight[0], kernel.weight[1], kernel.weight[2]),
                                 kernel.energy_share));
  }
  return result;
}

py::object quality_map(const Field& field, const std::vector<float>& values) {
  if (values.empty()) return py::none();
  return array_of(std::vector<float>(values), {field.outline().height, field.outline().width});
}

/// As quality_map(), of what is predicted: NaN where the field predicts nothing.
py::object predicted_map(const Field& field, std::vector<float> values) {
  const std::vector<float>& predicted = field.outline().quality.predicted_error;
  for (std::size_t p = 0; p < values.size(); ++p)
    if (predicted[p] == 0.0f) values[p] = std::numeric_limits<float>::quiet_NaN();
  return quality_map(field, values);
}

py::object predicted_error_of(const Field& field, const Floats& light) {
  const FieldOutline& outline = field.outline();
  const ImageView view = view_of(light, "light");
  const LightMap map{image_of(view), outline.basis.domain.parameterisation};
  require_domain(map, outline.basis.domain);
  if (outline.quality.predicted_error.empty()) return py::none();
  Image relit(outline.width, outline.height, 3);
  std::vector<float> error;
  unlocked([&] {
    field.relight({&view, 1}, relit.values.data(), {});
    error = predicted_error_under(outline, map.radiance, relit);
  });
  return predicted_map(field, std::move(error));
}

Field load(const std::filesystem::path& path) {
  return LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
    auto either = read_either_field(path, run);
    if (auto* packed = std::get_if<PackedField>(&either)) return Field(std::move(*packed));
    return Field(std::get<ReflectanceField>(std::move(either)));
  });
}

void save(const Field& field, const std::filesystem::path& path) {
  LongCall(py::none(), std::nullopt)([&](const RunContext&) {
    const OutputLock lock(path, {}, ".rfield");
    if (field.packed())
      write_packed_field(path, *field.packed());
    else
      write_reflectance_field(path, *field.rows());
  });
}

py::bytes png(const Field& field) {
  const LightDomain& domain = field.outline().basis.domain;
  const Image white(domain.width, domain.height, 3, 1.0f);
  const std::vector<py::ssize_t> shape = field.shape();
  Image image(static_cast<int>(shape[1]), static_cast<int>(shape[0]), 3);
  std::vector<std::uint8_t> file;
  unlocked([&] {
    const ImageView view(white);
    field.relight({&view, 1}, image.values.data(), {});
    constexpr int max_side = 640;
    const int side = std::max(image.width, image.height);
    if (side > max_side)
      image = resample_area(image, std::max(1, image.width * max_side / side),
                            std::max(1, image.height * max_side / side));
    file = encode_png(image, {exposure_to_white(image)});
  });
  return {reinterpret_cast<const char*>(file.data()), file.size()};
}

// ---- many frames

/// One Relighter; calls from several threads take turns.
class Frames {
 public:
  Frames(const Field& field, RelightPrecision precision)
      : relighter_(field.relighter(precision)),
        width_(field.outline().width),
        height_(field.outline().height) {
    if (field.outline().mesh)
      throw InputError("relighter() is for images; Field.relight() shows fields of meshes");
  }

  py::array relight(const Floats& light, const std::optional<py::array>& out) {
    return into(light, out, [&](const ImageView& view, std::span<float> target) {
      relighter_.relight_into({view, relighter_.domain().parameterisation}, target);
    });
  }

  py::array update(const Floats& light, const std::array<int, 4>& changed,
                   const std::optional<py::array>& out) {
    return into(light, out, [&](const ImageView& view, std::span<float> target) {
      const Box box{changed[0], changed[1], changed[2], changed[3]};
      const Image& image = relighter_.update(light_of(view, relighter_.domain()), box);
      std::ranges::copy(image.values, target.begin());
    });
  }

 private:
  template <class Show>
  py::array into(const Floats& light, const std::optional<py::array>& out, const Show& show) {
    const ImageView view = view_of(light, "light");
    const std::vector<py::ssize_t> shape{height_, width_, 3};
    py::array result = out ? *out : py::array_t<float>(shape);
    const std::span<float> target(target_of(result, shape), static_cast<std::size_t>(width_) * height_ * 3);
    unlocked([&] {
      const std::scoped_lock lock(mutex_);
      show(view, target);
    });
    return result;
  }

  std::mutex mutex_;
  Relighter relighter_;
  int width_, height_;
};

// ---- estimation

EstimateOptions options_of(const std::string& mode, int max_kernels, bool predict_errors, bool keep_outliers,
                           const std::string& rig, double memory_gib) {
  if (!(memory_gib > 0.0 && memory_gib < 1e6))
    throw InputError("memory is " + std::to_string(memory_gib) + "; give a number of GiB above 0");
  EstimateOptions options;
  options.mode = estimate_mode_from_name(mode);
  options.kernels = max_kernels;
  options.predict_errors = predict_errors;
  options.keep_outliers = keep_outliers;
  options.keep_rig = options.keep_drift = rig == "off";
  if (rig != "off" && rig != "auto")
    options.rig = std::make_shared<const RigModel>(rig_from_text(rig, "rig"));
  options.memory_bytes = static_cast<std::uint64_t>(memory_gib * 1024.0 * 1024.0 * 1024.0);
  options.check();
  return options;
}

Field estimate_arrays(const Floats& light, const Floats& observed, const std::optional<Floats>& sigma,
                      const std::optional<py::array_t<bool, py::array::c_style | py::array::forcecast>>& mask,
                      const std::string& parameterisation, const std::vector<std::string>& monitors,
                      const EstimateOptions& options, py::object progress, std::optional<int> threads) {
  const Parameterisation how = parameterisation_from_name(parameterisation);
  std::vector<LightMapView> lights;
  for (const ImageView& view : views_of(light, "light")) lights.emplace_back(view, how);
  const std::vector<ImageView> photographs = views_of(observed, "observed"),
                               noise = sigma ? views_of(*sigma, "sigma") : std::vector<ImageView>{};
  Mask counted;
  if (mask) {
    if (mask->ndim() != 2 || photographs.empty() || mask->shape(0) != photographs[0].height ||
        mask->shape(1) != photographs[0].width)
      throw InputError("mask: is not of the photographs' height×width");
    counted.assign(mask->data(), mask->data() + mask->size());
  }
  const auto placements = placements_from_texts(monitors);
  if (!lights.empty()) check_placements(placements, lights[0].domain(), "monitor");
  return LongCall(std::move(progress), threads)([&](const RunContext& run) {
    ReflectanceField field = estimate(lights, photographs, noise, counted, options, run);
    field.monitors = placements;
    return Field(std::move(field));
  });
}

}  // namespace

void bind_field(py::module_& module) {
  py::class_<EstimateOptions>(module, "EstimateOptions")
      .def(py::init(&options_of), py::arg("mode"), py::arg("max_kernels"), py::arg("predict_errors"),
           py::arg("keep_outliers"), py::arg("rig"), py::arg("memory"));
  py::class_<Field>(module, "Field")
      .def_static("load", &load)
      .def("save", &save)
      .def("relight", &relight)
      .def("transport", &transport)
      .def("lit_by", &lit_by)
      .def("kernels", &kernels)
      .def("png", &png)
      .def("pack",
           [](const Field& field, double error) {
             return LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
               if (field.packed())
                 throw InputError(
                     "the field is already packed, and the errors would accumulate; give the full field");
               return Field(pack_field(*field.rows(), error, run).field);
             });
           })
      .def_property_readonly("shape", &Field::shape)
      .def_property_readonly("light_shape",
                             [](const Field& field) {
                               const LightDomain& domain = field.outline().basis.domain;
                               return std::vector<py::ssize_t>{domain.height, domain.width, 3};
                             })
      .def_property_readonly("parameterisation",
                             [](const Field& field) {
                               return std::string(name_of(field.outline().basis.domain.parameterisation));
                             })
      .def_property_readonly("monitors",
                             [](const Field& field) {
                               std::vector<std::string> texts;
                               for (const auto& place : field.outline().monitors)
                                 texts.push_back(text_of(place));
                               return texts;
                             })
      .def_property_readonly(
          "colour_space",
          [](const Field& field) { return std::string(name_of(field.outline().colour_space)); })
      .def_property_readonly("provenance", [](const Field& field) { return field.outline().provenance; })
      .def_property_readonly("bits",
                             [](const Field& field) { return field.packed() ? field.packed()->bits() : 32; })
      .def_property_readonly(
          "predicted_error",
          [](const Field& f) { return predicted_map(f, f.outline().quality.predicted_error); })
      .def("predicted_error_under", &predicted_error_of)
      .def_property_readonly(
          "noise", [](const Field& f) { return predicted_map(f, f.outline().quality.photograph_noise); })
      .def_property_readonly("training_error", [](const Field& f) {
        return quality_map(f, f.outline().quality.training_error);
      });
  py::class_<Frames>(module, "Frames")
      .def(py::init([](const Field& field, const std::string& precision) {
        std::unique_ptr<Frames> frames;
        unlocked([&] { frames = std::make_unique<Frames>(field, precision_from_name(precision)); });
        return frames;
      }))
      .def("relight", &Frames::relight)
      .def("update", &Frames::update);
  module.def("estimate_arrays", &estimate_arrays);
}

}  // namespace refield::python
