// SPDX-License-Identifier: Apache-2.0
#include "core/learning_curve.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace refield {

namespace {

/// Estimated noise may come out above a measured error; that much of the lowest error, squared, is floor at
/// most.
constexpr double most_floor = 0.9;
/// An error that falls faster than this with more images is chance.
constexpr double most_exponent = 3.0;
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
  floor_ = std::min(noise * noise, most_floor * lowest);
  double y = 0.0, xy = 0.0;
  for (const LearningPoint& point : points) {
    if (!(point.share > 0.0f && point.error > 0.0f)) continue;
    const double own = std::log(std::pow(point.error, 2.0) - floor_);
    y += own;
    xy += own * std::log(point.share);
  }
  exponent_ = std::clamp(-(count * xy - x * y) / spread, 0.0, most_exponent);
  scale_ = std::exp((y + exponent_ * x) / count);
}

double LearningCurve::error_at(double share) const {
  return std::sqrt(floor_ + scale_ * std::pow(share, -exponent_));
}

std::string LearningCurve::advice() const {
  if (!known_) return "";
  const double now = error_at(1.0);
  const double twice = error_at(2.0);
  char text[192];
  if (twice <= (1.0 - worthwhile) * now)
    std::snprintf(text, sizeof text,
                  "more images would help: twice as many would reduce the median pixel error from about %.2f "
                  "%% to %.2f %%",
                  100.0 * now, 100.0 * twice);
  else
    std::snprintf(text, sizeof text,
                  "more images would hardly help: with twice as many, the median pixel error would be about "
                  "%.2f %% (now %.2f %%)%s",
                  100.0 * twice, 100.0 * now,
                  floor_ > 0.5 * now * now ? "; most of it is photograph noise" : "");
  return text;
}

}  // namespace refield
