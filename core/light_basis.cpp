// SPDX-License-Identifier: Apache-2.0
#include "core/light_basis.h"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "core/errors.h"
#include "core/summed_area_table.h"

namespace refield {

double LightBasis::area(std::size_t kernel) const {
  if (!is_hat(kernel)) return static_cast<double>(box(kernel).area());
  double sum = 0.0;
  const Box within = support(kernel);
  for (int y = within.y0; y < within.y1; ++y)
    for (int x = within.x0; x < within.x1; ++x) sum += hats.value(static_cast<int>(kernel), x, y, domain);
  return sum;
}

float LightBasis::value(std::size_t kernel, int x, int y) const {
  if (is_hat(kernel)) return hats.value(static_cast<int>(kernel), x, y, domain);
  const Box& inside = box(kernel);
  return x >= inside.x0 && x < inside.x1 && y >= inside.y0 && y < inside.y1 ? 1.0f : 0.0f;
}

Box LightBasis::support(std::size_t kernel) const {
  return is_hat(kernel) ? hats.support(static_cast<int>(kernel), domain) : box(kernel);
}

std::vector<float> LightBasis::project(const LightMap& light) const {
  const LightDomain given = light.domain();
  if (given != domain)
    throw InputError("the light map is " + std::to_string(given.width) + "×" + std::to_string(given.height) +
                     " (" + std::string(name_of(given.parameterisation)) + "), the field expects " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) + " (" +
                     std::string(name_of(domain.parameterisation)) + "); resample the map to that size");
  const SummedAreaTable table(light.radiance);
  std::vector<float> coefficients(size() * 3);
  std::ranges::copy(hats.project(light), coefficients.begin());
  float* sums = coefficients.data() + std::size_t{3} * hats.count();
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes.size(), 4096), [&](const auto& range) {
    for (std::size_t k = range.begin(); k != range.end(); ++k) {
      const auto sum = table.sum(boxes[k]);
      for (int c = 0; c < 3; ++c) sums[3 * k + c] = static_cast<float>(sum[c]);
    }
  });
  return coefficients;
}

}  // namespace refield
