// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <unordered_map>

#include "core/base/aligned_memory.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/smooth_space.h"
#include "estimate/options.h"

namespace refield {

/// One way to split a rectangle in two, with what every pixel that considers it needs.
///
/// The two halves' columns a₁, a₂ add up to the parent's column p, which a fit already spans; so a split adds
/// a single direction. It is kept as d = a₁ − f p with f = ⟨a₁,p⟩/⟨p,p⟩: the same span as a₁, but with the
/// large common part taken out, so that projecting d loses no digits in float32.
struct Split {
  Box first;  ///< the half with the smaller coordinates
  Box second;
  std::array<const float*, 3> direction{};  ///< d, [stride] of each channel; null before KernelCache::make()
  std::array<float, 3> fraction{};          ///< f of each channel
  std::array<float, 3> norm2{};             ///< ‖d‖² of each channel over all images
  std::array<const float*, 3> smooth{};     ///< Vᵀd; null before KernelCache::smooth_coordinates()

  Box parent() const { return {first.x0, first.y0, second.x1, second.y1}; }
};

/// Columns of A and splits of rectangles, made on demand and shared by the pixels that one thread visits:
/// neighbouring pixels walk nearly the same tree. A pixel of 25 kernels needs about 1 MB of it, so tiles of
/// pixels run from cache. Columns are extended as
/// SmoothSpace asks.
class KernelCache {
 public:
  KernelCache(const BoxTable& table, const SmoothSpace& smooth, EstimateMode mode)
      : table_(table), smooth_(smooth), mode_(mode) {}

  const BoxTable& table() const { return table_; }

  const SmoothSpace& smooth() const { return smooth_; }

  /// The extended column of a rectangle, [extent] of each channel.
  std::array<const float*, 3> column(const Box& box);
  const float* column(const Box& box, int channel);
  /// All ways to split a rectangle: even halves in both axes, or thirds and halves. Empty for a single texel.
  /// Their directions are made on demand, since reading the table is what costs.
  std::span<Split> splits(const Box& box);
  void make(Split& split, int channel);
  /// Asks in advance for what make() will read.
  void prefetch(const Split& split, int channel) const;
  /// Vᵀd of a split that was made, [smooth rank]: see SmoothSpace. On demand, since few splits are chosen.
  const float* smooth_coordinates(Split& split, int channel);

  std::size_t bytes() const {
    constexpr std::size_t of_node = 48;  // what a map allocates for an entry besides
    return blocks_in_use_ * block_floats * sizeof(float) + columns_.size() * (sizeof(Box) + 24 + of_node) +
           splits_.size() * (sizeof(Box) + sizeof(Splits) + of_node);
  }
  /// Forgets everything; pointers handed out become invalid. Keeps the memory for what comes.
  void clear();
  /// Forgets everything where that takes more than `limit_bytes`, and keeps no more memory than that.
  void keep_within(std::uint64_t limit_bytes);

 private:
  static constexpr std::size_t block_floats = 1 << 20;  // two huge pages
  static constexpr int max_splits = 6;                  // three positions along each side
  struct Splits {
    std::array<Split, max_splits> ways;
    int count = 0;
  };
  /// Memory that is written before it is read; so it is not cleared.
  float* allocate(std::size_t floats);
  struct FreeBlock {
    std::size_t bytes;
    void operator()(float* block) const { free_aligned(block, bytes); }
  };

  const BoxTable& table_;
  const SmoothSpace& smooth_;
  EstimateMode mode_;
  std::unordered_map<Box, std::array<const float*, 3>, BoxHash> columns_;
  std::unordered_map<Box, Splits, BoxHash> splits_;
  std::vector<std::unique_ptr<float, FreeBlock>> blocks_;
  std::size_t blocks_in_use_ = 0;
  std::size_t used_of_block_ = 0;  // floats of the last one in use
};

/// Positions at which an interval [begin, end) is split in the given mode: the middle, and in refined mode
/// also the thirds. Each lies strictly inside; short intervals have fewer.
std::vector<int> split_positions(int begin, int end, EstimateMode mode);

}  // namespace refield
