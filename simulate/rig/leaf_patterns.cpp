// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/light_maps.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "core/base/rng.h"

namespace refield {

namespace {

// docs/method/patterns.md has the experiments that chose these.
constexpr double smallest_side = 1.0 / 128,
                 largest_side = 0.7;          // geometric mean of a leaf's sides, of the width
constexpr double largest_elongation = 1.0;    // of each side, exponent of two
constexpr int design_columns = 32;            // cells of the design grid across
constexpr double shortest_kernel = 1.0 / 24;  // of the map; the longest covers it
constexpr double design_noise = 0.05;         // of the response to half of white
constexpr double mean_weight = 20.0;          // of the mean's deviation against what a pattern tells
constexpr int sweeps = 2;

/// Second moments of the mean over one interval of [0, cells) whose length is uniform in the logarithm and
/// whose place is uniform, over the parts that lie inside: Σ over lengths and places of s sᵀ, where s is the
/// covered share of each cell.
Eigen::MatrixXd interval_covariance(int cells) {
  constexpr int lengths = 24, places = 256;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(cells, cells);
  for (int l = 0; l < lengths; ++l) {
    const double length = cells * std::pow(shortest_kernel, (l + 0.5) / lengths);
    for (int p = 0; p < places; ++p) {
      const double start = -0.5 * length + cells * (p + 0.5) / places, end = start + length;
      Eigen::VectorXd share(cells);
      for (int i = 0; i < cells; ++i)
        share[i] = std::clamp(std::min(i + 1.0, end) - std::max<double>(i, start), 0.0, 1.0);
      sum += share * share.transpose() / (share.sum() * share.sum() * lengths * places);
    }
  }
  return sum;
}

}  // namespace

LeafPatterns::LeafPatterns(const LightDomain& domain, std::uint64_t seed)
    : domain_(domain),
      seed_(seed),
      columns_(std::min(design_columns, domain.width)),
      rows_(std::clamp(static_cast<int>(std::lround(1.0 * columns_ * domain.height / domain.width)), 1,
                       std::min(domain.height, 2 * design_columns))) {
  const Eigen::MatrixXd across = interval_covariance(columns_), down = interval_covariance(rows_);
  covariance_.resize(columns_ * rows_, columns_ * rows_);
  for (int j = 0; j < rows_; ++j)
    for (int i = 0; i < rows_; ++i)
      covariance_.block(i * columns_, j * columns_, columns_, columns_) = down(i, j) * across;
  noise_variance_ = design_noise * design_noise * 0.25 * covariance_.sum();
}

std::vector<LeafPatterns::Leaf> LeafPatterns::place_leaves(int number, int channel,
                                                           std::vector<int>& owner) const {
  const int width = domain_.width, height = domain_.height;
  Rng rng(seed_, 0x6c656166u, number, channel);
  owner.assign(static_cast<std::size_t>(width) * height, -1);
  std::vector<Leaf> leaves;
  // From front to back until nothing is uncovered: later leaves fill what earlier ones left.
  for (std::size_t uncovered = owner.size(); uncovered > 0;) {
    const double size = width * smallest_side * std::pow(largest_side / smallest_side, rng.uniform());
    const double elongation = std::exp2(rng.uniform(-largest_elongation, largest_elongation));
    const int w = std::max(1, static_cast<int>(std::lround(size * elongation)));
    const int h = std::max(1, static_cast<int>(std::lround(size / elongation)));
    const int x0 = static_cast<int>(std::floor(rng.uniform(-w, width))) + 1,
              y0 = static_cast<int>(std::floor(rng.uniform(-h, height))) + 1;
    std::map<int, int> texels_of_cell;
    int visible = 0;
    for (int y = std::max(0, y0); y < std::min(height, y0 + h); ++y)
      for (int x = std::max(0, x0); x < std::min(width, x0 + w); ++x) {
        int& leaf = owner[static_cast<std::size_t>(y) * width + x];
        if (leaf >= 0) continue;
        leaf = static_cast<int>(leaves.size());
        ++texels_of_cell[y * rows_ / height * columns_ + x * columns_ / width];
        ++visible;
      }
    if (visible == 0) continue;
    uncovered -= visible;
    Leaf leaf;
    leaf.area = static_cast<double>(visible) / static_cast<double>(owner.size());
    for (const auto& [cell, texels] : texels_of_cell)
      leaf.cells.emplace_back(
          cell, texels * static_cast<double>(columns_ * rows_) / static_cast<double>(owner.size()));
    leaves.push_back(std::move(leaf));
  }
  return leaves;
}

std::vector<int> LeafPatterns::choose_levels(std::vector<Leaf>& leaves, int number, int channel) {
  Rng rng(seed_, 0x6c6576656cu, number, channel);
  std::vector<int> level(leaves.size());
  for (int& l : level) l = rng.below(2) == 0 ? -1 : 1;
  Eigen::VectorXd light = Eigen::VectorXd::Zero(covariance_.rows());
  double mean = 0.0, total = 0.0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    Leaf& leaf = leaves[i];
    leaf.variance = 0.0;
    for (const auto& [a, s] : leaf.cells)
      for (const auto& [b, t] : leaf.cells) leaf.variance += s * t * covariance_(a, b);
    for (const auto& [cell, share] : leaf.cells) light[cell] += level[i] * share;
    mean += level[i] * leaf.area;
    total += leaf.variance;
  }
  Eigen::VectorXd response = covariance_ * light;
  std::vector<int> order(leaves.size());
  std::iota(order.begin(), order.end(), 0);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[rng.below(i)]);
    for (const int i : order) {
      const Leaf& leaf = leaves[i];
      double product = 0.0;
      for (const auto& [cell, share] : leaf.cells) product += share * response[cell];
      const double flipped = mean - 2.0 * level[i] * leaf.area;
      const double gain = -4.0 * (level[i] * product - leaf.variance) -
                          mean_weight * total * (flipped * flipped - mean * mean);
      if (gain <= 0.0) continue;
      for (const auto& [cell, share] : leaf.cells) response -= 2.0 * level[i] * share * covariance_.col(cell);
      mean = flipped;
      level[i] = -level[i];
    }
  }
  light.setZero();
  for (std::size_t i = 0; i < leaves.size(); ++i)
    if (level[i] > 0)
      for (const auto& [cell, share] : leaves[i].cells) light[cell] += share;
  response = covariance_ * light;
  covariance_ -= response * response.transpose() / (light.dot(response) + noise_variance_);
  return level;
}

LightMap LeafPatterns::next() {
  LightMap map{Image(domain_.width, domain_.height, 3), domain_.parameterisation};
  std::vector<int> owner;
  for (int c = 0; c < 3; ++c) {
    std::vector<Leaf> leaves = place_leaves(made_, c, owner);
    const std::vector<int> level = choose_levels(leaves, made_, c);
    for (std::size_t p = 0; p < owner.size(); ++p)
      map.radiance.values[3 * p + c] = level[owner[p]] > 0 ? 1.0f : 0.0f;
  }
  ++made_;
  return map;
}

}  // namespace refield
