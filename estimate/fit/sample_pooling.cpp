// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/sample_pooling.h"

#include <cmath>
#include <numbers>

#include "core/base/linear_algebra.h"
#include "core/image/metrics.h"
#include "estimate/fit/vector_kernels.h"

namespace refield {

namespace {

constexpr double noise_quantile = 0.25;
/// Components count as noise up to this many times the largest variance that noise alone reaches. On a
/// capture with 2 to 3 % noise, 1.5 reduces the median error under bars by 2 % more than 1.0; 2 is no better.
constexpr double noise_margin = 1.5;
/// A window keeps its samples if more than this part of its components are above the noise.
constexpr double max_rank_share = 1.0 / 3.0;
/// Less noise is not worth pooling: it is averaged out by the fit, whereas detail that pooling removes is
/// lost. With 0.7 % noise, pooling increases the median error under bars by 2 %.
constexpr double min_noise = 0.01;
/// Dark pixels count as no noisier than this, else most of what they show is taken for noise.
constexpr double max_noise = 0.15;
/// Fewer pixels have too little in common to tell noise from detail.
constexpr int min_window_pixels = 9;
/// Images keep equal weights if the standard deviation of the logarithms of their noise is below this: it is
/// measured to a few per cent, and the weights would reduce the variance of a fit by no more than 4 %.
constexpr double min_noise_spread = 0.1;
/// With less noise, detail makes up much of the weakest components. With 1.1 %, weights increase the error of
/// the picture by 2 % in natural light and 5 % under bars.
constexpr double min_weighted_noise = 0.02;
/// Images weigh at most this many times as much as the usual one. The measured noise of nearly black images
/// is not to be trusted: values below zero are cut off.
constexpr double max_weight_ratio = 4.0;
/// Times that the images' noise is measured, each time on images with the weights before. With one, images of
/// ten times the noise weigh twice what they should, and the field's error grows by a sixth; a fourth reduces
/// it by 2 %.
constexpr int weighting_passes = 3;
/// The noise of an image is measured without it: this many groups of images.
constexpr int image_folds = 4;
/// Brightness levels of the noise model, each with at least this number of windows.
constexpr int max_levels = 12, min_windows_per_level = 6;

constexpr int forward_offsets = window_side_px + (window_side_px - 1) * (2 * window_side_px - 1);
constexpr int offset_side = 2 * window_side_px - 1;

/// The eigenvalue below which the part `share` of a noise matrix's eigenvalues lies (Marchenko and Pastur
/// 1967): unit variance, `ratio` of columns to rows at most 1.
double noise_eigenvalue(double ratio, double share) {
  const double min_eigenvalue = std::pow(1.0 - std::sqrt(ratio), 2),
               max_eigenvalue = std::pow(1.0 + std::sqrt(ratio), 2);
  constexpr int steps = 2000;
  const double step = (max_eigenvalue - min_eigenvalue) / steps;
  double sum = 0.0;
  for (int i = 0; i < steps; ++i) {
    const double x = min_eigenvalue + (i + 0.5) * step;
    sum +=
        step * std::sqrt((max_eigenvalue - x) * (x - min_eigenvalue)) / (2.0 * std::numbers::pi * ratio * x);
    if (sum >= share) return x;
  }
  return max_eigenvalue;
}

int quartile_of(int pixels) {
  return static_cast<int>(noise_quantile * pixels);
}

double bulk_of(int pixels, double rows) {
  return noise_eigenvalue(std::min(pixels / rows, 1.0), (quartile_of(pixels) + 0.5) / pixels);
}

/// Where windows start that contain one of the pixels [first, last) of a side of the picture: at multiples of
/// the step, the last at the picture's edge.
std::vector<int> window_starts(int first, int last, int length) {
  std::vector<int> starts;
  const int end = length - window_side_px;
  for (int start = 0; start < end + window_step_px; start += window_step_px) {
    const int at = std::min(start, end);
    if (at + window_side_px > first && at < last) starts.push_back(at);
  }
  return starts;
}

}  // namespace

double kept_share(double energy, double ratio) {
  const double edge = 1.0 + std::sqrt(ratio);  // of what noise alone reaches
  if (!(energy > edge * edge)) return 0.0;
  const double beyond = energy - ratio - 1.0;
  return std::sqrt(std::max(beyond * beyond - 4.0 * ratio, 0.0)) / energy;
}

double NoiseModel::relative_variance(double mean_square) const {
  if (log_level.empty() || !(mean_square > 0.0)) return 0.0;
  const double level = std::log(mean_square);
  const auto above = std::ranges::upper_bound(log_level, level) - log_level.begin();
  if (above == 0) return std::exp(log_variance.front());
  if (above == std::ssize(log_level)) return std::exp(log_variance.back());
  const double part = (level - log_level[above - 1]) / (log_level[above] - log_level[above - 1]);
  return std::exp(std::lerp(log_variance[above - 1], log_variance[above], part));
}

namespace {

/// What noise is measured by: the weakest components of a window.
struct WeakestComponents {
  double log_level;    // of the mean square
  double eigenvalue;   // relative to it; the largest of these components
  double independent;  // samples that an image holds of a pixel, see NoiseModel
  int pixels;
  Eigen::VectorXd by_image;  // energy, [images seen]
};

/// `weights`: [images seen]. Nothing for a window with black pixels, unmeasured samples or no noise.
std::optional<WeakestComponents> weakest_components(const SampleWindow& window, int images,
                                                    std::span<const int> seen,
                                                    const Eigen::VectorXd& weights) {
  const int m = window.pixels;
  const auto rows = static_cast<int>(seen.size());
  if (m < min_window_pixels || 2 * m > rows) return std::nullopt;
  std::array<Eigen::MatrixXd, 3> scaled;
  std::array<Eigen::MatrixXd, image_folds> gram_of_fold;
  for (Eigen::MatrixXd& each : gram_of_fold) each = Eigen::MatrixXd::Zero(m, m);
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(m, m);
  double mean_square = 0.0;
  const auto rows_of = [&](int c, int fold) -> Eigen::MatrixXd {
    return scaled[c](Eigen::seq(fold, rows - 1, image_folds), Eigen::all);
  };
  for (int c = 0; c < 3; ++c) {
    scaled[c].resize(rows, m);
    for (int p = 0; p < m; ++p)
      for (int j = 0; j < rows; ++j)
        scaled[c](j, p) =
            weights[j] * window.values[(static_cast<std::size_t>(p) * 3 + c) * images + seen[j]];
    for (int p = 0; p < m; ++p) {
      const double square = scaled[c].col(p).squaredNorm() / rows;
      mean_square += square / (3 * m);
      scaled[c].col(p) /= std::sqrt(square);
    }
    for (int fold = 0; fold < image_folds; ++fold) {
      const Eigen::MatrixXd part = rows_of(c, fold);
      gram_of_fold[fold] += part.transpose() * part / (3.0 * rows);
    }
    gram += scaled[c].transpose() * scaled[c] / (3.0 * rows);
  }
  if (!gram.allFinite()) return std::nullopt;
  const int weakest = quartile_of(m);
  // Components that an image took part in are weak where its noise happens to be small, so that its energy is
  // taken from components of the other images.
  Eigen::VectorXd by_image = Eigen::VectorXd::Zero(rows);
  for (int fold = 0; fold < image_folds; ++fold) {
    const Eigen::MatrixXd others = symmetric_eigen(gram - gram_of_fold[fold]).vectors;
    for (int c = 0; c < 3; ++c) {
      const Eigen::MatrixXd energies = rows_of(c, fold) * others.leftCols(weakest);
      for (Eigen::Index i = 0; i < energies.rows(); ++i)
        by_image[fold + i * image_folds] += energies.row(i).squaredNorm();
    }
  }
  const SymmetricEigen eigen = symmetric_eigen(gram);
  std::array<Eigen::MatrixXd, 3> components;
  for (int c = 0; c < 3; ++c) components[c] = scaled[c] * eigen.vectors.leftCols(weakest);
  Eigen::Matrix3d products;
  for (int c = 0; c < 3; ++c)
    for (int d = 0; d < 3; ++d) products(c, d) = components[c].cwiseProduct(components[d]).sum();
  const Eigen::Vector3d scale = products.diagonal().cwiseSqrt().cwiseInverse();
  const double independent = 9.0 / (scale.asDiagonal() * products * scale.asDiagonal()).squaredNorm();
  if (!std::isfinite(independent)) return std::nullopt;
  return WeakestComponents{std::log(mean_square), eigen.values[weakest], independent, m,
                           by_image / by_image.mean()};
}

std::vector<WeakestComponents> weakest_components_of(std::span<const SampleWindow> windows, int images,
                                                     std::span<const int> seen,
                                                     const Eigen::VectorXd& weights) {
  std::vector<WeakestComponents> result;
  for (const SampleWindow& window : windows)
    if (auto found = weakest_components(window, images, seen, weights)) result.push_back(std::move(*found));
  return result;
}

/// Standard deviation of each image's noise relative to the others'.
Eigen::VectorXd noise_by_image(std::span<const WeakestComponents> measured) {
  Eigen::VectorXd noise(measured.front().by_image.size());
  std::vector<float> energies;
  for (Eigen::Index j = 0; j < noise.size(); ++j) {
    energies.clear();
    for (const WeakestComponents& each : measured) energies.push_back(static_cast<float>(each.by_image[j]));
    noise[j] = std::sqrt(quantile(energies, 0.5));
  }
  return noise;
}

/// Reciprocals of the noise, at most max_weight_ratio times the usual one, scaled so that samples keep their
/// mean square.
Eigen::VectorXd weights_for(const Eigen::VectorXd& noise, std::span<const SampleWindow> windows, int images,
                            std::span<const int> seen) {
  Eigen::VectorXd weights = noise.cwiseMax(1e-6).cwiseInverse();
  std::vector<float> sorted;
  for (const double weight : weights) sorted.push_back(static_cast<float>(weight));
  const double median = quantile(std::move(sorted), 0.5);
  weights = weights.cwiseMin(median * max_weight_ratio);
  double before = 0.0, after = 0.0;
  for (const SampleWindow& window : windows)
    for (int p = 0; p < 3 * window.pixels; ++p)
      for (std::size_t j = 0; j < seen.size(); ++j) {
        const double value = window.values[static_cast<std::size_t>(p) * images + seen[j]];
        if (!std::isfinite(value)) continue;
        before += value * value;
        after += std::pow(weights[static_cast<Eigen::Index>(j)] * value, 2);
      }
  return weights * std::sqrt(before / after);
}

}  // namespace

NoiseModel measure_noise(std::span<const SampleWindow> windows, int images, std::span<const int> left_out) {
  std::vector<int> seen;
  for (int j = 0; j < images; ++j)
    if (std::ranges::find(left_out, j) == left_out.end()) seen.push_back(j);
  const int rows = static_cast<int>(seen.size());
  NoiseModel noise;
  auto measured = weakest_components_of(windows, images, seen, Eigen::VectorXd::Ones(rows));
  const int levels = std::min<int>(measured.size() / min_windows_per_level, max_levels);
  if (levels == 0) return noise;
  std::vector<float> independent_samples, variances;
  for (const WeakestComponents& each : measured)
    independent_samples.push_back(static_cast<float>(each.independent));
  noise.samples_per_image = quantile(std::move(independent_samples), 0.5);
  const auto variance_of = [&](const WeakestComponents& each) {
    return static_cast<float>(each.eigenvalue / bulk_of(each.pixels, rows * noise.samples_per_image));
  };
  for (const WeakestComponents& each : measured) variances.push_back(variance_of(each));
  const Eigen::VectorXd by_image = noise_by_image(measured);
  const Eigen::ArrayXd logarithms = by_image.array().max(1e-6).log();
  const double spread = std::sqrt((logarithms - logarithms.mean()).square().mean());
  if (spread > min_noise_spread &&
      quantile(std::move(variances), 0.5) > min_weighted_noise * min_weighted_noise) {
    // Images that are much noisier than others hide in the strong components until they are weighted.
    Eigen::VectorXd weights = Eigen::VectorXd::Ones(rows);
    for (int pass = 0; pass < weighting_passes; ++pass) {
      weights = weights_for(noise_by_image(measured).cwiseQuotient(weights), windows, images, seen);
      measured = weakest_components_of(windows, images, seen, weights);
    }
    for (const double weight : weights) noise.image_weights.push_back(static_cast<float>(weight));
  }
  std::ranges::sort(measured, {}, &WeakestComponents::log_level);
  for (int i = 0; i < levels; ++i) {
    const std::size_t first = measured.size() * i / levels, last = measured.size() * (i + 1) / levels;
    variances.clear();
    for (std::size_t k = first; k < last; ++k) variances.push_back(variance_of(measured[k]));
    const double log_variance = std::log(std::max(quantile(variances, 0.5), 1e-12));
    noise.log_level.push_back(measured[(first + last) / 2].log_level);
    noise.log_variance.push_back(i == 0 ? log_variance : std::min(log_variance, noise.log_variance.back()));
  }
  return noise;
}

SamplePool::SamplePool(NoiseModel noise, int images)
    : noise_(std::move(noise)), images_(images), stride_(padded_length(images)), zeros_(3 * stride_, 0.0f) {
  for (int m = 0; m <= window_side_px * window_side_px; ++m)
    bulk_.push_back(m < min_window_pixels ? 0.0 : bulk_of(m, images * noise_.samples_per_image));
}

std::vector<PixelSamples> SamplePool::pool(const PixelTile& tile, int width, int height,
                                           const Observed& observed) {
  std::vector<PixelSamples> result;
  for (int y = tile.y0; y < tile.y1; ++y)
    for (int x = tile.x0; x < tile.x1; ++x) result.push_back(observed(x, y));
  constexpr int side = window_side_px;
  const bool too_few_images = images_ * noise_.samples_per_image < 2 * side * side;
  if (noise_.log_level.empty() || too_few_images || width < side || height < side) return result;
  load({std::max(tile.x0 - pooling_reach_px, 0), std::max(tile.y0 - pooling_reach_px, 0),
        std::min(tile.x1 + pooling_reach_px, width), std::min(tile.y1 + pooling_reach_px, height)},
       observed);
  if (std::ranges::none_of(pixels_, [](const Pixel& pixel) { return pixel.noise >= min_noise; }))
    return result;
  correlate();
  filters_.assign(result.size(), {std::vector<float>(offset_side * offset_side, 0.0f), 0, false});
  const std::vector<int> across = window_starts(tile.x0, tile.x1, width);
  for (const int y : window_starts(tile.y0, tile.y1, height))
    for (const int x : across) add_window(x, y, tile);
  pooled_.resize(result.size() * 3 * stride_);
  std::vector<float> minus(offset_side * offset_side);
  for (std::size_t i = 0; i < result.size(); ++i) {
    const Filter& filter = filters_[i];
    if (!filter.changes) continue;
    const int tile_width = tile.x1 - tile.x0;
    const int x = tile.x0 + static_cast<int>(i) % tile_width - region_.x0;
    const int y = tile.y0 + static_cast<int>(i) / tile_width - region_.y0;
    for (int c = 0; c < 3; ++c) {
      const float scale = pixels_[y * region_width_ + x].scale[c];
      if (!(scale > 0.0f)) continue;
      pointers_.clear();
      int count = 0;
      for (int k = 0; k < offset_side * offset_side; ++k) {
        if (filter.weights[k] == 0.0f) continue;
        const int q =
            (y + k / offset_side - pooling_reach_px) * region_width_ + x + k % offset_side - pooling_reach_px;
        pointers_.push_back(scaled_.data() + (static_cast<std::size_t>(q) * 3 + c) * stride_);
        minus[count++] = -filter.weights[k] / (static_cast<float>(filter.windows) * scale);
      }
      float* pooled = pooled_.data() + (i * 3 + c) * stride_;
      std::fill_n(pooled, stride_, 0.0f);
      subtract_combination(pooled, pointers_.data(), minus.data(), count, stride_);
      result[i][c] = pooled;
    }
  }
  return result;
}

void SamplePool::load(const PixelTile& region, const Observed& observed) {
  region_ = region;
  region_width_ = region.x1 - region.x0;
  const std::size_t count = static_cast<std::size_t>(region_width_) * (region.y1 - region.y0);
  pixels_.assign(count, {});
  scaled_.assign(count * 3 * stride_, 0.0f);
  for (std::size_t p = 0; p < count; ++p) {
    Pixel& pixel = pixels_[p];
    pixel.observed = observed(region.x0 + static_cast<int>(p) % region_width_,
                              region.y0 + static_cast<int>(p) / region_width_);
    if (pixel.observed[0] == nullptr) continue;
    std::array<double, 3> square{};
    for (int c = 0; c < 3; ++c) {
      for (int j = 0; j < images_; ++j)
        square[c] += static_cast<double>(pixel.observed[c][j]) * pixel.observed[c][j];
      square[c] /= images_;
    }
    const double mean_square = (square[0] + square[1] + square[2]) / 3.0;
    if (!(mean_square > 0.0)) continue;  // black, or with samples that were not measured
    pixel.noise = std::min(std::sqrt(noise_.relative_variance(mean_square)), max_noise);
    for (int c = 0; c < 3; ++c) {
      if (!(square[c] > 0.0)) continue;
      pixel.scale[c] = static_cast<float>(1.0 / (pixel.noise * std::sqrt(square[c])));
      float* scaled = scaled_.data() + (p * 3 + c) * stride_;
      for (int j = 0; j < images_; ++j) scaled[j] = pixel.scale[c] * pixel.observed[c][j];
    }
  }
}

void SamplePool::correlate() {
  products_.assign(pixels_.size() * forward_offsets, 0.0f);
  pointers_.resize(forward_offsets);
  std::array<float, forward_offsets> of_channel{};
  const int rows = static_cast<int>(pixels_.size()) / region_width_;
  for (std::size_t p = 0; p < pixels_.size(); ++p) {
    if (!(pixels_[p].noise > 0.0)) continue;
    const int x = static_cast<int>(p) % region_width_, y = static_cast<int>(p) / region_width_;
    float* products = products_.data() + p * forward_offsets;
    for (int c = 0; c < 3; ++c) {
      // All offsets each time, so that sums do not depend on where the region ends.
      int k = 0;
      for (int dy = 0; dy < window_side_px; ++dy)
        for (int dx = dy == 0 ? 0 : 1 - window_side_px; dx < window_side_px; ++dx, ++k) {
          const bool inside = x + dx >= 0 && x + dx < region_width_ && y + dy < rows;
          const std::size_t q = static_cast<std::size_t>(y + dy) * region_width_ + x + dx;
          pointers_[k] = inside ? scaled_.data() + (q * 3 + c) * stride_ : zeros_.data();
        }
      dots(scaled_.data() + (p * 3 + c) * stride_, pointers_.data(), forward_offsets, stride_,
           of_channel.data());
      for (k = 0; k < forward_offsets; ++k) products[k] += of_channel[k];
    }
  }
}

double SamplePool::product(int p, int q) const {
  const int dy = q / region_width_ - p / region_width_, dx = q % region_width_ - p % region_width_;
  const int offset = dy == 0 ? dx : window_side_px + (dy - 1) * offset_side + dx + window_side_px - 1;
  return products_[static_cast<std::size_t>(p) * forward_offsets + offset] / (3.0 * images_);
}

void SamplePool::add_window(int x0, int y0, const PixelTile& tile) {
  std::array<int, window_side_px * window_side_px> inside{};
  int count = 0;
  double noise = 0.0;
  for (int y = y0; y < y0 + window_side_px; ++y)
    for (int x = x0; x < x0 + window_side_px; ++x) {
      const int p = (y - region_.y0) * region_width_ + x - region_.x0;
      if (!(pixels_[p].noise > 0.0)) continue;
      inside[count++] = p;
      noise += pixels_[p].noise;
    }
  Eigen::MatrixXd mix = Eigen::MatrixXd::Identity(count, count);
  bool changes = false;
  if (count >= min_window_pixels && noise >= min_noise * count) {
    Eigen::MatrixXd gram(count, count);
    for (int i = 0; i < count; ++i)
      for (int k = i; k < count; ++k) gram(i, k) = gram(k, i) = product(inside[i], inside[k]);
    const SymmetricEigen eigen = symmetric_eigen(gram);
    // Where the weakest components are below the usual noise, there is less.
    const double bulk = std::clamp(eigen.values[quartile_of(count)] / bulk_[count], 1e-6, 1.0);
    const double ratio = count / (images_ * noise_.samples_per_image);
    Eigen::VectorXd kept(count);
    for (int k = 0; k < count; ++k) kept[k] = kept_share(eigen.values[k] / (noise_margin * bulk), ratio);
    changes = (kept.array() > 0.0).count() <= max_rank_share * count;
    if (changes) mix = eigen.vectors * kept.asDiagonal() * eigen.vectors.transpose();
  }
  const int tile_width = tile.x1 - tile.x0;
  for (int i = 0; i < count; ++i) {
    const int x = inside[i] % region_width_, y = inside[i] / region_width_;
    const int tx = x + region_.x0 - tile.x0, ty = y + region_.y0 - tile.y0;
    if (tx < 0 || tx >= tile_width || ty < 0 || ty >= tile.y1 - tile.y0) continue;
    Filter& filter = filters_[static_cast<std::size_t>(ty) * tile_width + tx];
    ++filter.windows;
    filter.changes = filter.changes || changes;
    for (int k = 0; k < count; ++k) {
      const int dx = inside[k] % region_width_ - x, dy = inside[k] / region_width_ - y;
      filter.weights[(dy + pooling_reach_px) * offset_side + dx + pooling_reach_px] +=
          static_cast<float>(mix(k, i));
    }
  }
}

}  // namespace refield
