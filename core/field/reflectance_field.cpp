// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/field/light_error.h"

namespace refield {

LightShares FieldOutline::light_shares(const Image& radiance) const {
  if (observed_light.empty()) return {};
  if (basis.interpolation) return LightInterpolator(*basis.interpolation, basis.domain).shares(radiance);
  double all = 0.0, observed = 0.0;
  for (const float value : radiance.values) all += value;
  for (const Box& box : observed_light)
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < radiance.channels; ++c) observed += radiance.at(x, y, c);
  return {0.0, all > 0.0 ? std::clamp(1.0 - observed / all, 0.0, 1.0) : 0.0};
}

void ReflectanceField::fit_interpolation() {
  if (!can_interpolate(observed_light, basis.domain)) return;
  constexpr std::size_t max_pixels = 300;
  std::vector<std::size_t> lit;
  for (std::size_t p = 0; p < transfer.rows(); ++p)
    if (transfer.row_start[p] < transfer.row_start[p + 1]) lit.push_back(p);
  const std::size_t count = std::min(lit.size(), max_pixels);
  const SourceResponses of_sources(*this, observed_light);
  Eigen::MatrixXd responses(of_sources.sources(), static_cast<Eigen::Index>(3 * count));
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    responses.middleCols(static_cast<Eigen::Index>(3 * k), 3) =
        of_sources.of_pixel(lit[k * lit.size() / count]);
  });
  basis.interpolation = fit_light_interpolation(observed_light, basis.domain, responses);
  // Photographs of one light source at a time.
  if (basis.interpolation && !quality.light_error.known() && knows_light_error(*this))
    predict_errors_between(*basis.interpolation, basis.domain, of_sources, quality);
}

Image ReflectanceField::relight(const LightMap& light) const {
  Image image(width, height, 3);
  apply(basis.project(light), image.values);
  return image;
}

void ReflectanceField::apply(std::span<const float> coefficients, std::span<float> outputs) const {
  transfer.apply(coefficients, outputs);
  if (mixes_colours()) convert_colours(outputs, output_from_primaries);
}

}  // namespace refield
