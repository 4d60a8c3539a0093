// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "estimate/fit/box_table.h"
#include "estimate/fit/vector_kernels.h"

namespace refield {

/// How strongly a smooth part of a pixel's transport is expected: the ratio λ of noise variance to the
/// variance that the smooth part causes in the samples. A small λ trusts the smooth part; the last class has
/// none.
struct SmoothClass {
  bool smooth = false;
  /// [3][rank]: what a product of two vectors Vᵀa is weighted with, see SmoothSpace; ≤ 0.
  std::array<std::vector<float>, 3> correction;
  double log_determinant = 0.0;  ///< Σ log(1 + w_k/λ) over directions and channels
  /// [3][hats × hats]: λ C⁻¹ in the units of the hats' Gram matrix, the prior's part of the normal equations.
  std::array<std::vector<double>, 3> penalty;
};

/// The smooth part of light transport: hat functions H whose weights follow a Gaussian process over the light
/// map (Matérn covariance C, ν = 3/2: Rasmussen and Williams 2006, eq. 4.17), so that neighbouring weights
/// are alike. What the samples say of it lives in the few directions V that the hats' sums over the training
/// lights span: K = HCHᵀ = V diag(w) Vᵀ.
///
/// Choosing rectangles beside a smooth part whose weights are integrated out is least squares in the metric
/// of P = (I + K/λ)⁻¹, which differs from I in the directions V alone: aᵀP b = aᵀb − Σ w_k/(w_k+λ) (Vᵀa)_k
/// (Vᵀb)_k. So a vector over the images that carries its Vᵀa behind it serves all classes.
class SmoothSpace {
 public:
  /// With the hats of the table; without any: a space of rank 0 whose single class has no smooth part.
  explicit SmoothSpace(const BoxTable& table);

  int hats() const { return hats_; }
  int rank() const { return rank_; }
  /// Floats of one channel of an extended vector: its values over the images [stride], then Vᵀa [rank],
  /// padded.
  std::size_t extent() const { return stride_ + padded_length(rank_); }
  std::size_t stride() const { return stride_; }
  const std::vector<SmoothClass>& classes() const { return classes_; }
  int class_without() const { return static_cast<int>(classes_.size()) - 1; }

  /// Vᵀa of one channel's vector a: [rank, padded].
  void project(const float* vector, int channel, float* coordinates) const;
  /// Writes it behind the vector.
  void extend(float* vector, int channel) const { project(vector, channel, vector + stride_); }
  /// Hᵀa from Vᵀa: [hats].
  void hat_products(const float* coordinates, int channel, double* products) const;
  /// HᵀH, [hats × hats].
  const std::vector<double>& hat_gram(int channel) const { return hat_gram_[channel]; }
  /// A hat's sums over the lights, [stride].
  const float* hat_column(int hat, int channel) const {
    return hat_columns_[channel].data() + static_cast<std::size_t>(hat) * stride_;
  }

 private:
  void analyse(const BoxTable& table, int channel);

  int hats_ = 0;
  int rank_ = 0;
  std::size_t stride_;
  std::array<AlignedFloats, 3> directions_;     // V, [rank × stride]
  std::array<std::vector<double>, 3> to_hats_;  // [hats × rank]
  std::array<std::vector<double>, 3> hat_gram_;
  std::array<AlignedFloats, 3> hat_columns_;
  std::vector<SmoothClass> classes_;
};

/// The grid of hats that suits a light map and a cap on the kernels of a pixel: nodes about equally far apart
/// in both directions, at most 20; none where the cap or the light map is too small.
HatGrid hat_grid_for(const LightDomain& domain, int kernels);

}  // namespace refield
