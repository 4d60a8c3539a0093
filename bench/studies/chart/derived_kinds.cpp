// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/derived_kinds.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <numeric>

#include "cli/run_context.h"

namespace refield::chart {

namespace {

constexpr double dark_level = 0.05;
constexpr double concentrated = 0.03, partly_concentrated = 0.10, broad = 0.20;
constexpr double shadowed = 0.15;
constexpr double least_light = 0.01;

double median(std::vector<float> values) {
  return quantile(std::move(values), 0.5);
}

Label label_of(double half_area, double dark_area) {
  if (half_area < concentrated) return refraction;
  if (half_area < partly_concentrated) return mixed;
  if (dark_area >= shadowed) return hard_shadow;
  return half_area < broad ? glossy : diffuse;
}

}  // namespace

TransportSpread transport_spread(const ReflectanceField& field, std::size_t pixel) {
  const LightDomain& domain = field.basis.domain;
  std::vector<float> texels(static_cast<std::size_t>(domain.width) * domain.height, 0.0f);
  for (std::uint64_t e = field.transfer.row_start[pixel]; e < field.transfer.row_start[pixel + 1]; ++e) {
    const std::uint32_t kernel = field.transfer.column[e];
    const Box within = field.basis.support(kernel);
    const float* weight = field.transfer.weight.data() + 3 * e;
    const float sum = weight[0] + weight[1] + weight[2];
    for (int y = within.y0; y < within.y1; ++y)
      for (int x = within.x0; x < within.x1; ++x)
        texels[static_cast<std::size_t>(y) * domain.width + x] += sum * field.basis.value(kernel, x, y);
  }
  const auto count = static_cast<double>(texels.size());
  TransportSpread spread;
  spread.light = std::accumulate(texels.begin(), texels.end(), 0.0);
  if (spread.light <= 0.0) return spread;
  std::ranges::sort(texels, std::greater<>());
  double gathered = 0.0;
  std::size_t first = 0;
  while (gathered < 0.5 * spread.light && first < texels.size()) gathered += texels[first++];
  spread.half_area = static_cast<double>(first) / count;
  const auto dark = static_cast<float>(dark_level * spread.light / count);
  const auto end = std::ranges::lower_bound(texels, dark, std::greater<>());
  spread.dark_area = static_cast<double>(texels.end() - end) / count;
  return spread;
}

PixelKinds derived_kinds(const ReflectanceField& field, const Mask& mask) {
  const int width = field.width, height = field.height;
  std::vector<TransportSpread> spreads(static_cast<std::size_t>(width) * height);
  tbb::parallel_for(0, height, [&](int y) {
    run_context().throw_if_stopped();
    for (int x = 0; x < width; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * width + x;
      spreads[p] = transport_spread(field, p);
    }
  });
  const auto counts = [&](std::size_t p) {
    return (mask.empty() || mask[p]) && field.transfer.row_start[p + 1] > field.transfer.row_start[p];
  };
  std::vector<float> light;
  for (std::size_t p = 0; p < spreads.size(); ++p)
    if (counts(p)) light.push_back(static_cast<float>(spreads[p].light));
  const double floor = light.empty() ? 0.0 : least_light * median(light);
  PixelKinds kinds{width, height, {std::begin(kind_names), std::end(kind_names)}, {}};
  kinds.labels.assign(spreads.size(), no_kind);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * width + x;
      if (!counts(p) || spreads[p].light < floor) continue;
      std::vector<float> half, dark;
      for (int j = std::max(0, y - 1); j < std::min(height, y + 2); ++j)
        for (int i = std::max(0, x - 1); i < std::min(width, x + 2); ++i) {
          const std::size_t q = static_cast<std::size_t>(j) * width + i;
          if (!counts(q)) continue;
          half.push_back(static_cast<float>(spreads[q].half_area));
          dark.push_back(static_cast<float>(spreads[q].dark_area));
        }
      kinds.labels[p] = label_of(median(std::move(half)), median(std::move(dark)));
    }
  return kinds;
}

}  // namespace refield::chart
