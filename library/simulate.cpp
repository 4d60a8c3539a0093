// SPDX-License-Identifier: Apache-2.0
#include "refield/simulate.h"

#include "cli/dynamic/prepared_scene.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "library/data.h"
#include "relight/pack/pack.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/harmonic_transfer.h"
#include "simulate/prt/prt_scene.h"
#include "simulate/tabletop/simulate.h"

namespace refield {

// ---- sessions

Session v0_2::simulate(const fs::path& recipe_path, const fs::path& folder, const SimulationOptions& options,
                       const RunContext& run) {
  Recipe recipe = read_recipe(recipe_path);
  const auto replace = [&](const char* name, const std::optional<int>& given, auto& value, int low,
                           int high) {
    if (!given) return;
    if (*given < low || *given > high)
      throw InputError(name, " is ", *given, "; give a number from ", low, " to ", high);
    value = *given;
  };
  replace("width", options.width, recipe.scene.camera.width, 1, 16384);
  replace("height", options.height, recipe.scene.camera.height, 1, 16384);
  replace("light_width", options.light_width, recipe.scene.monitor.texels.width, 8, 8192);
  replace("light_height", options.light_height, recipe.scene.monitor.texels.height, 8, 8192);
  replace("train", options.train, recipe.lights.train, 1, 9999);
  replace("natural", options.natural, recipe.lights.natural, 0, 9999);
  replace("bars", options.bars, recipe.lights.bars, 0, 999);
  replace("squares", options.squares, recipe.lights.squares, 0, 999);
  replace("seed", options.seed, recipe.seed, 0, 0x7fffffff);
  if (fs::exists(folder) && !(fs::is_directory(folder) && fs::is_empty(folder)))
    throw InputError(folder, ": is not an empty folder; give another one");
  SimulateOptions tracing;
  tracing.quality = options.quality;
  tracing.noise = options.noise;
  tracing.keep_transport = options.keep_transport;
  tracing.provenance = json_text(Json{{"program", "refield " REFIELD_VERSION},
                                      {"method", "ray traced transport"},
                                      {"recipe", recipe_path.filename().string()},
                                      {"seed", recipe.seed},
                                      {"quality", options.quality},
                                      {"noise", options.noise}});
  tracing.check();
  guarded(run, [&] {
    create_folders(folder);
    simulate_session(recipe, tracing, folder, run);
  });
  return Session(folder);
}

// ---- precomputed transport

namespace {

template <class Given, class Value>
void take(const std::optional<Given>& given, Value& value) {
  if (given) value = *given;
}

FieldRows cluster_rows(const prt::Scene& scene, const PrecomputeOptions& given, const RunContext& run) {
  prt::ClusterOptions options;
  take(given.resolution, options.resolution);
  take(given.epsilon, options.epsilon);
  take(given.diffuse_bounces, options.bounces);
  take(given.pixel_samples, options.pixel_samples);
  if (given.image) options.relighting = prt::Relighting::image;
  prt::ClusterStatistics statistics;
  return prt::cluster_transfer(scene, options, statistics, run);
}

}  // namespace

Field v0_2::precompute(const fs::path& path, const PrecomputeOptions& options, const RunContext& run) {
  const bool is_harmonic = options.method == PrecomputeOptions::Method::harmonics;
  prt::HarmonicOptions harmonics;
  take(options.order, harmonics.order);
  take(options.directions, harmonics.directions);
  take(options.radius, harmonics.radius);
  harmonics.check();
  return guarded(run, [&] {
    const bool glossy = is_harmonic || options.image;
    prt::Scene scene = prt::read_scene(path, run, glossy ? prt::Gloss::lobes : prt::Gloss::diffuse);
    prt::sort_vertices(scene);
    Json provenance{{"program", "refield " REFIELD_VERSION},
                    {"scene", path.filename().string()},
                    {"method", is_harmonic ? "sh" : "clusters"}};
    FieldRows rows =
        is_harmonic ? prt::harmonic_field(scene, harmonics, run) : cluster_rows(scene, options, run);
    provenance.update(json_from_text(rows.outline.provenance));
    rows.outline.provenance = json_text(provenance);
    if (rows.outline.mesh) rows.outline.mesh->camera = scene.camera;
    return public_field(pack_rows(std::move(rows), 8, run));
  });
}

// ---- moving scenes

struct v0_2::MovingPictures::Data {
  cli::PreparedScene scene;
  dynamic::FrameOptions frame;
};

MovingPictures::MovingPictures(const fs::path& scene, bool as_published, const RunContext& run) {
  dynamic::TransportOptions transport;
  dynamic::FrameOptions frame;
  if (as_published) {
    transport.fields = true;
    frame.direct_by_fields = true;
  }
  data_ = guarded(run, [&] {
    return std::unique_ptr<Data>(new Data{{dynamic::read_dynamic_scene(scene, run), transport, run}, frame});
  });
}
MovingPictures::MovingPictures(MovingPictures&&) noexcept = default;
MovingPictures::~MovingPictures() = default;

double MovingPictures::duration() const {
  return data_->scene.scene().duration();
}

Image MovingPictures::picture(double time, int bounces) {
  dynamic::FrameOptions options = data_->frame;
  options.bounces = bounces;
  options.check();
  if (!(time >= 0.0)) throw InputError("time is ", time, "; give 0 or more seconds");
  return guarded({}, [&] {
    data_->scene.solve(time, cli::camera_of(data_->scene.scene()), options);
    return data_->scene.picture(0, data_->scene.light().bounces());
  });
}

}  // namespace refield
