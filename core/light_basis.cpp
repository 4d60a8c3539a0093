// SPDX-License-Identifier: Apache-2.0
#include "core/light_basis.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/cube_map.h"
#include "core/errors.h"
#include "core/summed_area_table.h"

namespace refield {

namespace {

/// Sum of a hat along one side over the centres of the texels, by HatGrid's formula: value 1 − |p − node| at
/// p = (t + ½) s, s = (nodes − 1)/texels, which rises up to the node and falls from there. In closed form,
/// since a file may state any size.
double hat_sum(int node, int nodes, int texels) {
  if (nodes == 1) return texels;
  const double s = static_cast<double>(nodes - 1) / texels;
  /// The first texel whose centre does not lie before p.
  const auto first_from = [&](double p) { return std::clamp(std::ceil(p / s - 0.5), 0.0, 1.0 * texels); };
  const double begin = first_from(node - 1), top = first_from(node), end = first_from(node + 1);
  const auto sum_of_positions = [&](double from, double to) { return s * (to * to - from * from) / 2.0; };
  return (top - begin) * (1.0 - node) + sum_of_positions(begin, top) + (end - top) * (1.0 + node) -
         sum_of_positions(top, end);
}

}  // namespace

double LightBasis::area(std::size_t kernel) const {
  if (!is_smooth(kernel))
    return measure == Measure::texels ? static_cast<double>(box(kernel).area())
                                      : cube_solid_angle(box(kernel), domain.width);
  const auto number = static_cast<int>(kernel);
  if (number >= hats.count()) {  // harmonics but the first integrate to nothing
    const int harmonic = (number - hats.count()) / 2, sign = (number - hats.count()) % 2 == 0 ? 1 : -1;
    return harmonic == 0 ? sign * std::sqrt(4.0 * std::numbers::pi) : 0.0;
  }
  if (measure == Measure::texels)
    return hat_sum(number % hats.columns, hats.columns, domain.width) *
           hat_sum(number / hats.columns, hats.rows, domain.height);
  double sum = 0.0;
  const Box within = support(kernel);
  for (int y = within.y0; y < within.y1; ++y)
    for (int x = within.x0; x < within.x1; ++x)
      sum += hats.value(number, x, y, domain) * cube_solid_angle(x, y, domain.width);
  return sum;
}

float LightBasis::value(std::size_t kernel, int x, int y) const {
  const auto number = static_cast<int>(kernel);
  if (number < hats.count()) return hats.value(number, x, y, domain);
  if (is_smooth(kernel)) return harmonics.value(number - hats.count(), x, y, domain);
  const Box& inside = box(kernel);
  return x >= inside.x0 && x < inside.x1 && y >= inside.y0 && y < inside.y1 ? 1.0f : 0.0f;
}

Box LightBasis::support(std::size_t kernel) const {
  const auto number = static_cast<int>(kernel);
  if (number < hats.count()) return hats.support(number, domain);
  return is_smooth(kernel) ? Box{0, 0, domain.width, domain.height} : box(kernel);
}

std::vector<float> LightBasis::project(const LightMap& light) const {
  require_domain(light, domain);
  const Box whole{0, 0, domain.width, domain.height};
  const SmoothProjector projector(*this);
  std::optional<Image> weighed;
  if (projector.weighs()) projector.weigh(weighed.emplace(light.radiance), whole);
  const Image& values = weighed ? *weighed : light.radiance;
  std::vector<float> coefficients(size() * 3);
  std::ranges::transform(projector.project(values, whole), coefficients.begin(),
                         [](double sum) { return static_cast<float>(sum); });
  if (boxes.empty()) return coefficients;
  const SummedAreaTable table(values);
  float* sums = coefficients.data() + smooth() * 3;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes.size(), 4096), [&](const auto& range) {
    for (std::size_t k = range.begin(); k != range.end(); ++k) {
      const auto sum = table.sum(boxes[k]);
      for (int c = 0; c < 3; ++c) sums[3 * k + c] = static_cast<float>(sum[c]);
    }
  });
  return coefficients;
}

SmoothProjector::SmoothProjector(const LightBasis& basis)
    : domain_(basis.domain), hats_(basis.hats), count_(basis.smooth()) {
  if (basis.measure == Measure::solid_angle) solid_angles_ = cube_solid_angles(domain_.width);
  if (basis.harmonics.order > 0) harmonics_.emplace(basis.harmonics, domain_);
}

void SmoothProjector::weigh(Image& part, const Box& within) const {
  const int side = domain_.width;
  tbb::parallel_for(0, part.height, [&](int row) {
    const float* angle = solid_angles_.data() +
                         static_cast<std::size_t>((within.y0 + row) % side) * static_cast<std::size_t>(side) +
                         within.x0;
    float* texel = part.row(row).data();
    for (int x = 0; x < part.width; ++x, texel += 3)
      for (int c = 0; c < 3; ++c) texel[c] *= angle[x];
  });
}

std::vector<double> SmoothProjector::project(const Image& part, const Box& within) const {
  std::vector<double> coefficients = hats_.project(part, within, domain_);
  if (harmonics_) {
    const std::vector<double> more = harmonics_->project(part, within);
    coefficients.insert(coefficients.end(), more.begin(), more.end());
  }
  return coefficients;
}

}  // namespace refield
