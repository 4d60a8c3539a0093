// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/chart/measure.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "cli/run_context.h"
#include "core/base/units.h"

namespace refield::chart {

namespace {

constexpr int timed_frames = 9;

using Clock = std::chrono::steady_clock;

/// Median over a few frames, after one that warms caches.
double relight_ms(const peers::Model& model, const ChartData& data) {
  std::vector<float> times;
  for (int k = 0; k <= timed_frames; ++k) {
    const auto start = Clock::now();
    peers::relight(model, data.tests[static_cast<std::size_t>(k) % data.tests.size()].light);
    if (k > 0) times.push_back(static_cast<float>(1e3 * seconds_since(start)));
  }
  return quantile(times, 0.5);
}

}  // namespace

std::vector<double> held_out_errors(const peers::Model& model, const ChartData& data) {
  std::vector<Mask> kind_masks;
  if (data.pixel_kinds)
    for (std::size_t k = 0; k < data.pixel_kinds->names.size(); ++k)
      kind_masks.push_back(data.pixel_kinds->mask_of(k, data.mask));
  std::vector<double> errors;
  for (const std::string& light_kind : data.light_kinds) {
    SeriesError whole(data.mask);
    std::vector<SeriesError> by_kind(kind_masks.begin(), kind_masks.end());
    for (const TestFrame& test : data.tests) {
      if (test.kind != light_kind) continue;
      run_context().throw_if_stopped();
      const Image predicted = peers::relight(model, test.light);
      whole.add(predicted, test.reference.radiance, test.reference.sigma);
      for (SeriesError& error : by_kind) error.add(predicted, test.reference.radiance, test.reference.sigma);
    }
    errors.push_back(whole.relative_rmse());
    errors.push_back(whole.pixel_quantile(0.5));
    errors.push_back(whole.pixel_quantile(0.9));
    for (std::size_t k = 0; k < by_kind.size(); ++k) {
      const bool any = std::ranges::any_of(kind_masks[k], [](unsigned char counts) { return counts != 0; });
      const double none = std::numeric_limits<double>::quiet_NaN();
      errors.push_back(any ? by_kind[k].relative_rmse() : none);
      errors.push_back(any ? by_kind[k].pixel_quantile(0.5) : none);
    }
  }
  return errors;
}

ChartRow measure(const Task& task, const ChartData& data, const EstimateOptions& base) {
  const auto start = Clock::now();
  const peers::Model model = estimate_model(task, data, base);
  ChartRow row{task.method, task.setting, task.images, seconds_since(start), 0.0, 0.0, 0.0, {}};
  row.relight_ms = relight_ms(model, data);
  row.bytes_per_pixel = peers::bytes_per_pixel(model);
  row.functions_per_pixel = peers::functions_per_pixel(model);
  row.errors = held_out_errors(model, data);
  return row;
}

}  // namespace refield::chart
