// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "core/light/monitor_placement.h"
#include "simulate/geometry/mesh_file.h"
#include "simulate/geometry/place_mesh.h"

/// What scene files of all kinds have in common: camera, materials, objects and motion. One reader serves
/// ray-traced recipes, meshes with precomputed transport, area lights and dynamic scenes.
/// docs/reference/scene-files.md lists the keys, and which kind of scene uses which.
namespace refield {

class ConfigFile;
class ConfigSection;

using Rgb = Eigen::Array3f;

enum class SceneKind {
  traced,       ///< `refield simulate`: ray traced with surfaces of all kinds
  precomputed,  ///< `refield precompute`
  dynamic,      ///< `refield render`
};

/// A pinhole camera; +Y is up unless `up` says otherwise.
struct SceneCamera {
  int width = 640;  ///< pixels
  int height = 480;
  Eigen::Vector3d position{0.0, 0.0, 0.0};
  Eigen::Vector3d target{0.0, 0.0, -1.0};
  Eigen::Vector3d up{0.0, 1.0, 0.0};
  double vertical_fov_degrees = 35.0;

  PinholeCamera pinhole() const;
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
    phong,        ///< Lambert and a normalised Phong lobe
    ggx,          ///< Lambert and a microfacet lobe
    glossy,       ///< Lambert below a dielectric microfacet coat
    metal,        ///< microfacet conductor
    mirror,       ///< perfect conductor
    glass,        ///< smooth dielectric, refracting
    translucent,  ///< a thin sheet that reflects and transmits diffusely
  };
  std::string name{};
  Kind kind = Kind::diffuse;
  /// Linear RGB: diffuse albedo, or reflectance at normal incidence of a metal or mirror, or transmittance of
  /// each surface of glass.
  Rgb colour = Rgb::Constant(0.8f);
  Rgb specular = Rgb::Zero();  ///< reflectance of the lobe of phong and ggx
  TextureDescription texture{};
  double exponent = 0.0;             ///< of phong
  double roughness = 0.2;            ///< of ggx, glossy and metal: GGX α = roughness²
  double index_of_refraction = 1.5;  ///< of glossy and glass
  double transmission = 0.5;         ///< of translucent: the share of `colour` that goes through
};

/// A shape, its material and its place.
struct ObjectDescription {
  enum class Shape { plane, box, sphere, lathe, rabbit, file };
  std::string name{};
  Shape shape = Shape::box;
  std::string material{};                  ///< name of a material; empty: MaterialDescription's defaults
  int resolution = 0;                      ///< of a built-in shape (mesh_shapes.h); 0: the shape's default
  std::vector<Eigen::Vector2d> profile{};  ///< of a lathe: (radius, height) from one end to the other
  bool smooth = true;                      ///< of a lathe: round the profile's corners (Catmull–Rom)
  fs::path file{};                         ///< of Shape::file, relative to the scene's file
  std::optional<prt::ColourCoding> colours{};  ///< of its vertices; none: as usual for its format
  prt::Placement place{};
};

/// Where an object is and how it is turned, by time: linear between two keyframes, at rest before the first
/// and after the last. Angles are interpolated as numbers, so that they may exceed a full turn.
struct Motion {
  struct Place {
    double time;  ///< seconds
    Eigen::Vector3f position;
  };
  struct Angles {
    double time;
    EulerAngles turn;
  };
  std::vector<Place> path;    ///< times ascending, at least one
  std::vector<Angles> turns;  ///< may be empty: not turned

  Eigen::Vector3f position(double time) const;
  Eigen::Isometry3f at(double time) const;
  double duration() const;
};

// Readers of sections of scene files. All throw InputError that names file, line, key, value and remedy.

/// Linear RGB or a position: three numbers, absent: `standard`.
Eigen::Vector3f read_vector(ConfigSection& section, const char* key, const Eigen::Vector3f& standard,
                            double low = -1e6, double high = 1e6);

/// [camera].
SceneCamera read_camera(ConfigSection section);

/// All [[material]], of the kinds that the kind of scene supports. There may be none.
std::vector<MaterialDescription> read_materials(const ConfigFile& file, SceneKind scene);

/// The keys of [[object]] and [[light]] that describe a shape and its place. The caller reads what else the
/// section may hold, and finishes it.
ObjectDescription read_object(ConfigSection& section, SceneKind scene);

/// The key `material` of an object: the material of that name, or the default one.
MaterialDescription read_material_of(ConfigSection& section, std::span<const MaterialDescription> materials);

/// The mesh of read_object(), in its place and refined as the section asks for, without materials of its
/// file. Throws what read_mesh_file() does, too.
Mesh read_mesh(ConfigSection& section, SceneKind scene, const fs::path& folder, const RunContext& run);

struct SceneObject {
  Mesh mesh;
  MaterialDescription material;         ///< diffuse and white where the mesh's file says all
  std::vector<Eigen::Array4f> lobes{};  ///< of the mesh's file, see prt::MeshFile; or empty
};
/// Reads an object with its material: read_material_of() or, for a section without the key `material`, those
/// of the mesh's file, as colours and lobes of the vertices, by `gloss`.
SceneObject read_scene_object(ConfigSection& section, SceneKind scene,
                              std::span<const MaterialDescription> materials, const fs::path& folder,
                              prt::Gloss gloss, const RunContext& run);

/// `path`, and `turns` where `with_turns`; absent, the object rests at `position`.
Motion read_motion(ConfigSection& section, const Eigen::Vector3f& position, bool with_turns);

/// Throws InputError where a scene has more triangles than a field can hold.
void check_triangle_count(const fs::path& scene, std::size_t triangles);

/// A built-in shape about its own origin, before it is placed.
Mesh shape_mesh(const ObjectDescription& object);

}  // namespace refield
