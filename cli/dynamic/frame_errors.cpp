// SPDX-License-Identifier: Apache-2.0
#include "cli/dynamic/frame_errors.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "core/rng.h"

namespace refield::cli {

namespace {

constexpr std::size_t compared = 500;

struct Drawn {
  std::vector<dynamic::VertexOf> vertices;
  std::vector<std::size_t> number;  // in the joined mesh
};

Drawn draw_facing(const dynamic::DynamicScene& scene, double time, const Eigen::Vector3f& eye) {
  const std::vector<dynamic::Pose> poses = scene.poses(time);
  Drawn facing;
  std::size_t number = 0;
  for (std::uint32_t o = 0; o < scene.objects.size(); ++o) {
    const Mesh& mesh = scene.objects[o].mesh;
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v, ++number) {
      if ((poses[o].linear() * mesh.normals[v]).dot(eye - poses[o] * mesh.positions[v]) <= 0.0f) continue;
      facing.vertices.push_back({o, v});
      facing.number.push_back(number);
    }
  }
  Drawn drawn;
  Rng rng(7);
  const std::size_t all = facing.vertices.size(), count = std::min(all, compared);
  for (std::size_t i = 0; i < count; ++i) {  // one of each of `count` equal parts
    const std::size_t first = i * all / count, end = (i + 1) * all / count;
    const std::size_t k = first + static_cast<std::size_t>(rng.below(end - first));
    drawn.vertices.push_back(facing.vertices[k]);
    drawn.number.push_back(facing.number[k]);
  }
  return drawn;
}

}  // namespace

nlohmann::ordered_json frame_errors(PreparedScene& scene, double time, const dynamic::FrameOptions& options,
                                    int paths) {
  const PinholeCamera camera = camera_of(scene.scene());
  const Eigen::Vector3f eye = camera.position;
  const Drawn drawn = draw_facing(scene.scene(), time, eye);
  scene.solve(time, camera, options);
  const int bounces = scene.light().bounces();
  const auto reference = scene.reference(time, drawn.vertices, eye, {.paths = paths, .bounces = bounces});
  const std::size_t count = drawn.vertices.size();
  std::vector<Eigen::Array3f> all_reference(count, Eigen::Array3f::Zero());
  for (const auto& bounce : reference)
    for (std::size_t i = 0; i < count; ++i) all_reference[i] += bounce[i];
  const auto norm = [&](const auto& value) {
    double sum = 0.0;
    for (std::size_t i = 0; i < count; ++i) sum += value(i).matrix().template cast<double>().squaredNorm();
    return std::sqrt(sum);
  };
  const double all = norm([&](std::size_t i) { return all_reference[i]; });
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  const auto add = [&](const std::string& what, int first, int last,
                       const std::vector<Eigen::Array3f>& truth) {
    const auto radiance = scene.light().radiance(first, last);
    const double error =
        norm([&](std::size_t i) -> Eigen::Array3f { return radiance[drawn.number[i]] - truth[i]; });
    const double own = norm([&](std::size_t i) { return truth[i]; });
    rows.push_back(
        {{"what", what}, {"relative", error / own}, {"of_all", error / all}, {"share", own / all}});
  };
  for (int b = 0; b <= bounces; ++b)
    add(b == 0 ? "direct" : "bounce " + std::to_string(b), b, b, reference[static_cast<std::size_t>(b)]);
  add("all", 0, bounces, all_reference);
  return rows;
}

}  // namespace refield::cli
