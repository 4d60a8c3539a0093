// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "simulate/monitor_surface.h"
#include "simulate/scene_description.h"

namespace refield {

struct Ray {
  Eigen::Vector3f origin;
  Eigen::Vector3f direction;  ///< unit
};

/// Where a ray met the scene.
struct Hit {
  Eigen::Vector3f position;
  Eigen::Vector3f geometric_normal;  ///< unit, outwards
  Eigen::Vector3f shading_normal;    ///< unit, outwards, smooth over a lathe or sphere
  Eigen::Vector3f object_position;   ///< in the object's frame, for textures
  int object = -1;                   ///< −1: the monitor
  bool is_monitor() const { return object < 0; }
};

struct BoundingSphere {
  Eigen::Vector3f centre;
  float radius;
};

/// The scene's surfaces, ready for ray queries. All queries may run at the same time.
class Scene {
 public:
  /// Throws InputError for a shape that cannot be made.
  explicit Scene(const SceneDescription& description);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const SceneDescription& description() const { return description_; }
  const MonitorSurface& monitor() const { return monitor_; }
  const MaterialDescription& material_of(int object) const { return *materials_[object]; }
  const BoundingSphere& bounds_of(int object) const { return bounds_[object]; }

  std::optional<Hit> intersect(const Ray& ray) const;

  /// Whether something stands between two points. `from` should already be off its surface.
  bool occluded(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const;

  /// Through the camera pixel position (x, y) in pixels, (0, 0) the top left corner of the image.
  Ray camera_ray(float x, float y) const;

 private:
  struct Geometry;
  SceneDescription description_;
  MonitorSurface monitor_;
  std::vector<const MaterialDescription*> materials_;  // of each object
  std::vector<BoundingSphere> bounds_;
  std::unique_ptr<Geometry> geometry_;
  Eigen::Vector3f camera_origin_, camera_corner_, camera_right_, camera_down_;
};

}  // namespace refield
