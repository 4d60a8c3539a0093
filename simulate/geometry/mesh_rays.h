// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Geometry>

#include <memory>
#include <span>

#include "core/field/mesh.h"

struct RTCSceneTy;  // Embree's, whose headers stay in mesh_rays.cpp

namespace refield::prt {

inline constexpr std::size_t ray_packet = 16;

/// What a ray meets first.
struct FirstHit {
  std::uint32_t part;      ///< of a scene without instances: its mesh or sphere
  std::uint32_t instance;  ///< of a scene of instances
  std::uint32_t triangle;
  float u, v;  ///< shares of the triangle's second and third vertex
  float distance;
  Eigen::Vector3f normal;  ///< geometric, of any length
};

/// Triangles and spheres, or instances of other such scenes, ready for ray queries: what the program uses of
/// Embree. Parts are numbered from 0 in the order in which they are added. Queries take place after commit(),
/// and may run at the same time. Throws InputError where Embree refuses something.
class RayScene {
 public:
  enum class Use { still, moving };
  explicit RayScene(Use use = Use::still);

  std::uint32_t add_mesh(const Mesh& mesh);
  std::uint32_t add_sphere(const Eigen::Vector3f& centre, float radius);
  /// `scene` must be committed, and outlive this one.
  std::uint32_t add_instance(const RayScene& scene);
  /// Takes the instance's own coordinates to those of this scene; before commit().
  void set_pose(std::uint32_t instance, const Eigen::Isometry3f& pose);
  void commit();

  std::optional<FirstHit> first_hit(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction) const;
  /// First hits of up to 16 rays.
  void first_hits(std::span<const Eigen::Vector3f> origins, std::span<const Eigen::Vector3f> directions,
                  std::span<std::optional<FirstHit>> hits) const;
  /// Whether a ray of this length, in lengths of its direction, meets anything.
  bool is_occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float length) const;
  /// Which of up to 16 rays meet nothing, a bit each. `distance`: infinity, or where a ray ends, in lengths
  /// of its direction. `coherent`: they start near each other and go nearly alike, which is faster.
  std::uint32_t unoccluded(std::span<const Eigen::Vector3f> points,
                           std::span<const Eigen::Vector3f> directions, std::span<const float> distance,
                           bool coherent) const;

 private:
  struct Release {
    void operator()(RTCSceneTy* scene) const;
  };
  std::unique_ptr<RTCSceneTy, Release> scene_;
};

/// Where a ray meets a mesh first.
struct MeshHit {
  std::uint32_t triangle = 0;
  std::array<float, 3> share = {0, 0, 0};  ///< of the triangle's vertices in the point; add up to 1
  float distance = 0.0f;
  bool front = true;  ///< whether it meets the front side
};

/// `direction`: of the ray, in the mesh' own frame.
MeshHit mesh_hit(const Mesh& mesh, const FirstHit& hit, const Eigen::Vector3f& direction);

/// A mesh ready for ray queries (Embree). All queries may run at the same time. The mesh must outlive it.
class MeshRays {
 public:
  /// Throws InputError where Embree refuses the mesh.
  explicit MeshRays(const Mesh& mesh);

  const Mesh& mesh() const { return *mesh_; }
  const RayScene& scene() const { return scene_; }
  /// Start of rays from a point: off its surface by a length that is safe in float and not to be seen.
  Eigen::Vector3f off_surface(const Eigen::Vector3f& point, const Eigen::Vector3f& normal) const {
    return point + offset_ * normal;
  }

  static constexpr std::size_t packet = ray_packet;
  /// Which of up to 16 points see infinitely far in a unit direction, a bit each. Points should be off their
  /// surfaces; it is fastest for neighbours.
  std::uint32_t unoccluded(std::span<const Eigen::Vector3f> points, const Eigen::Vector3f& direction) const;
  /// Which of up to 16 points see so far each in its own unit direction; `distance`: infinity, or where the
  /// light stands.
  std::uint32_t unoccluded(std::span<const Eigen::Vector3f> points,
                           std::span<const Eigen::Vector3f> directions,
                           std::span<const float> distance) const;

  std::optional<MeshHit> intersect(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction) const;

 private:
  const Mesh* mesh_;
  float offset_;
  RayScene scene_;
};

}  // namespace refield::prt
