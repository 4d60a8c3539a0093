// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

struct FactorOptions {
  static constexpr int max_terms = 256;

  int largest = 0;      ///< number of terms K at most; 0: as many as `error` takes, up to max_terms
  double error = 0.02;  ///< relative, asked for; the fewest terms that meet it are kept

  bool operator==(const FactorOptions&) const = default;
};

/// One function of the angle from the normal on each side, times the turns about the normal of one Fourier
/// order: one term where that is 0, else two, cosine and sine. What factor() hands to BrdfFactors.
struct RadialTerm {
  int order = 0;
  std::vector<float> incoming;           ///< [nodes], evenly in √(1 − cosθ), both ends included
  std::vector<Eigen::Array3f> outgoing;  ///< [nodes]
};

/// A BRDF as a sum of products, f(ω, ω_o) ≈ Σ_k g_k(ω_o) h_k(ω) (Iwasaki et al., eq. 2), in the local frame
/// of Brdf. h_k are scalar, g_k RGB; below the horizon all are zero. The g_k are orthonormal under the
/// cosine, Σ_c ∫ g_j g_k cosθ dω = δ_jk, the h_k orthogonal under it and the largest first: so with L_k = ∫ L
/// V h_k cosθ dω, errors of the L_k add up as squares to that of the radiance that leaves (cosine-weighted
/// over all directions). Terms of one Fourier order's pair stand next to each other: their sum, as that of
/// all terms, does not depend on how the frame is turned about the normal. Where f is reciprocal and its
/// three channels are proportional, so is the sum.
class BrdfFactors {
 public:
  BrdfFactors() = default;
  /// Sorted; all with as many nodes. `error`: see error().
  BrdfFactors(const std::vector<RadialTerm>& radial, double error);

  /// K.
  int terms() const { return terms_; }
  /// h_k [terms] of a unit direction.
  void incoming(const Eigen::Vector3f& in, std::span<float> h) const;
  /// g_k [terms].
  void outgoing(const Eigen::Vector3f& out, std::span<Eigen::Array3f> g) const;
  /// Σ g_k h_k, what they stand for: to look at, as it allocates.
  Eigen::Array3f operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const;
  /// What is left out, relative: √(∫∫ |f − Σ g_k h_k|² ∕ ∫∫ |f|²), each integral over both hemispheres and
  /// weighted by both cosines.
  double error() const { return error_; }

 private:
  std::vector<int> order_;  // [radial terms]
  int terms_ = 0, highest_order_ = 0, nodes_ = 0;
  std::vector<float> incoming_;           // [nodes × radial terms]
  std::vector<Eigen::Array3f> outgoing_;  // [nodes × radial terms]
  double error_ = 0.0;
};

/// The fewest terms that meet the error asked for, or the best `largest` ones. By singular values of the
/// sampled f, one small decomposition for each Fourier order of the azimuth between the directions: an
/// isotropic f does not mix them. Where a pair of terms no longer fits under `largest`, single terms behind
/// it may still. A diffuse surface takes one term. Samples are as fine as the lobe asks for. Of a second or
/// less up to an exponent of 1000; of some seconds for the sharpest lobes. Throws Interrupted.
BrdfFactors factor(const Brdf& brdf, const FactorOptions& options, const RunContext& run = {});

/// Largest Fourier order m of the azimuth that is looked at: with as many terms as FactorOptions allows, the
/// largest ones are of lower orders (a lobe's are like harmonics of a hemisphere, half of l² below band l).
inline constexpr int highest_fourier_order = 32;

/// Where a direction above the horizon stands among nodes that go evenly in √(1 − cosθ) from the normal to
/// the horizon: equal steps are nearly equal angles there, and take one root.
inline float node_place(const Eigen::Vector3f& direction, int nodes) {
  const float root = std::sqrt(direction.head<2>().squaredNorm() / (1.0f + direction.z()));
  return std::min(root, 1.0f) * static_cast<float>(nodes - 1);
}

/// An isotropic BRDF by Fourier orders of the azimuth between the two directions,
/// f(θ, θ_o, Δφ) = Σ_m f_m(θ, θ_o) cos mΔφ.
struct FourierOrders {
  int nodes = 0;
  Eigen::VectorXd weight;          ///< [nodes]: cosθ dω of a node, by the radian of azimuth
  std::vector<Eigen::MatrixXf> f;  ///< [orders], each [nodes θ × 3 · nodes θ_o], RGB of a θ_o together
  double energy = 0.0;             ///< Σ_c ∫∫ f² cosθ dω cosθ_o dω_o, higher orders included
};

/// Samples so fine that the lobe is resolved (to half its standard deviation; at most 256 in each angle).
/// Runs on all cores. Throws Interrupted.
FourierOrders fourier_orders(const Brdf& brdf, const RunContext& run);

}  // namespace refield::dynamic
