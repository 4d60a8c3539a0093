// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/scene.h"

#include <tbb/parallel_for.h>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <string>

#include "core/base/errors.h"
#include "core/base/run_context.h"
#include "core/base/units.h"
#include "simulate/geometry/place_mesh.h"
#include "simulate/tabletop/surface.h"

namespace refield {

MonitorSurface::MonitorSurface(const MonitorInScene& monitor) : texels_(monitor.texels) {
  const Eigen::Vector3d normal = monitor.facing.normalized();
  const Eigen::Vector3d right =
      Eigen::Vector3d::UnitY().cross(normal).normalized();  // for someone in front of it
  const Eigen::Vector3d up = normal.cross(right);
  normal_ = normal.cast<float>();
  corner_ = (monitor.centre - 0.5 * monitor.width_m * right + 0.5 * monitor.height_m * up).cast<float>();
  column_step_ = (monitor.width_m / texels_.width * right).cast<float>();
  row_step_ = (-monitor.height_m / texels_.height * up).cast<float>();
  texel_area_ = column_step_.norm() * row_step_.norm();
}

Eigen::Vector2f MonitorSurface::texels_at(const Eigen::Vector3f& position) const {
  const Eigen::Vector3f d = position - corner_;
  return {d.dot(column_step_) / column_step_.squaredNorm(), d.dot(row_step_) / row_step_.squaredNorm()};
}

Eigen::Vector2i MonitorSurface::texel_at(const Eigen::Vector3f& position) const {
  const Eigen::Vector2f at = texels_at(position);
  return {std::clamp(static_cast<int>(std::floor(at.x())), 0, texels_.width - 1),
          std::clamp(static_cast<int>(std::floor(at.y())), 0, texels_.height - 1)};
}

std::vector<MonitorPlacement> monitor_placements(const SceneDescription& scene) {
  constexpr double mm_per_m = 1000.0;
  const Eigen::Vector3d up = Eigen::Vector3d::UnitY();
  const Eigen::Vector3d looks = scene.camera.target - scene.camera.position;
  const Eigen::Vector3d ahead = (looks - looks.dot(up) * up).normalized();
  Eigen::Matrix3d scene_from_world;  // into the left-handed axes of light maps
  scene_from_world << ahead.cross(up).transpose(), up.transpose(), ahead.transpose();
  const Eigen::Vector3d onto_screen = -(scene_from_world * scene.monitor.facing.normalized());
  MonitorPlacement placement;
  placement.turn.yaw = degrees_from_radians(std::atan2(onto_screen.x(), onto_screen.z()));
  placement.turn.pitch = -degrees_from_radians(std::asin(std::clamp(onto_screen.y(), -1.0, 1.0)));
  const Eigen::Vector3d centre = rotation_of(placement.turn).transpose() * scene_from_world *
                                 (scene.monitor.centre - scene.camera.target);
  placement.width_mm = mm_per_m * scene.monitor.width_m;
  placement.height_mm = mm_per_m * scene.monitor.height_m;
  placement.distance_mm = mm_per_m * centre.z();
  placement.offset_x_mm = mm_per_m * centre.x();
  placement.offset_y_mm = mm_per_m * centre.y();
  if (!(placement.distance_mm > 0.0)) return {};
  return {placement};
}

namespace {

// A shadow ray ends this fraction before its target, so that the target does not shadow itself.
constexpr float before_target = 1.0f - 1e-4f;

/// An object in the scene. Normals and textures are those of the unturned shape, its stretch included.
TabletopObject place_object(const ObjectDescription& object) {
  using Shape = ObjectDescription::Shape;
  const prt::Placement& place = object.place;
  const Eigen::Matrix3f turn = rotation_of(place.turn).cast<float>();
  TabletopObject result;
  Eigen::AlignedBox3f bounds;
  if (object.shape == Shape::sphere) {
    bounds.extend(Eigen::Vector3f::Constant(-0.5f)).extend(Eigen::Vector3f::Constant(0.5f));
  } else {
    result.mesh = shape_mesh(object);
    if (result.mesh.triangles.empty())
      throw InputError("object '" + object.name +
                       "': its shape has no surface; give a profile with some radius");
    if (place.stretch != Eigen::Vector3f::Ones()) prt::place(result.mesh, {.stretch = place.stretch});
    for (const Eigen::Vector3f& position : result.mesh.positions) bounds.extend(turn * position);
  }
  const auto [scale, shift] = prt::settle(bounds, place);
  Eigen::Isometry3f pose = Eigen::Isometry3f::Identity();
  pose.linear() = turn;
  pose.translation() = shift;
  for (Eigen::Vector3f& position : result.mesh.positions) position = pose * (scale * position);
  for (Eigen::Vector3f& normal : result.mesh.normals) normal = turn * normal;
  result.object_from_world = pose.inverse();
  result.bounds = {shift, 0.5f * scale};
  if (object.shape == Shape::sphere) return result;
  result.bounds = {prt::bounds_of(result.mesh).center(), 0.0f};
  for (const Eigen::Vector3f& position : result.mesh.positions)
    result.bounds.radius = std::max(result.bounds.radius, (position - result.bounds.centre).norm());
  return result;
}

Eigen::Vector3f at_barycentric(const std::vector<Eigen::Vector3f>& values,
                               const std::array<std::uint32_t, 3>& t, float u, float v) {
  return (1.0f - u - v) * values[t[0]] + u * values[t[1]] + v * values[t[2]];
}

}  // namespace

TabletopScene::TabletopScene(const SceneDescription& description)
    : description_(description), monitor_(description.monitor) {
  for (const ObjectDescription& object : description_.objects) {
    materials_.push_back(&material_named(object.material));
    placed_.push_back(place_object(object));
    const TabletopObject& last = placed_.back();
    if (last.mesh.triangles.empty())
      rays_.add_sphere(last.bounds.centre, last.bounds.radius);
    else
      rays_.add_mesh(last.mesh);
  }

  Mesh screen;
  const auto w = static_cast<float>(monitor_.texels().width),
             h = static_cast<float>(monitor_.texels().height);
  screen.positions = {monitor_.point(0, h), monitor_.point(w, h), monitor_.point(w, 0), monitor_.point(0, 0)};
  screen.triangles = {{0, 1, 2}, {0, 2, 3}};
  rays_.add_mesh(screen);  // after all objects
  rays_.commit();

  const SceneCamera& camera = description_.camera;
  const Eigen::Vector3d forward = (camera.target - camera.position).normalized();
  const Eigen::Vector3d right = forward.cross(camera.up).normalized();
  const Eigen::Vector3d down = forward.cross(right);
  const double pixel =
      2.0 * std::tan(radians_from_degrees(camera.vertical_fov_degrees) / 2.0) / camera.height;
  camera_origin_ = camera.position.cast<float>();
  camera_right_ = (pixel * right).cast<float>();
  camera_down_ = (pixel * down).cast<float>();
  camera_corner_ = (forward - 0.5 * pixel * (camera.width * right + camera.height * down)).cast<float>();
}

SceneCamera turned(SceneCamera camera, double right_px, double down_px) {
  const Eigen::Vector3d view = camera.target - camera.position;
  const Eigen::Vector3d right = view.normalized().cross(camera.up).normalized();
  const Eigen::Vector3d down = view.normalized().cross(right);
  const double pixel =
      2.0 * view.norm() * std::tan(radians_from_degrees(camera.vertical_fov_degrees) / 2.0) / camera.height;
  camera.target -= pixel * (right_px * right + down_px * down);
  return camera;
}

const MaterialDescription& TabletopScene::material_named(const std::string& name) const {
  static const MaterialDescription standard;
  if (name.empty()) return standard;
  const auto material = std::ranges::find(description_.materials, name, &MaterialDescription::name);
  if (material == description_.materials.end())
    throw InputError("an object refers to the material '" + name + "', which is not in the scene; add it");
  return *material;
}

std::optional<Hit> TabletopScene::intersect(const Ray& ray) const {
  const auto found = rays_.first_hit(ray.origin, ray.direction);
  if (!found) return std::nullopt;
  Hit hit;
  hit.position = ray.origin + found->distance * ray.direction;
  if (found->part == placed_.size()) {
    hit.geometric_normal = hit.shading_normal = monitor_.normal();
    hit.object_position = hit.position;
    return hit;
  }
  hit.object = static_cast<int>(found->part);
  const TabletopObject& placed = placed_[found->part];
  if (placed.mesh.triangles.empty()) {
    hit.geometric_normal = hit.shading_normal = (hit.position - placed.bounds.centre).normalized();
  } else {
    hit.geometric_normal = found->normal.normalized();
    hit.shading_normal =
        at_barycentric(placed.mesh.normals, placed.mesh.triangles[found->triangle], found->u, found->v)
            .normalized();
  }
  hit.object_position = placed.object_from_world * hit.position;
  return hit;
}

bool TabletopScene::occluded(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const {
  return rays_.is_occluded(from, to - from, before_target);
}

Ray TabletopScene::camera_ray(float x, float y) const {
  return {camera_origin_, (camera_corner_ + x * camera_right_ + y * camera_down_).normalized()};
}

namespace {

constexpr int grid = 4;  // rays per pixel, along a side
constexpr int min_majority = 3 * grid * grid / 4;
constexpr int monitor_columns = 16, monitor_rows = 12;
constexpr double least_hidden = 0.05, max_hidden = 0.95;

enum Label : std::uint8_t { none, diffuse, glossy, refraction, hard_shadow, mixed };

Label label_of(const TabletopScene& scene, const std::optional<Hit>& hit) {
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

void look_at_monitor(const TabletopScene& scene, const Hit& hit, const Ray& ray, Visibility& seen) {
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

Label label_pixel(const TabletopScene& scene, int x, int y) {
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
  if (*largest < min_majority) return mixed;
  const auto label = static_cast<Label>(std::distance(counts.begin(), largest));
  if (label != diffuse && label != glossy) return label;
  const double hidden = seen.facing > 0 ? static_cast<double>(seen.hidden) / seen.facing : 0.0;
  return hidden > least_hidden && hidden < max_hidden ? hard_shadow : label;
}

}  // namespace

PixelKinds scene_kinds(const TabletopScene& scene, const RunContext& run) {
  const SceneCamera& camera = scene.description().camera;
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
