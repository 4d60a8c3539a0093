// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace refield::prt {

/// The transfer of 16 outputs from some squares of light, one byte each weight with a common scale for a
/// square (section 6 of Johan and Nishita has one byte and no zeros; here squares that give nothing to all 16
/// are dropped).
struct GroupWeights {
  std::vector<std::uint32_t> square;  ///< name while clustering, then number in the basis
  std::vector<float> scale;           ///< [squares]
  std::vector<std::uint8_t> weight;   ///< [squares × values]

  /// `values` ≥ 0, as many for each square.
  void append(std::uint32_t name, std::span<const float> values) {
    constexpr float largest = 255.0f, half = 0.5f;
    const float top = *std::ranges::max_element(values);
    if (top <= 0.0f) return;
    square.push_back(name);
    scale.push_back(top / largest);
    for (const float value : values)
      weight.push_back(static_cast<std::uint8_t>(value / top * largest + half));
  }
};

}  // namespace refield::prt
