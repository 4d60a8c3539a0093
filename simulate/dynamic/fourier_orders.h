// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/run_context.h"
#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

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
