// SPDX-License-Identifier: Apache-2.0
// Estimation, fields and relighting.

#include "binding.h"
#include "refield/estimate.h"
#include "refield/relight.h"

namespace refield::python {

namespace {

// ---- fields

std::vector<py::ssize_t> shape_of(const Field& field) {
  return {field.height(), field.width(), 3};
}

LightMapView light_of(const Field& field, const Floats& light) {
  return {view_of(light, "light"), field.light_domain().parameterisation};
}

/// In this thread, since starting another one would take longer than a picture.
void relight_one(const Field& field, const LightMapView& light, std::span<float> picture, int threads) {
  std::vector<std::string> notes;
  RunContext run;
  run.max_threads = threads;
  run.on_note = [&](const std::string& text) { notes.push_back(text); };
  unlocked([&] { field.relight({&light, 1}, picture, run); });
  for (const std::string& note : notes) log_note(note);
}

py::array relight(const Field& field, const Floats& light, const std::optional<py::array>& out,
                  py::object progress, std::optional<int> threads) {
  const bool is_batch = light.ndim() == 4;
  std::vector<LightMapView> lights;
  if (is_batch)
    for (const ImageView& view : views_of(light, "light"))
      lights.emplace_back(view, field.light_domain().parameterisation);
  else
    lights = {light_of(field, light)};
  std::vector<py::ssize_t> shape = shape_of(field);
  if (is_batch) shape.insert(shape.begin(), static_cast<py::ssize_t>(lights.size()));
  py::array result = out ? *out : py::array_t<float>(shape);
  const std::span<float> pictures(target_of(result, shape), static_cast<std::size_t>(result.size()));
  if (lights.size() == 1 && progress.is_none())
    relight_one(field, lights[0], pictures, threads.value_or(0));
  else
    LongCall(std::move(progress),
             threads)([&](const RunContext& run) { field.relight(lights, pictures, run); });
  return result;
}

py::array lit_by(const Field& field, int u, int v) {
  const LightDomain domain = field.light_domain();
  if (u < 0 || v < 0 || u >= domain.width || v >= domain.height)
    throw InputError("texel (", u, ", ", v, ") is outside the ", domain.width, "×", domain.height,
                     " light map");
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (int c = 0; c < 3; ++c) light.radiance.at(u, v, c) = 1.0f;
  Image picture(field.width(), field.height(), 3);
  relight_one(field, light, picture.values, 0);
  return array_of(std::move(picture));
}

py::list kernels(const Field& field, int x, int y) {
  py::list result;
  for (const PixelKernel& kernel : unlocked([&] { return field.kernels(x, y); })) {
    const Box& box = kernel.support;
    result.append(py::make_tuple(kernel.hat ? "hat" : "box", py::make_tuple(box.x0, box.y0, box.x1, box.y1),
                                 py::make_tuple(kernel.weight[0], kernel.weight[1], kernel.weight[2]),
                                 kernel.energy_share));
  }
  return result;
}

py::object predicted_error_under(const Field& field, const Floats& light) {
  const LightMapView view = light_of(field, light);
  return map_or_none(unlocked([&] { return field.predicted_error(view); }));
}

py::bytes png(const Field& field) {
  const std::vector<std::uint8_t> file = unlocked([&] { return field.thumbnail(); });
  return {reinterpret_cast<const char*>(file.data()), file.size()};
}

// ---- many frames

RelightPrecision precision_from_name(const std::string& name) {
  if (name == "fast") return RelightPrecision::fast;
  if (name == "fine") return RelightPrecision::fine;
  throw InputError("precision is '", name, "'; give 'fast' or 'fine'");
}

/// A field laid out for speed; from one thread at a time.
class Frames {
 public:
  Frames(const Field& field, RelightPrecision precision) : relighter_(field, precision) {}

  py::array relight(const Floats& light, const std::optional<py::array>& out) {
    return into(light, out,
                [&](const LightMapView& view, std::span<float> target) { relighter_.relight(view, target); });
  }

  py::array update(const Floats& light, const std::array<int, 4>& changed,
                   const std::optional<py::array>& out) {
    return into(light, out, [&](const LightMapView& view, std::span<float> target) {
      relighter_.update(view, {changed[0], changed[1], changed[2], changed[3]}, target);
    });
  }

 private:
  template <class Show>
  py::array into(const Floats& light, const std::optional<py::array>& out, const Show& show) {
    const LightMapView view(view_of(light, "light"), relighter_.light_domain().parameterisation);
    const std::vector<py::ssize_t> shape{relighter_.height(), relighter_.width(), 3};
    py::array result = out ? *out : py::array_t<float>(shape);
    const std::span<float> target(target_of(result, shape), static_cast<std::size_t>(result.size()));
    unlocked([&] {
      const std::scoped_lock lock(mutex_);
      show(view, target);
    });
    return result;
  }

  std::mutex mutex_;
  Relighter relighter_;
};

// ---- estimation

EstimateOptions options_of(const std::string& mode, int max_kernels, bool predict_errors, bool keep_outliers,
                           const std::string& rig, double memory_gib) {
  if (!(memory_gib > 0.0 && memory_gib < 1e6))
    throw InputError("memory is ", memory_gib, "; give a number of GiB above 0");
  EstimateOptions options;
  options.mode = estimate_mode_from_name(mode);
  options.kernels = max_kernels;
  options.predict_errors = predict_errors;
  options.keep_outliers = keep_outliers;
  options.keep_rig = options.keep_drift = rig == "off";
  if (rig != "off" && rig != "auto") options.rig = rig_model(rig, "rig");
  options.memory_bytes = static_cast<std::uint64_t>(memory_gib * 1024.0 * 1024.0 * 1024.0);
  options.check();
  return options;
}

Field estimate_arrays(const Floats& light, const Floats& observed, const std::optional<Floats>& sigma,
                      const std::optional<Flags>& mask, const std::string& parameterisation,
                      const std::vector<std::string>& monitors, const EstimateOptions& options,
                      py::object progress, std::optional<int> threads) {
  const Parameterisation how = parameterisation_from_name(parameterisation);
  std::vector<LightMapView> lights;
  for (const ImageView& view : views_of(light, "light")) lights.emplace_back(view, how);
  const std::vector<ImageView> photographs = views_of(observed, "observed"),
                               noise = sigma ? views_of(*sigma, "sigma") : std::vector<ImageView>{};
  const CaptureArrays capture{lights, photographs, noise, mask_of(mask, photographs),
                              placements_from_texts(monitors)};
  return LongCall(std::move(progress),
                  threads)([&](const RunContext& run) { return estimate(capture, options, run); });
}

}  // namespace

void bind_field(py::module_& module) {
  py::class_<EstimateOptions>(module, "EstimateOptions")
      .def(py::init(&options_of), py::arg("mode"), py::arg("max_kernels"), py::arg("predict_errors"),
           py::arg("keep_outliers"), py::arg("rig"), py::arg("memory"));
  py::class_<Field>(module, "Field")
      .def_static("load",
                  [](const std::filesystem::path& path) {
                    return LongCall(py::none(),
                                    std::nullopt)([&](const RunContext& run) { return Field(path, run); });
                  })
      .def("save",
           [](const Field& field, const std::filesystem::path& path) {
             LongCall(py::none(), std::nullopt)([&](const RunContext&) { field.write(path); });
           })
      .def("relight", &relight)
      .def("transport", [](const Field& field, int x,
                           int y) { return array_of(unlocked([&] { return field.transport(x, y); })); })
      .def("lit_by", &lit_by)
      .def("kernels", &kernels)
      .def("png", &png)
      .def("pack",
           [](const Field& field, double error) {
             return LongCall(py::none(),
                             std::nullopt)([&](const RunContext& run) { return pack(field, error, run); });
           })
      .def_property_readonly("shape", &shape_of)
      .def_property_readonly("light_shape",
                             [](const Field& field) {
                               const LightDomain domain = field.light_domain();
                               return std::vector<py::ssize_t>{domain.height, domain.width, 3};
                             })
      .def_property_readonly(
          "parameterisation",
          [](const Field& field) { return std::string(name_of(field.light_domain().parameterisation)); })
      .def_property_readonly("monitors",
                             [](const Field& field) {
                               std::vector<std::string> texts;
                               for (const auto& place : field.monitors()) texts.push_back(text_of(place));
                               return texts;
                             })
      .def_property_readonly("colour_space",
                             [](const Field& field) { return std::string(name_of(field.colour_space())); })
      .def_property_readonly("provenance", &Field::provenance)
      .def_property_readonly("bits", &Field::bits)
      .def_property_readonly("predicted_error",
                             [](const Field& field) { return map_or_none(field.predicted_error()); })
      .def("predicted_error_under", &predicted_error_under)
      .def_property_readonly("noise",
                             [](const Field& field) { return map_or_none(field.photograph_noise()); })
      .def_property_readonly("training_error",
                             [](const Field& field) { return map_or_none(field.training_error()); });
  py::class_<Frames>(module, "Frames")
      .def(py::init([](const Field& field, const std::string& precision) {
        return unlocked([&] { return std::make_unique<Frames>(field, precision_from_name(precision)); });
      }))
      .def("relight", &Frames::relight)
      .def("update", &Frames::update);
  module.def("estimate_arrays", &estimate_arrays);
}

}  // namespace refield::python
