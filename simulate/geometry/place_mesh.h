// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Geometry>

#include "core/field/mesh.h"
#include "core/light/monitor_placement.h"

namespace refield::prt {

/// The box around all vertices; empty where there are none.
Eigen::AlignedBox3f bounds_of(const Mesh& mesh);

/// Where a mesh stands in a scene, in the order in which it is done.
struct Placement {
  Eigen::Vector3f stretch = {1.0f, 1.0f, 1.0f};  ///< along the mesh's own axes, all above zero
  EulerAngles turn = {};
  std::optional<float> size = std::nullopt;                ///< the longest side of its bounding box
  std::optional<Eigen::Vector3f> position = std::nullopt;  ///< where the middle of its bounding box comes
  /// Its lowest point comes to height 0; above the origin where no position is given.
  bool on_ground = false;
  /// `position` is that of the mesh's own origin instead.
  bool keeps_origin = false;
};

/// What `size`, `position` and `on_ground` do to a mesh of these bounds, stretched and turned: it is scaled
/// about the origin, then shifted.
struct Settled {
  float scale;
  Eigen::Vector3f shift;
};
Settled settle(const Eigen::AlignedBox3f& bounds, const Placement& placement);

/// Moves a mesh; normals follow. Throws InputError where coordinates leave what float can hold.
void place(Mesh& mesh, const Placement& placement);

/// Joins a mesh, moved, to others.
void append(const Mesh& mesh, const Eigen::Isometry3f& pose, Mesh& all);

/// More triangles than this no mesh is refined to; a field of them would not fit anywhere.
inline constexpr std::size_t max_triangles = std::size_t{1} << 26;

/// Halves edges longer than `longest_edge`, again and again, until none is: shadows and other changes of
/// light stand on vertices. An edge is halved for both its triangles, so no gaps arise. New vertices have the
/// mean position and colour and the mean normal's direction, and of `lobes` (MeshFile) the mean, unless that
/// is empty. Throws InputError where that takes more than max_triangles, or for a length that is not above
/// zero.
void refine(Mesh& mesh, float longest_edge, std::vector<Eigen::Array4f>* lobes = nullptr);

}  // namespace refield::prt
