// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/outlier_frames.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "core/base/linear_algebra.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/vector_kernels.h"
#include "estimate/job/observations.h"

namespace refield {

namespace {

constexpr int cell_rows = 12;
constexpr int cell_columns = 16;
constexpr int block = 16;  ///< rows that an EXR file compresses together
constexpr int pixels_across = 4;
constexpr int pixels_down = 3;
constexpr int least_cell_side = 4;

/// Starts of at most `most` cells of `size` pixels along a side of `length`, spread evenly, each a multiple
/// of the size where that is the block.
std::vector<int> starts(int length, int max_count, int size) {
  const int there = std::max(1, length / size);
  const int count = std::min(max_count, there);
  std::vector<int> result;
  for (int i = 0; i < count; ++i) result.push_back(there * (2 * i + 1) / (2 * count) * size);
  return result;
}

/// Where in a cell of `size` the i-th of `count` pixels lies.
int offset(int i, int count, int size) {
  return (2 * i + 1) * size / (2 * count);
}

}  // namespace

double PixelSample::mean_square(std::span<const int> left_out) const {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i]) || std::ranges::count(left_out, static_cast<int>(i % images)) > 0) continue;
    sum += static_cast<double>(values[i]) * values[i];
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

PixelSample read_pixel_sample(std::span<const CaptureFrame> frames, int width, int height, const Mask& mask,
                              float clip_level, const RunContext& run) {
  const int cell_height = std::clamp(height / cell_rows, least_cell_side, block);
  const int cell_width = std::max(least_cell_side, width / cell_columns);
  struct Place {
    int x, y;
  };
  PixelSample sample;
  sample.images = static_cast<int>(frames.size());
  std::vector<std::vector<Place>> bands;  // the places of each row of cells
  std::vector<int> band_rows = starts(height, cell_rows, cell_height);
  for (const int y0 : band_rows) {
    auto& places = bands.emplace_back();
    for (const int x0 : starts(width, cell_columns, cell_width)) {
      PixelSample::Cell cell{x0, y0, cell_width, cell_height, {}};
      for (int j = 0; j < pixels_down; ++j)
        for (int i = 0; i < pixels_across; ++i) {
          const int x = x0 + offset(i, pixels_across, cell_width);
          const int y = y0 + offset(j, pixels_down, cell_height);
          if (x >= width || y >= height) continue;
          if (!mask.empty() && mask[static_cast<std::size_t>(y) * width + x] == 0) continue;
          cell.pixels.push_back(sample.pixels++);
          places.push_back({x, y});
        }
      if (!cell.pixels.empty()) sample.cells.push_back(std::move(cell));
    }
  }
  sample.values.resize(std::size_t{3} * sample.pixels * sample.images);
  int pixel = 0;
  for (std::size_t b = 0; b < bands.size(); ++b) {
    if (bands[b].empty()) continue;
    const int last = std::min(band_rows[b] + cell_height, height);
    const auto band = read_observations(frames, width, band_rows[b], last, clip_level, run);
    for (const Place& place : bands[b]) {
      for (int c = 0; c < 3; ++c)
        std::copy_n(band.samples(place.x, place.y, c), sample.images, sample.series(c, pixel));
      ++pixel;
    }
    const int window_rows = std::min(window_side_px, cell_height);
    for (const int x0 : starts(width, cell_columns, cell_width)) {
      SampleWindow& window = sample.windows.emplace_back();
      for (int y = band_rows[b]; y < std::min(band_rows[b] + window_rows, height); ++y)
        for (int x = x0; x < std::min(x0 + window_side_px, width); ++x) {
          if (!mask.empty() && mask[static_cast<std::size_t>(y) * width + x] == 0) continue;
          for (int c = 0; c < 3; ++c)
            window.values.insert(window.values.end(), band.samples(x, y, c),
                                 band.samples(x, y, c) + sample.images);
          ++window.pixels;
        }
    }
  }
  return sample;
}

namespace {

/// Lights are seen at most so finely: what a pixel shows of finer detail counts as noise here.
constexpr int max_columns = 40;
constexpr int max_rows = 30;
/// Standard deviations of the blurs, in parts of the map's width; 0: none.
constexpr std::array<double, 3> blurs = {0.0, 0.03, 0.12};
constexpr std::array<double, 4> ridges = {1e-5, 1e-4, 1e-3, 1e-2};
/// Few enough to stay in the first-level cache while every row of a predictor passes.
constexpr int series_at_a_time = 32;

int cells_along(int texels, int max_cells) {
  return std::min(texels, max_cells);
}

/// Rows of texels of a cell that the derivatives by the tone curve's exponent are summed over: logarithms
/// cost more than all else.
constexpr int max_tone_rows = 8;

/// What light_features() holds of one light, with logarithms of radiance itself.
struct CoarseLight {
  std::array<std::array<Eigen::VectorXd, 3>, 3> sums;  // [channel][derivative], [cells]
  float white = 0.0f;
  LightSketch sketch;

  CoarseLight(const LightMap& light, int columns, int rows) : sketch(sketch_of(light.radiance)) {
    const Image& image = light.radiance;
    const auto cells = static_cast<Eigen::Index>(columns) * rows;
    std::array<Eigen::VectorXd, 3> in_tone_rows;
    for (int c = 0; c < 3; ++c) {
      sums[c].fill(Eigen::VectorXd::Zero(cells));
      in_tone_rows[c] = Eigen::VectorXd::Zero(cells);
    }
    const int step = std::max(1, image.height / rows / max_tone_rows);
    for (int y = 0; y < image.height; ++y) {
      const int row = static_cast<int>(static_cast<std::int64_t>(y) * rows / image.height);
      for (int x = 0; x < image.width; ++x) {
        const int column = static_cast<int>(static_cast<std::int64_t>(x) * columns / image.width);
        const Eigen::Index cell = row * columns + column;
        for (int c = 0; c < 3; ++c) {
          const float value = image.at(x, y, c);
          sums[c][0][cell] += value;
          white = std::max(white, value);
          if (y % step != 0 || !(value > 0.0f)) continue;
          const float logarithm = std::log(value);
          in_tone_rows[c][cell] += value;
          sums[c][1][cell] += value * logarithm;
          sums[c][2][cell] += value * logarithm * logarithm;
        }
      }
    }
    for (int c = 0; c < 3; ++c)
      for (Eigen::Index i = 0; step > 1 && i < cells; ++i) {
        const double factor = in_tone_rows[c][i] > 0.0 ? sums[c][0][i] / in_tone_rows[c][i] : 0.0;
        sums[c][1][i] *= factor;
        sums[c][2][i] *= factor;
      }
  }
};

LightFeatures features_of(const std::vector<std::optional<CoarseLight>>& lights, int columns, int rows) {
  LightFeatures features;
  features.columns = columns;
  features.rows = rows;
  const auto images = static_cast<Eigen::Index>(lights.size());
  std::vector<LightSketch> sketches;
  for (const auto& light : lights) {
    features.white = std::max<double>(features.white, light->white);
    sketches.push_back(light->sketch);
  }
  features.groups = light_groups(sketches);
  const double log_white = std::log(features.white > 0.0 ? features.white : 1.0);
  for (int c = 0; c < 3; ++c) {
    auto& channel = features.of_channel[c];
    channel.fill(Eigen::MatrixXd(static_cast<Eigen::Index>(columns) * rows, images));
    for (Eigen::Index j = 0; j < images; ++j) {
      const auto& sums = lights[j]->sums[c];
      channel[0].col(j) = sums[0];
      channel[1].col(j) = sums[1] - log_white * sums[0];
      channel[2].col(j) = sums[2] - 2.0 * log_white * sums[1] + log_white * log_white * sums[0];
    }
  }
  return features;
}

}  // namespace

Eigen::MatrixXd blur_matrix(Eigen::Index cells, double sigma) {
  Eigen::MatrixXd weights(cells, cells);
  for (Eigen::Index i = 0; i < cells; ++i)
    for (Eigen::Index j = 0; j < cells; ++j)
      weights(i, j) = std::exp(-0.5 * static_cast<double>((i - j) * (i - j)) / (sigma * sigma));
  return weights.array().colwise() / weights.rowwise().sum().array();
}

LightGrams light_grams(const LightFeatures& lights) {
  const Eigen::Index images = lights.images();
  const int columns = lights.columns, rows = lights.rows;
  LightGrams grams;
  grams.images = static_cast<int>(images);
  grams.repeats = repeats_in(lights.groups);
  for (int c = 0; c < 3; ++c)
    for (const double blur : blurs) {
      Eigen::MatrixXd features(images, static_cast<Eigen::Index>(columns) * rows);
      for (Eigen::Index j = 0; j < images; ++j) {
        const auto light = lights.of_channel[c][0].col(j);
        features.row(j) = light;
        if (blur == 0.0) continue;
        const double sigma = std::max(0.5, blur * columns);
        const Eigen::Map<const Eigen::MatrixXd> map(light.data(), columns, rows);
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

Eigen::MatrixXd ridge_inverse(const Eigen::MatrixXd& gram, double ridge) {
  Eigen::MatrixXd inner = gram;
  inner.diagonal().array() += ridge;
  return inner.llt().solve(Eigen::MatrixXd::Identity(gram.rows(), gram.rows()));
}

namespace {

float reordered_median(std::vector<float>& values) {
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

/// One way to predict: the inverse M of gram + ridge over the frames that count, zero elsewhere, and for the
/// others what it takes to predict them.
struct Predictor {
  std::size_t stride = 0;
  AlignedFloats inverse;  ///< rows of [stride] floats, padded with zeros; [images × stride]
  /// Diagonal of the inverse; for frames that are left out, and those of repeated lights, inverse predictive
  /// variance.
  Eigen::VectorXf diagonal;
  /// Rows that are predictions from others alone, times `diagonal`: of the same frames.
  std::vector<char> is_prediction;
  AlignedFloats with_repeats;  ///< `inverse` before frames of one light were kept from predicting each other
  Eigen::MatrixXd exact;       ///< the same, unrounded: differences of its entries count

  float* row(Eigen::Index j) { return inverse.data() + j * stride; }
  const float* row(Eigen::Index j) const { return inverse.data() + j * stride; }
  const float* filling_row(Eigen::Index j) const {
    return (with_repeats.empty() ? inverse : with_repeats).data() + j * stride;
  }
};

/// Rows for the frames of one light, from the inverse of the `kept` frames, its rows and columns in their
/// order: (P_GG)⁻¹ P_G is what these show more than the other frames predict, and (P_GG)⁻¹ its covariance.
void predict_without(const std::vector<int>& group, const Eigen::MatrixXd& gram, double ridge,
                     const std::vector<Eigen::Index>& kept, const Eigen::MatrixXd& inverse,
                     Predictor& result) {
  std::vector<Eigen::Index> own, places;  // of the group's frames that are kept
  for (const int j : group)
    if (const auto found = std::ranges::lower_bound(kept, j); found != kept.end() && *found == j) {
      own.push_back(j);
      places.push_back(found - kept.begin());
    }
  if (own.empty()) return;
  const Eigen::MatrixXd inner = inverse(places, places);
  const Eigen::LLT<Eigen::MatrixXd> factor(inner);
  const Eigen::MatrixXd residual = factor.solve(Eigen::MatrixXd(inverse(places, Eigen::all)));
  const Eigen::MatrixXd covariance = factor.solve(Eigen::MatrixXd::Identity(inner.rows(), inner.rows()));
  const auto set_row = [&](Eigen::Index j, const Eigen::VectorXd& functional, double precision) {
    std::fill_n(result.row(j), result.stride, 0.0f);
    for (std::size_t a = 0; a < kept.size(); ++a)
      result.row(j)[kept[a]] = static_cast<float>(precision * functional[static_cast<Eigen::Index>(a)]);
    for (const Eigen::Index other : own) result.row(j)[other] = 0.0f;  // but for rounding
    result.row(j)[j] = result.diagonal[j] = static_cast<float>(precision);
    result.is_prediction[j] = 1;
  };
  for (std::size_t i = 0; i < own.size(); ++i) {
    const auto a = static_cast<Eigen::Index>(i);
    set_row(own[i], residual.row(a), 1.0 / covariance(a, a));
  }
  for (const int j : group) {
    if (std::ranges::binary_search(own, j)) continue;  // the others are left out
    Eigen::VectorXd k = gram(kept, j);
    k(places).setZero();
    const Eigen::VectorXd with_own = inverse * k;
    const Eigen::VectorXd weights = with_own - residual.transpose() * with_own(places);
    set_row(j, -weights, 1.0 / (gram(j, j) + ridge - k.dot(weights)));
  }
}

Predictor predictor(const Eigen::MatrixXd& gram, double ridge, const std::vector<char>& left_out,
                    const std::vector<std::vector<int>>& repeats) {
  const Eigen::Index images = gram.rows();
  std::vector<Eigen::Index> kept;
  for (Eigen::Index j = 0; j < images; ++j)
    if (!left_out[j]) kept.push_back(j);
  const auto count = static_cast<Eigen::Index>(kept.size());
  const Eigen::MatrixXd inverse = ridge_inverse(gram(kept, kept), ridge);
  Predictor result;
  result.stride = padded_length(images);
  result.inverse.assign(images * result.stride, 0.0f);
  result.diagonal = Eigen::VectorXf::Zero(images);
  result.is_prediction = left_out;
  result.exact = Eigen::MatrixXd::Zero(images, images);
  result.exact(kept, kept) = inverse;
  for (Eigen::Index a = 0; a < count; ++a) {
    for (Eigen::Index b = 0; b < count; ++b) result.row(kept[a])[kept[b]] = static_cast<float>(inverse(a, b));
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
      result.row(j)[kept[a]] = static_cast<float>(-precision * weights[a]);
    result.row(j)[j] = result.diagonal[j] = static_cast<float>(precision);
  }
  if (!repeats.empty()) result.with_repeats = result.inverse;
  for (const auto& group : repeats) predict_without(group, gram, ridge, kept, inverse, result);
  return result;
}

/// Puts values in place of unmeasured samples under which their own residuals vanish: the same as leaving
/// them out. `series`: [stride].
void fill_unmeasured(const Predictor& way, const std::vector<Eigen::Index>& missing, float* series) {
  const auto count = static_cast<Eigen::Index>(missing.size());
  for (const Eigen::Index j : missing) series[j] = 0.0f;
  const Eigen::MatrixXd inner = way.exact(missing, missing);
  Eigen::VectorXd right(count);
  for (Eigen::Index a = 0; a < count; ++a) {
    const float* row = way.filling_row(missing[a]);
    float product = 0.0f;
    dots(series, &row, 1, way.stride, &product);
    right[a] = -product;
  }
  const Eigen::VectorXd values = solve_symmetric(inner, right);
  for (Eigen::Index a = 0; a < count; ++a) series[missing[a]] = static_cast<float>(values[a]);
}

/// Of each frame's residual where `missing` frames were not measured: the diagonal of (K + λI)⁻¹ of the
/// measured frames alone; of predictions, the variance of the missing ones is added.
Eigen::VectorXf precision_without(const Predictor& way, const std::vector<Eigen::Index>& missing) {
  const Eigen::Index images = way.exact.rows();
  Eigen::MatrixXd on_missing = way.exact(missing, Eigen::all);
  for (Eigen::Index j = 0; j < images; ++j)
    for (std::size_t a = 0; way.is_prediction[j] && a < missing.size(); ++a)
      on_missing(static_cast<Eigen::Index>(a), j) = way.row(j)[missing[a]];
  const Eigen::MatrixXd inner = way.exact(missing, missing);
  inner.llt().matrixL().solveInPlace(on_missing);
  Eigen::VectorXf precision(images);
  for (Eigen::Index j = 0; j < images; ++j) {
    const double lost = on_missing.col(j).squaredNorm();
    const double p = way.is_prediction[j] ? way.diagonal[j] : way.exact(j, j);
    constexpr double least = 1e-9;  // of p: no negative one by rounding
    precision[j] =
        static_cast<float>(way.is_prediction[j] ? p / (1.0 + lost / p) : std::max(p - lost, least * p));
  }
  return precision;
}

/// Several series of one channel, each tried with one predictor after another; the best is kept.
class SeriesBatch {
 public:
  /// `first`, `count`: of the columns of `series`, which must outlive this.
  SeriesBatch(const Eigen::MatrixXf& series, Eigen::Index first, Eigen::Index count,
              const std::vector<char>& left_out)
      : series_(series),
        first_(first),
        count_(count),
        images_(series.rows()),
        stride_(padded_length(images_)),
        values_(count * stride_, 0.0f),
        products_(images_ * count),
        missing_(count),
        counted_(count),
        best_(count, std::numeric_limits<float>::infinity()),
        residual_(images_) {
    for (Eigen::Index s = 0; s < count; ++s) {
      values_of_.push_back(values_.data() + s * stride_);
      for (Eigen::Index j = 0; j < images_; ++j) {
        const float value = series(j, first + s);
        values_[s * stride_ + j] = value;
        if (!std::isfinite(value)) values_[s * stride_ + j] = 0.0f;
        if (!left_out[j]) (std::isfinite(value) ? counted_ : missing_)[s].push_back(j);
      }
    }
  }

  void try_predictor(const Predictor& way, LeaveOneOut& result) {
    for (Eigen::Index s = 0; s < count_; ++s)
      if (!missing_[s].empty()) fill_unmeasured(way, missing_[s], values_.data() + s * stride_);
    for (Eigen::Index j = 0; j < images_; ++j)
      dots(way.row(j), values_of_.data(), count_, stride_, products_.data() + j * count_);
    for (Eigen::Index s = 0; s < count_; ++s) {
      if (!missing_[s].empty()) precision_ = precision_without(way, missing_[s]);
      const Eigen::VectorXf& precision = missing_[s].empty() ? way.diagonal : precision_;
      for (Eigen::Index j = 0; j < images_; ++j)
        residual_[j] = products_[j * count_ + s] / (way.is_prediction[j] ? way.diagonal : precision)[j];
      const auto& counted = counted_[s];
      // The median is below the best one if more than half the residuals are: most ways end here.
      const auto below =
          std::ranges::count_if(counted, [&](Eigen::Index j) { return std::abs(residual_[j]) < best_[s]; });
      if (below <= std::ssize(counted) / 2) continue;
      sizes_.clear();
      for (const Eigen::Index j : counted) sizes_.push_back(std::abs(residual_[j]));
      standardised_ = sizes_;
      for (std::size_t i = 0; i < counted.size(); ++i) standardised_[i] *= std::sqrt(precision[counted[i]]);
      best_[s] = reordered_median(sizes_);
      const float scale = 1.4826f * reordered_median(standardised_);
      auto residual = result.residual.col(first_ + s), standardised = result.standardised.col(first_ + s);
      for (Eigen::Index j = 0; j < images_; ++j) {
        residual[j] = residual_[j];
        standardised[j] = scale > 0.0f ? residual_[j] * std::sqrt(precision[j]) / scale : 0.0f;
      }
      for (Eigen::Index j = 0; j < images_; ++j)
        if (!std::isfinite(series_(j, first_ + s))) residual[j] = standardised[j] = 0.0f;
    }
  }

 private:
  const Eigen::MatrixXf& series_;
  const Eigen::Index first_, count_, images_;
  const std::size_t stride_;
  AlignedFloats values_;                                      // [count × stride]
  std::vector<const float*> values_of_;                       // of each series
  std::vector<float> products_;                               // [images × count]
  std::vector<std::vector<Eigen::Index>> missing_, counted_;  // of the frames that are not left out
  std::vector<float> best_;                                   // median size of the residuals
  Eigen::VectorXf precision_;
  std::vector<float> residual_, sizes_, standardised_;
};

}  // namespace

LightFeatures light_features(std::span<const CaptureFrame> frames, const LightDomain& domain,
                             const RunContext& run) {
  const int columns = cells_along(domain.width, max_columns);
  const int rows = cells_along(domain.height, max_rows);
  std::vector<std::optional<CoarseLight>> lights(frames.size());
  tbb::parallel_for(std::size_t{0}, frames.size(), [&](std::size_t j) {
    run.throw_if_stopped();
    const LightMap light = read_illumination(frames[j], domain.parameterisation, run);
    require_usable(light, domain, frames[j].illumination.string());
    lights[j].emplace(light, columns, rows);
  });
  return features_of(lights, columns, rows);
}

LeaveOneOut leave_one_out(const std::vector<Eigen::MatrixXd>& grams, const Eigen::MatrixXf& series,
                          const std::vector<char>& left_out, const std::vector<std::vector<int>>& repeats,
                          const RunContext& run) {
  std::vector<Predictor> ways;
  for (const Eigen::MatrixXd& gram : grams)
    for (const double ridge : ridges) ways.push_back(predictor(gram, ridge, left_out, repeats));
  const Eigen::Index images = series.rows();
  LeaveOneOut result;
  result.residual = Eigen::MatrixXf::Zero(images, series.cols());
  result.standardised = Eigen::MatrixXf::Zero(images, series.cols());
  const tbb::blocked_range<Eigen::Index> all(0, series.cols(), series_at_a_time);
  tbb::parallel_for(all, [&](const auto& range) {
    run.throw_if_stopped();
    const Eigen::Index first = range.begin();
    const Eigen::Index count = range.end() - first;
    SeriesBatch batch(series, first, count, left_out);
    for (const Predictor& way : ways) batch.try_predictor(way, result);
  });
  return result;
}

namespace {

/// A frame is an outlier when the logarithm of its residual lies that many standard deviations, and at least
/// so far, above the median frame's: a factor of 2.2 over the picture, of 2.7 in a cell. In good captures,
/// noise with heavy tails included, no frame came beyond 1.7 and 2.1.
struct Limit {
  double deviations;
  double least;
};
constexpr Limit limit_whole{6.0, 0.8};
constexpr Limit limit_cell{7.0, 1.0};
/// A cell differs in an outlier when its residual is this many times its own typical one.
constexpr float cell_differs = 3.0f;
/// An outlier's residual, relative to what the pixels show, is at least that many times the typical frame's.
constexpr double least_residual = 2.0;
constexpr int max_rounds = 8;
/// Frames that stand less out than the worst by this logarithm wait for the next round: the worst may have
/// made them.
constexpr double close_to_worst = 1.5;
constexpr float tiny = 1e-12f;

/// How far each value lies above the median of those not left out, in units of the limit: beyond 1 is an
/// outlier.
std::vector<double> excess(const std::vector<float>& statistic, const std::vector<char>& left_out,
                           const Limit& limit) {
  std::vector<float> logs;
  for (std::size_t j = 0; j < statistic.size(); ++j)
    if (!left_out[j]) logs.push_back(std::log(std::max(statistic[j], tiny)));
  const float centre = upper_median(logs);
  for (float& value : logs) value = std::abs(value - centre);
  const double reach = std::max(limit.deviations * 1.4826 * upper_median(logs), limit.least);
  std::vector<double> result;
  for (const float value : statistic) result.push_back((std::log(std::max(value, tiny)) - centre) / reach);
  return result;
}

/// Residuals of all frames, and what is assessed by.
class Examination {
 public:
  Examination(const LightGrams& grams, const PixelSample& sample, const std::vector<char>& left_out,
              const RunContext& run)
      : sample_(sample) {
    for (int c = 0; c < 3; ++c) {
      const Eigen::Map<const Eigen::MatrixXf> series(sample.series(c, 0), sample.images, sample.pixels);
      loo_[c] = leave_one_out(grams.of_channel[c], series, left_out, grams.repeats, run);
    }
    cells_.resize(sample.cells.size());
    for (int j = 0; j < sample.images; ++j) {
      std::vector<float> sizes;
      float worst = 0.0f;
      for (std::size_t i = 0; i < cells_.size(); ++i) {
        const std::vector<int>& pixels = sample.cells[i].pixels;
        std::vector<float> in_cell;
        for (const int p : pixels)
          if (const auto measured = size(j, p)) in_cell.push_back(*measured);
        if (2 * in_cell.size() < pixels.size()) in_cell.clear();  // the median of few would stand out
        sizes.insert(sizes.end(), in_cell.begin(), in_cell.end());
        cells_[i].push_back(upper_median(std::move(in_cell)));
        worst = std::max(worst, cells_[i].back());
      }
      whole_.push_back(upper_median(std::move(sizes)));
      worst_cell_.push_back(worst);
    }
  }

  const std::vector<float>& whole() const { return whole_; }
  const std::vector<float>& worst_cell() const { return worst_cell_; }

  /// Median of |observed − predicted| / predicted over pixels and channels.
  double relative_residual(int j, const std::vector<int>& pixels) const {
    std::vector<float> values;
    for_each_ratio(j, pixels, [&](int, float ratio) { values.push_back(std::abs(ratio)); });
    return upper_median(std::move(values));
  }
  std::array<double, 3> brightness(int j, const std::vector<int>& pixels) const {
    std::array<std::vector<float>, 3> values;
    for_each_ratio(j, pixels, [&](int c, float ratio) { values[c].push_back(ratio); });
    return {upper_median(values[0]), upper_median(values[1]), upper_median(values[2])};
  }
  /// What is left of the relative residual once the brightness of each channel is put right.
  double residual_besides_brightness(int j, const std::vector<int>& pixels,
                                     const std::array<double, 3>& brightness) const {
    std::vector<float> values;
    for_each_ratio(j, pixels, [&](int c, float ratio) {
      values.push_back(static_cast<float>(std::abs(ratio - brightness[c])));
    });
    return upper_median(std::move(values));
  }
  /// Cells whose residual in frame j is far from their own usual one.
  std::vector<std::size_t> differing_cells(int j) const {
    std::vector<std::size_t> result;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      std::vector<float> measured = cells_[i];
      std::erase(measured, 0.0f);
      if (cells_[i][j] > cell_differs * std::max(upper_median(std::move(measured)), tiny))
        result.push_back(i);
    }
    return result;
  }

 private:
  /// Mean over the measured channels of the standardised residual.
  std::optional<float> size(int j, int p) const {
    float sum = 0.0f, count = 0.0f;
    for (int c = 0; c < 3; ++c) {
      if (!std::isfinite(sample_.series(c, p)[j])) continue;
      sum += std::abs(loo_[c].standardised(j, p));
      count += 1.0f;
    }
    return count > 0.0f ? std::optional(sum / count) : std::nullopt;
  }
  template <class Use>
  void for_each_ratio(int j, const std::vector<int>& pixels, Use use) const {
    for (const int p : pixels)
      for (int c = 0; c < 3; ++c) {
        const float observed = sample_.series(c, p)[j];
        const float predicted = observed - loo_[c].residual(j, p);
        if (std::isfinite(observed) && predicted > 0.0f) use(c, observed / predicted - 1.0f);
      }
  }

  const PixelSample& sample_;
  std::array<LeaveOneOut, 3> loo_;
  std::vector<float> whole_, worst_cell_;  // of each frame
  std::vector<std::vector<float>> cells_;  // [cells][frames]; zero where fewer than half was measured
};

std::vector<int> all_pixels(const PixelSample& sample) {
  std::vector<int> pixels(sample.pixels);
  for (int p = 0; p < sample.pixels; ++p) pixels[p] = p;
  return pixels;
}

/// What a typical frame shows, to measure the others by.
struct Typical {
  double whole = 0.0;  ///< medians over the frames that count
  double worst_cell = 0.0;
  double residual = 0.0;  ///< relative
};

Typical typical_of(const Examination& found, const std::vector<int>& pixels,
                   const std::vector<char>& left_out) {
  std::vector<float> whole, cell, residual;
  for (std::size_t j = 0; j < left_out.size(); ++j) {
    if (left_out[j]) continue;
    whole.push_back(found.whole()[j]);
    cell.push_back(found.worst_cell()[j]);
    residual.push_back(static_cast<float>(found.relative_residual(static_cast<int>(j), pixels)));
  }
  return {std::max(upper_median(whole), tiny), std::max(upper_median(cell), tiny), upper_median(residual)};
}

/// `everywhere`: it stands out over the whole picture, not in a cell alone.
OutlierFrame describe(const Examination& found, const PixelSample& sample, const std::vector<int>& all,
                      const Typical& typical, int j, bool everywhere) {
  OutlierFrame outlier;
  outlier.frame = j;
  if (everywhere) {
    outlier.times_typical = found.whole()[j] / typical.whole;
    outlier.residual = found.relative_residual(j, all);
    outlier.brightness = found.brightness(j, all);
    const double rest = found.residual_besides_brightness(j, all, outlier.brightness);
    outlier.kind = rest < std::max(3.0 * typical.residual, 0.1 * outlier.residual)
                       ? OutlierFrame::Kind::brightness
                       : OutlierFrame::Kind::light;
    return outlier;
  }
  const auto cells = found.differing_cells(j);
  std::vector<int> pixels;
  std::vector<float> xs, ys;
  for (const std::size_t i : cells) {
    const PixelSample::Cell& cell = sample.cells[i];
    pixels.insert(pixels.end(), cell.pixels.begin(), cell.pixels.end());
    xs.push_back(static_cast<float>(cell.x + cell.width / 2));
    ys.push_back(static_cast<float>(cell.y + cell.height / 2));
  }
  outlier.kind = OutlierFrame::Kind::region;
  outlier.share = static_cast<double>(cells.size()) / static_cast<double>(sample.cells.size());
  outlier.x = static_cast<int>(upper_median(xs));
  outlier.y = static_cast<int>(upper_median(ys));
  outlier.times_typical = found.worst_cell()[j] / typical.worst_cell;
  outlier.residual = found.relative_residual(j, pixels);
  outlier.brightness = found.brightness(j, pixels);
  return outlier;
}

/// A start: many bad frames spoil what the others predict of each other, so the search begins without the
/// worst; the good ones among them come back.
std::vector<char> worst_fifth(const Examination& found) {
  std::vector<float> ordered = found.whole();
  std::ranges::sort(ordered);
  const float limit = ordered[ordered.size() - 1 - ordered.size() / 5];
  std::vector<char> result;
  for (const float value : found.whole()) result.push_back(value > limit);
  return result;
}

}  // namespace

std::string description_of(const OutlierFrame& outlier) {
  const auto percent = [](double value) { return 100.0 * value; };
  switch (outlier.kind) {
    case OutlierFrame::Kind::brightness: {
      const auto& b = outlier.brightness;
      return formatted(
          "its brightness is off by %+.1f, %+.1f, %+.1f %% (red, green, blue): a flicker or another exposure",
          percent(b[0]), percent(b[1]), percent(b[2]));
    }
    case OutlierFrame::Kind::light:
      return formatted(
          "it differs by %.0f %% from what the other photographs predict, %.0f times as much as "
          "usual: perhaps it was taken under another light",
          percent(outlier.residual), outlier.times_typical);
    default:  // a region
      return formatted(
          "%.0f %% of the picture, around pixel (%d, %d), differs by %.0f %%, %.0f times as much "
          "as usual: something moved there",
          percent(outlier.share), outlier.x, outlier.y, percent(outlier.residual), outlier.times_typical);
  }
}

OutlierSearch find_outlier_frames(const LightGrams& grams, const PixelSample& sample, const RunContext& run) {
  OutlierSearch search;
  if (sample.images < min_frames_to_assess || sample.pixels == 0) return search;
  std::vector<char> left_out =
      worst_fifth(Examination(grams, sample, std::vector<char>(sample.images, 0), run));
  for (int round = 0;; ++round) {
    run.throw_if_stopped();
    const Examination found(grams, sample, left_out, run);
    const auto whole = excess(found.whole(), left_out, limit_whole);
    const auto cell = excess(found.worst_cell(), left_out, limit_cell);
    const auto standing = [&](int j) { return std::max(whole[j], cell[j]); };
    double worst = 0.0;
    for (int j = 0; j < sample.images; ++j)
      if (!left_out[j]) worst = std::max(worst, standing(j));
    // Frames left out in earlier rounds come back where the others, by themselves, predict them.
    std::vector<char> next(sample.images, 0);
    for (int j = 0; j < sample.images; ++j)
      next[j] = standing(j) > 1.0 && (left_out[j] || standing(j) > worst / close_to_worst);
    if (next == left_out || round == max_rounds) {
      const auto all = all_pixels(sample);
      const Typical typical = typical_of(found, all, left_out);
      search.typical_residual = typical.residual;
      for (int j = 0; j < sample.images; ++j) {
        search.residuals.push_back(found.relative_residual(j, all));
        if (!left_out[j]) continue;
        const OutlierFrame outlier = describe(found, sample, all, typical, j, whole[j] > 1.0);
        // Under a very bright light noise is so low that what stands out need not matter.
        if (outlier.residual > least_residual * typical.residual) search.outliers.push_back(outlier);
      }
      search.too_many = 4 * search.outliers.size() > static_cast<std::size_t>(sample.images);
      return search;
    }
    left_out = next;
    if (4 * std::ranges::count(left_out, 1) > 3 * sample.images) return search;  // no assessing at all
  }
}

}  // namespace refield
