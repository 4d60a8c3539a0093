// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/run_context.h"
#include "simulate/prt/harmonic_transfer.h"
#include "simulate/prt/mesh_rays.h"
#include "simulate/prt/surface_response.h"

namespace refield::prt {

using RowMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// For each vertex and channel a matrix I: row i, the harmonics of light that arrives times its cosine
/// (I_0 alone where all is diffuse); column j, the harmonics of the scene's light.
struct ArrivingLight {
  int rows = 0, columns = 0, channels = 0;
  std::vector<float> values;  ///< [vertices × rows × channels × columns]

  ArrivingLight(std::size_t vertices, int rows, int columns, int channels);
  using Strided = Eigen::Map<RowMatrix, 0, Eigen::OuterStride<>>;
  using ConstStrided = Eigen::Map<const RowMatrix, 0, Eigen::OuterStride<>>;
  Strided of(std::size_t vertex, int channel);
  ConstStrided of(std::size_t vertex, int channel) const;

 private:
  std::size_t start(std::size_t vertex, int channel) const;
};

/// The passes of harmonic_transfer(). Keeps, as the paper does, a bit for each vertex and direction: whether
/// a ray that way meets a surface that reflects, so that interreflection traces those alone.
class HarmonicPasses {
 public:
  HarmonicPasses(const Scene& scene, const HarmonicOptions& options, const SurfaceResponse& response);

  /// One channel: what lies in the way dims all alike.
  ArrivingLight shadow(const RunContext& run = {});
  /// Light that arrives by one reflection more than `before`. All its channels.
  ArrivingLight interreflection(const ArrivingLight& before, const RunContext& run = {});

 private:
  static constexpr std::size_t block = MeshRays::packet;
  struct Block;  // successive vertices and their samples' weights
  struct Sight;  // a sample of the light sphere as a vertex sees it

  void see_distant(Block& block);
  void see_near(Block& block) const;
  Sight sight_of(const Eigen::Vector3f& from, std::size_t sample) const;
  void integrate(const Block& block, std::size_t lane, ArrivingLight& light) const;
  /// What surfaces send out of the light that arrives.
  ArrivingLight reflect(const ArrivingLight& light) const;
  /// The front that a ray from a vertex meets.
  std::optional<MeshHit> reflector(std::size_t vertex, std::size_t sample) const;
  /// The first `count` harmonics of the line of sight along a ray, mirrored where the ray meets a surface.
  Eigen::RowVectorXf mirrored_harmonics(const MeshHit& hit, const Eigen::Vector3f& direction,
                                        int count) const;
  void gather(std::size_t vertex, const ArrivingLight& sent, ArrivingLight& light);

  std::uint64_t* blocked_of(std::size_t vertex) { return &blocked_[vertex * words_]; }
  std::size_t samples() const { return directions_.size(); }

  const Scene& scene_;
  const HarmonicOptions& options_;
  const SurfaceResponse& response_;
  MeshRays rays_;
  Eigen::Vector3f middle_;
  std::vector<Eigen::Vector3f> directions_;
  RowMatrix harmonics_;  // [samples × order²]
  float solid_angle_;    // of a sample
  std::size_t words_;    // of a vertex' bits
  std::vector<std::uint64_t> blocked_;
};

}  // namespace refield::prt
