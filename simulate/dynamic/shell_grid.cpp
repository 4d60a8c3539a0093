// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/shell_grid.h"

#include <algorithm>
#include <cmath>

namespace refield::dynamic {

ShellGrid::ShellGrid(int rings, int shells, float smallest, float largest) : rings_(rings) {
  log_smallest_ = std::log(smallest);
  log_step_ = shells > 1 ? std::log(largest / smallest) / static_cast<float>(shells - 1) : 1.0f;
  for (int s = 0; s < shells; ++s)
    radii_.push_back(std::exp(log_smallest_ + log_step_ * static_cast<float>(s)));
}

Eigen::Vector3f ShellGrid::position(std::size_t point) const {
  const std::size_t shell = point / (side() * side()), on_shell = point % (side() * side());
  const int u = static_cast<int>(on_shell % side()) - rings_,
            v = static_cast<int>(on_shell / side()) - rings_;
  const int y = rings_ - std::abs(u) - std::abs(v);
  // The lower half stands outside of the square's inner diamond, its x and z folded outwards.
  const int x = y >= 0 ? u : (u < 0 ? -1 : 1) * (rings_ - std::abs(v));
  const int z = y >= 0 ? v : (v < 0 ? -1 : 1) * (rings_ - std::abs(u));
  return radii_[shell] *
         Eigen::Vector3f(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)).normalized();
}

std::uint32_t ShellGrid::number(int x, int y, int z) const {
  const int u = y >= 0 ? x : (x < 0 ? -1 : 1) * (rings_ - std::abs(z));
  const int v = y >= 0 ? z : (z < 0 ? -1 : 1) * (rings_ - std::abs(x));
  return static_cast<std::uint32_t>(static_cast<std::size_t>(v + rings_) * side() +
                                    static_cast<std::size_t>(u + rings_));
}

ShellGrid::Corners ShellGrid::around(const Eigen::Vector3f& place) const {
  const float radius = std::max(place.norm(), 1e-30f);
  const float shell_place = (std::log(radius) - log_smallest_) / log_step_;
  const int last = static_cast<int>(radii_.size()) - 1;
  const int inner = std::clamp(static_cast<int>(std::floor(shell_place)), 0, std::max(last - 1, 0));
  const int outer = std::min(inner + 1, last);
  const float outer_share = std::clamp(shell_place - static_cast<float>(inner), 0.0f, 1.0f);
  const float falloff = radius > radii_.back() ? radii_.back() * radii_.back() / (radius * radius) : 1.0f;

  // Within the octant: a + b + c = rings, whole parts and what is left of a and c.
  const Eigen::Array3f size = place.array().abs() / std::max(place.array().abs().sum(), 1e-30f);
  const float a = size.x() * static_cast<float>(rings_), c = size.z() * static_cast<float>(rings_);
  const int ia = std::min(static_cast<int>(a), rings_ - 1),
            ic = std::min(static_cast<int>(c), rings_ - 1 - ia);
  const float fa = a - static_cast<float>(ia), fc = c - static_cast<float>(ic);
  std::array<std::array<int, 2>, 3> corner;
  std::array<float, 3> share;
  if (fa + fc <= 1.0f || ia + ic + 2 > rings_) {
    corner = {{{ia, ic}, {ia + 1, ic}, {ia, ic + 1}}};
    share = {std::max(1.0f - fa - fc, 0.0f), fa, fc};
  } else {
    corner = {{{ia + 1, ic + 1}, {ia + 1, ic}, {ia, ic + 1}}};
    share = {fa + fc - 1.0f, 1.0f - fc, 1.0f - fa};
  }
  const int sx = place.x() < 0.0f ? -1 : 1, sy = place.y() < 0.0f ? -1 : 1, sz = place.z() < 0.0f ? -1 : 1;
  Corners corners;
  const auto on_shell = static_cast<std::uint32_t>(side() * side());
  for (std::size_t i = 0; i < 3; ++i) {
    const auto [x, z] = corner[i];
    const std::uint32_t point = number(sx * x, sy * std::max(rings_ - x - z, 0), sz * z);
    corners.point[i] = static_cast<std::uint32_t>(inner) * on_shell + point;
    corners.point[i + 3] = static_cast<std::uint32_t>(outer) * on_shell + point;
    corners.weight[i] = falloff * share[i] * (1.0f - outer_share);
    corners.weight[i + 3] = falloff * share[i] * outer_share;
  }
  return corners;
}

}  // namespace refield::dynamic
