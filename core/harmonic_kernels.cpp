// SPDX-License-Identifier: Apache-2.0
#include "core/harmonic_kernels.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "core/cube_map.h"

namespace refield {

namespace {

/// Means of the harmonics over texel (x, y), by the four Gauss points of the square and their densities of
/// solid angle: exact but for the fourth power of (order ∕ resolution).
void texel_means(int order, int x, int y, int resolution, std::vector<double>& means) {
  const double off = 0.5 / std::sqrt(3.0);
  std::array<double, harmonics_of(largest_harmonics_order)> at_point;
  const auto functions = static_cast<std::size_t>(harmonics_of(order));
  means.assign(functions, 0.0);
  double total = 0.0;
  for (const double column : {x + 0.5 - off, x + 0.5 + off})
    for (const double row : {y + 0.5 - off, y + 0.5 + off}) {
      const Eigen::Vector3d direction = cube_direction(column, row, resolution);
      const double density = std::pow(direction.cwiseAbs().maxCoeff(), 3);
      evaluate_harmonics(order, direction, std::span(at_point).first(functions));
      for (std::size_t i = 0; i < functions; ++i) means[i] += density * at_point[i];
      total += density;
    }
  for (double& mean : means) mean /= total;
}

}  // namespace

float HarmonicKernels::value(int kernel, int x, int y, const LightDomain& domain) const {
  std::vector<double> means;
  texel_means(order, x, y, domain.width, means);
  return static_cast<float>((kernel % 2 == 0 ? 1.0 : -1.0) * means[static_cast<std::size_t>(kernel / 2)]);
}

HarmonicTable::HarmonicTable(const HarmonicKernels& kernels, const LightDomain& domain)
    : domain_(domain),
      functions_(static_cast<std::size_t>(harmonics_of(kernels.order))),
      values_(static_cast<std::size_t>(domain.width) * domain.height * functions_) {
  tbb::parallel_for(0, domain.height, [&](int y) {
    std::vector<double> means;
    float* to = values_.data() + static_cast<std::size_t>(y) * domain.width * functions_;
    for (int x = 0; x < domain.width; ++x) {
      texel_means(kernels.order, x, y, domain.width, means);
      for (const double mean : means) *to++ = static_cast<float>(mean);
    }
  });
}

std::vector<double> HarmonicTable::project(const Image& part, const Box& within) const {
  // Sums of a row in float, of rows in double: rows are short.
  const auto functions = static_cast<Eigen::Index>(functions_);
  constexpr int rows_at_a_time = 16;
  const int blocks = (part.height + rows_at_a_time - 1) / rows_at_a_time;
  std::vector<Eigen::ArrayXXd> of_block(static_cast<std::size_t>(blocks));
  tbb::parallel_for(0, blocks, [&](int block) {
    Eigen::ArrayXXd sum = Eigen::ArrayXXd::Zero(functions, 3);
    for (int y = block * rows_at_a_time; y < std::min(part.height, (block + 1) * rows_at_a_time); ++y) {
      const std::size_t first =
          static_cast<std::size_t>(within.y0 + y) * domain_.width + static_cast<std::size_t>(within.x0);
      const Eigen::Map<const Eigen::MatrixXf> harmonics(values_.data() + first * functions_, functions,
                                                        part.width);
      const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> light(
          part.row(y).data(), part.width, 3);
      sum += (harmonics * light).array().cast<double>();
    }
    of_block[static_cast<std::size_t>(block)] = sum;
  });
  std::vector<double> coefficients(2 * functions_ * 3, 0.0);
  for (const auto& sum : of_block)
    for (std::size_t i = 0; i < functions_; ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = sum(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(c));
        coefficients[6 * i + c] += value;
        coefficients[6 * i + 3 + c] -= value;
      }
  return coefficients;
}

}  // namespace refield
