// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light/light_map.h"
#include "relight/relighter.h"

namespace refield::bench {

/// A lat-long map of noise and a sun of one texel, 1e5 times as bright; or the one that REFIELD_ENV names.
LightMap environment(int width);

/// Bytes a second that all cores read from memory together.
double read_rate();

/// Bytes that TileRelighter::relight() reads and writes at least: transfer, light, its table of whole
/// numbers, and `image`, which it gave.
inline std::size_t bytes_per_frame(const TileRelighter& relighter, const Image& image) {
  const LightDomain domain = relighter.domain();
  const std::size_t texels = static_cast<std::size_t>(domain.width) * static_cast<std::size_t>(domain.height);
  return std::visit([](const auto& transfer) { return transfer.bytes(); }, relighter.transfer()) +
         texels * (4 * sizeof(std::int32_t) + 3 * sizeof(float)) + image.values.size() * sizeof(float);
}

}  // namespace refield::bench
