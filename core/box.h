// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <compare>
#include <cstdint>
#include <functional>

namespace refield {

/// A rectangle of light-map texels, half-open: columns [x0, x1) and rows [y0, y1).
struct Box {
  std::int32_t x0 = 0;
  std::int32_t y0 = 0;
  std::int32_t x1 = 0;
  std::int32_t y1 = 0;

  std::int32_t width() const { return x1 - x0; }
  std::int32_t height() const { return y1 - y0; }
  std::int64_t area() const { return static_cast<std::int64_t>(width()) * height(); }
  bool contains(std::int32_t x, std::int32_t y) const { return x >= x0 && x < x1 && y >= y0 && y < y1; }
  bool inside(std::int32_t map_width, std::int32_t map_height) const {
    return x0 >= 0 && y0 >= 0 && x0 < x1 && y0 < y1 && x1 <= map_width && y1 <= map_height;
  }
  friend auto operator<=>(const Box&, const Box&) = default;
};

struct BoxHash {
  std::size_t operator()(const Box& box) const {
    const auto word = [](std::int32_t a, std::int32_t b) {
      return static_cast<std::uint64_t>(static_cast<std::uint32_t>(a)) << 32 | static_cast<std::uint32_t>(b);
    };
    std::uint64_t h = word(box.x0, box.y0) * 0x9e3779b97f4a7c15ull;
    h ^= h >> 29;
    h = (h + word(box.x1, box.y1)) * 0xbf58476d1ce4e5b9ull;
    return static_cast<std::size_t>(h ^ (h >> 32));
  }
};

}  // namespace refield
