// SPDX-License-Identifier: Apache-2.0
#include "core/field/drift.h"

#include <cmath>
#include <limits>

#include "core/image/image_io.h"
#include "core/image/metrics.h"

namespace refield {

namespace {

constexpr std::size_t max_pixels = 40'000;
/// Pixels darker than this part of the brightest (99th percentile) are mostly noise.
constexpr double darkest = 0.05;
constexpr int rounds = 3;
constexpr double significant_errors = 4.0;
constexpr double significant_gain = 5e-4;
/// A frame breaks the curve when it lies so far off its neighbours' line, and taking it out leaves the others
/// on theirs.
constexpr double broken_gain = 0.01;
constexpr double broken_share = 0.4;

struct WeightedValue {
  double value;
  double weight;
};

double weighted_median(std::vector<WeightedValue>& values) {
  std::ranges::sort(values, {}, &WeightedValue::value);
  double total = 0.0;
  for (const WeightedValue& v : values) total += v.weight;
  double sum = 0.0;
  for (const WeightedValue& v : values)
    if ((sum += v.weight) >= 0.5 * total) return v.value;
  return 1.0;
}

struct Centre {
  double value = 1.0;
  double deviation = 0.0;  ///< standard deviation of the noise around it
};

/// The weighted median and MAD of what lies within four standard deviations of themselves: what a third of
/// the pixels shows of something else then hardly shifts it.
Centre robust_centre(const std::vector<WeightedValue>& values) {
  constexpr double kept_deviations = 4.0;
  constexpr int trims = 4;
  Centre centre;
  double reach = std::numeric_limits<double>::infinity();
  for (int trim = 0; trim < trims; ++trim) {
    std::vector<WeightedValue> near;
    for (const WeightedValue& v : values)
      if (std::abs(v.value - centre.value) <= reach) near.push_back(v);
    centre.value = weighted_median(near);
    for (WeightedValue& v : near) v.value = std::abs(v.value - centre.value);
    centre.deviation = 1.4826 * weighted_median(near);
    reach = kept_deviations * centre.deviation;
  }
  return centre;
}

void require_same_light(const CaptureFrame& first, const CaptureFrame& other, Parameterisation domain,
                        const RunContext& run) {
  if (first.illumination == other.illumination) return;
  if (read_illumination(first, domain, run).radiance.values !=
      read_illumination(other, domain, run).radiance.values)
    throw InputError(other.illumination, ": all reference frames must show the same light; ",
                     first.illumination, " differs; change the role of one of them");
}

/// [frames][pixels × 3] of a lattice of pixels inside the mask; NaN where not measured.
std::vector<std::vector<float>> read_references(const std::vector<CaptureFrame>& frames,
                                                const CaptureSession& session, const RunContext& run) {
  const Mask mask = session.mask ? read_mask(*session.mask, session.width, session.height) : Mask{};
  const std::size_t pixels = static_cast<std::size_t>(session.width) * session.height;
  const std::size_t step = std::max<std::size_t>(1, pixels / max_pixels) | 1;  // odd: no column is favoured
  std::vector<std::vector<float>> samples;
  for (const CaptureFrame& frame : frames) {
    run.throw_if_stopped();
    const Photograph photograph = read_photograph(frame.observed);
    if (photograph.radiance.width != session.width || photograph.radiance.height != session.height)
      throw InputError(frame.observed, ": is ", shape_text(photograph.radiance),
                       ", the other photographs are ", session.width, "×", session.height);
    auto& values = samples.emplace_back();
    for (std::size_t p = 0; p < pixels; p += step) {
      if (!mask.empty() && mask[p] == 0) continue;
      for (std::size_t i = 3 * p; i < 3 * p + 3; ++i) {
        const bool measured = photograph.sigma.empty() || std::isfinite(photograph.sigma.values[i]);
        values.push_back(measured ? photograph.radiance.values[i] : std::numeric_limits<float>::quiet_NaN());
      }
    }
  }
  return samples;
}

/// Gains of all frames in one channel, relative to each other.
void fit_channel(const std::vector<std::vector<float>>& samples, int channel,
                 std::vector<DriftPoint>& points) {
  const std::size_t frames = samples.size();
  std::vector<std::size_t> chosen;
  for (std::size_t i = channel; i < samples[0].size(); i += 3)
    if (std::ranges::all_of(samples, [&](const auto& frame) { return std::isfinite(frame[i]); }))
      chosen.push_back(i);
  std::vector<double> gain(frames, 1.0), error(frames, 0.0), scene(chosen.size());
  for (int round = 0; round < rounds; ++round) {
    std::vector<double> brightness;
    for (std::size_t p = 0; p < chosen.size(); ++p) {
      std::vector<double> shown;
      for (std::size_t k = 0; k < frames; ++k) shown.push_back(samples[k][chosen[p]] / gain[k]);
      scene[p] = upper_median(std::move(shown));
      brightness.push_back(scene[p]);
    }
    if (brightness.empty()) return;
    std::ranges::sort(brightness);
    const double bright = brightness[brightness.size() * 99 / 100];
    if (!(bright > 0.0)) return;  // a channel without light says nothing
    for (std::size_t k = 0; k < frames; ++k) {
      std::vector<WeightedValue> ratios;
      double sum = 0.0, squares = 0.0;
      for (std::size_t p = 0; p < chosen.size(); ++p) {
        if (!(scene[p] > darkest * bright)) continue;
        const double weight = std::min(scene[p], bright);
        ratios.push_back({samples[k][chosen[p]] / scene[p], weight});
        sum += weight;
        squares += weight * weight;
      }
      const Centre centre = robust_centre(ratios);
      gain[k] = centre.value;
      // Standard error of a median of normal noise.
      error[k] = 1.2533 * centre.deviation / centre.value * std::sqrt(squares) / sum;
    }
  }
  for (std::size_t k = 0; k < frames; ++k) {
    points[k].gain[channel] = gain[k];
    points[k].uncertainty[channel] = error[k];
  }
}

/// How far each used point lies off the line through its neighbours. The ends are never assessed: an area
/// light that warms up changes fastest there.
std::vector<double> off_line(const std::vector<DriftPoint>& points, const std::vector<std::size_t>& used) {
  std::vector<double> result(used.size(), 0.0);
  for (std::size_t i = 1; i + 1 < used.size(); ++i) {
    const DriftPoint& before = points[used[i - 1]];
    const DriftPoint& at = points[used[i]];
    const DriftPoint& after = points[used[i + 1]];
    const double t = (at.order - before.order) / (after.order - before.order);
    for (int c = 0; c < 3; ++c)
      result[i] =
          std::max(result[i], std::abs(at.gain[c] - (before.gain[c] + t * (after.gain[c] - before.gain[c]))));
  }
  return result;
}

void set_broken_aside(std::vector<DriftPoint>& points) {
  std::vector<std::size_t> used;
  for (std::size_t k = 0; k < points.size(); ++k) used.push_back(k);
  for (std::size_t max_dropped = points.size() / 4; max_dropped > 0 && used.size() >= 5; --max_dropped) {
    const auto off = off_line(points, used);
    const double worst = *std::ranges::max_element(off);
    if (worst < broken_gain) return;
    // The frame whose absence leaves the smallest rest.
    std::size_t best = 1;
    double smallest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i + 1 < used.size(); ++i) {
      auto others = used;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      const double rest = std::ranges::max(off_line(points, others));
      if (rest < smallest) {
        smallest = rest;
        best = i;
      }
    }
    if (smallest > broken_share * worst) return;
    points[used[best]].used = false;
    used.erase(used.begin() + static_cast<std::ptrdiff_t>(best));
  }
}

/// Whether gains of 5 points and more jump to and fro: then squared differences of neighbours are 2 times
/// those from the mean, 0.2 to 1.2 times where gains drift or step once. Source: von Neumann 1941.
bool scatters(const std::vector<DriftPoint>& points) {
  constexpr double max_ratio = 1.5;
  Eigen::Matrix3Xd gains(3, std::ranges::count(points, true, &DriftPoint::used));
  for (Eigen::Index k = 0; const DriftPoint& point : points)
    if (point.used) gains.col(k++) = Eigen::Vector3d(point.gain.data());
  const Eigen::Index steps = gains.cols() - 1;
  const double changes = (gains.rightCols(steps) - gains.leftCols(steps)).squaredNorm();
  return steps >= 4 && changes > max_ratio * (gains.colwise() - gains.rowwise().mean()).squaredNorm();
}

}  // namespace

std::array<float, 3> Drift::gain_at(double order) const {
  const DriftPoint* before = nullptr;
  const DriftPoint* after = nullptr;
  for (const DriftPoint& point : points) {
    if (!point.used) continue;
    if (point.order <= order) before = &point;
    if (point.order >= order && !after) after = &point;
  }
  if (!before) before = after;
  if (!after) after = before;
  if (!before) return {1.0f, 1.0f, 1.0f};
  const double span = after->order - before->order;
  const double t = span > 0.0 ? (order - before->order) / span : 0.0;
  std::array<float, 3> gain{};
  for (int c = 0; c < 3; ++c)
    gain[c] = static_cast<float>(before->gain[c] + t * (after->gain[c] - before->gain[c]));
  return gain;
}

Drift measure_drift(const CaptureSession& session, const RunContext& run) {
  Drift drift;
  auto frames = session.frames_of(FrameRole::reference);
  if (frames.size() < 2) return drift;
  std::ranges::stable_sort(frames, {}, &CaptureFrame::order);
  for (const CaptureFrame& frame : frames) {
    require_same_light(frames.front(), frame, session.light.parameterisation, run);
    drift.points.push_back({frame.name, frame.order});
  }
  const auto samples = read_references(frames, session, run);
  for (int c = 0; c < 3; ++c) fit_channel(samples, c, drift.points);
  set_broken_aside(drift.points);
  const auto first = std::ranges::find(drift.points, true, &DriftPoint::used)->gain;
  for (DriftPoint& point : drift.points)
    for (int c = 0; c < 3; ++c) {
      point.gain[c] /= first[c];
      if (!point.used) continue;
      const double change = std::abs(point.gain[c] - 1.0);
      drift.largest = std::max(drift.largest, change);
      if (change > std::max(significant_errors * point.uncertainty[c], significant_gain))
        drift.significant = true;
    }
  drift.significant = drift.significant && !scatters(drift.points);
  return drift;
}

Drift remove_drift(CaptureSession& session, const RunContext& run) {
  Drift drift = measure_drift(session, run);
  if (drift.points.empty()) return drift;
  for (CaptureFrame& frame : session.frames)
    frame.gain = drift.significant ? drift.gain_at(frame.order) : std::array<float, 3>{1.0f, 1.0f, 1.0f};
  return drift;
}

}  // namespace refield
