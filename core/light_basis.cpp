// SPDX-License-Identifier: Apache-2.0
#include "core/light_basis.h"

#include <tbb/parallel_for.h>

#include "core/errors.h"
#include "core/summed_area_table.h"

namespace refield {

std::vector<float> BoxBasis::project(const LightMap& light) const {
  const LightDomain given = light.domain();
  if (given != domain)
    throw InputError("the light map is " + std::to_string(given.width) + "×" + std::to_string(given.height) +
                     " (" + std::string(name_of(given.parameterisation)) + "), the field expects " +
                     std::to_string(domain.width) + "×" + std::to_string(domain.height) + " (" +
                     std::string(name_of(domain.parameterisation)) + "); resample the map to that size");
  const SummedAreaTable table(light.radiance);
  std::vector<float> coefficients(boxes.size() * 3);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes.size(), 4096), [&](const auto& range) {
    for (std::size_t k = range.begin(); k != range.end(); ++k) {
      const auto sum = table.sum(boxes[k]);
      for (int c = 0; c < 3; ++c) coefficients[3 * k + c] = static_cast<float>(sum[c]);
    }
  });
  return coefficients;
}

}  // namespace refield
