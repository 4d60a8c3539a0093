// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "core/light_map.h"

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

}  // namespace refield
