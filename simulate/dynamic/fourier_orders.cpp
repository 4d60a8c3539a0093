// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/fourier_orders.h"

#include <tbb/parallel_for.h>

#include <numbers>

#include "core/run_context.h"

namespace refield::dynamic {

namespace {

constexpr int fewest_nodes = 48, most_nodes = 256, fewest_azimuths = 96, most_azimuths = 256;

/// Radians over which the BRDF changes: of a lobe its standard deviation.
double width_of(const Brdf& brdf) {
  switch (brdf.lobe) {
    case Lobe::none:
      return 1.0;
    case Lobe::phong:
      return 1.0 / std::sqrt(std::max(1.0f, brdf.exponent));
    case Lobe::ggx:
      return std::min(0.7 * brdf.roughness, 0.04);  // the horizon asks for some
    case Lobe::table: {
      const BrdfTable& table = *brdf.table;
      const int finest = std::max({table.theta_in(), table.theta_out(), table.delta_phi() / 2});
      return std::numbers::pi / 2 / finest;
    }
  }
  return 1.0;
}

/// At the horizon itself f is zero by definition; just above it is what functions tend to.
constexpr double lowest_height = 1e-4;

/// Unit vector of a node, at azimuth 0.
Eigen::Vector3f direction_of(int node, int nodes) {
  const double root = static_cast<double>(node) / (nodes - 1);
  const double z = std::max(1.0 - root * root, lowest_height);
  return Eigen::Vector3d(std::sqrt((1.0 - z) * (1.0 + z)), 0.0, z).cast<float>();
}

/// cosθ dω of each node by the radian of azimuth; with r² = 1 − cosθ it is (1 − r²) 2r dr. None at both ends,
/// so that what microfacets grow to at the horizon itself does not count.
Eigen::VectorXd weights_of(int nodes) {
  const Eigen::ArrayXd root = Eigen::ArrayXd::LinSpaced(nodes, 0.0, 1.0);
  return (1.0 - root.square()) * 2.0 * root / (nodes - 1);
}

/// Azimuths between the two directions, from 0 to π, and what share of that interval each stands for.
struct Azimuths {
  std::vector<Eigen::Vector2f> directions;
  Eigen::VectorXd angle, share;
};

/// At the middles of even steps of u in Δφ = π (u − sin 2πu/2π): dense about the mirror direction, where
/// lobes at grazing angles are narrower than anywhere else, and as exact for smooth functions as even steps
/// are, as what is summed goes on smoothly beyond both ends.
Azimuths azimuths_of(int count) {
  Azimuths azimuths{{}, Eigen::VectorXd(count), Eigen::VectorXd(count)};
  for (int a = 0; a < count; ++a) {
    const double u = (a + 0.5) / count, turn = 2.0 * std::numbers::pi * u;
    azimuths.angle[a] = std::numbers::pi * u - 0.5 * std::sin(turn);
    azimuths.share[a] = (1.0 - std::cos(turn)) / count;
    azimuths.directions.push_back(
        Eigen::Vector2d(std::cos(azimuths.angle[a]), std::sin(azimuths.angle[a])).cast<float>());
  }
  return azimuths;
}

/// Takes samples to cosine coefficients, [orders × azimuths].
Eigen::MatrixXf cosine_transform(int orders, const Azimuths& azimuths) {
  Eigen::MatrixXf transform(orders, azimuths.angle.size());
  for (int m = 0; m < orders; ++m)
    transform.row(m) = ((m == 0 ? 1.0 : 2.0) * azimuths.share.array() * (m * azimuths.angle.array()).cos())
                           .matrix()
                           .transpose()
                           .cast<float>();
  return transform;
}

/// f from one θ to all θ_o, [azimuths × 3 · nodes].
Eigen::MatrixXf samples_from(const Brdf& brdf, int node, int nodes,
                             const std::vector<Eigen::Vector2f>& azimuths) {
  const Eigen::Vector3f in = direction_of(node, nodes);
  Eigen::MatrixXf samples(azimuths.size(), 3 * nodes);
  for (int j = 0; j < nodes; ++j) {
    const Eigen::Vector3f out = direction_of(j, nodes);
    for (std::size_t a = 0; a < azimuths.size(); ++a)
      samples.block<1, 3>(static_cast<Eigen::Index>(a), 3 * j) =
          brdf(in, {out.x() * azimuths[a].x(), out.x() * azimuths[a].y(), out.z()}).matrix().transpose();
  }
  return samples;
}

}  // namespace

FourierOrders fourier_orders(const Brdf& brdf, const RunContext& run) {
  const double width = width_of(brdf);
  FourierOrders result;
  const int nodes = result.nodes = std::clamp(static_cast<int>(4.0 / width), fewest_nodes, most_nodes);
  const int azimuth_count = std::clamp(static_cast<int>(16.0 / width), fewest_azimuths, most_azimuths);
  const int orders = std::clamp(static_cast<int>(3.0 / width), 8, highest_fourier_order) + 1;
  result.weight = weights_of(nodes);
  const Azimuths azimuths = azimuths_of(azimuth_count);
  const Eigen::MatrixXf transform = cosine_transform(orders, azimuths);
  result.f.assign(static_cast<std::size_t>(orders), Eigen::MatrixXf(nodes, 3 * nodes));
  Eigen::VectorXd energies(nodes);
  tbb::parallel_for(0, nodes, [&](int i) {
    run.throw_if_stopped();
    const Eigen::MatrixXf samples = samples_from(brdf, i, nodes, azimuths.directions);
    const Eigen::MatrixXf coefficients = transform * samples;
    for (int m = 0; m < orders; ++m) result.f[static_cast<std::size_t>(m)].row(i) = coefficients.row(m);
    double energy = 0.0;
    for (int j = 0; j < nodes; ++j)
      energy += result.weight[j] *
                azimuths.share.dot(samples.middleCols<3>(3 * j).rowwise().squaredNorm().cast<double>());
    energies[i] = 4.0 * std::numbers::pi * std::numbers::pi * result.weight[i] * energy;
  });
  result.energy = energies.sum();
  return result;
}

}  // namespace refield::dynamic
