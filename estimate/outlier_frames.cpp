// SPDX-License-Identifier: Apache-2.0
#include "estimate/outlier_frames.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/run_context.h"

namespace refield {

namespace {

/// A frame is an outlier when the logarithm of its residual lies so many standard deviations, and at least
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
/// An outlier's residual, relative to what the pixels show, is at least so many times the typical frame's.
constexpr double least_residual = 2.0;
constexpr int most_rounds = 8;
/// Frames that stand less out than the worst by this logarithm wait for the next round: the worst may have
/// made them.
constexpr double close_to_worst = 1.5;
constexpr float tiny = 1e-12f;

float median_of(std::vector<float> values) {
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::ranges::nth_element(values, middle);
  return *middle;
}

/// How far each value lies above the median of those not left out, in units of the limit: beyond 1 is an
/// outlier.
std::vector<double> excess(const std::vector<float>& statistic, const std::vector<char>& left_out,
                           const Limit& limit) {
  std::vector<float> logs;
  for (std::size_t j = 0; j < statistic.size(); ++j)
    if (!left_out[j]) logs.push_back(std::log(std::max(statistic[j], tiny)));
  const float centre = median_of(logs);
  for (float& value : logs) value = std::abs(value - centre);
  const double reach = std::max(limit.deviations * 1.4826 * median_of(logs), limit.least);
  std::vector<double> result;
  for (const float value : statistic) result.push_back((std::log(std::max(value, tiny)) - centre) / reach);
  return result;
}

/// Residuals of all frames, and what is judged by.
class Examination {
 public:
  Examination(const LightGrams& grams, const PixelSample& sample, const std::vector<char>& left_out,
              const RunContext& run)
      : sample_(sample) {
    for (int c = 0; c < 3; ++c) {
      const Eigen::Map<const Eigen::MatrixXf> series(sample.series(c, 0), sample.images, sample.pixels);
      loo_[c] = leave_one_out(grams.of_channel[c], series, left_out, run);
    }
    cells_.resize(sample.cells.size());
    std::vector<float> sizes(sample.pixels);
    for (int j = 0; j < sample.images; ++j) {
      for (int p = 0; p < sample.pixels; ++p) sizes[p] = size(j, p);
      whole_.push_back(median_of(sizes));
      float worst = 0.0f;
      for (std::size_t i = 0; i < cells_.size(); ++i) {
        std::vector<float> in_cell;
        for (const int p : sample.cells[i].pixels) in_cell.push_back(sizes[p]);
        cells_[i].push_back(median_of(in_cell));
        worst = std::max(worst, cells_[i].back());
      }
      worst_cell_.push_back(worst);
    }
  }

  const std::vector<float>& whole() const { return whole_; }
  const std::vector<float>& worst_cell() const { return worst_cell_; }

  /// Median of |observed − predicted| / predicted over pixels and channels.
  double relative_residual(int j, const std::vector<int>& pixels) const {
    std::vector<float> values;
    for_each_ratio(j, pixels, [&](int, float ratio) { values.push_back(std::abs(ratio)); });
    return median_of(std::move(values));
  }
  std::array<double, 3> brightness(int j, const std::vector<int>& pixels) const {
    std::array<std::vector<float>, 3> values;
    for_each_ratio(j, pixels, [&](int c, float ratio) { values[c].push_back(ratio); });
    return {median_of(values[0]), median_of(values[1]), median_of(values[2])};
  }
  /// What is left of the relative residual once the brightness of each channel is put right.
  double residual_besides_brightness(int j, const std::vector<int>& pixels,
                                     const std::array<double, 3>& brightness) const {
    std::vector<float> values;
    for_each_ratio(j, pixels, [&](int c, float ratio) {
      values.push_back(static_cast<float>(std::abs(ratio - brightness[c])));
    });
    return median_of(std::move(values));
  }
  /// Cells whose residual in frame j is far from their own usual one.
  std::vector<std::size_t> differing_cells(int j) const {
    std::vector<std::size_t> result;
    for (std::size_t i = 0; i < cells_.size(); ++i)
      if (cells_[i][j] > cell_differs * std::max(median_of(cells_[i]), tiny)) result.push_back(i);
    return result;
  }

 private:
  /// Mean over the channels of the standardised residual.
  float size(int j, int p) const {
    float sum = 0.0f;
    for (const LeaveOneOut& channel : loo_) sum += std::abs(channel.standardised(j, p));
    return sum / 3.0f;
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
  std::vector<std::vector<float>> cells_;  // [cells][frames]
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
  return {std::max(median_of(whole), tiny), std::max(median_of(cell), tiny), median_of(residual)};
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
  outlier.x = static_cast<int>(median_of(xs));
  outlier.y = static_cast<int>(median_of(ys));
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
  char text[200];
  const auto percent = [](double value) { return 100.0 * value; };
  switch (outlier.kind) {
    case OutlierFrame::Kind::brightness: {
      const auto& b = outlier.brightness;
      std::snprintf(
          text, sizeof text,
          "its brightness is off by %+.1f, %+.1f, %+.1f %% (red, green, blue): a flicker or another "
          "exposure",
          percent(b[0]), percent(b[1]), percent(b[2]));
      break;
    }
    case OutlierFrame::Kind::light:
      std::snprintf(
          text, sizeof text,
          "it differs by %.0f %% from what the other photographs predict, %.0f times as much as usual: "
          "perhaps it was taken under another light",
          percent(outlier.residual), outlier.times_typical);
      break;
    case OutlierFrame::Kind::region:
      std::snprintf(
          text, sizeof text,
          "%.0f %% of the picture, around pixel (%d, %d), differs by %.0f %%, %.0f times as much as "
          "usual: something moved there",
          percent(outlier.share), outlier.x, outlier.y, percent(outlier.residual), outlier.times_typical);
      break;
  }
  return text;
}

OutlierSearch find_outlier_frames(const LightGrams& grams, const PixelSample& sample, const RunContext& run) {
  OutlierSearch search;
  if (sample.images < fewest_frames_to_judge || sample.pixels == 0) return search;
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
    if (next == left_out || round == most_rounds) {
      const auto all = all_pixels(sample);
      const Typical typical = typical_of(found, all, left_out);
      search.typical_residual = typical.residual;
      for (int j = 0; j < sample.images; ++j) {
        if (!left_out[j]) continue;
        const OutlierFrame outlier = describe(found, sample, all, typical, j, whole[j] > 1.0);
        // Under a very bright light noise is so low that what stands out need not matter.
        if (outlier.residual > least_residual * typical.residual) search.outliers.push_back(outlier);
      }
      search.too_many = 4 * search.outliers.size() > static_cast<std::size_t>(sample.images);
      return search;
    }
    left_out = next;
    if (4 * std::ranges::count(left_out, 1) > 3 * sample.images) return search;  // no judging at all
  }
}

}  // namespace refield
