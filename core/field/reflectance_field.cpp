// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

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
  Eigen::MatrixXd responses(observed_light.size(), 3 * count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    const std::size_t pixel = lit[k * lit.size() / count];
    for (std::size_t s = 0; s < observed_light.size(); ++s) {
      const Box& source = observed_light[s];
      std::array<double, 3> sum{};
      double solid_angle = 0.0;
      for (int y = source.y0; y < source.y1; ++y)
        for (int x = source.x0; x < source.x1; ++x) {
          solid_angle += lat_long_solid_angle(y, basis.domain.width, basis.domain.height);
          for (auto e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e)
            if (const float value = basis.value(transfer.column[e], x, y); value != 0.0f)
              for (std::size_t c = 0; c < 3; ++c)
                sum[c] += static_cast<double>(transfer.weight[3 * e + c]) * value;
        }
      for (std::size_t c = 0; c < 3; ++c)
        responses(static_cast<Eigen::Index>(s), static_cast<Eigen::Index>(3 * k + c)) = sum[c] / solid_angle;
    }
  });
  basis.interpolation = fit_light_interpolation(observed_light, basis.domain, responses);
}

Image ReflectanceField::relight(const LightMap& light) const {
  Image image(width, height, 3);
  transfer.apply(basis.project(light), image.values);
  return image;
}

}  // namespace refield
