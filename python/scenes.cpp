// SPDX-License-Identifier: Apache-2.0
// Sessions, simulation, precomputed transport, HDR photographs, environments and error measures.
#include <algorithm>
#include <map>

#include "binding.h"
#include "refield/compare.h"
#include "refield/estimate.h"
#include "refield/hdr.h"
#include "refield/relight.h"
#include "refield/simulate.h"

namespace refield::python {

namespace {

namespace fs = std::filesystem;

py::tuple arrays_of(Photograph&& photograph) {
  py::object sigma = map_or_none(std::move(photograph.sigma));
  return py::make_tuple(array_of(std::move(photograph.radiance)), sigma);
}

// ---- sessions

void require_frame(const Session& session, std::size_t i) {
  if (i >= session.size()) throw py::index_error();
}

py::object mask_of_session(const Session& session) {
  const Mask mask = session.mask();
  if (mask.empty()) return py::none();
  py::array_t<bool> array({session.height(), session.width()});
  std::ranges::transform(mask, array.mutable_data(), [](unsigned char value) { return value != 0; });
  return array;
}

Field estimate_session(const Session& session, const std::optional<fs::path>& mask,
                       const std::vector<std::string>& monitors, const EstimateOptions& options,
                       py::object progress, std::optional<int> threads) {
  Session changed = session;
  if (mask) changed.set_mask(*mask);
  if (!monitors.empty()) changed.set_monitors(placements_from_texts(monitors));
  return LongCall(std::move(progress),
                  threads)([&](const RunContext& run) { return estimate(changed, options, run); });
}

// ---- errors

py::dict as_dict(const HeldOutError& error) {
  py::list list;
  for (const HeldOutImage& image : error.per_image)
    list.append(py::make_tuple(image.name, image.error.relative_rmse, image.error.tone_mapped_psnr_db));
  py::dict result;
  result["kind"] = error.kind;
  result["images"] = error.images;
  result["trained_on"] = error.trained_on;
  result["relative_rmse"] = error.relative_rmse;
  result["median"] = error.median;
  result["percentile_90"] = error.percentile_90;
  result["tone_mapped_psnr_db"] = error.tone_mapped_psnr_db;
  result["per_image"] = list;
  return result;
}

py::list compare_field(const Field& field, const Session& session, const Field* truth, py::object progress) {
  const auto errors = LongCall(std::move(progress), std::nullopt)(
      [&](const RunContext& run) { return compare(field, session, truth, 1.0, run); });
  py::list result;
  for (const HeldOutError& error : errors) result.append(as_dict(error));
  return result;
}

py::dict compare_arrays(const Floats& predicted, const Floats& observed, const std::optional<Floats>& sigma,
                        const std::optional<Flags>& mask) {
  const auto images = views_of(predicted, "predicted"), references = views_of(observed, "observed"),
             noise = sigma ? views_of(*sigma, "sigma") : std::vector<ImageView>{};
  require_own_threads();
  return as_dict(compare(images, references, noise, mask_of(mask, references)));
}

// ---- computed captures and fields

/// Sets a value that was given under a name.
template <class Values, class Value>
void take(const Values& values, const char* name, std::optional<Value>& value) {
  if (const auto given = values.find(name); given != values.end()) value = static_cast<Value>(given->second);
}

Session simulate_session(const fs::path& recipe, const fs::path& folder,
                         const std::map<std::string, int>& sizes, int quality, double noise,
                         bool keep_transport, py::object progress, std::optional<int> threads) {
  SimulationOptions options;
  take(sizes, "width", options.width);
  take(sizes, "height", options.height);
  take(sizes, "light_width", options.light_width);
  take(sizes, "light_height", options.light_height);
  take(sizes, "train", options.train);
  take(sizes, "natural", options.natural);
  take(sizes, "bars", options.bars);
  take(sizes, "squares", options.squares);
  take(sizes, "seed", options.seed);
  options.quality = quality;
  options.noise = noise;
  options.keep_transport = keep_transport;
  return LongCall(std::move(progress),
                  threads)([&](const RunContext& run) { return simulate(recipe, folder, options, run); });
}

Field precompute_field(const fs::path& path, const std::string& method,
                       const std::map<std::string, double>& settings, py::object progress,
                       std::optional<int> threads) {
  if (method != "clusters" && method != "sh")
    throw InputError("method is '", method, "'; give 'clusters' or 'sh'");
  PrecomputeOptions options;
  if (method == "sh") options.method = PrecomputeOptions::Method::harmonics;
  take(settings, "resolution", options.resolution);
  take(settings, "epsilon", options.epsilon);
  take(settings, "diffuse_bounces", options.diffuse_bounces);
  take(settings, "pixel_samples", options.pixel_samples);
  options.image = settings.contains("image");
  take(settings, "sh_order", options.order);
  take(settings, "directions", options.directions);
  take(settings, "radius", options.radius);
  return LongCall(std::move(progress),
                  threads)([&](const RunContext& run) { return precompute(path, options, run); });
}

/// One picture at a time.
class Moving {
 public:
  Moving(const fs::path& path, const std::string& mode, py::object progress, std::optional<int> threads)
      : pictures_(made(path, mode, std::move(progress), threads)) {}

  double duration() const { return pictures_.duration(); }

  py::array frame(double time, int bounces) {
    return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext&) {
      const std::scoped_lock lock(mutex_);
      return pictures_.picture(time, bounces);
    }));
  }

 private:
  static MovingPictures made(const fs::path& path, const std::string& mode, py::object progress,
                             std::optional<int> threads) {
    if (mode != "refined" && mode != "paper")
      throw InputError("mode is '", mode, "'; give 'refined' or 'paper'");
    return LongCall(std::move(progress), threads)(
        [&](const RunContext& run) { return MovingPictures(path, mode == "paper", run); });
  }

  std::mutex mutex_;
  MovingPictures pictures_;
};

// ---- HDR photographs

py::tuple merge_files(const std::vector<fs::path>& paths, const std::vector<double>& seconds,
                      const std::string& response, double full_scale_electrons, double read_noise_electrons) {
  const ExposureCamera camera{response, full_scale_electrons, read_noise_electrons};
  return arrays_of(LongCall(py::none(), std::nullopt)(
      [&](const RunContext& run) { return merge_exposures(paths, seconds, camera, run); }));
}

py::tuple merge_arrays(const Floats& images, const std::vector<double>& seconds, double full_scale_electrons,
                       double read_noise_electrons) {
  const std::vector<ImageView> views = views_of(images, "images");
  const ExposureCamera camera{"", full_scale_electrons, read_noise_electrons};
  return arrays_of(LongCall(py::none(), std::nullopt)(
      [&](const RunContext& run) { return merge_exposures(views, seconds, camera, run); }));
}

// ---- environments

py::array project(const Floats& map, const LightDomain& target, const std::vector<MonitorPlacement>& monitors,
                  const std::array<double, 3>& turn) {
  const ImageView view = view_of(map, "map");
  return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
    return Environment(view, run).project(target, monitors, {turn[0], turn[1], turn[2]}, run).radiance;
  }));
}

void bind_session(py::module_& module) {
  py::class_<Session>(module, "Session")
      .def_static("read", [](const fs::path& folder) { return Session(folder); })
      .def_static("pairs",
                  [](const std::vector<fs::path>& light, const std::vector<fs::path>& observed,
                     const std::string& parameterisation) {
                    return Session(light, observed, parameterisation_from_name(parameterisation));
                  })
      .def_static(
          "globs",
          [](const std::string& light, const std::string& observed, const std::string& parameterisation) {
            return Session(light, observed, parameterisation_from_name(parameterisation));
          })
      .def("hold_out",
           [](const Session& session, int every) {
             Session changed = session;
             changed.hold_out(every);
             return changed;
           })
      .def("__len__", &Session::size)
      .def("frame",
           [](const Session& session, std::size_t i) {
             require_frame(session, i);
             const SessionFrame frame = session.frame(i);
             // Names of files may not be UTF-8, which paths survive.
             return py::make_tuple(py::str(py::cast(fs::path(frame.name))), std::string(name_of(frame.role)),
                                   frame.kind, frame.light, frame.observed);
           })
      .def("light",
           [](const Session& session, std::size_t i) {
             require_frame(session, i);
             return array_of(LongCall(py::none(), std::nullopt)(
                 [&](const RunContext& run) { return session.light(i, run).radiance; }));
           })
      .def("observed",
           [](const Session& session, std::size_t i) {
             require_frame(session, i);
             return arrays_of(
                 LongCall(py::none(), std::nullopt)([&](const RunContext&) { return session.observed(i); }));
           })
      .def_property_readonly("mask", &mask_of_session)
      .def_property_readonly(
          "colour_space", [](const Session& session) { return std::string(name_of(session.colour_space())); })
      .def_property_readonly("folder", &Session::folder)
      .def_property_readonly(
          "shape",
          [](const Session& session) { return py::make_tuple(session.height(), session.width(), 3); })
      .def_property_readonly("light_shape",
                             [](const Session& session) {
                               const LightDomain domain = session.light_domain();
                               return py::make_tuple(domain.height, domain.width, 3);
                             })
      .def_property_readonly("parameterisation", [](const Session& session) {
        return std::string(name_of(session.light_domain().parameterisation));
      });
}

}  // namespace

void bind_scenes(py::module_& module) {
  bind_session(module);
  py::class_<Moving>(module, "MovingPictures")
      .def(py::init<const fs::path&, const std::string&, py::object, std::optional<int>>())
      .def("frame", &Moving::frame)
      .def_property_readonly("duration", &Moving::duration);
  module.def("estimate_session", &estimate_session);
  module.def("compare_field", &compare_field);
  module.def("compare_arrays", &compare_arrays);
  module.def("simulate", &simulate_session);
  module.def("precompute", &precompute_field);
  module.def("merge_files", &merge_files);
  module.def("merge_arrays", &merge_arrays);
  module.def("environment_of_field",
             [](const Floats& map, const Field& field, const std::vector<std::string>& monitors,
                const std::array<double, 3>& turn) {
               return project(map, field.light_domain(),
                              monitors.empty() ? field.monitors() : placements_from_texts(monitors), turn);
             });
  module.def("environment", [](const Floats& map, int height, int width, const std::string& parameterisation,
                               const std::vector<std::string>& monitors, const std::array<double, 3>& turn) {
    return project(map, {width, height, parameterisation_from_name(parameterisation)},
                   placements_from_texts(monitors), turn);
  });
  module.def("read_image", [](const fs::path& path) {
    return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext&) { return read_image(path); }));
  });
  module.def("read_light_map", [](const fs::path& path, const std::string& parameterisation) {
    return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
      return read_light_map(path, parameterisation_from_name(parameterisation), run).radiance;
    }));
  });
  module.def("write_exr", [](const fs::path& path, const Floats& image) {
    require_own_threads();
    if (path.extension() != ".exr")
      throw InputError(path, ": the image is written as OpenEXR; give a name that ends in .exr");
    write_exr(path, Image(view_of(image, "image")));
  });
}

}  // namespace refield::python
