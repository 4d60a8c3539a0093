// SPDX-License-Identifier: Apache-2.0
#include "core/field/light_basis.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "core/base/errors.h"
#include "core/light/cube_map.h"
#include "core/light/summed_area_table.h"

namespace refield {

namespace {

/// Position of a texel's centre in units of the distance between nodes.
double position(int texel, int texels, int nodes) {
  return (texel + 0.5) / texels * (nodes - 1);
}

double hat(double position, int node, int nodes) {
  return nodes == 1 ? 1.0 : std::max(0.0, 1.0 - std::abs(position - node));
}

/// Texels [first, last) whose centres lie between two nodes, the first of which is `node`.
struct Interval {
  int node = 0;
  int first = 0;
  int last = 0;
};

std::vector<Interval> intervals(int first, int last, int texels, int nodes) {
  std::vector<Interval> found;
  for (int texel = first; texel < last; ++texel) {
    const int node = std::min(static_cast<int>(position(texel, texels, nodes)), std::max(nodes - 2, 0));
    if (found.empty() || found.back().node != node) found.push_back({node, texel, texel});
    found.back().last = texel + 1;
  }
  return found;
}

}  // namespace

float HatGrid::value(int node, int x, int y, const LightDomain& domain) const {
  return static_cast<float>(hat(position(x, domain.width, columns), node % columns, columns) *
                            hat(position(y, domain.height, rows), node / columns, rows));
}

Box HatGrid::support(int node, const LightDomain& domain) const {
  const auto interval = [](int texels, int at, int nodes) -> std::pair<int, int> {
    if (nodes == 1) return {0, texels};
    const double spacing = static_cast<double>(texels) / (nodes - 1);
    return {std::max(0, static_cast<int>(std::floor((at - 1) * spacing))),
            std::min(texels, static_cast<int>(std::ceil((at + 1) * spacing)))};
  };
  const auto [x0, x1] = interval(domain.width, node % columns, columns);
  const auto [y0, y1] = interval(domain.height, node / columns, rows);
  return {x0, y0, x1, y1};
}

std::vector<double> HatGrid::project(const LightMap& light) const {
  const LightDomain domain = light.domain();
  return project(light.radiance, {0, 0, domain.width, domain.height}, domain);
}

std::vector<double> HatGrid::project(const Image& radiance, const Box& within,
                                     const LightDomain& domain) const {
  if (count() == 0) return {};
  // Between two nodes a row gives its light to both, in parts that are linear in x: the sum of the light and
  // of its share for the right node say it all, two products a texel and channel.
  const auto row_values = static_cast<std::size_t>(columns) * 3;
  std::vector<double> along_rows(row_values * static_cast<std::size_t>(within.height()), 0.0);
  const std::vector<Interval> across = intervals(within.x0, within.x1, domain.width, columns);
  std::vector<double> shares;
  for (const Interval& interval : across)
    for (int x = interval.first; x < interval.last; ++x)
      shares.push_back(position(x, domain.width, columns) - interval.node);
  tbb::parallel_for(0, within.height(), [&](int y) {
    double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y);
    const float* texel = radiance.row(y).data();
    const double* share = shares.data();
    for (const Interval& interval : across) {
      // Two texels at a time: a sum waits half as often for the one before.
      double sum[6] = {}, right[6] = {};
      int x = interval.first;
      for (; x + 1 < interval.last; x += 2, texel += 6, share += 2)
        for (int i = 0; i < 6; ++i) {
          sum[i] += texel[i];
          right[i] += share[i / 3] * texel[i];
        }
      for (; x < interval.last; ++x, texel += 3, ++share)
        for (int c = 0; c < 3; ++c) {
          sum[c] += texel[c];
          right[c] += *share * texel[c];
        }
      for (int c = 0; c < 3; ++c) {
        sum[c] += sum[c + 3];
        right[c] += right[c + 3];
      }
      for (int c = 0; c < 3; ++c) {
        if (interval.node + 1 < columns) along_row[3 * (interval.node + 1) + c] += right[c];
        along_row[3 * interval.node + c] += sum[c] - right[c];
      }
    }
  });
  std::vector<double> coefficients(static_cast<std::size_t>(count()) * 3);
  for (const Interval& interval : intervals(within.y0, within.y1, domain.height, rows))
    for (int y = interval.first; y < interval.last; ++y) {
      const double share = position(y, domain.height, rows) - interval.node;
      const double* along_row = along_rows.data() + row_values * static_cast<std::size_t>(y - within.y0);
      double* upper = coefficients.data() + row_values * static_cast<std::size_t>(interval.node);
      for (std::size_t i = 0; i < row_values; ++i) {
        upper[i] += (1.0 - share) * along_row[i];
        if (interval.node + 1 < rows) upper[row_values + i] += share * along_row[i];
      }
    }
  return coefficients;
}

namespace {

/// Means of the harmonics over texel (x, y), by the four Gauss points of the square and their densities of
/// solid angle: exact but for the fourth power of (order ∕ resolution).
void texel_means(int order, int x, int y, int resolution, std::vector<double>& means) {
  const double off = 0.5 / std::sqrt(3.0);
  std::array<double, harmonics_of(largest_harmonics_order)> at_point;
  const auto functions = static_cast<std::size_t>(harmonics_of(order));
  means.assign(functions, 0.0);
  double total = 0.0;
  for (const double column : {x + 0.5 - off, x + 0.5 + off})
    for (const double row : {y + 0.5 - off, y + 0.5 + off}) {
      const Eigen::Vector3d direction = cube_direction(column, row, resolution);
      const double density = std::pow(direction.cwiseAbs().maxCoeff(), 3);
      evaluate_harmonics(order, direction, std::span(at_point).first(functions));
      for (std::size_t i = 0; i < functions; ++i) means[i] += density * at_point[i];
      total += density;
    }
  for (double& mean : means) mean /= total;
}

}  // namespace

float HarmonicKernels::value(int kernel, int x, int y, const LightDomain& domain) const {
  std::vector<double> means;
  texel_means(order, x, y, domain.width, means);
  return static_cast<float>((kernel % 2 == 0 ? 1.0 : -1.0) * means[static_cast<std::size_t>(kernel / 2)]);
}

HarmonicTable::HarmonicTable(const HarmonicKernels& kernels, const LightDomain& domain)
    : domain_(domain),
      functions_(static_cast<std::size_t>(harmonics_of(kernels.order))),
      values_(static_cast<std::size_t>(domain.width) * domain.height * functions_) {
  tbb::parallel_for(0, domain.height, [&](int y) {
    std::vector<double> means;
    float* to = values_.data() + static_cast<std::size_t>(y) * domain.width * functions_;
    for (int x = 0; x < domain.width; ++x) {
      texel_means(kernels.order, x, y, domain.width, means);
      for (const double mean : means) *to++ = static_cast<float>(mean);
    }
  });
}

std::vector<double> HarmonicTable::project(const Image& part, const Box& within) const {
  // Sums of a row in float, of rows in double: rows are short.
  const auto functions = static_cast<Eigen::Index>(functions_);
  constexpr int rows_at_a_time = 16;
  const int blocks = (part.height + rows_at_a_time - 1) / rows_at_a_time;
  std::vector<Eigen::ArrayXXd> of_block(static_cast<std::size_t>(blocks));
  tbb::parallel_for(0, blocks, [&](int block) {
    Eigen::ArrayXXd sum = Eigen::ArrayXXd::Zero(functions, 3);
    for (int y = block * rows_at_a_time; y < std::min(part.height, (block + 1) * rows_at_a_time); ++y) {
      const std::size_t first =
          static_cast<std::size_t>(within.y0 + y) * domain_.width + static_cast<std::size_t>(within.x0);
      const Eigen::Map<const Eigen::MatrixXf> harmonics(values_.data() + first * functions_, functions,
                                                        part.width);
      const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> light(
          part.row(y).data(), part.width, 3);
      sum += (harmonics * light).array().cast<double>();
    }
    of_block[static_cast<std::size_t>(block)] = sum;
  });
  std::vector<double> coefficients(2 * functions_ * 3, 0.0);
  for (const auto& sum : of_block)
    for (std::size_t i = 0; i < functions_; ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const double value = sum(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(c));
        coefficients[6 * i + c] += value;
        coefficients[6 * i + 3 + c] -= value;
      }
  return coefficients;
}

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
  if (basis.interpolation)
    interpolator_ = std::make_shared<const LightInterpolator>(*basis.interpolation, domain_);
}

void SmoothProjector::weigh(Image& part, const Box& within) const {
  if (interpolator_) return interpolator_->gather(part);
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
