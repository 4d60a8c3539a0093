// SPDX-License-Identifier: Apache-2.0
#include "core/field/predicted_error.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <numeric>

#include "core/base/number_text.h"
#include "core/field/light_error.h"
#include "core/field/reflectance_field.h"
#include "core/image/metrics.h"

namespace refield {

namespace {

/// Estimated noise may come out above a measured error; that much of the lowest error, squared, is floor at
/// most.
constexpr double max_floor = 0.9;
/// An error that falls faster than this with more images is chance.
constexpr double max_exponent = 3.0;
/// Twice the images are worth advising for when they take off at least this part of the error.
constexpr double worthwhile = 0.1;

}  // namespace

LearningCurve::LearningCurve(std::span<const LearningPoint> points, double noise) {
  double count = 0.0, x = 0.0, xx = 0.0;
  double lowest = std::numeric_limits<double>::infinity();
  for (const LearningPoint& point : points) {
    if (!(point.share > 0.0f && point.error > 0.0f)) continue;
    const double log_share = std::log(point.share);
    count += 1.0;
    x += log_share;
    xx += log_share * log_share;
    lowest = std::min(lowest, std::pow(point.error, 2.0));
  }
  const double spread = count * xx - x * x;
  known_ = count >= 2.0 && spread > 1e-6 * count * count;
  if (!known_) return;
  floor_ = std::min(noise * noise, max_floor * lowest);
  double y = 0.0, xy = 0.0;
  for (const LearningPoint& point : points) {
    if (!(point.share > 0.0f && point.error > 0.0f)) continue;
    const double log_error = std::log(std::pow(point.error, 2.0) - floor_);
    y += log_error;
    xy += log_error * std::log(point.share);
  }
  exponent_ = std::clamp(-(count * xy - x * y) / spread, 0.0, max_exponent);
  scale_ = std::exp((y + exponent_ * x) / count);
}

double LearningCurve::error_at(double share) const {
  return std::sqrt(floor_ + scale_ * std::pow(share, -exponent_));
}

std::string LearningCurve::advice() const {
  if (!known_) return "";
  const double now = error_at(1.0);
  const double twice = error_at(2.0);
  if (twice <= (1.0 - worthwhile) * now)
    return formatted(
        "more images would help: twice as many would reduce the median pixel error from about %.2f "
        "%% to %.2f %%",
        100.0 * now, 100.0 * twice);
  return formatted(
      "more images would hardly help: with twice as many, the median pixel error would be about "
      "%.2f %% (now %.2f %%)%s",
      100.0 * twice, 100.0 * now, floor_ > 0.5 * now * now ? "; most of it is photograph noise" : "");
}

namespace {

/// Lattice pixels weigh by a Gaussian of this many lattice steps, and are looked for this far.
constexpr double spread_steps = 1.5;
constexpr int reach_steps = 3;
/// Spread of the logarithm of the squared leave-one-out error: e^0.7, a factor of two of the error.
constexpr double spread_log_error = 1.4;
/// Light with few degrees of freedom (docs/method/progressive.md): part of the way from leave-one-out to
/// cross-validation. Rectangles that leave 16 times less squared error than the regression expects are the
/// right ones, and cross-validation, whose fewer lights may not tell them, does not count. Where it finds
/// max_ratio times the squared error, nothing is predicted.
constexpr double share_of_cross_validation = 0.5, far_beyond = 16.0, max_ratio = 9.0;
/// Noise is sought in this quantile of the leave-one-out errors, which by chance are that many standard
/// deviations lower there.
constexpr double best_share = 0.05, best_deviations = 1.645;
/// The best pixels' leave-one-out error may be that much lower than noise that is stated right.
constexpr double stated_margin = 1.1;
/// Brightness levels of the noise, each with at least this number of pixels.
constexpr std::size_t max_levels = 12, min_pixels_per_level = 100;
/// Squared relative errors below float32's own are not distinguished.
constexpr double least = 1e-12;

double logarithm(double squared) {
  return std::log(std::max(squared, least));
}

/// One block of the lattice: how much larger, as a logarithm, the cross-validated error is.
struct LatticePoint {
  bool known = false;
  double log_error = 0.0;
  double log_ratio = 0.0;
};

class Prediction {
 public:
  Prediction(const FieldOutline& field, std::span<const ErrorEvidence> evidence)
      : field_(field),
        evidence_(evidence),
        blocks_(field.width, field.height),
        lattice_width_(lattice_size(field.width)),
        lattice_height_(lattice_size(field.height)),
        lattice_(static_cast<std::size_t>(lattice_width_) * lattice_height_) {
    std::vector<double> ratios;
    for (int v = 0; v < lattice_height_; ++v)
      for (int u = 0; u < lattice_width_; ++u) {
        double log_errors = 0.0, log_ratios = 0.0;
        int known = 0;
        const int y0 = blocks_.corner(v), x0 = blocks_.corner(u), side_px = CrossValidationLattice::side_px;
        for (int y = y0; y < std::min(y0 + side_px, field.height); ++y)
          for (int x = x0; x < std::min(x0 + side_px, field.width); ++x) {
            const ErrorEvidence& pixel = at(x, y);
            if (!(pixel.leave_one_out > 0.0f) || !(pixel.cross_validated > 0.0f)) continue;
            log_errors += logarithm(pixel.leave_one_out);
            log_ratios += logarithm(pixel.cross_validated) - logarithm(pixel.leave_one_out);
            ++known;
          }
        if (known == 0) continue;
        const double log_error = log_errors / known, log_ratio = log_ratios / known;
        lattice_[static_cast<std::size_t>(v) * lattice_width_ + u] = {true, log_error, log_ratio};
        ratios.push_back(log_ratio);
      }
    common_log_ratio_ = upper_median(std::move(ratios));
  }

  /// Squared relative error of leave-one-out, steadied by the neighbours.
  double steadied(int x, int y) const {
    std::array<double, 9> near;
    near.fill(std::numeric_limits<double>::infinity());
    int count = 0;
    for (int ny = std::max(y - 1, 0); ny <= std::min(y + 1, field_.height - 1); ++ny)
      for (int nx = std::max(x - 1, 0); nx <= std::min(x + 1, field_.width - 1); ++nx)
        if (at(nx, ny).leave_one_out > 0.0f) near[count++] = at(nx, ny).leave_one_out;
    // For an even number, the mean of the middle two.
    std::ranges::sort(near);
    const double median = 0.5 * (near[(count - 1) / 2] + near[count / 2]);
    return std::sqrt(at(x, y).leave_one_out * median);
  }

  double ratio(int x, int y) const {
    const double log_error = logarithm(at(x, y).leave_one_out);
    const int step_px = blocks_.step_px();
    const int u0 = x / step_px;
    const int v0 = y / step_px;
    // What is far away in every way still says a little.
    constexpr double common_weight = 1e-3;
    double sum = common_weight * common_log_ratio_;
    double weights = common_weight;
    for (int v = std::max(v0 - reach_steps, 0); v <= std::min(v0 + reach_steps, lattice_height_ - 1); ++v)
      for (int u = std::max(u0 - reach_steps, 0); u <= std::min(u0 + reach_steps, lattice_width_ - 1); ++u) {
        const LatticePoint& point = lattice_[static_cast<std::size_t>(v) * lattice_width_ + u];
        if (!point.known) continue;
        const double dx = (place(u) - x) / (spread_steps * step_px);
        const double dy = (place(v) - y) / (spread_steps * step_px);
        const double de = (point.log_error - log_error) / spread_log_error;
        const double weight = std::exp(-0.5 * (dx * dx + dy * dy + de * de));
        sum += weight * point.log_ratio;
        weights += weight;
      }
    return std::exp(sum / weights);
  }

 private:
  double place(int lattice) const {
    return blocks_.corner(lattice) + 0.5 * (CrossValidationLattice::side_px - 1);
  }
  int lattice_size(int pixels) const {
    return (pixels - blocks_.corner(0) + blocks_.step_px() - 1) / blocks_.step_px();
  }
  const ErrorEvidence& at(int x, int y) const {
    return evidence_[static_cast<std::size_t>(y) * field_.width + x];
  }

  const FieldOutline& field_;
  std::span<const ErrorEvidence> evidence_;
  CrossValidationLattice blocks_;
  int lattice_width_, lattice_height_;
  std::vector<LatticePoint> lattice_;
  double common_log_ratio_ = 0.0;
};

/// Squared leave-one-out error, such that best_share of the pixels that have noise alone would be below it.
float above_chance(const ErrorEvidence& pixel) {
  const double chance = best_deviations * std::sqrt(2.0 / pixel.samples);
  return static_cast<float>(pixel.leave_one_out / std::max(1.0 - chance, 0.5));
}

/// The photographs' noise, squared and relative to Σ b²: as they state it, scaled down where even the best
/// pixels have less error; else, against brightness, the error of the pixels that are fitted best. Relative
/// noise does not grow with brightness.
class PhotographNoise {
 public:
  /// `signal`: [pixels] or empty for pixels that are equally bright.
  PhotographNoise(std::span<const float> signal, std::span<const ErrorEvidence> evidence) {
    std::vector<std::array<float, 2>> pixels;  // logarithm of brightness, squared error
    std::vector<float> errors;
    for (std::size_t p = 0; p < evidence.size(); ++p) {
      if (!(evidence[p].leave_one_out > 0.0f)) continue;
      pixels.push_back({std::log(signal.empty() ? 1.0f : signal[p]), above_chance(evidence[p])});
      if (evidence[p].noise > 0.0f) errors.push_back(above_chance(evidence[p]) / evidence[p].noise);
    }
    if (!errors.empty()) of_stated_ = std::min(1.0, stated_margin * quantile(errors, best_share));
    std::ranges::sort(pixels);
    const std::size_t levels = std::clamp<std::size_t>(pixels.size() / min_pixels_per_level, 1, max_levels);
    for (std::size_t i = 0; i < levels && !pixels.empty(); ++i) {
      const std::size_t first = pixels.size() * i / levels, last = pixels.size() * (i + 1) / levels;
      errors.clear();
      for (std::size_t k = first; k < last; ++k) errors.push_back(pixels[k][1]);
      const double log_error = logarithm(quantile(errors, best_share));
      log_signal_.push_back(pixels[(first + last) / 2][0]);
      log_error_.push_back(i == 0 ? log_error : std::min(log_error, log_error_.back()));
    }
  }

  double of(const ErrorEvidence& pixel, float signal) const {
    return pixel.noise > 0.0f ? of_stated_ * pixel.noise : at(signal);
  }

 private:
  double at(float signal) const {
    const double level = std::log(signal);
    const auto above = std::ranges::upper_bound(log_signal_, level) - log_signal_.begin();
    if (above == 0) return std::exp(log_error_.front());
    if (above == std::ssize(log_signal_)) return std::exp(log_error_.back());
    const double part = (level - log_signal_[above - 1]) / (log_signal_[above] - log_signal_[above - 1]);
    return std::exp(std::lerp(log_error_[above - 1], log_error_[above], part));
  }

  double of_stated_ = 1.0;                      // part of the noise that photographs state
  std::vector<double> log_signal_, log_error_;  // [levels]
};

/// The class whose ratio is next to a hundred times the noise.
std::uint32_t light_class_of(double noise) {
  std::uint32_t nearest = 0;
  while (nearest + 1 < light_noise_ratios.size() &&
         100.0 * noise > std::sqrt(light_noise_ratios[nearest] * light_noise_ratios[nearest + 1]))
    ++nearest;
  return nearest;
}

/// Middle errors over the pixels where fits to parts of the images were tried; none where these are so few
/// that they do not stand for the picture.
std::vector<LearningPoint> learning_curve_of(std::span<const ErrorEvidence> evidence) {
  std::vector<float> quarter, half, most;
  for (const ErrorEvidence& pixel : evidence) {
    if (!(pixel.from_quarter > 0.0f && pixel.from_half > 0.0f && pixel.cross_validated > 0.0f)) continue;
    quarter.push_back(std::sqrt(pixel.from_quarter));
    half.push_back(std::sqrt(pixel.from_half));
    most.push_back(std::sqrt(pixel.cross_validated));
  }
  constexpr std::size_t min_pixels = 64;  // four blocks
  if (quarter.size() < min_pixels) return {};
  const auto median = [](const std::vector<float>& errors) {
    return static_cast<float>(quantile(errors, 0.5));
  };
  return {{0.25f, median(quarter)}, {0.5f, median(half)}, {0.8f, median(most)}};
}

}  // namespace

bool LightErrorModel::is_sound() const {
  constexpr std::size_t max_cells = 4096;
  const std::size_t count = cells.size(), square = count * count;
  if (count == 0) return directions.empty() && variances.empty();
  if (count > max_cells || directions.empty() || directions.size() % square != 0) return false;
  return !variances.empty() && variances.size() % (directions.size() / count) == 0;
}

std::vector<double> LightErrorModel::variances_under(const Image& radiance) const {
  std::vector<std::array<double, 3>> sums;
  sums.reserve(cells.size());
  for (const Box& cell : cells) {
    auto& sum = sums.emplace_back(std::array<double, 3>{});
    for (int y = cell.y0; y < cell.y1; ++y)
      for (int x = cell.x0; x < cell.x1; ++x)
        for (int c = 0; c < 3; ++c) sum[c] += radiance.at(x, y, c);
  }
  const std::size_t count = cells.size(), priors = directions.size() / (count * count);
  std::vector<double> total(classes(), 0.0), along(count);
  for (std::size_t prior = 0; prior < priors; ++prior) {
    const float* direction = directions.data() + prior * count * count;
    for (double& mean_square : along) {
      std::array<double, 3> effect{};
      for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c) effect[c] += static_cast<double>(direction[i]) * sums[i][c];
      mean_square = (effect[0] * effect[0] + effect[1] * effect[1] + effect[2] * effect[2]) / 3.0;
      direction += count;
    }
    for (std::size_t k = prior * total.size() / priors; k < (prior + 1) * total.size() / priors; ++k)
      total[k] = std::inner_product(along.begin(), along.end(), variances.data() + k * count, 0.0);
  }
  return total;
}

double error_of_all_images(double cross_validated, double noise) {
  const double part = std::pow(0.8, 1.5);
  return cross_validated - (1.0 - part) * std::max(cross_validated - noise, 0.0);
}

void predict_errors(FieldOutline& field, std::span<const ErrorEvidence> evidence) {
  FieldQuality& quality = field.quality;
  quality.predicted_error.assign(evidence.size(), 0.0f);
  quality.photograph_noise.assign(evidence.size(), 0.0f);
  quality.learning_curve = learning_curve_of(evidence);
  if (evidence.empty()) return;
  const Prediction prediction(field, evidence);
  const bool has_signal = quality.training_signal.size() == evidence.size();
  const std::span<const float> signal = has_signal ? quality.training_signal : std::span<const float>();
  const PhotographNoise photographs(signal, evidence);
  const bool has_noise_classes = quality.light_error.classes() == light_noise_ratios.size();
  if (has_noise_classes) quality.light_class.assign(evidence.size(), 0);
  tbb::parallel_for(0, field.height, [&](int y) {
    for (int x = 0; x < field.width; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * field.width + x;
      if (!(evidence[p].leave_one_out > 0.0f)) continue;
      const double steadied = prediction.steadied(x, y), ratio = prediction.ratio(x, y);
      const double expected = evidence[p].expected;  // NaN of light with many degrees of freedom
      if (expected > 0.0 && ratio > max_ratio) continue;
      const double noise = photographs.of(evidence[p], has_signal ? signal[p] : 1.0f);
      if (has_noise_classes) quality.light_class[p] = light_class_of(noise);
      double predicted = std::max(error_of_all_images(steadied * ratio, noise), steadied);
      if (expected > 0.0) {
        const bool rectangles_alone = expected >= far_beyond * steadied;
        const double excess = rectangles_alone ? 0.0 : steadied * (ratio - 1.0);  // of cross-validation
        predicted = std::max(steadied + share_of_cross_validation * excess, 0.0);
      }
      double misfit = std::max(predicted - noise, 0.0);
      if (expected < far_beyond * steadied) {
        misfit = expected;
        predicted = std::max(predicted, misfit);
      }
      quality.predicted_error[p] = static_cast<float>(std::sqrt(predicted));
      quality.photograph_noise[p] = static_cast<float>(std::sqrt(predicted - misfit));
    }
  });
}

}  // namespace refield
