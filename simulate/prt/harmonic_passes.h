// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/prt/harmonic_transfer.h"
#include "simulate/prt/prt_scene.h"

namespace refield::prt {

/// Band factors λ_l, l < order, of Material's lobe (n + 2)/2π · tⁿ over t > 0: what it leaves of band l when
/// it averages light around a direction, 2π ∫ lobe(t) P_l(t) dt (Funk and Hecke). In closed form:
/// λ_0 = (n + 2)/(n + 1), λ_1 = 1, λ_l = λ_(l−2) (n − l + 2)/(n + l + 1).
std::vector<double> lobe_factors(double exponent, int order);

using RowMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// How the vertices of a scene reflect harmonics of the light that arrives at them times its cosine, I_i,
/// over the mirrored line of sight R: radiance(R) = Σ_i response_i I_i y_i(R). A lobe takes the harmonics one
/// by one, a diffuse surface the mean: kd/π · I_0/y_00, as a constant over R the coefficient 4 kd I_0. The
/// lobe of a GGX material is multiplied by its GgxGain at R · normal, which mixes the harmonics.
class SurfaceResponse {
 public:
  SurfaceResponse(const Scene& scene, int order);

  /// 1 where the whole scene is diffuse (I_0 alone matters), else order².
  int outputs() const { return outputs_; }
  /// Whether all vertices reflect the three channels alike.
  bool is_grey() const { return grey_; }
  /// What a field multiplies a vertex by last: its diffuse or specular reflectance, white where it has both.
  Eigen::Array3f colour(std::size_t vertex) const;
  /// What a vertex sends in each of `channels` (1 where they are alike, or 3), [outputs × columns of the
  /// light]; `light` [1 or 3 channels]; with colour() or before it.
  std::vector<RowMatrix> reflect(std::size_t vertex, std::span<const RowMatrix> light, int channels,
                                 bool with_colour) const;

 private:
  /// Scale and offset as matrices over the harmonics of the mirrored line of sight.
  std::array<RowMatrix, 2> gain(std::size_t vertex) const;
  const Material& material(std::size_t vertex) const {
    return scene_->materials[scene_->material_of_vertex[vertex]];
  }
  Eigen::Array3f diffuse(std::size_t vertex) const;

  const Scene* scene_;
  int outputs_ = 1;
  bool grey_ = true;
  std::vector<Eigen::VectorXf> lobe_;               // [materials][order²]
  std::vector<std::optional<GgxGain>> gain_;        // [materials]
  Eigen::Matrix<float, Eigen::Dynamic, 3> sights_;  // where gains are sampled; no rows: there are none
  RowMatrix at_sights_;                             // [sights × order²]
};

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
  std::vector<RowMatrix> channels_of(std::size_t vertex) const;

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
