// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/run_context.h"
#include "simulate/prt/mesh_rays.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

/// A point that gathers light from its surroundings; a zero normal: none.
struct Gatherer {
  Eigen::Vector3f position = Eigen::Vector3f::Zero();  ///< off its surface
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
};

/// Diffuse interreflection: the light that reaches points by way of other surfaces, for each direction of
/// incident light. As this changes slowly with the direction, it is computed for 8×8 cells of each cube face
/// (four directions a cell) and interpolated between their middles. Surfaces on the way reflect by their
/// diffuse part alone; how bright they are is computed at the mesh' vertices, so coarse meshes are to be
/// refined. Each point looks around by 128 rays, the same for all, so what it misses shows as bias rather
/// than noise.
class BouncedLight {
 public:
  static constexpr std::size_t block = MeshRays::packet;

  /// `bounces` ≥ 1 surfaces on the way. Throws Interrupted. `rays` are needed here alone.
  BouncedLight(const Scene& scene, const MeshRays& rays, std::span<const Gatherer> points, int bounces,
               const RunContext& run);

  /// Adds what white points [16 of a block] reflect of light that was bounced: E ∕ π for light from a unit
  /// direction, `values` [channels × 16]; one channel takes the first.
  void add(std::size_t of_block, const Eigen::Vector3f& direction, std::span<float> values) const;

 private:
  std::size_t blocks_;
  std::vector<Eigen::half> table_;  // [blocks × cells × 3 × 16]
};

/// Whether all diffuse reflectance is grey, so that bounced light has the colour of the incident light.
bool bounces_grey(const Scene& scene);

}  // namespace refield::prt
