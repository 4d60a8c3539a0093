// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/frame_times.h"

#include <algorithm>
#include <cstdio>

#include "core/metrics.h"

namespace refield {

FrameStatistics frame_statistics(const std::vector<FrameTime>& frames) {
  FrameStatistics result;
  result.frames = frames.size();
  if (frames.empty()) return result;
  std::vector<float> totals;
  for (const FrameTime& frame : frames) {
    result.mean.total_ms += frame.total_ms;
    result.mean.view_ms += frame.view_ms;
    result.mean.tone_ms += frame.tone_ms;
    result.mean.draw_ms += frame.draw_ms;
    result.mean.relight_ms += frame.relight_ms;
    result.mean.light_ms += frame.light_ms;
    result.mean.wait_ms += frame.wait_ms;
    result.longest_ms = std::max(result.longest_ms, frame.total_ms);
    if (frame.relight_ms > 0.0) ++result.relit;
    totals.push_back(static_cast<float>(frame.total_ms));
  }
  const auto count = static_cast<double>(frames.size());
  result.mean.total_ms /= count;
  result.mean.view_ms /= count;
  result.mean.tone_ms /= count;
  result.mean.draw_ms /= count;
  result.mean.wait_ms /= count;
  if (result.relit > 0) {
    result.mean.relight_ms /= static_cast<double>(result.relit);
    result.mean.light_ms /= static_cast<double>(result.relit);
  }
  if (result.mean.total_ms > 0.0) result.per_second = 1000.0 / result.mean.total_ms;
  result.percentile_95_ms = quantile(std::move(totals), 0.95);
  return result;
}

std::string text_of(const FrameStatistics& statistics) {
  char text[300], view[40] = "", light[40] = "";
  if (statistics.mean.view_ms > 0.0)
    std::snprintf(view, sizeof view, " view %.1f ms,", statistics.mean.view_ms);
  if (statistics.mean.light_ms > 0.0)
    std::snprintf(light, sizeof light, "light map %.1f ms and ", statistics.mean.light_ms);
  std::snprintf(
      text, sizeof text,
      "%zu frames, %.1f per second (95 %% within %.1f ms, longest %.1f ms): %srelighting %.1f ms in "
      "%zu of them,%s tone mapping %.1f ms, drawing %.1f ms",
      statistics.frames, statistics.per_second, statistics.percentile_95_ms, statistics.longest_ms, light,
      statistics.mean.relight_ms, statistics.relit, view, statistics.mean.tone_ms, statistics.mean.draw_ms);
  return text;
}

}  // namespace refield
