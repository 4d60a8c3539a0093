// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

namespace refield::dynamic {

/// Products of two functions told by harmonics of one order, projected onto the same order:
/// c_i = Σ_jk Γ_ijk a_j b_k, Γ_ijk = ∫ y_i y_j y_k dω (Zhou et al. 2005, section 4). Most Γ are zero.
class HarmonicProduct {
 public:
  explicit HarmonicProduct(int order);
  /// The matrix [order² × order²] that multiplies by `b` [order²].
  Eigen::MatrixXf matrix(std::span<const float> b) const;
  std::size_t coefficients() const { return value_.size(); }

 private:
  struct Pair {
    std::uint8_t j, k;
  };
  std::vector<std::uint32_t> first_;  // [order² + 1], in the next two
  std::vector<Pair> pair_;
  std::vector<float> value_;
};

}  // namespace refield::dynamic
