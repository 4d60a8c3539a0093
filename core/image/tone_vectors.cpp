// SPDX-License-Identifier: Apache-2.0
#include "core/image/tone_vectors.h"

#include <algorithm>

// Vectors of 16 bytes on any machine. Highway goes without them under GCC 12, whose bug 106322 (products'
// upper halves) does not concern what is used here.
#define HWY_BROKEN_EMU128 0

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/image/tone_vectors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t batch_pixels = 16;

/// Of `3 × batch_pixels` values.
HWY_INLINE void look_up(const LevelCells& cells, const float* HWY_RESTRICT values,
                        std::uint8_t* HWY_RESTRICT levels) {
  const hn::CappedTag<float, batch_pixels> d;
  const hn::RebindToSigned<decltype(d)> whole;
  const hn::Rebind<std::uint8_t, decltype(d)> narrow;
  const auto* bytes = reinterpret_cast<const std::int32_t*>(cells.level_at_start);
  for (std::size_t i = 0; i < 3 * batch_pixels; i += hn::Lanes(d)) {
    auto value = hn::LoadU(d, values + i);
    value = hn::IfThenElseZero(hn::Gt(value, hn::Zero(d)), value);
    const auto cell = hn::ShiftRightSame(hn::BitCast(whole, value), cells.shift);
    auto level = hn::And(hn::GatherOffset(whole, bytes, cell), hn::Set(whole, 0xff));
    for (int step = 0; step < cells.steps; ++step) {
      const auto next = hn::GatherIndex(d, cells.least_value_of + 1, level);
      level = hn::Sub(level, hn::VecFromMask(whole, hn::RebindMask(whole, hn::Ge(value, next))));
    }
    hn::StoreU(hn::DemoteTo(narrow, level), narrow, levels + i);
  }
}

void tone_map_vectorised(const LevelCells& cells, const float* HWY_RESTRICT values, std::size_t pixels,
                         std::uint8_t* HWY_RESTRICT rgba) {
  const hn::FixedTag<std::uint8_t, batch_pixels> d;
  HWY_ALIGN std::uint8_t levels[3 * batch_pixels];
  const auto opaque = hn::Set(d, 255);
  const auto map_batch = [&](const float* from, std::uint8_t* to) {
    look_up(cells, from, levels);
    hn::Vec<decltype(d)> red, green, blue;
    hn::LoadInterleaved3(d, levels, red, green, blue);
    hn::StoreInterleaved4(red, green, blue, opaque, d, to);
  };
  std::size_t first = 0;
  for (; first + batch_pixels <= pixels; first += batch_pixels)
    map_batch(values + 3 * first, rgba + 4 * first);
  if (first == pixels) return;
  float rest[3 * batch_pixels] = {};
  std::uint8_t rest_rgba[4 * batch_pixels];
  std::copy(values + 3 * first, values + 3 * pixels, rest);
  map_batch(rest, rest_rgba);
  std::copy_n(rest_rgba, 4 * (pixels - first), rgba + 4 * first);
}

}  // namespace refield::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield {

HWY_EXPORT(tone_map_vectorised);

void tone_map_pixels(const LevelCells& cells, const float* values, std::size_t pixels, std::uint8_t* rgba) {
  HWY_DYNAMIC_DISPATCH(tone_map_vectorised)(cells, values, pixels, rgba);
}

}  // namespace refield
#endif
