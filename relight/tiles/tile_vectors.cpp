// SPDX-License-Identifier: Apache-2.0
#include "relight/tiles/tile_vectors.h"

// Vectors of four floats on any machine. Highway goes without them under GCC 12, whose bug 106322 (products'
// upper halves) does not concern what is used here.
#define HWY_BROKEN_EMU128 0

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "relight/tiles/tile_vectors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Rgb = hn::FixedTag<float, 4>;
using Whole4 = hn::FixedTag<std::int32_t, 4>;
using Lanes = hn::CappedTag<float, group_pixels>;

/// Where the corners of boxes lie in a table of three numbers a corner. `straight`: (x0, y0) and (x1, y1) of
/// each box, `crossed`: (x1, y0) and (x0, y1). Reads and writes box_batch boxes.
constexpr std::size_t box_batch = 32;
HWY_INLINE void locate_corners(const SmallBox* boxes, std::int32_t stride,
                               std::int32_t* HWY_RESTRICT straight, std::int32_t* HWY_RESTRICT crossed) {
  const hn::CappedTag<std::int32_t, 2 * box_batch> d;
  const auto in_row = hn::Set(d, 0xffff);
  const auto row = hn::Set(d, 3 * stride);
  const auto* corners = reinterpret_cast<const std::int32_t*>(boxes);  // x in the low half, y in the high one
  for (std::size_t i = 0; i < 2 * box_batch; i += hn::Lanes(d)) {
    const auto corner = hn::LoadU(d, corners + i);
    const auto y = hn::Mul(hn::ShiftRight<16>(corner), row);
    const auto column = hn::And(corner, in_row);
    const auto x = hn::Add(hn::Add(column, column), column);
    hn::Store(hn::Add(y, x), d, straight + i);
    hn::Store(hn::Add(y, hn::Shuffle2301(x)), d, crossed + i);
  }
}

void sum_boxes_fixed_vectorised(const std::int32_t* HWY_RESTRICT corners, std::int32_t stride,
                                const float* HWY_RESTRICT step, const SmallBox* HWY_RESTRICT boxes,
                                std::size_t count, float* HWY_RESTRICT sums) {
  const Whole4 whole;
  const Rgb rgb;
  const auto worth = hn::LoadU(rgb, step);
  const auto corner = [&](std::int32_t place) { return hn::LoadU(whole, corners + place); };
  HWY_ALIGN std::int32_t straight[2 * box_batch];
  HWY_ALIGN std::int32_t crossed[2 * box_batch];
  SmallBox last[box_batch];
  for (std::size_t first = 0; first < count; first += box_batch) {
    const std::size_t batch = HWY_MIN(box_batch, count - first);
    if (batch < box_batch) std::copy_n(boxes + first, batch, last);
    locate_corners(batch < box_batch ? last : boxes + first, stride, straight, crossed);
    for (std::size_t k = 0; k < batch; ++k) {
      const auto sum = hn::Sub(hn::Add(corner(straight[2 * k]), corner(straight[2 * k + 1])),
                               hn::Add(corner(crossed[2 * k]), corner(crossed[2 * k + 1])));
      hn::StoreU(hn::Mul(hn::ConvertTo(rgb, sum), worth), rgb, sums + 4 * (first + k));
    }
  }
}

/// Whole numbers of 8 or 16 bits to float.
template <class D, class Weight>
HWY_INLINE auto widened(D d, const Weight* weights) {
  const hn::Rebind<Weight, D> narrow;
  const hn::Rebind<std::int32_t, D> wide;
  return hn::ConvertTo(d, hn::PromoteTo(wide, hn::LoadU(narrow, weights)));
}

template <class Weight, class V>
HWY_INLINE void add_uses(const SparseWeights<Weight>* uses, std::size_t count, V light,
                         float* HWY_RESTRICT pixels) {
  const Rgb rgb;
  // The fourth weight is the pixel's number, and what the fourth sums come to is never looked at.
  for (std::size_t i = 0; i < count; ++i) {
    float* sum = pixels + 4 * uses[i].pixel;
    hn::Store(hn::MulAdd(widened(rgb, uses[i].channel), light, hn::Load(rgb, sum)), rgb, sum);
  }
}

/// Prefetches the next tile, a cache line at a time, while this one is multiplied: asked for all at once, the
/// lines would wait for one another and what this tile needs would wait behind them. Starts where all light
/// needs a tile and ends one line behind it, at the lengths of the tile that follows.
class LinesAhead {
 public:
  template <class Weight>
  explicit HWY_INLINE LinesAhead(const Tile<Weight>& next)
      : line_(reinterpret_cast<const char*>(next.support.data() + next.common.size())),
        end_(reinterpret_cast<const char*>(next.record_weight.data() + next.record_weight.size()) + 64) {}
  HWY_INLINE void prefetch_one() {
    __builtin_prefetch(line_);
    if (line_ < end_) line_ += 64;
  }
  HWY_INLINE void prefetch_rest() {
    for (; line_ < end_; line_ += 64) __builtin_prefetch(line_);
  }

 private:
  const char* line_;
  const char* end_;
};

/// Adds the dense weights of one group; `light` [dense kernels × 4].
template <bool grey, class Weight>
HWY_INLINE void add_group(const Tile<Weight>& tile, const float* HWY_RESTRICT light, std::size_t group,
                          LinesAhead& ahead, float* HWY_RESTRICT pixels) {
  const Lanes d;
  const Rgb rgb;
  HWY_ALIGN float factor[4];
  for (std::size_t lane = 0; lane < group_pixels; lane += hn::Lanes(d)) {
    auto red = hn::Zero(d), green = hn::Zero(d), blue = hn::Zero(d);
    for (std::size_t r = tile.group[group]; r < tile.group[group + 1]; ++r) {
      hn::Store(hn::Mul(hn::LoadU(rgb, light + std::size_t{4} * tile.record_kernel[r]),
                        hn::Set(rgb, tile.record_scale[r])),
                rgb, factor);
      constexpr std::size_t record = (grey ? 1 : 3) * group_pixels, apart = grey ? 0 : group_pixels;
      const Weight* weights = tile.record_weight.data() + r * record + lane;
      ahead.prefetch_one();
      red = hn::MulAdd(widened(d, weights), hn::Set(d, factor[0]), red);
      green = hn::MulAdd(widened(d, weights + apart), hn::Set(d, factor[1]), green);
      blue = hn::MulAdd(widened(d, weights + 2 * apart), hn::Set(d, factor[2]), blue);
    }
    hn::Store(red, d, pixels + lane);
    hn::Store(green, d, pixels + group_pixels + lane);
    hn::Store(blue, d, pixels + 2 * group_pixels + lane);
  }
}

template <class Weight>
HWY_INLINE void sum_all(const Tile<Weight>& tile, const float* HWY_RESTRICT light,
                        float* HWY_RESTRICT dense_light, const Tile<Weight>& next, TileSums& sums) {
  const Rgb rgb;
  sums.has_sparse = !tile.sparse.empty();
  if (sums.has_sparse) hwy::ZeroBytes<sizeof sums.sparse>(sums.sparse);
  const SparseWeights<Weight>* uses = tile.sparse.data();
  const float* scale = tile.scale.data();
  const auto scaled = [&](std::size_t k) {
    return hn::Mul(hn::LoadU(rgb, light + 4 * k), hn::Set(rgb, scale[k]));
  };
  LinesAhead ahead(next);
  std::size_t kernel = 0;
  for (const auto run : tile.runs) {
    const std::size_t end = kernel + run.kernels;
    if (run.uses == 1)
      for (std::size_t k = kernel; k < end; ++k) {
        if (k % 8 == 0) ahead.prefetch_one();
        add_uses<Weight>(uses++, 1, scaled(k), sums.sparse);
      }
    else if (run.uses > 1)
      for (std::size_t k = kernel; k < end; ++k, uses += run.uses) {
        ahead.prefetch_one();
        add_uses<Weight>(uses, run.uses, scaled(k), sums.sparse);
      }
    kernel = end;
  }
  for (std::size_t i = 0; i < tile.dense_kernels.size(); ++i)
    hn::StoreU(hn::LoadU(rgb, light + std::size_t{4} * tile.dense_kernels[i]), rgb, dense_light + 4 * i);
  const bool grey = tile.is_grey();
  for (std::size_t g = 0; g < groups_of_tile; ++g) {
    float* pixels = sums.dense + g * 3 * group_pixels;
    if (grey)
      add_group<true>(tile, dense_light, g, ahead, pixels);
    else
      add_group<false>(tile, dense_light, g, ahead, pixels);
  }
  ahead.prefetch_rest();
}

template <bool grey, class Weight>
HWY_INLINE void add_touched_records(const Tile<Weight>& tile, const TouchedWeights& touched,
                                    const float* HWY_RESTRICT light, float* HWY_RESTRICT dense) {
  const Lanes d;
  constexpr std::size_t record = (grey ? 1 : 3) * group_pixels, apart = grey ? 0 : group_pixels;
  for (const auto& entry : touched.dense) {
    const Weight* weights = tile.record_weight.data() + std::size_t{entry.record} * record;
    const float* own_light = light + std::size_t{4} * entry.light;
    const float scale = tile.record_scale[entry.record];
    float* pixels = dense + std::size_t{entry.group} * 3 * group_pixels;
    for (std::size_t lane = 0; lane < group_pixels; lane += hn::Lanes(d)) {
      const auto first = widened(d, weights + lane);
      for (std::size_t c = 0; c < 3; ++c) {
        const auto values = grey || c == 0 ? first : widened(d, weights + c * apart + lane);
        float* sum = pixels + c * group_pixels + lane;
        hn::Store(hn::MulAdd(values, hn::Set(d, own_light[c] * scale), hn::Load(d, sum)), d, sum);
      }
    }
  }
}

template <class Weight>
HWY_INLINE std::uint32_t sum_touched_by(const Tile<Weight>& tile, const TouchedWeights& touched,
                                        const float* HWY_RESTRICT light, TileSums& sums) {
  const Rgb rgb;
  std::uint32_t groups = 0;
  sums.has_sparse = !touched.sparse.empty();
  if (sums.has_sparse) hwy::ZeroBytes<sizeof sums.sparse>(sums.sparse);
  for (const auto& entry : touched.sparse) {
    const SparseWeights<Weight>* uses = tile.sparse.data() + entry.first_use;
    const auto scaled =
        hn::Mul(hn::LoadU(rgb, light + std::size_t{4} * entry.light), hn::Set(rgb, tile.scale[entry.kernel]));
    add_uses<Weight>(uses, entry.uses, scaled, sums.sparse);
    for (std::size_t i = 0; i < entry.uses; ++i) groups |= 1u << (uses[i].pixel / group_pixels);
  }
  hwy::ZeroBytes<sizeof sums.dense>(sums.dense);
  if (tile.is_grey())
    add_touched_records<true>(tile, touched, light, sums.dense);
  else
    add_touched_records<false>(tile, touched, light, sums.dense);
  for (const auto& entry : touched.dense) groups |= 1u << entry.group;
  return groups;
}

void sum_all_8(const Tile<std::uint8_t>& tile, const float* light, float* dense_light,
               const Tile<std::uint8_t>& next, TileSums& sums) {
  sum_all(tile, light, dense_light, next, sums);
}
void sum_all_16(const Tile<std::uint16_t>& tile, const float* light, float* dense_light,
                const Tile<std::uint16_t>& next, TileSums& sums) {
  sum_all(tile, light, dense_light, next, sums);
}
std::uint32_t sum_touched_8(const Tile<std::uint8_t>& tile, const TouchedWeights& touched, const float* light,
                            TileSums& sums) {
  return sum_touched_by(tile, touched, light, sums);
}
std::uint32_t sum_touched_16(const Tile<std::uint16_t>& tile, const TouchedWeights& touched,
                             const float* light, TileSums& sums) {
  return sum_touched_by(tile, touched, light, sums);
}

/// Numbers of the boxes that overlap `within`, from `first` on; returns how many.
std::size_t find_touched_vectorised(const SmallBox* boxes, std::size_t count, const Box& within,
                                    std::int64_t first, std::int64_t* HWY_RESTRICT touched) {
  // A box overlaps when x0 < within.x1, y0 < within.y1, x1 > within.x0 and y1 > within.y0. Of the first two,
  // both sides are complemented, so that one comparison does for all four numbers.
  const hn::ScalableTag<std::int16_t> d;
  const hn::Repartition<std::int64_t, decltype(d)> whole_box;
  const auto lanes_of = [&](std::int16_t x0, std::int16_t y0, std::int16_t x1, std::int16_t y1) {
    std::int64_t bits;
    const std::int16_t four[4] = {x0, y0, x1, y1};
    hwy::CopyBytes<sizeof bits>(four, &bits);
    return hn::BitCast(d, hn::Set(whole_box, bits));
  };
  const auto small = [](std::int32_t value) { return static_cast<std::int16_t>(value); };
  const auto flip = lanes_of(-1, -1, 0, 0);
  const auto bound = lanes_of(small(~within.x1), small(~within.y1), small(within.x0), small(within.y0));
  const auto all = hn::Set(whole_box, std::int64_t{-1});
  const std::size_t step = hn::Lanes(whole_box);
  const auto apart = hn::Set(whole_box, static_cast<std::int64_t>(step));
  auto numbers = hn::Iota(whole_box, first);
  std::size_t found = 0, k = 0;
  for (; k + step <= count; k += step, numbers = hn::Add(numbers, apart)) {
    const auto corners = hn::LoadU(d, reinterpret_cast<const std::int16_t*>(boxes + k));
    const auto inside = hn::VecFromMask(d, hn::Gt(hn::Xor(corners, flip), bound));
    found += hn::CompressBlendedStore(numbers, hn::Eq(hn::BitCast(whole_box, inside), all), whole_box,
                                      touched + found);
  }
  for (; k < count; ++k)
    if (boxes[k].x0 < within.x1 && boxes[k].x1 > within.x0 && boxes[k].y0 < within.y1 &&
        boxes[k].y1 > within.y0)
      touched[found++] = first + static_cast<std::int64_t>(k);
  return found;
}

void store_groups_vectorised(const TileSums& sums, std::uint32_t groups, bool add, float* pixels,
                             std::size_t row_floats) {
  const Lanes d;
  const Rgb four;
  constexpr int across = tile_side_px / group_side_px;
  constexpr std::size_t row = group_side_px * 3;
  HWY_ALIGN float packed[group_pixels * 3];
  for (std::size_t g = 0; g < groups_of_tile; ++g) {
    if ((groups >> g & 1u) == 0) continue;
    for (std::size_t i = 0; i < group_pixels; i += hn::Lanes(d)) {
      const float* dense = sums.dense + g * 3 * group_pixels + i;
      auto red = hn::Load(d, dense), green = hn::Load(d, dense + group_pixels),
           blue = hn::Load(d, dense + 2 * group_pixels);
      if (sums.has_sparse) {
        hn::Vec<Lanes> more_red, more_green, more_blue, none;
        hn::LoadInterleaved4(d, sums.sparse + 4 * (g * group_pixels + i), more_red, more_green, more_blue,
                             none);
        red = hn::Add(red, more_red);
        green = hn::Add(green, more_green);
        blue = hn::Add(blue, more_blue);
      }
      hn::StoreInterleaved3(red, green, blue, d, packed + 3 * i);
    }
    float* corner = pixels + g / across * group_side_px * row_floats + g % across * row;
    for (std::size_t y = 0; y < group_side_px; ++y)
      for (std::size_t i = 0; i < row; i += 4) {
        float* out = corner + y * row_floats + i;
        const auto sum = hn::Load(four, packed + y * row + i);
        hn::StoreU(add ? hn::Add(sum, hn::LoadU(four, out)) : sum, four, out);
      }
  }
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(sum_boxes_fixed_vectorised);
HWY_EXPORT(sum_all_8);
HWY_EXPORT(sum_all_16);
HWY_EXPORT(sum_touched_8);
HWY_EXPORT(sum_touched_16);
HWY_EXPORT(find_touched_vectorised);
HWY_EXPORT(store_groups_vectorised);

void sum_boxes_fixed(const std::int32_t* corners, std::int32_t stride, const float* step,
                     const SmallBox* boxes, std::size_t count, float* sums) {
  HWY_DYNAMIC_DISPATCH(sum_boxes_fixed_vectorised)(corners, stride, step, boxes, count, sums);
}

void sum_kernels(const Tile<std::uint8_t>& tile, const float* light, float* dense_light,
                 const Tile<std::uint8_t>& next, TileSums& sums) {
  HWY_DYNAMIC_DISPATCH(sum_all_8)(tile, light, dense_light, next, sums);
}

void sum_kernels(const Tile<std::uint16_t>& tile, const float* light, float* dense_light,
                 const Tile<std::uint16_t>& next, TileSums& sums) {
  HWY_DYNAMIC_DISPATCH(sum_all_16)(tile, light, dense_light, next, sums);
}

std::uint32_t sum_touched(const Tile<std::uint8_t>& tile, const TouchedWeights& touched, const float* light,
                          TileSums& sums) {
  return HWY_DYNAMIC_DISPATCH(sum_touched_8)(tile, touched, light, sums);
}

std::uint32_t sum_touched(const Tile<std::uint16_t>& tile, const TouchedWeights& touched, const float* light,
                          TileSums& sums) {
  return HWY_DYNAMIC_DISPATCH(sum_touched_16)(tile, touched, light, sums);
}

void find_touched(std::span<const SmallBox> boxes, const Box& within, std::int64_t first,
                  std::vector<std::int64_t>& touched) {
  const std::size_t before = touched.size();
  touched.resize(before + boxes.size());
  touched.resize(before + HWY_DYNAMIC_DISPATCH(find_touched_vectorised)(boxes.data(), boxes.size(), within,
                                                                        first, touched.data() + before));
}

void store_groups(const TileSums& sums, std::uint32_t groups, bool add, float* pixels,
                  std::size_t row_floats) {
  HWY_DYNAMIC_DISPATCH(store_groups_vectorised)(sums, groups, add, pixels, row_floats);
}

}  // namespace refield
#endif
