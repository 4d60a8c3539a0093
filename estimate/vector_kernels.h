// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>

#include "estimate/aligned_memory.h"

namespace refield {

/// The estimator's columns are vectors over the training images, padded with zeros to a multiple of this many
/// floats and aligned to cache lines, so that the kernels below need no tails.
inline constexpr std::size_t column_padding = 16;

constexpr std::size_t padded_length(std::size_t n) {
  return (n + column_padding - 1) / column_padding * column_padding;
}

/// out[k] = Σ_j vector[j] · others[k][j] for k < count; `n` a multiple of column_padding.
/// Vectorised for the processor at hand (Google Highway). The limit is the load of `others`: 4 n bytes a
/// product.
void dots(const float* vector, const float* const* others, std::size_t count, std::size_t n, float* out);

/// Cholesky factorisation in place: A [size × size], symmetric, column by column with leading dimension
/// `stride` (a multiple of cholesky_padding; memory behind the last row is written to). Its lower triangle
/// becomes L with the inverse of the diagonal in place of the diagonal. Returns the first column whose pivot
/// is not above `least_pivot` times its diagonal, or −1. Columns are updated as whole vectors: dot products
/// would wait for their own sums.
int factorise_cholesky(double* A, std::size_t size, std::size_t stride, double least_pivot);
inline constexpr std::size_t cholesky_padding = 8;

/// vector[j] −= Σ_k coefficient[k] · others[k][j].
void subtract_combination(float* vector, const float* const* others, const float* coefficients,
                          std::size_t count, std::size_t n);

/// gain[j] += max(correlation[j], 0)² / norm2[j] where norm2[j] > least[j]; `n` a multiple of column_padding.
void add_gains(const float* correlation, const float* norm2, const float* least, std::size_t n, float* gain);

/// Makes `vector` a unit vector orthogonal to `count` orthonormal ones, `n` as above, and returns the length
/// that it then had; 0, and a zero vector, where it depends on them to the precision of float32 sums.
/// `coordinates`: [count] products with them.
float orthonormalise(float* vector, const float* const* basis, std::size_t count, std::size_t n,
                     float* coordinates);

}  // namespace refield
