// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/frame_errors.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "cli/run_context.h"
#include "core/base/rng.h"
#include "relight/mesh/mesh_view.h"

namespace refield::studies {

FrameTimes measure_frames(PreparedScene& scene, const dynamic::FrameOptions& options) {
  constexpr int frames = 15;
  const PinholeCamera camera = camera_of(scene.scene());
  std::vector<FrameTimes> all;
  using Clock = std::chrono::steady_clock;
  const auto ms_since = [](Clock::time_point start) {
    return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  };
  for (int frame = 0; frame < frames; ++frame) {
    const auto start = Clock::now();
    scene.solve(scene.scene().duration() * frame / frames, camera, options);
    scene.light().radiance(0, scene.light().bounces());
    const double solved = ms_since(start);
    const auto before_picture = Clock::now();
    scene.picture(0, scene.light().bounces());
    const dynamic::DynamicLight::Times& times = scene.light().times();
    all.push_back({solved, 1e3 * times.direct, 1e3 * times.place, 1e3 * times.bounces, 1e3 * times.shade,
                   ms_since(before_picture) - 1e3 * times.shade});
  }
  const auto median = [&](double FrameTimes::*part) {
    std::vector<double> values;
    for (const FrameTimes& times : all) values.push_back(times.*part);
    std::ranges::nth_element(values, values.begin() + frames / 2);
    return values[frames / 2];
  };
  return {median(&FrameTimes::frame),   median(&FrameTimes::direct), median(&FrameTimes::place),
          median(&FrameTimes::bounces), median(&FrameTimes::shade),  median(&FrameTimes::picture)};
}

namespace {

constexpr std::size_t max_vertices = 500;
constexpr int reference_area_light_points = 4096;

/// References for vertices at a time, by bounce.
std::vector<std::vector<Eigen::Array3f>> traced(const PreparedScene& scene, double time,
                                                std::span<const dynamic::PathStart> starts,
                                                const dynamic::ReferenceOptions& options) {
  const std::vector<dynamic::Pose> poses = scene.scene().poses(time);
  dynamic::SceneRays rays(scene.rays());
  rays.move(poses);
  const auto area_lights = dynamic::area_points(scene.scene().lights.at(time), reference_area_light_points);
  return trace_bounces(scene.scene(), rays, poses, {.area_lights = area_lights}, starts, options,
                       run_context());
}

void draw_facing(const dynamic::DynamicScene& scene, FrameReference& drawn) {
  const Eigen::Vector3f eye = drawn.camera.position;
  const std::vector<dynamic::Pose> poses = scene.poses(drawn.time);
  FrameReference facing;
  std::size_t number = 0;
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Mesh& mesh = scene.objects[o].mesh;
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v, ++number) {
      if ((poses[o].linear() * mesh.normals[v]).dot(eye - poses[o] * mesh.positions[v]) <= 0.0f) continue;
      facing.vertices.push_back(path_start(scene, poses, o, v, eye));
      facing.number.push_back(number);
    }
  }
  Rng rng(7);
  const std::size_t all = facing.vertices.size(), count = std::min(all, max_vertices);
  for (std::size_t i = 0; i < count; ++i) {  // one of each of `count` equal parts
    const std::size_t first = i * all / count, end = (i + 1) * all / count;
    const std::size_t k = first + static_cast<std::size_t>(rng.below(end - first));
    drawn.vertices.push_back(facing.vertices[k]);
    drawn.number.push_back(facing.number[k]);
  }
}

}  // namespace

FrameReference frame_reference(const PreparedScene& scene, double time, int bounces, int paths) {
  FrameReference reference;
  reference.time = time;
  reference.camera = camera_of(scene.scene());
  draw_facing(scene.scene(), reference);
  reference.bounces = traced(scene, time, reference.vertices, {.paths = paths, .bounces = bounces});
  return reference;
}

Image traced_picture(PreparedScene& scene, double time, int bounces, int paths) {
  const PinholeCamera camera = camera_of(scene.scene());
  const std::vector<dynamic::Pose> poses = scene.scene().poses(time);
  std::vector<dynamic::PathStart> starts;
  for (std::uint32_t o = 0; o < poses.size(); ++o)
    for (std::uint32_t v = 0; v < scene.scene().objects[o].mesh.positions.size(); ++v)
      starts.push_back(path_start(scene.scene(), poses, o, v, camera.position));
  std::vector<Eigen::Array3f> radiance(starts.size(), Eigen::Array3f::Zero());
  for (const auto& bounce : traced(scene, time, starts, {.paths = paths, .bounces = bounces}))
    for (std::size_t v = 0; v < radiance.size(); ++v) radiance[v] += bounce[v];
  scene.solve(time, camera, {.bounces = 0});  // for the mesh and the area lights, which shine
  std::vector<Eigen::Array3f> shown = scene.radiance(0, 0);
  std::ranges::copy(radiance, shown.begin());
  const Mesh all = scene.mesh();
  return MeshRenderer(all, camera).show(shown);
}

std::vector<LightError> frame_errors(PreparedScene& scene, const FrameReference& reference,
                                     dynamic::FrameOptions options) {
  const int bounces = static_cast<int>(reference.bounces.size()) - 1;
  options.bounces = bounces;
  scene.solve(reference.time, reference.camera, options);
  const std::size_t count = reference.vertices.size();
  const auto truth_of = [&](int first, int last) {
    std::vector<Eigen::Array3f> truth(count, Eigen::Array3f::Zero());
    for (int b = first; b <= last; ++b)
      for (std::size_t i = 0; i < count; ++i) truth[i] += reference.bounces[static_cast<std::size_t>(b)][i];
    return truth;
  };
  const auto norm = [](const std::vector<Eigen::Array3f>& values) {
    double sum = 0.0;
    for (const auto& value : values) sum += value.matrix().cast<double>().squaredNorm();
    return std::sqrt(sum);
  };
  const double all = norm(truth_of(0, bounces));
  std::vector<LightError> errors;
  const auto add = [&](const std::string& what, int first, int last) {
    const auto radiance = scene.light().radiance(first, last);
    const std::vector<Eigen::Array3f> truth = truth_of(first, last);
    std::vector<Eigen::Array3f> difference(count);
    for (std::size_t i = 0; i < count; ++i) difference[i] = radiance[reference.number[i]] - truth[i];
    errors.push_back({what, norm(difference) / norm(truth), norm(difference) / all, norm(truth) / all});
  };
  add("direct", 0, 0);
  for (int b = 1; b <= bounces; ++b) add("bounce " + std::to_string(b), b, b);
  if (bounces > 0) add("bounced", 1, bounces);
  add("all", 0, bounces);
  return errors;
}

}  // namespace refield::studies
