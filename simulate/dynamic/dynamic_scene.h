// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/mesh.h"
#include "simulate/dynamic/brdf.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/geometry/scene_description.h"
#include "simulate/prt/area_lights.h"

namespace refield::dynamic {

/// Takes an object's own coordinates to those of the scene.
using Pose = Eigen::Isometry3f;

struct SceneHit {
  std::uint32_t object;
  prt::MeshHit on;  ///< of the object's mesh
};

/// Rigid objects that move, ready for ray queries: each object's own search tree is built once, and a move
/// rebuilds the small one over their bounding boxes (Embree's instances). Queries may run at the same time,
/// but not with move(). The objects' rays must outlive it.
class SceneRays {
 public:
  explicit SceneRays(std::span<const prt::MeshRays> objects);

  /// [objects]; before the first query and whenever something moved.
  void move(std::span<const Pose> poses);

  /// Which of up to 16 points see so far each in its own direction, a bit each; `distance` in lengths of the
  /// direction. For neighbours that look at one place.
  std::uint32_t unoccluded(std::span<const Eigen::Vector3f> points,
                           std::span<const Eigen::Vector3f> directions,
                           std::span<const float> distance) const;
  /// What up to 16 rays meet first.
  void intersect(std::span<const Eigen::Vector3f> origins, std::span<const Eigen::Vector3f> directions,
                 std::span<std::optional<SceneHit>> hits) const;

 private:
  SceneHit hit_on_object(const prt::FirstHit& hit, const Eigen::Vector3f& direction) const;

  std::span<const prt::MeshRays> objects_;
  std::vector<Pose> poses_;
  prt::RayScene scene_;
};

/// Where rays from vertices start, in the mesh's own axes: a hundredth of the way to the middle of their
/// triangles, along the surface. A vertex at the edge of a sheet may lie exactly in another object, as the
/// foot of a wall in the floor, where it is chance what its rays meet; its light is that of the surface
/// beside it.
std::vector<Eigen::Vector3f> ray_starts(const Mesh& mesh);

/// About the middle of a mesh' bounding box, around all its vertices.
struct BoundingBall {
  Eigen::Vector3f middle;
  float radius;
};
BoundingBall bounding_ball(const Mesh& mesh);

/// A rigid object of one material.
struct MovingObject {
  std::string name;
  Mesh mesh;  ///< the middle of its bounding box at the origin; colours multiply what leaves
  Brdf brdf;
  Motion motion;
};

struct DynamicScene {
  std::vector<MovingObject> objects;
  prt::AreaLights lights;
  std::optional<PinholeCamera> camera;

  double duration() const;
  std::vector<Pose> poses(double time) const;
};

/// Reads a scene's description (TOML, docs/reference/scene-files.md). Throws InputError or FormatError,
/// naming the file.
DynamicScene read_dynamic_scene(const fs::path& path, const RunContext& run);

/// All objects in place, joined into one mesh, object after object.
Mesh joined_mesh(const DynamicScene& scene, std::span<const Pose> poses);

}  // namespace refield::dynamic
