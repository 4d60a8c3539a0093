// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/image/pixel_classes.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"

namespace refield {

using Rgb = Eigen::Array3f;

/// A pinhole camera. Lengths are in metres, +Y is up.
struct CameraInScene {
  int width = 0;  ///< pixels
  int height = 0;
  Eigen::Vector3d position{0.0, 0.0, 0.0};
  Eigen::Vector3d target{0.0, 0.0, -1.0};
  double vertical_fov_degrees = 40.0;
};

/// A flat emitter whose texels send out equal radiance in all directions of its front side.
struct MonitorInScene {
  LightDomain texels;
  Eigen::Vector3d centre{0.0, 0.0, 0.0};
  Eigen::Vector3d facing{0.0, 0.0, 1.0};  ///< normal of the front side
  double width_m = 0.6;
  double height_m = 0.45;
};

/// What a surface's base colour looks like over the surface.
struct TextureDescription {
  enum class Kind { plain, checker, noise, wood };
  Kind kind = Kind::plain;
  Rgb second_colour = Rgb::Zero();  ///< the other colour of the pattern
  double scale_m = 0.05;            ///< size of a check, or of the coarsest feature
};

struct MaterialDescription {
  enum class Kind {
    diffuse,      ///< Lambert
    glossy,       ///< Lambert below a dielectric microfacet coat
    metal,        ///< microfacet conductor
    mirror,       ///< perfect conductor
    glass,        ///< smooth dielectric, refracting
    translucent,  ///< a thin sheet that reflects and transmits diffusely
  };
  std::string name{};
  Kind kind = Kind::diffuse;
  Rgb colour = Rgb::Constant(0.5f);  ///< albedo, or normal-incidence reflectance of a metal or mirror
  TextureDescription texture{};
  double roughness = 0.2;            ///< of glossy and metal: GGX α = roughness²
  double index_of_refraction = 1.5;  ///< of glossy and glass
  double transmission = 0.5;         ///< of translucent: the share of `colour` that goes through
};

struct ObjectDescription {
  enum class Kind { quad, box, sphere, lathe };
  std::string name{};
  Kind kind = Kind::box;
  std::string material{};
  Eigen::Vector3d position{0.0, 0.0, 0.0};  ///< centre of a quad, box or sphere; bottom centre of a lathe
  Eigen::Vector3d size{1.0, 1.0, 1.0};      ///< of a box; of a quad x and z
  Eigen::Vector3d rotation_degrees{0.0, 0.0, 0.0};  ///< about x, then y, then z
  double radius = 0.1;                              ///< of a sphere
  std::vector<Eigen::Vector2d> profile{};  ///< of a lathe: (radius, height) from one end to the other
  bool smooth = true;                      ///< of a lathe: round the profile's corners (Catmull–Rom)
};

/// Everything that light meets.
struct SceneDescription {
  CameraInScene camera;
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

/// Sorts the camera's pixels by what they show (kind_names in core/image/pixel_classes.h), from the first
/// surfaces that 4 × 4 rays through a pixel meet:
///  - refraction: three quarters or more are mirror or glass, or the monitor itself;
///  - diffuse (with translucent), glossy (with metal): the same for these materials ...
///  - hard_shadow: ... but from 5 to 95 % of the monitor points that face the surface are hidden from it,
///    so that the edge of something lies across its light;
///  - mixed: no sort of material reaches three quarters, as on the outlines of things.
/// Pixels whose rays mostly meet nothing are of no kind.
PixelKinds scene_kinds(const Scene& scene, const RunContext& run = {});

}  // namespace refield
