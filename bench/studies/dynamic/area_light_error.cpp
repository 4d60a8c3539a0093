// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/area_light_error.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "simulate/dynamic/brdf.h"

namespace refield::dynamic {

namespace {

constexpr int area_light_positions = 24, light_samples = 150, sights = 400;

std::vector<Eigen::Array3f> outgoing_terms(const BrdfFactors& factors, const Eigen::Vector3f& out) {
  std::vector<Eigen::Array3f> terms(static_cast<std::size_t>(factors.terms()));
  factors.outgoing(out, terms);
  return terms;
}

/// Σ h_k cosθ over an area light's points, [terms].
Eigen::VectorXf incoming_terms(const BrdfFactors& factors, const std::vector<Eigen::Vector3f>& area_light) {
  Eigen::VectorXf sum = Eigen::VectorXf::Zero(factors.terms()), terms(factors.terms());
  for (const Eigen::Vector3f& in : area_light) {
    factors.incoming(in, {terms.data(), static_cast<std::size_t>(terms.size())});
    sum += std::max(in.z(), 0.0f) * terms;
  }
  return sum;
}

Eigen::Array3f exact_radiance(const Brdf& brdf, const std::vector<Eigen::Vector3f>& area_light,
                              const Eigen::Vector3f& out) {
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (const Eigen::Vector3f& in : area_light) sum += std::max(in.z(), 0.0f) * brdf(in, out);
  return sum;
}

}  // namespace

std::vector<Eigen::Vector3f> disc_of_directions(const Eigen::Vector3f& middle, double radius, int count) {
  const Eigen::Matrix3f from_local = tangent_frame(middle).transpose();
  std::vector<Eigen::Vector3f> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1.0 - (1.0 - std::cos(radius)) * (i + 0.5) / count, across = std::sqrt(1.0 - z * z);
    const double turn = 2.0 * std::numbers::pi * (2.0 - std::numbers::phi) * i;
    directions.push_back(from_local *
                         Eigen::Vector3d(across * std::cos(turn), across * std::sin(turn), z).cast<float>());
  }
  return directions;
}

double area_light_error(const Brdf& brdf, const BrdfFactors& factors, double radius) {
  const auto outs = disc_of_directions(Eigen::Vector3f::UnitZ(), std::numbers::pi / 2, sights);
  std::vector<std::vector<Eigen::Array3f>> g;
  for (const Eigen::Vector3f& out : outs) g.push_back(outgoing_terms(factors, out));
  double wrong = 0.0, all = 0.0;
  for (const auto& middle :
       disc_of_directions(Eigen::Vector3f::UnitZ(), std::numbers::pi / 2, area_light_positions)) {
    const auto area_light = disc_of_directions(middle, radius, light_samples);
    const Eigen::VectorXf incoming = incoming_terms(factors, area_light);
    for (std::size_t o = 0; o < outs.size(); ++o) {
      const Eigen::Array3f exact = exact_radiance(brdf, area_light, outs[o]);
      Eigen::Array3f left = exact;
      for (std::size_t k = 0; k < g[o].size(); ++k) left -= incoming[static_cast<Eigen::Index>(k)] * g[o][k];
      wrong += outs[o].z() * left.matrix().squaredNorm();
      all += outs[o].z() * exact.matrix().squaredNorm();
    }
  }
  return all > 0.0 ? std::sqrt(wrong / all) : 0.0;
}

}  // namespace refield::dynamic
