// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "simulate/dynamic/brdf_factors.h"
#include "simulate/dynamic/direct_light.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/glossy_sums.h"
#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

/// Indirect light by rays from every vertex: what it sees is found once a frame, and all bounces use it.
/// Nothing depends on distances between objects, so light is right where they touch. A vertex has few rays;
/// those of its neighbours, up to two edges away and facing the same side, stand in for more (interleaved
/// sampling: Keller and Heidrich 2001). Diffuse vertices take the mean of what their neighbours receive,
/// weighted down where objects are near (Ward et al. 1988). Glossy ones evaluate the rays of their neighbours
/// for their own normals, combined by the balance heuristic (Veach and Guibas 1995). An object sends the
/// light of the vertex nearest to the hit. Limit: Embree's rays, three quarters of the time.
class GatheredLight {
 public:
  /// `scene` and `transport` must outlive it; `rays` and `transport` [objects].
  GatheredLight(const DynamicScene& scene, std::span<const prt::MeshRays> rays,
                std::span<const ObjectTransport> transport);

  /// Finds what vertices see in `count` directions each, where `rays` was moved to `poses`. Runs on all
  /// cores.
  void trace(const SceneRays& rays, std::span<const Pose> poses, int count);
  /// L_k [objects] of the next bounce. Runs on all cores.
  std::vector<TermLight> bounce(std::span<const TermLight> light);

 private:
  /// What stays as it is when an object moves.
  struct Surface {
    std::vector<Eigen::Vector3f> start;      // [vertices], of rays
    std::vector<std::uint8_t> pattern;       // [vertices]
    std::vector<std::uint32_t> near, first;  // itself and neighbours; [vertices + 1] into near
    std::vector<float> h;                    // glossy: [places of the table × padded K]
    /// Glossy: [near × rays]; weights are cosine ∕ sum of the cosines of all vertices that may have cast it.
    std::vector<RayShare> shares;
  };
  /// A hit on a glossy object: what it sends depends on the direction.
  struct GlossyHit {
    std::uint32_t object, vertex;
  };
  /// Those of some vertices' rays.
  struct GlossyHits {
    std::vector<GlossyHit> hits;
    std::vector<float> g;     // colour · g_k, RGB
    std::uint32_t first = 0;  // in sent_
  };
  struct Batch {
    std::uint32_t object, first, end;  // vertices
  };

  void set_directions(int count);
  void set_shares(std::size_t object);
  void trace(const Batch& batch, const SceneRays& rays, std::span<const Pose> poses, GlossyHits& glossy);
  void send(std::span<const TermLight> light);
  void receive_diffuse(std::size_t object, TermLight& light) const;
  void receive_glossy(std::size_t object, TermLight& light) const;
  std::span<const std::uint32_t> near(const Surface& surface, std::size_t v) const {
    return std::span(surface.near).subspan(surface.first[v], surface.first[v + 1] - surface.first[v]);
  }

  const DynamicScene& scene_;
  std::span<const ObjectTransport> transport_;
  std::vector<Surface> surfaces_;            // [objects]
  std::vector<std::uint32_t> first_vertex_;  // [objects + 1], of all
  std::vector<Batch> batches_;
  std::size_t count_ = 0;                    // rays of a vertex
  std::vector<Eigen::Vector3f> directions_;  // [patterns × count], local
  std::vector<std::uint32_t> seen_;          // [all vertices × count], where in sent_
  std::vector<float> nearness_;              // [all vertices], mean of 1 ∕ distance of what they see
  std::vector<GlossyHits> glossy_;           // [batches]
  /// Radiance that leaves diffuse vertices; nothing; then what glossy hits send.
  std::vector<Eigen::Vector4f> sent_;
};

}  // namespace refield::dynamic
