// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/frame_errors.h"

#include <cmath>
#include <string>

#include "core/rng.h"

namespace refield::cli {

namespace {

constexpr std::size_t most_vertices = 500;

void draw_facing(const dynamic::DynamicScene& scene, FrameReference& drawn) {
  const Eigen::Vector3f eye = drawn.camera.position;
  const std::vector<dynamic::Pose> poses = scene.poses(drawn.time);
  FrameReference facing;
  std::size_t number = 0;
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Mesh& mesh = scene.objects[o].mesh;
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v, ++number) {
      if ((poses[o].linear() * mesh.normals[v]).dot(eye - poses[o] * mesh.positions[v]) <= 0.0f) continue;
      facing.vertices.push_back({o, v});
      facing.number.push_back(number);
    }
  }
  Rng rng(7);
  const std::size_t all = facing.vertices.size(), count = std::min(all, most_vertices);
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
  reference.bounces = scene.reference(time, reference.vertices, reference.camera.position,
                                      {.paths = paths, .bounces = bounces});
  return reference;
}

std::vector<LightError> frame_errors(PreparedScene& scene, const FrameReference& reference,
                                     dynamic::FrameOptions options) {
  const int bounces = static_cast<int>(reference.bounces.size()) - 1;
  options.bounces = bounces;
  options.until = 0.0;
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

}  // namespace refield::cli
