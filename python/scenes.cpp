// SPDX-License-Identifier: Apache-2.0
// Sessions, simulation, precomputed transport, HDR photographs, environments and error measures.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "acquire/import/bracket_response.h"
#include "cli/dynamic/prepared_scene.h"
#include "core/base/files.h"
#include "core/base/json_text.h"
#include "core/field/drift.h"
#include "estimate/rig/rig_model.h"
#include "python/binding.h"
#include "python/field.h"
#include "refield/estimate.h"
#include "refield/hdr.h"
#include "refield/precompute.h"
#include "relight/held_out.h"
#include "simulate/tabletop/simulate.h"

namespace refield::python {

namespace {

namespace fs = std::filesystem;

// ---- Session

CaptureSession pairs_of(const std::vector<fs::path>& lights, const std::vector<fs::path>& observed,
                        const std::string& parameterisation) {
  if (lights.size() != observed.size())
    throw InputError(std::to_string(lights.size()) + " light maps and " + std::to_string(observed.size()) +
                     " photographs do not belong together; give one light map for each photograph");
  if (lights.empty()) throw InputError("light and observed are empty; give the files of a capture");
  CaptureSession session;
  session.light.parameterisation = parameterisation_from_name(parameterisation);
  for (std::size_t j = 0; j < lights.size(); ++j)
    session.frames.push_back(
        {lights[j].stem().string(), FrameRole::train, "", lights[j], observed[j], static_cast<double>(j)});
  check_image_sizes(session);
  return session;
}

const CaptureFrame& frame_of(const CaptureSession& session, std::size_t i) {
  if (i >= session.frames.size()) throw py::index_error();
  return session.frames[i];
}

py::array light_of_frame(const CaptureSession& session, std::size_t i) {
  const CaptureFrame& frame = frame_of(session, i);
  return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
    return read_illumination(frame, session.light.parameterisation, run).radiance;
  }));
}

py::tuple observed_of_frame(const CaptureSession& session, std::size_t i) {
  const CaptureFrame& frame = frame_of(session, i);
  Photograph photograph =
      LongCall(py::none(), std::nullopt)([&](const RunContext&) { return read_observed(frame); });
  py::object sigma = py::none();
  if (!photograph.sigma.empty()) sigma = array_of(std::move(photograph.sigma));
  return py::make_tuple(array_of(std::move(photograph.radiance)), sigma);
}

py::object mask_of_session(const CaptureSession& session) {
  if (!session.mask) return py::none();
  const Mask mask = read_mask(*session.mask, session.width, session.height);
  py::array_t<bool> array({session.height, session.width});
  std::ranges::transform(mask, array.mutable_data(), [](unsigned char value) { return value != 0; });
  return array;
}

Field estimate_session(const CaptureSession& session, const std::optional<fs::path>& mask,
                       const std::vector<std::string>& monitors, const EstimateOptions& options,
                       py::object progress, std::optional<int> threads) {
  CaptureSession changed = session;
  if (mask) changed.mask = mask;
  if (!monitors.empty()) changed.monitors = placements_from_texts(monitors);
  return LongCall(std::move(progress), threads)(
      [&](const RunContext& run) { return Field(estimate_field(changed, options, run)); });
}

// ---- errors

py::dict errors_as_dict(const std::string& kind, std::size_t images, std::optional<std::size_t> trained_on,
                        double rmse, double median, double percentile_90, double psnr,
                        const std::vector<HeldOutImage>& per_image) {
  py::list list;
  for (const HeldOutImage& image : per_image)
    list.append(py::make_tuple(image.name, image.error.relative_rmse, image.error.tone_mapped_psnr_db));
  py::dict result;
  result["kind"] = kind;
  result["images"] = images;
  result["trained_on"] = trained_on;
  result["relative_rmse"] = rmse;
  result["median"] = median;
  result["percentile_90"] = percentile_90;
  result["tone_mapped_psnr_db"] = psnr;
  result["per_image"] = list;
  return result;
}

py::list compare_field(const Field& field, const CaptureSession& given, const Field* truth,
                       py::object progress) {
  CaptureSession session = given;
  const auto rows = field.rows();
  if (std::ranges::none_of(session.frames, [](const auto& f) { return f.role == FrameRole::test; }))
    mark_held_out(session, *rows);
  const auto errors = LongCall(std::move(progress), std::nullopt)([&](const RunContext& run) {
    if (!truth) remove_drift(session, run);
    correct_held_out(rows->provenance, session);
    return held_out_errors(*rows, session, truth ? truth->rows().get() : nullptr, FrameRole::test, 1.0, run);
  });
  if (const std::string warning = training_warning(errors); !warning.empty()) log_note(warning);
  py::list result;
  for (const HeldOutError& error : errors)
    result.append(errors_as_dict(error.kind, error.images, error.trained_on, error.relative_rmse,
                                 error.median, error.percentile_90, error.tone_mapped_psnr_db,
                                 error.per_image));
  return result;
}

py::dict compare_arrays(
    const Floats& predicted, const Floats& observed, const std::optional<Floats>& sigma,
    const std::optional<py::array_t<bool, py::array::c_style | py::array::forcecast>>& mask) {
  const auto images = views_of(predicted, "predicted"), references = views_of(observed, "observed"),
             noise = sigma ? views_of(*sigma, "sigma") : std::vector<ImageView>{};
  require_own_threads();
  if (images.empty() || images.size() != references.size() || (sigma && noise.size() != images.size()))
    throw InputError(std::to_string(images.size()) + " predicted and " + std::to_string(references.size()) +
                     " observed images do not belong together; give as many of both");
  Mask counted;
  if (mask) counted.assign(mask->data(), mask->data() + mask->size());
  SeriesError series(counted);
  std::vector<HeldOutImage> per_image;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const Image a = image_of(images[i]), b = image_of(references[i]),
                s = sigma ? image_of(noise[i]) : Image();
    series.add(a, b, s);
    for (std::size_t k = 0; k < b.values.size(); ++k)
      if ((!std::isfinite(a.values[k]) || !std::isfinite(b.values[k])) &&
          (s.empty() || !std::isinf(s.values[k])) && (counted.empty() || counted[k / 3] != 0))
        throw InputError(std::string(std::isfinite(b.values[k]) ? "predicted" : "observed") + "[" +
                         std::to_string(i) +
                         "]: has a sample that is not finite; exclude it by the mask, or mark " +
                         "it as unmeasured (sigma = inf)");
    per_image.push_back({std::to_string(i), {}, image_error(a, b, counted, s)});
  }
  return errors_as_dict("", series.images(), 0, series.relative_rmse(), series.pixel_quantile(0.5),
                        series.pixel_quantile(0.9), tone_mapped_psnr_db(per_image), per_image);
}

// ---- simulation

CaptureSession simulate(const fs::path& recipe_path, const fs::path& folder,
                        const std::map<std::string, int>& sizes, int quality, double noise,
                        bool keep_transport, py::object progress, std::optional<int> threads) {
  Recipe recipe = read_recipe(recipe_path);
  const auto replace = [&](const char* name, auto& value, int low, int high) {
    const auto given = sizes.find(name);
    if (given == sizes.end()) return;
    if (given->second < low || given->second > high)
      throw InputError(std::string(name) + " is " + std::to_string(given->second) + "; give a number from " +
                       std::to_string(low) + " to " + std::to_string(high));
    value = given->second;
  };
  replace("width", recipe.scene.camera.width, 1, 16384);
  replace("height", recipe.scene.camera.height, 1, 16384);
  replace("light_width", recipe.scene.monitor.texels.width, 8, 8192);
  replace("light_height", recipe.scene.monitor.texels.height, 8, 8192);
  replace("train", recipe.lights.train, 1, 9999);
  replace("natural", recipe.lights.natural, 0, 9999);
  replace("bars", recipe.lights.bars, 0, 999);
  replace("squares", recipe.lights.squares, 0, 999);
  replace("seed", recipe.seed, 0, 0x7fffffff);
  if (fs::exists(folder) && !(fs::is_directory(folder) && fs::is_empty(folder)))
    throw InputError(folder.string() + ": is not an empty folder; give another one");
  SimulateOptions options;
  options.quality = quality;
  options.noise = noise;
  options.keep_transport = keep_transport;
  options.provenance = json_text(nlohmann::json{{"program", "refield " REFIELD_VERSION},
                                                {"method", "ray traced transport"},
                                                {"recipe", recipe_path.filename().string()},
                                                {"seed", recipe.seed},
                                                {"quality", quality},
                                                {"noise", noise}});
  options.check();
  return LongCall(std::move(progress), threads)([&](const RunContext& run) {
    const ThreadLimit limit(run);
    create_folders(folder);
    simulate_session(recipe, options, folder, run);
    return read_capture_session(folder);
  });
}

// ---- precomputed transport

Field precompute(const fs::path& path, const std::string& method,
                 const std::map<std::string, double>& settings, py::object progress,
                 std::optional<int> threads) {
  if (method != "clusters" && method != "sh")
    throw InputError("method is '" + method + "'; give 'clusters' or 'sh'");
  prt::ClusterOptions clusters;
  prt::HarmonicOptions harmonics;
  const auto take = [&](const char* name, auto& value) {
    if (const auto given = settings.find(name); given != settings.end())
      value = static_cast<std::decay_t<decltype(value)>>(given->second);
  };
  take("resolution", clusters.resolution);
  take("epsilon", clusters.epsilon);
  take("diffuse_bounces", clusters.bounces);
  take("pixel_samples", clusters.pixel_samples);
  if (settings.contains("image")) clusters.relighting = prt::Relighting::image;
  take("sh_order", harmonics.order);
  take("directions", harmonics.directions);
  take("radius", harmonics.radius);
  harmonics.check();
  return LongCall(std::move(progress), threads)([&](const RunContext& run) {
    const ThreadLimit limit(run);
    const bool glossy = method == "sh" || clusters.relighting == prt::Relighting::image;
    prt::Scene scene = prt::read_scene(path, run, glossy ? prt::Gloss::lobes : prt::Gloss::diffuse);
    prt::sort_vertices(scene);
    nlohmann::ordered_json provenance{
        {"program", "refield " REFIELD_VERSION}, {"scene", path.filename().string()}, {"method", method}};
    FieldRows rows;
    if (method == "clusters") {
      prt::ClusterStatistics statistics;
      rows = prt::cluster_transfer(scene, clusters, statistics, run);
      provenance.update(nlohmann::ordered_json::parse(rows.outline.provenance));
    } else {
      prt::HarmonicStatistics statistics;
      rows = prt::harmonic_field(scene, prt::harmonic_transfer(scene, harmonics, statistics, run),
                                 harmonics.map_resolution);
      provenance.update({{"order", harmonics.order},
                         {"window", "none"},
                         {"directions", harmonics.directions},
                         {"radius", harmonics.radius},
                         {"pass_energy", statistics.pass_energy}});
    }
    rows.outline.provenance = json_text(provenance);
    if (rows.outline.mesh) rows.outline.mesh->camera = scene.camera;
    return Field(pack_rows(std::move(rows), 8, run));
  });
}

// ---- HDR photographs

py::tuple arrays_of(Photograph&& merged) {
  py::array sigma = array_of(std::move(merged.sigma));
  return py::make_tuple(array_of(std::move(merged.radiance)), sigma);
}

py::tuple merge_files(const std::vector<fs::path>& paths, const std::vector<double>& seconds,
                      const std::string& response, double full_scale_electrons, double read_noise_electrons) {
  BracketCamera camera;
  camera.response = response;
  camera.full_scale_electrons = full_scale_electrons;
  camera.read_noise_electrons = read_noise_electrons;
  const std::vector<Seconds> exposures(seconds.begin(), seconds.end());
  return arrays_of(LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
    Bracket bracket = read_bracket(paths, camera, exposures);
    const std::vector<BracketSamples> samples = {samples_of(bracket)};
    for (const std::string& note : settle_response(samples, camera)) run.note(note);
    return merge_bracket(bracket, camera);
  }));
}

py::tuple merge_arrays(const Floats& images, const std::vector<double>& seconds, double full_scale_electrons,
                       double read_noise_electrons) {
  std::vector<Image> copies;
  for (const ImageView& view : views_of(images, "images")) copies.push_back(image_of(view));
  if (copies.empty() || copies.size() != seconds.size())
    throw InputError(std::to_string(copies.size()) + " images and " + std::to_string(seconds.size()) +
                     " exposure times do not belong together; give one exposure time per image");
  for (const double exposure : seconds)
    if (!(exposure > 0.0)) throw InputError("exposures: " + std::to_string(exposure) + " is not above 0");
  const std::vector<Seconds> exposures(seconds.begin(), seconds.end());
  LinearSensor sensor;
  sensor.saturation = 1.0;
  sensor.electrons_per_value = full_scale_electrons;
  sensor.read_noise_electrons = read_noise_electrons;
  return arrays_of(LongCall(py::none(), std::nullopt)([&](const RunContext&) {
    return merge_linear_exposures(copies, exposures, sensor, with_unmeasured_saturation);
  }));
}

// ---- environments

py::array project(const Floats& map, const LightDomain& target, const std::vector<std::string>& monitors,
                  const std::array<double, 3>& turn) {
  const ImageView view = view_of(map, "map");
  const auto kind = environment_kind(view.width, view.height);
  if (!kind)
    throw InputError(
        "the map is " + std::to_string(view.width) + "×" + std::to_string(view.height) +
        ", which is not an environment map: give a lat-long map (twice as wide as high) or a cube "
        "map (six square faces stacked vertically, +X −X +Y −Y +Z −Z)");
  const auto placements = placements_from_texts(monitors);
  LightMap environment{image_of(view), *kind};
  return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext& run) {
    repair_light_map(environment, "map", run);
    return EnvironmentProjector(target, placements, run)
        .project(environment, {turn[0], turn[1], turn[2]}, run)
        .light.radiance;
  }));
}

// ---- moving scenes

class MovingPictures {
 public:
  MovingPictures(const fs::path& path, const std::string& mode, py::object progress,
                 std::optional<int> threads) {
    if (mode != "refined" && mode != "paper")
      throw InputError("mode is '" + mode + "'; give 'refined' or 'paper'");
    dynamic::TransportOptions transport;
    if (mode == "paper") {
      transport = dynamic::as_in_the_paper(transport);
      frame_.direct = dynamic::DirectLightBy::field_products;
      frame_.exact_direct = false;
    }
    LongCall(std::move(progress), threads)([&](const RunContext& run) {
      const ThreadLimit limit(run);
      scene_ = std::make_unique<cli::PreparedScene>(dynamic::read_dynamic_scene(path, run), transport, run);
    });
  }

  double duration() const { return scene_->scene().duration(); }

  py::array frame(double time, int bounces) {
    dynamic::FrameOptions options = frame_;
    options.bounces = bounces;
    options.check();
    if (!(time >= 0.0)) throw InputError("time is " + std::to_string(time) + "; give 0 or more seconds");
    return array_of(LongCall(py::none(), std::nullopt)([&](const RunContext&) {
      const std::scoped_lock lock(mutex_);
      scene_->solve(time, cli::camera_of(scene_->scene()), options);
      return scene_->picture(0, scene_->light().bounces());
    }));
  }

 private:
  std::mutex mutex_;
  dynamic::FrameOptions frame_;
  std::unique_ptr<cli::PreparedScene> scene_;
};

}  // namespace

void bind_scenes(py::module_& module) {
  py::class_<CaptureSession>(module, "Session")
      .def_static("read",
                  [](const fs::path& folder) {
                    CaptureSession session = read_capture_session(folder);
                    return session;
                  })
      .def_static("pairs", &pairs_of)
      .def_static(
          "globs",
          [](const std::string& light, const std::string& observed, const std::string& parameterisation) {
            CaptureSession session =
                pair_by_globs(light, observed, parameterisation_from_name(parameterisation));
            check_image_sizes(session);
            return session;
          })
      .def("hold_out",
           [](const CaptureSession& session, int every) {
             CaptureSession changed = session;
             hold_out_every(changed, every);
             return changed;
           })
      .def("__len__", [](const CaptureSession& session) { return session.frames.size(); })
      .def("frame",
           [](const CaptureSession& session, std::size_t i) {
             const CaptureFrame& frame = frame_of(session, i);
             return py::make_tuple(frame.name, std::string(name_of(frame.role)), frame.kind,
                                   frame.illumination, frame.observed);
           })
      .def("light", &light_of_frame)
      .def("observed", &observed_of_frame)
      .def_property_readonly("mask", &mask_of_session)
      .def_property_readonly(
          "colour_space",
          [](const CaptureSession& session) { return std::string(name_of(session.colour_space())); })
      .def_property_readonly("folder", [](const CaptureSession& session) { return session.folder; })
      .def_property_readonly(
          "shape",
          [](const CaptureSession& session) { return py::make_tuple(session.height, session.width, 3); })
      .def_property_readonly("light_shape",
                             [](const CaptureSession& session) {
                               return py::make_tuple(session.light.height, session.light.width, 3);
                             })
      .def_property_readonly("parameterisation", [](const CaptureSession& session) {
        return std::string(name_of(session.light.parameterisation));
      });
  py::class_<MovingPictures>(module, "MovingPictures")
      .def(py::init<const fs::path&, const std::string&, py::object, std::optional<int>>())
      .def("frame", &MovingPictures::frame)
      .def_property_readonly("duration", &MovingPictures::duration);
  module.def("estimate_session", &estimate_session);
  module.def("compare_field", &compare_field);
  module.def("compare_arrays", &compare_arrays);
  module.def("simulate", &simulate);
  module.def("precompute", &precompute);
  module.def("merge_files", &merge_files);
  module.def("merge_arrays", &merge_arrays);
  module.def("environment_of_field",
             [](const Floats& map, const Field& field, const std::vector<std::string>& monitors,
                const std::array<double, 3>& turn) {
               std::vector<std::string> places = monitors;
               if (places.empty())
                 for (const auto& place : field.outline().monitors) places.push_back(text_of(place));
               return project(map, field.outline().basis.domain, places, turn);
             });
  module.def("environment", [](const Floats& map, int height, int width, const std::string& parameterisation,
                               const std::vector<std::string>& monitors, const std::array<double, 3>& turn) {
    constexpr std::int64_t max_texels = std::int64_t{1} << 27;  // cube maps with faces of 4096×4096
    if (height < 1 || width < 1 || std::int64_t{height} * width > max_texels)
      throw InputError("shape is " + std::to_string(height) + "×" + std::to_string(width) +
                       "; give at least one row and one column, and at most " + std::to_string(max_texels) +
                       " texels");
    return project(map, {width, height, parameterisation_from_name(parameterisation)}, monitors, turn);
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
      throw InputError(path.string() + ": the image is written as OpenEXR; give a name that ends in .exr");
    write_exr(path, image_of(view_of(image, "image")));
  });
}

}  // namespace refield::python
