// SPDX-License-Identifier: Apache-2.0
#include "tests/relight/mixed_field.h"

#include "core/base/rng.h"
#include "tests/support/random_data.h"

namespace refield::test {

ReflectanceField mixed_field(int width, int height, LightDomain domain, HatGrid hats) {
  Rng rng(7, static_cast<std::uint64_t>(width), static_cast<std::uint64_t>(height));
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis = {domain, hats, {}};
  const auto new_box = [&] {
    field.basis.boxes.push_back(random_box(rng, domain.width, domain.height));
    return static_cast<std::uint32_t>(field.basis.size() - 1);
  };
  std::vector<std::uint32_t> everywhere(8);
  for (auto& kernel : everywhere) kernel = new_box();
  std::vector<std::vector<std::uint32_t>> of_block(
      static_cast<std::size_t>((width / 4 + 1) * (height / 4 + 1)));
  for (auto& block : of_block)
    for (int i = 0; i < 6; ++i) block.push_back(new_box());
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      std::vector<std::uint32_t> columns;
      const std::uint64_t sort = rng.below(8);
      if (sort > 0) {
        for (int hat = 0; hat < hats.count(); ++hat)
          if (rng.below(5) > 0) columns.push_back(static_cast<std::uint32_t>(hat));
        for (const auto kernel : of_block[static_cast<std::size_t>(y / 4 * (width / 4 + 1) + x / 4)])
          if (rng.below(6) > 0) columns.push_back(kernel);
        if (sort > 4) columns.push_back(everywhere[rng.below(everywhere.size())]);
        for (std::uint64_t own = rng.below(4); own > 0; --own) columns.push_back(new_box());
      }
      std::vector<float> weights;
      for (const auto kernel : columns) {
        const double area = field.basis.area(kernel);
        for (int c = 0; c < 3; ++c) weights.push_back(static_cast<float>(rng.uniform() / area));
      }
      field.transfer.append_row(columns, weights);
    }
  return field;
}

ReflectanceField with_both_signs(ReflectanceField field) {
  Rng rng(17);
  for (float& weight : field.transfer.weight)
    if (rng.below(3) == 0) weight = -weight;
  return field;
}

}  // namespace refield::test
