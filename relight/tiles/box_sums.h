// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "core/base/aligned_memory.h"
#include "core/field/light_basis.h"
#include "core/field/transfer_tiles.h"
#include "core/image/image.h"
#include "core/light/summed_area_table.h"

/// The light inside boxes of a light map, as tiles of a field need it. LightBasis::project() is the
/// reference.
namespace refield {

inline SmallBox small_box(const Box& box) {
  return {static_cast<std::int16_t>(box.x0), static_cast<std::int16_t>(box.y0),
          static_cast<std::int16_t>(box.x1), static_cast<std::int16_t>(box.y1)};
}

/// Sums of one light over boxes.
class BoxSums {
 public:
  virtual ~BoxSums() = default;
  /// The light under boxes that only `tile` has, in the tile's order: `sums` [boxes × 4], one value per
  /// channel and an undefined one.
  virtual void sum_own(int tile, std::span<const SmallBox> boxes, float* sums) const = 0;
};

/// Sums that were computed for all tiles at once, by SquareSums or BoxProjector.
class OwnSums final : public BoxSums {
 public:
  /// `sums` [boxes × 3]; `start` [tiles]: first of each tile's boxes.
  OwnSums(const float* sums, std::span<const std::uint32_t> start) : sums_(sums), start_(start) {}
  void sum_own(int tile, std::span<const SmallBox> boxes, float* sums) const override {
    const float* from = sums_ + std::size_t{3} * start_[static_cast<std::size_t>(tile)];
    for (std::size_t k = 0; k < boxes.size(); ++k) std::copy_n(from + 3 * k, 3, sums + 4 * k);
  }

 private:
  const float* sums_;
  std::span<const std::uint32_t> start_;
};

/// A summed-area table of a light, or of a change of it.
class BoxSumTable : public BoxSums {
 public:
  /// Tabulates `light`, 3 channels; memory is kept from one light to the next. Runs on all cores. Throws
  /// InputError for other images.
  virtual void build(const Image& light) = 0;
  /// The light under any boxes: `sums` [boxes × 4], one value per channel and an undefined one.
  virtual void sum(std::span<const SmallBox> boxes, float* sums) const = 0;
  void sum_own(int, std::span<const SmallBox> boxes, float* sums) const final { sum(boxes, sums); }
};

/// SummedAreaTable, in double: for maps and precisions for which FixedPointTable is not accurate enough.
class DoubleTable final : public BoxSumTable {
 public:
  void build(const Image& light) override { table_.build(light); }
  void sum(std::span<const SmallBox> boxes, float* sums) const override;

 private:
  SummedAreaTable table_;
};

/// A summed-area table of 32-bit whole numbers: half the bytes of one in double, which matters because boxes
/// are looked up all over it. Prefix sums are rounded to steps of 2⁻³¹ of the light's total (of its
/// magnitude, where it has negative parts) and wrap around at 2³²; differences of wrapped numbers are exact,
/// and no box holds more than the total. So the sum over a box is off by at most two steps, 1e-9 of all
/// light, however it is spread: little beside any box of a map of up to some million texels, and worse than a
/// table in double for larger ones.
class FixedPointTable final : public BoxSumTable {
 public:
  void build(const Image& light) override;
  void sum(std::span<const SmallBox> boxes, float* sums) const override;
  /// What one step is worth, a channel each.
  const std::array<float, 4>& step() const { return step_; }

 private:
  std::int32_t stride() const { return width_ + 1; }

  int width_ = 0;
  /// Corner (x, y) of the table, x in [0, width], y in [0, height], is at 3 · (y · stride() + x); one number
  /// more may be read behind the last.
  std::vector<std::int32_t, AlignedAllocator<std::int32_t>> corners_;
  std::vector<double> columns_;  // sums of each strip's columns
  std::array<float, 4> step_ = {0.0f, 0.0f, 0.0f, 0.0f};
};

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
  /// Moments of a texel or a square: radiance × solid angle × (1, x, y, z of the direction in the face's
  /// axes).
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
