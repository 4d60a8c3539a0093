// SPDX-License-Identifier: Apache-2.0
#include "cli/report/image_count_study.h"

#include <algorithm>
#include <optional>

#include "cli/report/evaluation.h"
#include "cli/report/study_window.h"
#include "core/image_io.h"
#include "core/interrupt.h"
#include "core/progress.h"
#include "estimate/estimate.h"

namespace refield::report {

namespace fs = std::filesystem;

namespace {

constexpr int counts_of_the_paper[] = {25, 50, 75, 100};

std::vector<int> image_counts(int available) {
  std::vector<int> counts;
  for (const int count : counts_of_the_paper)
    if (count < available) counts.push_back(count);
  if (available > 1) counts.push_back(available);
  return counts;
}

std::string series_name(const EstimateOptions& options) {
  return std::string(name_of(options.mode)) + ", " +
         (options.kernels > 0 ? std::to_string(options.kernels) + " kernels" : "kernels by the data") +
         (options.mode == EstimateMode::paper && options.spatial_passes == 0 ? ", no spatial correction"
                                                                             : "");
}

bool same_way(const EstimateOptions& a, const EstimateOptions& b) {
  return a.mode == b.mode && a.kernels == b.kernels && a.sweeps() == b.sweeps();
}

std::vector<StudySeries> ways_to_estimate(const ReportInput& input) {
  std::vector<StudySeries> ways;
  const auto add = [&](const EstimateOptions& options) {
    if (std::ranges::none_of(ways, [&](const StudySeries& way) { return same_way(way.options, options); }))
      ways.push_back({series_name(options), options, {}});
  };
  for (const FieldEntry& entry : input.fields) add(entry.options);
  EstimateOptions paper = input.fields.front().options;
  paper.mode = EstimateMode::paper;
  EstimateOptions uncorrected = paper;
  uncorrected.spatial_passes = 0;
  add(paper);
  add(uncorrected);
  return ways;
}

/// A field that was made in this very way from all images need not be estimated again.
std::optional<ReflectanceField> made_already(const ReportInput& input, const EstimateOptions& options,
                                             const Box& window) {
  for (const FieldEntry& entry : input.fields)
    if (entry.options_recorded && same_way(entry.options, options)) return cropped(entry.field, window);
  return std::nullopt;
}

}  // namespace

ImageCountStudy study_image_count(const ReportInput& input, std::size_t most_pixels,
                                  const fs::path& scratch) {
  ImageCountStudy study;
  const auto available = static_cast<int>(input.session.frames_of(FrameRole::train).size());
  const auto counts = image_counts(available);
  if (counts.empty() || input.session.frames_of(FrameRole::test).empty()) return study;

  study.window = typical_window(input.fields.front().field, input.mask, most_pixels);
  study.mask = cropped(input.mask, input.session.width, study.window);
  const CaptureSession session = cropped(input.session, study.window, scratch / "window");
  const CaptureSession reference =
      input.truth ? cropped(*input.truth, study.window, scratch / "window-truth") : session;
  for (const char* kind : {"natural", "bar"})
    for (const CaptureFrame& frame : spread_frames(reference, kind, 1)) study.picture_frames.push_back(frame);
  if (study.picture_frames.empty())
    study.picture_frames = spread_frames(reference, kinds_of(reference).front(), 2);
  std::vector<LightMap> lights;
  for (const CaptureFrame& frame : study.picture_frames) {
    study.reference.push_back(read_photograph(frame.observed).radiance);
    lights.push_back(read_light_map(frame.illumination, session.light.parameterisation));
  }

  study.series = ways_to_estimate(input);
  Progress progress("error by number of images", study.series.size() * counts.size());
  for (StudySeries& series : study.series)
    for (const int count : counts) {
      throw_if_interrupted();
      CaptureSession first_images = session;
      first_images.frames = session.frames_of(FrameRole::train);
      first_images.frames.resize(static_cast<std::size_t>(count));
      EstimateOptions options = series.options;
      options.kernels = std::min(options.kernels, count);
      options.predict_errors = false;  // the study knows the true ones
      std::optional<ReflectanceField> field;
      if (count == available) field = made_already(input, options, study.window);
      if (!field) field = estimate_field(first_images, options);
      StudyPoint point{count, options.kernels, sorted_errors(*field, reference), {}};
      for (const LightMap& light : lights) point.predicted.push_back(field->relight(light));
      series.points.push_back(std::move(point));
      progress.advance();
    }
  return study;
}

}  // namespace refield::report
