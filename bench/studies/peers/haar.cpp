// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/haar.h"

#include <algorithm>
#include <bit>
#include <numbers>

namespace refield::peers {

namespace {

constexpr float root_half = std::numbers::sqrt2_v<float> / 2.0f;

/// One level on `length` values that lie `step` apart: sums to the front, differences behind.
void forward(float* values, int length, int step, std::vector<float>& scratch) {
  for (int i = 0; i < length / 2; ++i) {
    const float a = values[static_cast<std::ptrdiff_t>(2 * i) * step];
    const float b = values[static_cast<std::ptrdiff_t>(2 * i + 1) * step];
    scratch[i] = (a + b) * root_half;
    scratch[length / 2 + i] = (a - b) * root_half;
  }
  for (int i = 0; i < length; ++i) values[static_cast<std::ptrdiff_t>(i) * step] = scratch[i];
}

void backward(float* values, int length, int step, std::vector<float>& scratch) {
  for (int i = 0; i < length; ++i) scratch[i] = values[static_cast<std::ptrdiff_t>(i) * step];
  for (int i = 0; i < length / 2; ++i) {
    const float sum = scratch[i], difference = scratch[length / 2 + i];
    values[static_cast<std::ptrdiff_t>(2 * i) * step] = (sum + difference) * root_half;
    values[static_cast<std::ptrdiff_t>(2 * i + 1) * step] = (sum - difference) * root_half;
  }
}

}  // namespace

int haar_side(const LightDomain& domain) {
  return static_cast<int>(std::bit_ceil(static_cast<unsigned>(std::max(domain.width, domain.height))));
}

void haar_transform(std::span<float> square, int side) {
  std::vector<float> scratch(side);
  for (int length = side; length > 1; length /= 2) {
    for (int y = 0; y < length; ++y)
      forward(square.data() + static_cast<std::ptrdiff_t>(y) * side, length, 1, scratch);
    for (int x = 0; x < length; ++x) forward(square.data() + x, length, side, scratch);
  }
}

void inverse_haar_transform(std::span<float> square, int side) {
  std::vector<float> scratch(side);
  for (int length = 2; length <= side; length *= 2) {
    for (int x = 0; x < length; ++x) backward(square.data() + x, length, side, scratch);
    for (int y = 0; y < length; ++y)
      backward(square.data() + static_cast<std::ptrdiff_t>(y) * side, length, 1, scratch);
  }
}

std::vector<float> haar_coefficients(const LightMap& light, int channel) {
  const int side = haar_side(light.domain());
  std::vector<float> square(static_cast<std::size_t>(side) * side, 0.0f);
  const Image& map = light.radiance;
  for (int y = 0; y < map.height; ++y)
    for (int x = 0; x < map.width; ++x)
      square[static_cast<std::size_t>(y) * side + x] = map.at(x, y, channel);
  haar_transform(square, side);
  return square;
}

}  // namespace refield::peers
