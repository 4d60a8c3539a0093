// SPDX-License-Identifier: Apache-2.0
#include "estimate/light_predictor.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "core/errors.h"
#include "core/image_io.h"
#include "core/run_context.h"
#include "estimate/box_table.h"

namespace refield {

namespace {

/// Lights are seen at most so finely: what a pixel shows of finer detail counts as noise here.
constexpr int most_columns = 40;
constexpr int most_rows = 30;
/// Standard deviations of the blurs, in parts of the map's width; 0: none.
constexpr std::array<double, 3> blurs = {0.0, 0.03, 0.12};
constexpr std::array<double, 4> ridges = {1e-5, 1e-4, 1e-3, 1e-2};
constexpr int series_at_a_time = 64;

int cells_along(int texels, int most) {
  return std::min(texels, most);
}

/// Summed radiance of the cells of a coarse grid: [channel][cells].
void coarsen(const LightMap& light, int columns, int rows, std::array<Eigen::VectorXd, 3>& features) {
  const Image& image = light.radiance;
  for (auto& channel : features) channel = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(columns) * rows);
  for (int y = 0; y < image.height; ++y) {
    const int row = static_cast<int>(static_cast<std::int64_t>(y) * rows / image.height);
    for (int x = 0; x < image.width; ++x) {
      const int column = static_cast<int>(static_cast<std::int64_t>(x) * columns / image.width);
      for (int c = 0; c < 3; ++c) features[c][row * columns + column] += image.at(x, y, c);
    }
  }
}

/// Gaussian weights between the cells along one axis, rows summing to one.
Eigen::MatrixXd blur_matrix(int cells, double sigma) {
  Eigen::MatrixXd weights(cells, cells);
  for (int i = 0; i < cells; ++i)
    for (int j = 0; j < cells; ++j) weights(i, j) = std::exp(-0.5 * (i - j) * (i - j) / (sigma * sigma));
  return weights.array().colwise() / weights.rowwise().sum().array();
}

LightGrams grams_of(const std::vector<std::array<Eigen::VectorXd, 3>>& lights, int columns, int rows) {
  const auto images = static_cast<Eigen::Index>(lights.size());
  LightGrams grams;
  grams.images = static_cast<int>(images);
  for (int c = 0; c < 3; ++c)
    for (const double blur : blurs) {
      Eigen::MatrixXd features(images, static_cast<Eigen::Index>(columns) * rows);
      for (Eigen::Index j = 0; j < images; ++j) {
        features.row(j) = lights[j][c];
        if (blur == 0.0) continue;
        const double sigma = std::max(0.5, blur * columns);
        const Eigen::Map<const Eigen::MatrixXd> map(lights[j][c].data(), columns, rows);
        const Eigen::MatrixXd blurred =
            blur_matrix(columns, sigma) * map * blur_matrix(rows, sigma).transpose();
        features.row(j) = Eigen::Map<const Eigen::VectorXd>(blurred.data(), blurred.size());
      }
      Eigen::MatrixXd gram = features * features.transpose();
      const double mean = gram.trace() / static_cast<double>(images);
      if (mean > 0.0) gram /= mean;
      grams.of_channel[c].push_back(std::move(gram));
    }
  return grams;
}

float reordered_median(std::vector<float>& values) {
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

/// One way to predict: the inverse M of gram + ridge over the frames that count, zero elsewhere, and for the
/// others what it takes to predict them.
struct Predictor {
  Eigen::MatrixXf inverse;   ///< [images × images]
  Eigen::VectorXf diagonal;  ///< of the inverse; for frames that are left out the inverse predictive variance
};

Predictor predictor(const Eigen::MatrixXd& gram, double ridge, const std::vector<char>& left_out) {
  const Eigen::Index images = gram.rows();
  std::vector<Eigen::Index> kept;
  for (Eigen::Index j = 0; j < images; ++j)
    if (!left_out[j]) kept.push_back(j);
  const auto count = static_cast<Eigen::Index>(kept.size());
  Eigen::MatrixXd inner = gram(kept, kept);
  inner.diagonal().array() += ridge;
  const Eigen::MatrixXd inverse = inner.llt().solve(Eigen::MatrixXd::Identity(count, count));
  Predictor result;
  result.inverse = Eigen::MatrixXf::Zero(images, images);
  result.diagonal = Eigen::VectorXf::Zero(images);
  for (Eigen::Index a = 0; a < count; ++a) {
    for (Eigen::Index b = 0; b < count; ++b)
      result.inverse(kept[a], kept[b]) = static_cast<float>(inverse(a, b));
    result.diagonal[kept[a]] = static_cast<float>(inverse(a, a));
  }
  // A frame that is left out: residual b − kᵀM b, of variance κ + ridge − kᵀM k, as if it were the last of n
  // + 1.
  for (Eigen::Index j = 0; j < images; ++j) {
    if (!left_out[j]) continue;
    const Eigen::VectorXd k = gram(kept, j);
    const Eigen::VectorXd weights = inverse * k;
    const double precision = 1.0 / (gram(j, j) + ridge - k.dot(weights));
    for (Eigen::Index a = 0; a < count; ++a)
      result.inverse(j, kept[a]) = static_cast<float>(-precision * weights[a]);
    result.inverse(j, j) = result.diagonal[j] = static_cast<float>(precision);
  }
  return result;
}

/// Puts values in place of unmeasured samples under which their own residuals vanish: the same as leaving
/// them out.
void fill_unmeasured(const Predictor& way, const std::vector<Eigen::Index>& missing,
                     Eigen::VectorXf& series) {
  const auto count = static_cast<Eigen::Index>(missing.size());
  for (const Eigen::Index j : missing) series[j] = 0.0f;
  const Eigen::VectorXf product = way.inverse * series;
  Eigen::MatrixXd inner(count, count);
  Eigen::VectorXd right(count);
  for (Eigen::Index a = 0; a < count; ++a) {
    for (Eigen::Index b = 0; b < count; ++b) inner(a, b) = way.inverse(missing[a], missing[b]);
    right[a] = -product[missing[a]];
  }
  const Eigen::VectorXd values = inner.ldlt().solve(right);
  for (Eigen::Index a = 0; a < count; ++a) series[missing[a]] = static_cast<float>(values[a]);
}

}  // namespace

LightGrams light_grams(std::span<const CaptureFrame> frames, const LightDomain& domain,
                       const RunContext& run) {
  const int columns = cells_along(domain.width, most_columns);
  const int rows = cells_along(domain.height, most_rows);
  std::vector<std::array<Eigen::VectorXd, 3>> features(frames.size());
  tbb::parallel_for(std::size_t{0}, frames.size(), [&](std::size_t j) {
    run.throw_if_stopped();
    const LightMap light = read_illumination(frames[j], domain.parameterisation, run);
    require_usable(light, domain, frames[j].illumination.string());
    coarsen(light, columns, rows, features[j]);
  });
  return grams_of(features, columns, rows);
}

LightGrams light_grams(std::span<const LightMap> lights) {
  if (lights.empty()) throw InputError("no light maps were given");
  const int columns = cells_along(lights[0].radiance.width, most_columns);
  const int rows = cells_along(lights[0].radiance.height, most_rows);
  std::vector<std::array<Eigen::VectorXd, 3>> features(lights.size());
  for (std::size_t j = 0; j < lights.size(); ++j) coarsen(lights[j], columns, rows, features[j]);
  return grams_of(features, columns, rows);
}

LeaveOneOut leave_one_out(const std::vector<Eigen::MatrixXd>& grams, const Eigen::MatrixXf& series,
                          const std::vector<char>& left_out, const RunContext& run) {
  std::vector<Predictor> ways;
  for (const Eigen::MatrixXd& gram : grams)
    for (const double ridge : ridges) ways.push_back(predictor(gram, ridge, left_out));
  const Eigen::Index images = series.rows();
  LeaveOneOut result;
  result.residual = Eigen::MatrixXf::Zero(images, series.cols());
  result.standardised = Eigen::MatrixXf::Zero(images, series.cols());
  const tbb::blocked_range<Eigen::Index> all(0, series.cols(), series_at_a_time);
  tbb::parallel_for(all, [&](const auto& range) {
    run.throw_if_stopped();
    const Eigen::Index first = range.begin();
    const Eigen::Index count = range.end() - first;
    Eigen::MatrixXf values = series.middleCols(first, count);
    std::vector<std::vector<Eigen::Index>> missing(count);
    for (Eigen::Index s = 0; s < count; ++s)
      for (Eigen::Index j = 0; j < images; ++j)
        if (!std::isfinite(values(j, s))) missing[s].push_back(j);
    std::vector<float> best(count, std::numeric_limits<float>::infinity());
    for (const Predictor& way : ways) {
      for (Eigen::Index s = 0; s < count; ++s) {
        if (missing[s].empty()) continue;
        Eigen::VectorXf filled = values.col(s);
        fill_unmeasured(way, missing[s], filled);
        values.col(s) = filled;
      }
      const Eigen::MatrixXf products = way.inverse * values;
      for (Eigen::Index s = 0; s < count; ++s) {
        const Eigen::ArrayXf residual = products.col(s).array() / way.diagonal.array();
        std::vector<float> sizes, standardised;
        for (Eigen::Index j = 0; j < images; ++j)
          if (!left_out[j] && std::isfinite(series(j, first + s))) {
            sizes.push_back(std::abs(residual[j]));
            standardised.push_back(sizes.back() * std::sqrt(way.diagonal[j]));
          }
        const float typical = reordered_median(sizes);
        if (!(typical < best[s])) continue;
        best[s] = typical;
        const float scale = 1.4826f * reordered_median(standardised);
        result.residual.col(first + s) = residual;
        result.standardised.col(first + s) = scale > 0.0f
                                                 ? (residual * way.diagonal.array().sqrt() / scale).eval()
                                                 : Eigen::ArrayXf::Zero(images);
        for (const Eigen::Index j : missing[s])
          result.residual(j, first + s) = result.standardised(j, first + s) = 0.0f;
      }
    }
  });
  return result;
}

}  // namespace refield
