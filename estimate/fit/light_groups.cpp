// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/light_groups.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/base/linear_algebra.h"

namespace refield {

namespace {

/// Each texel is added to one place in each of these parts: two texels share all places with a probability of
/// 2e-7.
constexpr int parts = 3, part_length = 171;

/// Lights are parallel if the squared sine of their angle is below this (a relative difference of 4.5 %, as
/// of 8-bit levels at a quarter of the brightness or of a measured light), and below this part of its mean
/// over all pairs: patterns on a bright ground differ little, all of them.
constexpr double parallel = 2e-3, parallel_share = 1e-2, parallel_surely = 1e-6;
/// A channel of less energy than this part of the light's is not lit.
constexpr double unlit = 1e-4;

/// splitmix64 (Steele, Lea and Flood 2014).
std::uint64_t mixed(std::uint64_t state) {
  state += 0x9e3779b97f4a7c15ull;
  state = (state ^ (state >> 30)) * 0xbf58476d1ce4e5b9ull;
  state = (state ^ (state >> 27)) * 0x94d049bb133111ebull;
  return state ^ (state >> 31);
}

}  // namespace

LightSketch sketch_of(const Image& light) {
  LightSketch sketch;
  sketch.fill(Eigen::VectorXd::Zero(parts * part_length));
  for (std::size_t i = 0; i < light.pixel_count(); ++i) {
    const float* texel = light.values.data() + 3 * i;
    if (texel[0] == 0.0f && texel[1] == 0.0f && texel[2] == 0.0f) continue;
    std::uint64_t random = mixed(i);
    for (int part = 0; part < parts; ++part, random >>= 20) {
      const double sign = random & 1 ? 1.0 : -1.0;
      const auto place =
          static_cast<Eigen::Index>(part * part_length + (random >> 1 & 0x7ffff) % part_length);
      for (int c = 0; c < 3; ++c) sketch[c][place] += sign * texel[c];
    }
  }
  return sketch;
}

std::vector<int> light_groups(std::span<const LightSketch> lights) {
  const auto images = static_cast<Eigen::Index>(lights.size());
  Eigen::MatrixXd energy(3, images);
  for (Eigen::Index j = 0; j < images; ++j)
    for (int c = 0; c < 3; ++c) energy(c, j) = lights[j][c].squaredNorm();
  // The largest squared sine over the channels in which both are lit; −1: in none.
  Eigen::MatrixXd sine2 = Eigen::MatrixXd::Constant(images, images, -1.0);
  for (int c = 0; c < 3; ++c) {
    Eigen::MatrixXd units = Eigen::MatrixXd::Zero(parts * part_length, images);
    for (Eigen::Index j = 0; j < images; ++j)
      if (energy(c, j) > unlit * energy.col(j).sum()) units.col(j) = lights[j][c].normalized();
    Eigen::MatrixXd cosines = Eigen::MatrixXd::Zero(images, images);
    cosines.selfadjointView<Eigen::Lower>().rankUpdate(units.transpose());
    for (Eigen::Index j = 0; j < images; ++j)
      for (Eigen::Index i = j + 1; i < images; ++i)
        if (cosines(i, i) > 0.0 && cosines(j, j) > 0.0)
          sine2(i, j) = std::max(sine2(i, j), std::max(1.0 - cosines(i, j) * std::abs(cosines(i, j)), 0.0));
  }
  double sum = 0.0;
  std::int64_t pairs = 0;
  for (Eigen::Index j = 0; j < images; ++j)
    for (Eigen::Index i = j + 1; i < images; ++i)
      if (sine2(i, j) >= 0.0) {
        sum += sine2(i, j);
        ++pairs;
      }
  const double limit =
      pairs > 0 ? std::clamp(parallel_share * sum / static_cast<double>(pairs), parallel_surely, parallel)
                : 0.0;
  std::vector<int> first(lights.size());  // another member, before it; itself for the first of a group
  std::iota(first.begin(), first.end(), 0);
  const auto root = [&](int j) {
    while (first[j] != j) j = first[j] = first[first[j]];
    return j;
  };
  for (int j = 0; j < images; ++j)
    for (int i = j + 1; i < images; ++i)
      if (sine2(i, j) >= 0.0 && sine2(i, j) <= limit) {
        const int a = root(i), b = root(j);
        first[std::max(a, b)] = std::min(a, b);
      }
  std::vector<int> groups(lights.size());
  int count = 0;
  for (int j = 0; j < images; ++j) groups[j] = root(j) == j ? count++ : groups[root(j)];
  return groups;
}

int light_rank(std::span<const LightSketch> lights) {
  constexpr std::size_t max_lights = 256;
  constexpr double min_share = 1e-6;  // of an eigenvalue, relative to the largest
  if (lights.empty() || lights.size() > max_lights) return static_cast<int>(lights.size());
  const auto images = static_cast<Eigen::Index>(lights.size());
  Eigen::MatrixXd units(3 * parts * part_length, images);
  for (Eigen::Index j = 0; j < images; ++j) {
    units.col(j) << lights[j][0], lights[j][1], lights[j][2];
    units.col(j).normalize();
  }
  const Eigen::VectorXd values = symmetric_eigenvalues(units.transpose() * units);
  return static_cast<int>((values.array() > min_share * values.maxCoeff()).count());
}

int count_of(std::span<const int> groups) {
  return groups.empty() ? 0 : *std::ranges::max_element(groups) + 1;
}

std::vector<std::vector<int>> members_of(std::span<const int> groups) {
  std::vector<std::vector<int>> members(count_of(groups));
  for (std::size_t j = 0; j < groups.size(); ++j) members[groups[j]].push_back(static_cast<int>(j));
  return members;
}

std::vector<std::vector<int>> repeats_in(std::span<const int> groups) {
  std::vector<std::vector<int>> members = members_of(groups);
  std::erase_if(members, [](const auto& group) { return group.size() < 2; });
  return members;
}

}  // namespace refield
