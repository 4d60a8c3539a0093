// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/scene.h"

#include <algorithm>
#include <cmath>

#include "core/base/units.h"
#include "simulate/geometry/place_mesh.h"

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
      throw InputError("object '", object.name,
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
    throw InputError("an object refers to the material '", name, "', which is not in the scene; add it");
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

}  // namespace refield
