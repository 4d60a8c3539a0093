// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/field/light_basis.h"
#include "core/field/transfer_tiles.h"
#include "core/image/image.h"

namespace refield {

/// Sums the light of a cube map over squares whose sides are powers of two, as clusters of light are:
/// radiance times solid angle and the light vector together. Each texel is read once, and four sums of
/// squares make that of a larger one, so that nothing as large as the map is written: for a summed-area table
/// of 1024² texels per face that would be 100 MB.
class SquareSums {
 public:
  /// Whether all kernels are such squares.
  static bool can_sum(int resolution, std::span<const VectorBox> vector_boxes,
                      std::span<const SmallBox> boxes);

  /// Takes 16 bytes for each texel of a face.
  SquareSums(int resolution, std::span<const VectorBox> vector_boxes, std::span<const SmallBox> boxes);

  /// Coefficients of vector boxes, then of boxes, under `light`, [kernels × 3]: in single precision, 1e-6 of
  /// the light of a square. Copies `light` to `copy`, of the same size; false where a value is not finite.
  /// Runs on all cores.
  bool project(const ImageView& light, Image& copy, std::span<float> sums) const;

 private:
  /// Of a texel or a square: radiance × solid angle × (1, x, y, z of the direction in the face's axes).
  using Moments = Eigen::Array<float, 4, 3>;
  /// A square to be summed, at a place of its level.
  struct Square {
    std::uint32_t place = 0, kernel = 0;
    std::uint8_t level = 0;
    Eigen::Array4f weights;  ///< of the moments
  };

  Square square_of(const SmallBox& box, std::uint32_t kernel, const Eigen::Vector3f* vector) const;
  bool sum_block(const ImageView& light, Image& copy, int face, int block, std::span<float> sums,
                 std::vector<Moments>& scratch, Moments& whole) const;

  int resolution_, block_side_, blocks_, block_level_;
  std::vector<Eigen::Array4f> weights_;  // [R²], of a face's texels
  std::vector<Square> squares_;          // by block
  std::vector<std::size_t> first_;       // [faces × blocks² + 1], in squares_; then those of several blocks
};

}  // namespace refield
