// SPDX-License-Identifier: Apache-2.0
#include "acquire/series/clock_match.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "core/errors.h"

namespace refield {

namespace {

constexpr std::size_t least_common = 10;   // photographs that must overlap
constexpr double least_correlation = 0.5;  // below, the series do not go together
constexpr double ambiguous = 0.9;          // of the best: another offset is as good
constexpr int slow_half_width = 7;         // photographs on either side whose mean is the slow part

/// Log brightness without its slow part, over time.
struct Signal {
  std::vector<double> time;
  std::vector<double> value;
  double interval = 0.0;

  explicit Signal(std::span<const TimedBrightness> series) {
    std::vector<double> log_brightness;
    for (const TimedBrightness& sample : series) {
      time.push_back(sample.time);
      log_brightness.push_back(std::log(std::max(sample.brightness, 1e-12)));
    }
    const auto count = static_cast<std::ptrdiff_t>(time.size());
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, i - slow_half_width);
      const std::ptrdiff_t to = std::min(count, i + slow_half_width + 1);
      double mean = 0.0;
      for (std::ptrdiff_t k = from; k < to; ++k) mean += log_brightness[k] / static_cast<double>(to - from);
      value.push_back(log_brightness[i] - mean);
    }
    interval = median_interval(time);
  }

  /// Between samples by a straight line; nullopt outside the series and in its gaps.
  std::optional<double> at(double t) const {
    const auto after = std::ranges::upper_bound(time, t);
    if (after == time.begin() || after == time.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - time.begin());
    const double step = time[i] - time[i - 1];
    if (step > 3.0 * interval) return std::nullopt;
    const double share = (t - time[i - 1]) / step;
    return (1.0 - share) * value[i - 1] + share * value[i];
  }
};

/// Correlation of the signals under a relation of their clocks; −1 where too few samples overlap.
double correlation(const Signal& first, const Signal& second, const ClockRelation& relation) {
  double n = 0.0, sum_a = 0.0, sum_b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
  for (std::size_t i = 0; i < second.time.size(); ++i) {
    const auto a = first.at(relation.first_from_second(second.time[i]));
    if (!a) continue;
    const double b = second.value[i];
    n += 1.0;
    sum_a += *a;
    sum_b += b;
    aa += *a * *a;
    bb += b * b;
    ab += *a * b;
  }
  const double shorter = static_cast<double>(std::min(first.time.size(), second.time.size()));
  if (n < std::max<double>(least_common, 0.25 * shorter)) return -1.0;
  const double variance = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  return variance > 0.0 ? (ab - sum_a * sum_b / n) / std::sqrt(variance) : 0.0;
}

/// Climbs to the nearest maximum by steps that are halved.
void refine(const Signal& first, const Signal& second, bool with_drift, double step,
            ClockEstimate& estimate) {
  const double duration = std::max(second.time.back() - second.time.front(), 1.0);
  const auto improved = [&](double offset_change, double drift_change) {
    ClockRelation moved = estimate.relation;
    moved.offset_seconds += offset_change;
    moved.drift += drift_change;
    const double value = correlation(first, second, moved);
    if (value <= estimate.correlation) return false;
    estimate.relation = moved;
    estimate.correlation = value;
    return true;
  };
  for (; step > 1e-3 * second.interval; step *= 0.5) {
    bool moving = true;
    for (int i = 0; moving && i < 100; ++i) {
      moving = improved(step, 0.0) || improved(-step, 0.0);
      const double slope = step / duration;
      // Drift turns about the middle of the series, so that it leaves the offset's fit as it is.
      const double middle = -0.5 * slope * duration;
      if (with_drift) moving = improved(middle, slope) || improved(-middle, -slope) || moving;
    }
  }
}

}  // namespace

double median_interval(std::span<const ClockSeconds> times) {
  if (times.size() < 2) return 0.0;
  std::vector<double> intervals;
  for (std::size_t i = 1; i < times.size(); ++i) intervals.push_back(times[i] - times[i - 1]);
  const auto middle = intervals.begin() + static_cast<std::ptrdiff_t>(intervals.size() / 2);
  std::nth_element(intervals.begin(), middle, intervals.end());
  return *middle;
}

ClockEstimate estimate_clocks(std::span<const TimedBrightness> first, std::span<const TimedBrightness> second,
                              double largest_offset_seconds, bool with_drift) {
  const std::string remedy = "; give the offset of the clocks with --offset";
  if (first.size() < least_common || second.size() < least_common)
    throw InputError("series of " + std::to_string(first.size()) + " and " + std::to_string(second.size()) +
                     " photographs are too short to estimate the clock offset from brightness" + remedy);
  if (!(largest_offset_seconds > 0.0))
    throw InputError("the largest offset to try must be above zero seconds");
  const Signal a(first), b(second);
  const double step = 0.5 * std::min(a.interval, b.interval);
  if (!(step > 0.0)) throw InputError("photographs of one series share one time" + remedy);

  const auto tries = static_cast<int>(std::min(2e6, std::ceil(largest_offset_seconds / step)));
  std::vector<double> found(2 * tries + 1);
  ClockEstimate best{{0.0, 0.0, b.time.front()}, -2.0, 0.0};
  for (int i = -tries; i <= tries; ++i) {
    const ClockRelation relation{i * step, 0.0, b.time.front()};
    const double value = found[i + tries] = correlation(a, b, relation);
    if (value > best.correlation) best = {relation, value, 0.0};
  }
  const int peak = static_cast<int>(std::lround(best.relation.offset_seconds / step));
  constexpr int another = 8;  // steps: four intervals away it is another offset
  for (int i = -tries; i <= tries; ++i)
    if (std::abs(i - peak) > another) best.runner_up = std::max(best.runner_up, found[i + tries]);
  refine(a, b, with_drift, step, best);
  if (best.correlation < least_correlation)
    throw InputError("the brightness of the two series is not correlated (highest correlation " +
                     std::to_string(best.correlation) + " within ±" + std::to_string(largest_offset_seconds) +
                     " s); widen --largest-offset, or" + remedy.substr(1));
  if (best.runner_up > ambiguous * best.correlation)
    throw InputError(
        "the brightness of the two series matches equally well at several offsets (correlations " +
        std::to_string(best.correlation) + " and " + std::to_string(best.runner_up) + ")" + remedy);
  return best;
}

std::vector<std::pair<std::size_t, std::size_t>> match_in_time(std::span<const ClockSeconds> first,
                                                               std::span<const ClockSeconds> second,
                                                               const ClockRelation& relation,
                                                               double tolerance_seconds) {
  struct Candidate {
    double distance;
    std::size_t first, second;
  };
  std::vector<Candidate> candidates;
  for (std::size_t j = 0; j < second.size(); ++j) {
    const double time = relation.first_from_second(second[j]);
    const auto from = std::ranges::lower_bound(first, time - tolerance_seconds);
    for (auto at = from; at != first.end() && *at <= time + tolerance_seconds; ++at)
      candidates.push_back({std::abs(*at - time), static_cast<std::size_t>(at - first.begin()), j});
  }
  std::ranges::stable_sort(candidates, {}, &Candidate::distance);
  std::vector<bool> first_taken(first.size()), second_taken(second.size());
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (const Candidate& candidate : candidates) {
    if (first_taken[candidate.first] || second_taken[candidate.second]) continue;
    first_taken[candidate.first] = second_taken[candidate.second] = true;
    pairs.emplace_back(candidate.first, candidate.second);
  }
  std::ranges::sort(pairs);
  return pairs;
}

}  // namespace refield
