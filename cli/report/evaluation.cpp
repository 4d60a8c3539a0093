// SPDX-License-Identifier: Apache-2.0
#include "cli/report/evaluation.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "core/image_io.h"
#include "core/run_context.h"

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
                                        const RunContext& run) {
  auto errors = held_out_errors(field, reference, nullptr, FrameRole::test, 1.0, run);
  std::ranges::stable_sort(errors, comes_before, &HeldOutError::kind);
  return errors;
}

Image held_out_map(const ReflectanceField& field, const CaptureSession& reference, const std::string& kind,
                   const RunContext& run) {
  SeriesError error;
  for (const CaptureFrame& frame : reference.frames_of(FrameRole::test)) {
    if (frame.kind != kind) continue;
    run.throw_if_stopped();
    const LightMap light = read_light_map(frame.illumination, reference.light.parameterisation, run);
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
      figures[f].errors.push_back({"photographs", sorted_errors(field, input.session, run)});
      if (input.truth) figures[f].errors.push_back({"exact images", sorted_errors(field, *input.truth, run)});
    }
    if (!input.session.frames.empty()) {
      const CaptureFrame& frame = held_out.empty() ? input.session.frames.front() : held_out.front();
      figures[f].relight_seconds = measure_relighting(
          field, read_light_map(frame.illumination, input.session.light.parameterisation, run));
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

}  // namespace refield::report
