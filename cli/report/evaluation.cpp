// SPDX-License-Identifier: Apache-2.0
#include "cli/report/evaluation.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <utility>

#include "core/base/run_context.h"
#include "core/image/image_io.h"

namespace refield::report {

namespace {

int rank_of(const std::string& kind) {
  static const std::vector<std::string> first = {"natural", "bar", "square", "white"};
  if (kind == "black") return 100;
  return static_cast<int>(std::ranges::find(first, kind) - first.begin());
}

bool comes_before(const std::string& a, const std::string& b) {
  return std::pair(rank_of(a), a) < std::pair(rank_of(b), b);
}

/// Median time to relight one frame, over up to a third of a second after one run that warms caches and
/// threads.
double measure_relighting(const ReflectanceField& field, const LightMap& light) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::duration<double> budget(0.3);
  constexpr std::size_t fewest = 3, most = 50;
  field.relight(light);
  std::vector<float> seconds;
  const auto start = Clock::now();
  while (seconds.size() < fewest || (seconds.size() < most && Clock::now() - start < budget)) {
    const auto before = Clock::now();
    field.relight(light);
    seconds.push_back(std::chrono::duration<float>(Clock::now() - before).count());
  }
  return quantile(seconds, 0.5);
}

}  // namespace

std::vector<std::string> kinds_of(const CaptureSession& session) {
  std::vector<std::string> kinds;
  for (const CaptureFrame& frame : session.frames_of(FrameRole::test)) kinds.push_back(frame.kind);
  std::ranges::sort(kinds, comes_before);
  kinds.erase(std::unique(kinds.begin(), kinds.end()), kinds.end());
  return kinds;
}

const HeldOutError* find_kind(const std::vector<HeldOutError>& errors, const std::string& kind) {
  const auto found = std::ranges::find(errors, kind, &HeldOutError::kind);
  return found == errors.end() ? nullptr : &*found;
}

std::vector<HeldOutError> sorted_errors(const ReflectanceField& field, const CaptureSession& reference,
                                        double noise_scale, const RunContext& run) {
  auto errors = held_out_errors(field, reference, nullptr, FrameRole::test, noise_scale, run);
  std::ranges::stable_sort(errors, comes_before, &HeldOutError::kind);
  return errors;
}

Image held_out_map(const ReflectanceField& field, const CaptureSession& reference, const std::string& kind,
                   const RunContext& run) {
  SeriesError error;
  for (const CaptureFrame& frame : reference.frames_of(FrameRole::test)) {
    if (frame.kind != kind) continue;
    run.throw_if_stopped();
    const LightMap light = read_illumination(frame, reference.light.parameterisation, run);
    const Photograph photograph = read_observed(frame);
    error.add(field.relight(light), photograph.radiance, photograph.sigma);
  }
  return error.relative_rmse_map();
}

std::vector<FieldFigures> evaluate(const ReportInput& input, const RunContext& run) {
  std::vector<FieldFigures> figures(input.fields.size());
  const auto held_out = input.session.frames_of(FrameRole::test);
  for (std::size_t f = 0; f < figures.size(); ++f) {
    run.throw_if_stopped();
    const ReflectanceField& field = input.fields[f].field;
    if (!held_out.empty()) {
      figures[f].errors.push_back({"photographs", sorted_errors(field, input.session, 1.0, run)});
      if (input.truth)
        figures[f].errors.push_back({"exact images", sorted_errors(field, *input.truth, 0.0, run)});
    }
    if (!input.session.frames.empty()) {
      const CaptureFrame& frame = held_out.empty() ? input.session.frames.front() : held_out.front();
      figures[f].relight_seconds = measure_relighting(
          field, read_illumination(frame, input.session.light.parameterisation, run));
    }
  }
  return figures;
}

std::vector<CaptureFrame> spread_frames(const CaptureSession& session, const std::string& kind,
                                        std::size_t count) {
  auto frames = session.frames_of(FrameRole::test);
  std::erase_if(frames, [&](const CaptureFrame& frame) { return frame.kind != kind; });
  count = std::min(count, frames.size());
  std::vector<CaptureFrame> chosen;
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(frames[(2 * i + 1) * frames.size() / (2 * count)]);
  return chosen;
}

namespace {

using Json = nlohmann::ordered_json;

std::string name_of_kind(const HeldOutError& error) {
  return error.kind.empty() ? "all" : error.kind;
}

Json kinds_json(const std::vector<HeldOutError>& errors) {
  Json json = Json::object();
  for (const HeldOutError& error : errors)
    json[name_of_kind(error)] = {{"images", error.images},
                                 {"trained_on", error.trained_on ? Json(*error.trained_on) : Json(nullptr)},
                                 {"relative_rmse", error.relative_rmse},
                                 {"median", error.median},
                                 {"percentile_90", error.percentile_90},
                                 {"tone_mapped_psnr_db", error.tone_mapped_psnr_db}};
  return json;
}

/// The same with each image's own errors.
Json kinds_and_images_json(const std::vector<HeldOutError>& errors) {
  Json json = kinds_json(errors);
  for (const HeldOutError& error : errors)
    for (const HeldOutImage& image : error.per_image)
      json[name_of_kind(error)]["per_image"].push_back(
          {{"name", image.name},
           {"observed", image.observed.string()},
           {"relative_rmse", image.error.relative_rmse},
           {"tone_mapped_psnr_db", image.error.tone_mapped_psnr_db}});
  return json;
}

Json options_json(const EstimateOptions& options) {
  return {{"mode", name_of(options.mode)},
          {"kernels", options.kernels},
          {"spatial_passes", options.spatial_passes}};
}

Json field_json(const FieldEntry& entry, const FieldFigures& figures) {
  const double pixels = static_cast<double>(entry.field.width) * entry.field.height;
  const KernelStatistics& statistics = entry.statistics;
  Json json = {{"path", entry.path.string()},
               {"label", entry.label},
               {"options", entry.options_recorded ? options_json(entry.options) : Json(nullptr)},
               {"file_bytes", entry.file_bytes},
               {"bytes_per_pixel", static_cast<double>(entry.file_bytes) / pixels},
               {"relight_ms", 1000.0 * figures.relight_seconds}};
  json["statistics"] = {{"distinct_boxes", statistics.distinct_boxes},
                        {"mean_kernels", statistics.mean_stored},
                        {"nonzero_share", statistics.nonzero_share},
                        {"share_of_99_percent", statistics.share_of_99_percent},
                        {"share_of_95_percent", statistics.share_of_95_percent}};
  json["errors"] = Json::object();
  for (const ReferenceErrors& errors : figures.errors)
    json["errors"][errors.reference] = kinds_and_images_json(errors.kinds);
  return json;
}

}  // namespace

Json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                  const std::vector<ChosenPixel>& pixels) {
  const CaptureSession& session = input.session;
  Json json;
  json["session"] = {{"folder", text_of(session)},
                     {"width", session.width},
                     {"height", session.height},
                     {"light_width", session.light.width},
                     {"light_height", session.light.height},
                     {"training_images", session.frames_of(FrameRole::train).size()},
                     {"held_out_images", session.frames_of(FrameRole::test).size()}};
  json["fields"] = Json::array();
  for (std::size_t f = 0; f < figures.size(); ++f)
    json["fields"].push_back(field_json(input.fields[f], figures[f]));
  json["pixels"] = Json::array();
  for (const ChosenPixel& pixel : pixels)
    json["pixels"].push_back({{"x", pixel.x}, {"y", pixel.y}, {"kind", pixel.kind}});
  return json;
}

}  // namespace refield::report
