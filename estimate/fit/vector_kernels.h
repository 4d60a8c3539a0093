// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "core/base/aligned_memory.h"

namespace refield {

/// The estimator's columns are vectors over the training images, padded with zeros to a multiple of this many
/// floats and aligned to cache lines, so that the kernels below need no tails.
inline constexpr std::size_t column_padding = 16;
/// And vectors of doubles to a multiple of this many.
inline constexpr std::size_t column_padding_doubles = 8;

constexpr std::size_t padded_length(std::size_t n) {
  return (n + column_padding - 1) / column_padding * column_padding;
}

/// out[k] = Σ_j vector[j] · others[k][j] for k < count; `n` a multiple of the padding.
/// Vectorised for the processor at hand (Google Highway). The limit is the load of `others`: 4 n bytes a
/// product.
void dots(const float* vector, const float* const* others, std::size_t count, std::size_t n, float* out);
void dots(const double* vector, const double* const* others, std::size_t count, std::size_t n, double* out);

/// vector[j] −= Σ_k coefficient[k] · others[k][j].
void subtract_combination(float* vector, const float* const* others, const float* coefficients,
                          std::size_t count, std::size_t n);
void subtract_combination(double* vector, const double* const* others, const double* coefficients,
                          std::size_t count, std::size_t n);

/// out[j] = (d[j] − c[j]) − (b[j] − a[j]) for j < n: what a rectangle holds, of a summed-area table at its
/// corners {a, b, c, d}, upper before lower, left before right. No alignment is asked for.
void corner_sums(const std::array<const double*, 4>& corners, std::size_t n, float* out);

/// The products of these sums with a vector and with themselves.
void corner_products(const std::array<const double*, 4>& corners, std::size_t n, const float* vector,
                     float& with_vector, float& squared);

/// gain[j] += max(correlation[j], 0)² / norm2[j] where norm2[j] > least[j]; `n` a multiple of column_padding.
void add_gains(const float* correlation, const float* norm2, const float* least, std::size_t n, float* gain);

/// Makes `vector` a unit vector orthogonal to `count` orthonormal ones, `n` as above, and returns the length
/// that it then had; 0, and a zero vector, where it depends on them to the precision of float32 sums.
/// `coordinates`: [count] products with them.
float orthonormalise(float* vector, const float* const* basis, std::size_t count, std::size_t n,
                     float* coordinates);

}  // namespace refield
