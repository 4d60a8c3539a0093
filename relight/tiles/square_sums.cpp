// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/box_sums.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <bit>
#include <cmath>

#include "core/light/cube_map.h"

namespace refield {

namespace {

/// A block's sums of 2×2 texels and more, 64 KB, stay in the second-level cache.
constexpr int largest_block = 64;

int level_of(const SmallBox& box) {
  return std::countr_zero(static_cast<unsigned>(box.x1 - box.x0));
}

bool is_power_of_two(int number) {
  return number > 0 && (number & (number - 1)) == 0;
}

}  // namespace

bool SquareSums::can_sum(int resolution, std::span<const VectorBox> vector_boxes,
                         std::span<const SmallBox> boxes) {
  const auto is_square = [&](const SmallBox& box) {
    const int side = box.x1 - box.x0;
    return is_power_of_two(side) && side <= resolution && box.y1 - box.y0 == side && box.x0 % side == 0 &&
           box.y0 % side == 0;
  };
  return is_power_of_two(resolution) && std::ranges::all_of(boxes, is_square) &&
         std::ranges::all_of(vector_boxes,
                             [&](const VectorBox& kernel) { return is_square(small_box(kernel.box)); });
}

SquareSums::SquareSums(int resolution, std::span<const VectorBox> vector_boxes,
                       std::span<const SmallBox> boxes)
    : resolution_(resolution),
      block_side_(std::min(resolution, largest_block)),
      blocks_(resolution / block_side_),
      block_level_(std::countr_zero(static_cast<unsigned>(block_side_))),
      weights_(static_cast<std::size_t>(resolution) * resolution) {
  const std::vector<float> angles = cube_solid_angles(resolution);
  tbb::parallel_for(0, resolution, [&](int y) {
    for (int x = 0; x < resolution; ++x) {
      const std::size_t at =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(resolution) + static_cast<std::size_t>(x);
      const Eigen::Vector3f direction = cube_mean_direction(x, y, resolution).cast<float>();
      weights_[at] << 1.0f, direction.x(), direction.y(), direction.z();
      weights_[at] *= angles[at];
    }
  });
  std::uint32_t kernel = 0;
  std::vector<std::pair<std::size_t, Square>> found;
  const auto add = [&](const SmallBox& box, const Eigen::Vector3f* vector) {
    const Square square = square_of(box, kernel++, vector);
    const int face = box.y0 / resolution_, top = box.y0 % resolution_;
    const auto all = static_cast<std::size_t>(cube_faces) * blocks_ * blocks_;
    const std::size_t block =
        static_cast<std::size_t>(face * blocks_ + top / block_side_) * blocks_ + box.x0 / block_side_;
    found.emplace_back(square.level > block_level_ ? all : block, square);
  };
  for (const VectorBox& vector_box : vector_boxes) add(small_box(vector_box.box), &vector_box.vector);
  for (const SmallBox& box : boxes) add(box, nullptr);
  std::ranges::stable_sort(found, {}, [](const auto& placed) { return placed.first; });
  first_.assign(static_cast<std::size_t>(cube_faces) * blocks_ * blocks_ + 1, 0);
  for (const auto& [block, square] : found) {
    squares_.push_back(square);
    if (block + 1 < first_.size()) ++first_[block + 1];
  }
  for (std::size_t b = 1; b < first_.size(); ++b) first_[b] += first_[b - 1];
}

SquareSums::Square SquareSums::square_of(const SmallBox& box, std::uint32_t kernel,
                                         const Eigen::Vector3f* vector) const {
  Square square;
  square.kernel = kernel;
  square.level = static_cast<std::uint8_t>(level_of(box));
  const int face = box.y0 / resolution_, top = box.y0 % resolution_;
  const bool in_block = square.level <= block_level_;
  const int side = in_block ? block_side_ : resolution_;
  const int across = side >> square.level;
  square.place =
      static_cast<std::uint32_t>((top % side >> square.level) * across + (box.x0 % side >> square.level) +
                                 (in_block ? 0 : face * across * across));
  square.weights << 1.0f, 0.0f, 0.0f, 0.0f;
  if (vector) {
    const Eigen::Vector3f on_face = cube_face_axes(face).cast<float>() * *vector;
    square.weights << 0.0f, on_face.x(), on_face.y(), on_face.z();
  }
  return square;
}

namespace {

/// The level above: sums of four.
template <class Moments>
void add_up(const Moments* from, int across, Moments* to) {
  for (int y = 0; y < across; y += 2)
    for (int x = 0; x < across; x += 2) {
      const Moments* upper = from + static_cast<std::ptrdiff_t>(y) * across + x;
      *to++ = (upper[0] + upper[1]) + (upper[across] + upper[across + 1]);
    }
}

template <class Moments>
void store(const Moments& moments, const Eigen::Array4f& weights, float* sum) {
  // In double: values of large vectors nearly cancel.
  for (Eigen::Index c = 0; c < 3; ++c)
    sum[c] = static_cast<float>((moments.col(c).template cast<double>() * weights.cast<double>()).sum());
}

}  // namespace

bool SquareSums::sum_block(const ImageView& light, Image& copy, int face, int block, std::span<float> sums,
                           std::vector<Moments>& scratch, Moments& whole) const {
  const int x0 = block % blocks_ * block_side_, y0 = block / blocks_ * block_side_;
  const auto values = static_cast<std::size_t>(block_side_) * 3;
  const bool is_dense = light.channel_stride == 1 && light.pixel_stride == 3;
  for (int y = y0; y < y0 + block_side_; ++y) {
    const int row = face * resolution_ + y;
    float* out = &copy.at(x0, row, 0);
    if (is_dense) {
      const float* in = light.values + row * light.row_stride + std::ptrdiff_t{3} * x0;
      std::copy_n(in, values, out);
    } else {
      for (int x = 0; x < block_side_; ++x)
        for (int c = 0; c < 3; ++c) out[3 * x + c] = light.at(x0 + x, row, c);
    }
  }
  const auto texel = [&](int x, int y) -> Moments {
    const Eigen::Array4f& weights =
        weights_[static_cast<std::size_t>(y) * static_cast<std::size_t>(resolution_) +
                 static_cast<std::size_t>(x)];
    const float* radiance = &copy.at(x, face * resolution_ + y, 0);
    Moments moments;
    for (Eigen::Index c = 0; c < 3; ++c) moments.col(c) = weights * radiance[c];
    return moments;
  };
  // Levels from 2×2 texels on, one after another.
  std::array<std::size_t, 16> level{};
  Moments* pairs = scratch.data();
  for (int y = y0; y + 1 < y0 + block_side_; y += 2)
    for (int x = x0; x + 1 < x0 + block_side_; x += 2)
      *pairs++ = (texel(x, y) + texel(x + 1, y)) + (texel(x, y + 1) + texel(x + 1, y + 1));
  for (int l = 1; l < block_level_; ++l) {
    const int across = block_side_ >> l;
    level[static_cast<std::size_t>(l) + 1] =
        level[static_cast<std::size_t>(l)] +
        static_cast<std::size_t>(across) * static_cast<std::size_t>(across);
    add_up(scratch.data() + level[static_cast<std::size_t>(l)], across,
           scratch.data() + level[static_cast<std::size_t>(l) + 1]);
  }
  whole = block_level_ == 0 ? texel(x0, y0) : scratch[level[static_cast<std::size_t>(block_level_)]];
  // What is not finite makes its block's sums so; so do very large values, seldom.
  if (!whole.isFinite().all())
    for (int y = y0; y < y0 + block_side_; ++y)
      if (!std::ranges::all_of(std::span(&copy.at(x0, face * resolution_ + y, 0), values),
                               [](float value) { return std::isfinite(value); }))
        return false;
  const std::size_t number =
      static_cast<std::size_t>(face) * blocks_ * blocks_ + static_cast<std::size_t>(block);
  for (std::size_t i = first_[number]; i < first_[number + 1]; ++i) {
    const Square& square = squares_[i];
    const auto side = static_cast<std::uint32_t>(block_side_);
    const Moments moments = square.level == 0 ? texel(x0 + static_cast<int>(square.place % side),
                                                      y0 + static_cast<int>(square.place / side))
                                              : scratch[level[square.level] + square.place];
    store(moments, square.weights, sums.data() + std::size_t{3} * square.kernel);
  }
  return true;
}

bool SquareSums::project(const ImageView& light, Image& copy, std::span<float> sums) const {
  const int in_face = blocks_ * blocks_;
  std::vector<Moments> of_blocks(static_cast<std::size_t>(cube_faces) * in_face);
  std::atomic<bool> finite = true;
  tbb::enumerable_thread_specific<std::vector<Moments>> scratches(
      [&] { return std::vector<Moments>(static_cast<std::size_t>(block_side_) * block_side_ / 2 + 1); });
  // All faces in turn: the weights of a block's texels are the same for them, and stay in the cache.
  tbb::parallel_for(0, in_face, [&](int block) {
    for (int face = 0; face < cube_faces; ++face)
      if (!sum_block(light, copy, face, block, sums, scratches.local(),
                     of_blocks[static_cast<std::size_t>(face) * in_face + static_cast<std::size_t>(block)]))
        finite = false;
  });
  if (!finite) return false;
  std::vector<Moments> larger;
  int level = block_level_;
  for (int across = blocks_; across > 1; across /= 2) {
    larger.resize(of_blocks.size() / 4);
    for (int face = 0; face < cube_faces; ++face)
      add_up(of_blocks.data() + static_cast<std::ptrdiff_t>(face) * across * across, across,
             larger.data() + static_cast<std::ptrdiff_t>(face) * across * across / 4);
    std::swap(of_blocks, larger);
    ++level;
    for (std::size_t i = first_.back(); i < squares_.size(); ++i)
      if (squares_[i].level == level)
        store(of_blocks[squares_[i].place], squares_[i].weights,
              sums.data() + std::size_t{3} * squares_[i].kernel);
  }
  return true;
}

}  // namespace refield
