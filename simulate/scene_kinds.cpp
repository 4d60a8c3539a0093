// SPDX-License-Identifier: Apache-2.0
#include "simulate/scene_kinds.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <iterator>

#include "core/run_context.h"
#include "simulate/surface.h"

namespace refield {

namespace {

constexpr int grid = 4;  // rays a pixel, along a side
constexpr int most = 3 * grid * grid / 4;
constexpr int monitor_columns = 16, monitor_rows = 12;
constexpr double least_hidden = 0.05, most_hidden = 0.95;

enum Label : std::uint8_t { none, diffuse, glossy, refraction, hard_shadow, mixed };

Label label_of(const Scene& scene, const std::optional<Hit>& hit) {
  if (!hit) return none;
  if (hit->is_monitor()) return refraction;
  switch (scene.material_of(hit->object).kind) {
    case MaterialDescription::Kind::mirror:
    case MaterialDescription::Kind::glass:
      return refraction;
    case MaterialDescription::Kind::glossy:
    case MaterialDescription::Kind::metal:
      return glossy;
    default:
      return diffuse;
  }
}

/// Points of the monitor that could light a surface, and those of them that something hides.
struct Visibility {
  int facing = 0;
  int hidden = 0;
};

void look_at_monitor(const Scene& scene, const Hit& hit, const Ray& ray, Visibility& seen) {
  const Surface surface(scene, hit, -ray.direction);
  const MonitorSurface& monitor = scene.monitor();
  const Eigen::Vector3f normal =
      hit.geometric_normal.dot(ray.direction) < 0.0f ? hit.geometric_normal : (-hit.geometric_normal).eval();
  for (int j = 0; j < monitor_rows; ++j)
    for (int i = 0; i < monitor_columns; ++i) {
      const auto at = [](int cell, int cells, int texels) {
        return (static_cast<float>(cell) + 0.5f) * static_cast<float>(texels) / static_cast<float>(cells);
      };
      const Eigen::Vector3f point = monitor.point(at(i, monitor_columns, monitor.texels().width),
                                                  at(j, monitor_rows, monitor.texels().height));
      const Eigen::Vector3f direction = (point - hit.position).normalized();
      if (direction.dot(normal) <= 0.0f || direction.dot(monitor.normal()) >= 0.0f) continue;
      ++seen.facing;
      if (scene.occluded(surface.off_surface(direction), point)) ++seen.hidden;
    }
}

Label label_pixel(const Scene& scene, int x, int y) {
  std::array<int, mixed + 1> counts{};
  Visibility seen;
  for (int j = 0; j < grid; ++j)
    for (int i = 0; i < grid; ++i) {
      const Ray ray = scene.camera_ray(static_cast<float>(x) + (static_cast<float>(i) + 0.5f) / grid,
                                       static_cast<float>(y) + (static_cast<float>(j) + 0.5f) / grid);
      const auto hit = scene.intersect(ray);
      const Label label = label_of(scene, hit);
      ++counts[label];
      if (label == diffuse || label == glossy) look_at_monitor(scene, *hit, ray, seen);
    }
  const auto largest = std::ranges::max_element(counts);
  if (*largest < most) return mixed;
  const auto label = static_cast<Label>(std::distance(counts.begin(), largest));
  if (label != diffuse && label != glossy) return label;
  const double hidden = seen.facing > 0 ? static_cast<double>(seen.hidden) / seen.facing : 0.0;
  return hidden > least_hidden && hidden < most_hidden ? hard_shadow : label;
}

}  // namespace

PixelKinds scene_kinds(const Scene& scene, const RunContext& run) {
  const CameraInScene& camera = scene.description().camera;
  PixelKinds kinds{camera.width, camera.height, {std::begin(kind_names), std::end(kind_names)}, {}};
  kinds.labels.resize(static_cast<std::size_t>(camera.width) * camera.height);
  tbb::parallel_for(0, camera.height, [&](int y) {
    run.throw_if_stopped();
    for (int x = 0; x < camera.width; ++x)
      kinds.labels[static_cast<std::size_t>(y) * camera.width + x] = label_pixel(scene, x, y);
  });
  return kinds;
}

}  // namespace refield
