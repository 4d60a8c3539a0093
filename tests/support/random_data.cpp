// SPDX-License-Identifier: Apache-2.0
#include "tests/support/random_data.h"

#include <algorithm>
#include <array>
#include <cstdlib>

namespace refield::test {

Image random_image(Rng& rng, int width, int height, int channels, double low, double high) {
  Image image(width, height, channels);
  for (float& value : image.values) value = static_cast<float>(rng.uniform(low, high));
  return image;
}

LightMap random_light(Rng& rng, const LightDomain& domain) {
  return {random_image(rng, domain.width, domain.height, 3), domain.parameterisation};
}

Box random_box(Rng& rng, int map_width, int map_height) {
  const auto interval = [&](int length) {
    const auto a = static_cast<std::int32_t>(rng.below(length));
    const auto b = a + 1 + static_cast<std::int32_t>(rng.below(length - a));
    return std::pair{a, b};
  };
  const auto [x0, x1] = interval(map_width);
  const auto [y0, y1] = interval(map_height);
  return {x0, y0, x1, y1};
}

ReflectanceField random_field(Rng& rng, int width, int height, const LightDomain& domain, int boxes,
                              int max_kernels) {
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis.domain = domain;
  for (int k = 0; k < boxes; ++k) field.basis.boxes.push_back(random_box(rng, domain.width, domain.height));
  for (int pixel = 0; pixel < width * height; ++pixel) {
    std::vector<std::uint32_t> columns(rng.below(max_kernels + 1));
    std::vector<float> weights(columns.size() * 3);
    for (auto& column : columns) column = static_cast<std::uint32_t>(rng.below(boxes));
    for (float& weight : weights) weight = static_cast<float>(rng.uniform());
    field.transfer.append_row(columns, weights);
    field.quality.training_error.push_back(static_cast<float>(rng.uniform()));
  }
  return field;
}

int fuzz_rounds() {
  const char* text = std::getenv("REFIELD_FUZZ_ROUNDS");
  return text ? std::max(1, std::atoi(text)) : 300;
}

}  // namespace refield::test
