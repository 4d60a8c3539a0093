// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/frame_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

void log_drift(const Drift& drift, const RunContext& run) {
  if (drift.points.empty()) return;
  char text[160];
  std::snprintf(text, sizeof text, "drift: brightness changed by up to %.2f %% over %zu reference frames: %s",
                100.0 * drift.largest, drift.points.size(),
                drift.significant ? "divided out" : "below the measurement uncertainty, not corrected");
  run.note(text);
  for (const DriftPoint& point : drift.points)
    if (!point.used)
      run.note("drift: " + point.frame + " does not fit the curve of the others and is ignored");
}

/// The fit squares products of samples and sums of light in single precision, which further off are infinite
/// or zero. Such photographs come from a conversion gone wrong, which scaling them silently would hide.
void require_usual_brightness(const EstimateJob& job) {
  constexpr double least = 1e-9, most = 1e7;
  const double typical = std::sqrt(job.mean_square);
  if (typical == 0.0 || (typical >= least && typical <= most)) return;
  char text[160];
  std::snprintf(
      text, sizeof text,
      ": the photographs' samples are about %.1e, too %s for the computation; scale all photographs by "
      "the same factor to values around 1",
      typical, typical < least ? "small" : "large");
  throw InputError(job.frames.front().observed.parent_path().string() + text);
}

/// Compares the frames with one another: finds those to leave out, and those that are doubtful.
void assess_frames(const EstimateJob& job, const PixelSample& sample, FrameReport& report,
                   const RunContext& run) {
  const auto grams = light_grams(job.frames, job.session.light, run);
  const OutlierSearch search = find_outlier_frames(grams, sample, run);
  report.typical_residual = search.typical_residual;
  auto& list = search.too_many ? report.doubtful : report.left_out;
  for (const OutlierFrame& outlier : search.outliers)
    list.push_back({job.frames[outlier.frame].name, description_of(outlier), outlier});
  for (const LeftOutFrame& frame : report.left_out) run.note(frame.name + " is left out: " + frame.why);
  if (!report.doubtful.empty())
    run.note(std::to_string(report.doubtful.size()) + " of " + std::to_string(job.frames.size()) +
             " photographs do not fit the others, too many to leave out; check the capture. The first: " +
             report.doubtful.front().name + ": " + report.doubtful.front().why);
}

}  // namespace

FrameReport check_frames(EstimateJob& job, const EstimateOptions& options, const RunContext& run) {
  FrameReport report;
  report.drift = job.drift;
  log_drift(job.drift, run);
  const bool can_assess =
      !options.keep_outliers && static_cast<int>(job.frames.size()) >= min_frames_to_assess;
  if (!can_assess && options.mode != EstimateMode::refined) return report;
  const auto sample =
      read_pixel_sample(job.frames, job.session.width, job.session.height, job.mask, options.clip_level, run);
  job.mean_square = sample.mean_square({});
  require_usual_brightness(job);
  if (can_assess) assess_frames(job, sample, report, run);
  std::vector<int> images;
  for (const LeftOutFrame& frame : report.left_out) images.push_back(frame.found.frame);
  job.noise = measure_noise(sample.windows, sample.images, images);
  if (images.empty()) return report;
  job.mean_square = sample.mean_square(images);
  for (const LeftOutFrame& frame : report.left_out) job.left_out.push_back(frame.name);
  std::erase_if(job.frames, [&](const CaptureFrame& frame) {
    return std::ranges::find(report.left_out, frame.name, &LeftOutFrame::name) != report.left_out.end();
  });
  job.session.frames = job.frames;
  require_enough_frames(job, options);
  return report;
}

}  // namespace refield
