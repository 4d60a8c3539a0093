// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/geometry/scene_description.h"

namespace refield {

/// A flat emitter whose texels send out equal radiance in all directions of its front side.
struct MonitorInScene {
  LightDomain texels;
  Eigen::Vector3d centre{0.0, 0.0, 0.0};
  Eigen::Vector3d facing{0.0, 0.0, 1.0};  ///< normal of the front side
  double width_m = 0.6;
  double height_m = 0.45;
};

/// Everything that light meets. Lengths are in metres; the axes are right-handed: +X right, +Y up, +Z towards
/// the viewer, against that of scene files. Objects are planes, boxes, spheres and lathes.
struct SceneDescription {
  SceneCamera camera;
  MonitorInScene monitor;
  Rgb ambient_radiance = Rgb::Zero();  ///< room light, the same from all directions
  std::vector<MaterialDescription> materials;
  std::vector<ObjectDescription> objects;
};

/// Where the monitor's texels lie in space. Columns run from left to right and rows downwards as someone in
/// front of the monitor sees them.
class MonitorSurface {
 public:
  explicit MonitorSurface(const MonitorInScene& monitor);

  const LightDomain& texels() const { return texels_; }
  const Eigen::Vector3f& normal() const { return normal_; }
  float texel_area() const { return texel_area_; }

  /// Position of a point given in texels, (0, 0) the top left corner, (width, height) the bottom right.
  Eigen::Vector3f point(float column, float row) const {
    return corner_ + column * column_step_ + row * row_step_;
  }

  /// Inverse of point(): the column and row of a position on the surface, in texels.
  Eigen::Vector2f texels_at(const Eigen::Vector3f& position) const;

  /// Texel that holds a position on the surface; positions on the rim count to the nearest texel.
  Eigen::Vector2i texel_at(const Eigen::Vector3f& position) const;

 private:
  LightDomain texels_;
  Eigen::Vector3f corner_, column_step_, row_step_, normal_;
  float texel_area_;
};

/// The camera turned about its centre of projection, so that the middle of the picture moves by that much.
SceneCamera turned(SceneCamera camera, double right_px, double down_px);

/// Where the monitor stands as seen from the scene, whose middle is what the camera looks at: the one
/// placement of a session of this scene. None when the middle lies behind the monitor.
std::vector<MonitorPlacement> monitor_placements(const SceneDescription& scene);

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

/// An object's geometry in the scene.
struct TabletopObject {
  Mesh mesh;  ///< empty where `bounds` is the object, a sphere
  Eigen::Isometry3f object_from_world;
  BoundingSphere bounds;
};

/// The scene's surfaces, ready for ray queries. All queries may run at the same time.
class TabletopScene {
 public:
  /// Throws InputError for a shape that cannot be made.
  explicit TabletopScene(const SceneDescription& description);
  TabletopScene(const TabletopScene&) = delete;
  TabletopScene& operator=(const TabletopScene&) = delete;

  const SceneDescription& description() const { return description_; }
  const MonitorSurface& monitor() const { return monitor_; }
  const MaterialDescription& material_of(int object) const { return *materials_[object]; }
  const BoundingSphere& bounds_of(int object) const { return placed_[object].bounds; }

  std::optional<Hit> intersect(const Ray& ray) const;

  /// Whether something stands between two points. `from` should already be off its surface.
  bool occluded(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const;

  /// Through the camera pixel position (x, y) in pixels, (0, 0) the top left corner of the image.
  Ray camera_ray(float x, float y) const;

 private:
  const MaterialDescription& material_named(const std::string& name) const;

  SceneDescription description_;
  MonitorSurface monitor_;
  std::vector<const MaterialDescription*> materials_;  // of each object
  std::vector<TabletopObject> placed_;
  prt::RayScene rays_;  // parts: the objects, then the monitor
  Eigen::Vector3f camera_origin_, camera_corner_, camera_right_, camera_down_;
};

}  // namespace refield
