// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/verdict.h"

#include <cmath>

#include "core/base/json.h"
#include "core/base/number_text.h"
#include "estimate/job/estimate_job.h"
#include "estimate/quality/frame_check.h"

namespace refield {

namespace {

using State = RigFinding::State;

// From this share of the samples on, the light of highlights is missing from the field.
constexpr double min_clipped = 2e-4, many_clipped = 0.02;
// Relative noise from which photographs say little about single pixels.
constexpr double much_noise = 0.1;
// What a median training error may leave beside the noise. With --rig off, undisturbed captures of two
// scenes leave less than .002, colour mixing of 12 % leaves .031, a camera that creeps by .3 pixels .027, all
// effects together .041, wrong pairs .64. What is less looks like noise to the fit: a tone curve that is off
// by an exponent of 1.05 leaves .012.
constexpr double max_unexplained_error = 0.025;
// Noise with bright outliers, as path tracers leave it, is larger than it is measured to be: .033 seem to be
// left of an undisturbed capture. Neighbouring pixels share .0026 of that, and as much of two captures with 1
// and 2 % of noise; with --rig off they share .011 of varying room light, .012 of a wrong tone curve, .017 to
// .039 of other effects and .6 of wrong pairs.
constexpr double min_shared_error = 0.006;

std::string percent(double share) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g %%", 100.0 * share);
  return text;
}

/// What to do about an effect of the rig.
std::string remedy_of(const std::string& effect, State state) {
  struct Remedy {
    const char *effect, *corrected, *wrong;
  };
  static constexpr std::array<Remedy, 6> remedies{{
      {"pairing", "leave the correction on, or name photographs and lights alike",
       "see that the patterns light the scene, and import the photographs again in the order of the lights"},
      {"motion", "leave the correction on, or fix the camera and photograph again from there",
       "fix the camera and photograph again from there"},
      {"colour", "leave the correction on: relit pictures keep the colours of the camera",
       "photograph one full screen of each primary, or use a camera profile"},
      {"tone", "leave the correction on, or measure the tone curve by 'refield acquire calibrate'",
       "measure the tone curve by 'refield acquire calibrate'"},
      {"gain", "leave the correction on; set exposure, aperture and white balance by hand",
       "set exposure, aperture and white balance by hand and photograph again"},
      {"room light", "leave the correction on; keep the room dark during the capture",
       "darken the room and photograph again"},
  }};
  const auto found =
      std::ranges::find(remedies, effect, [](const Remedy& r) { return std::string(r.effect); });
  if (state == State::good || found == remedies.end()) return "";
  return state == State::corrected ? found->corrected : found->wrong;
}

VerdictRow row_of(const RigFinding& finding) {
  VerdictRow row{finding.effect == "tone"   ? "tone curve"
                 : finding.effect == "gain" ? "brightness"
                                            : finding.effect,
                 finding.state,
                 finding.measured,
                 {},
                 {},
                 remedy_of(finding.effect, finding.state)};
  if (finding.residual_before != finding.residual_after) {
    row.residual_before = finding.residual_before;
    row.residual_after = finding.residual_after;
  }
  return row;
}

VerdictRow clipping_row(double share) {
  VerdictRow row{"clipping", State::good, percent(share) + " of the samples were not measured", {}, {}, ""};
  if (share == 0.0) row.measured = "every sample was measured";
  if (share < min_clipped) return row;
  row.state = share < many_clipped ? State::suspicious : State::unusable;
  row.remedy = "add a shorter exposure: the samples are left out, and highlights are known less well";
  return row;
}

VerdictRow noise_row(double noise) {
  VerdictRow row{"noise", State::good, percent(noise) + " of a sample", {}, {}, ""};
  if (noise == 0.0) row.measured = "not measured: too few photographs or too little noise";
  if (noise < much_noise) return row;
  row.state = State::suspicious;
  row.remedy = "expose longer, or average several frames per exposure";
  return row;
}

std::string names_of(const std::vector<LeftOutFrame>& frames) {
  constexpr std::size_t max_names = 3;
  return listed(frames, max_names, &LeftOutFrame::name);
}

VerdictRow outlier_row(const FrameReport& report) {
  VerdictRow row{"outlier frames", State::good, "none", {}, {}, ""};
  if (report.typical_residual == 0.0) row.measured = "not compared: too few photographs";
  if (!report.left_out.empty()) {
    row.state = State::corrected;
    row.measured = names_of(report.left_out) + ": " + report.left_out.front().why;
    row.remedy = "they are left out; photograph them again if many are";
  }
  if (!report.doubtful.empty()) {
    row.state = State::unusable;
    row.measured = std::to_string(report.doubtful.size()) +
                   " photographs do not fit the others: " + names_of(report.doubtful);
    row.remedy = "check that each light map belongs to its photograph, and that nothing moved";
  }
  return row;
}

VerdictRow drift_row(const Drift& drift) {
  VerdictRow row{"drift", State::good, "no reference frames", {}, {}, ""};
  if (drift.points.empty()) return row;
  row.measured = "brightness changed by up to " + percent(drift.largest) + " over " +
                 std::to_string(drift.points.size()) + " reference frames";
  if (!drift.significant) return row;
  row.state = State::corrected;
  row.remedy = "leave the correction on; let monitor and camera warm up for half an hour";
  return row;
}

}  // namespace

std::string_view name_of(State state) {
  constexpr std::array<std::string_view, 4> names{"good", "corrected", "suspicious", "unusable"};
  return names[static_cast<std::size_t>(state)];
}

State CaptureVerdict::state() const {
  State worst = State::good;
  for (const VerdictRow& row : rows) worst = std::max(worst, row.state);
  return worst;
}

CaptureVerdict verdict_of(const FrameReport& report, int photographs) {
  CaptureVerdict verdict{photographs, {}, report.typical_residual, report.noise};
  for (const RigFinding& finding : report.rig.findings) verdict.rows.push_back(row_of(finding));
  verdict.rows.push_back(drift_row(report.drift));
  verdict.rows.push_back(clipping_row(report.clipped_share));
  verdict.rows.push_back(noise_row(report.noise));
  verdict.rows.push_back(outlier_row(report));
  return verdict;
}

CaptureVerdict check_capture(const CaptureSession& session, const EstimateOptions& options,
                             const RunContext& run) {
  RunContext quiet = run;
  quiet.on_note = {};  // the verdict says it
  EstimateJob job = open_job(session, options, quiet);
  const auto photographs = static_cast<int>(job.frames.size());
  return verdict_of(check_frames(job, options, quiet), photographs);
}

Json verdict_json(const CaptureVerdict& verdict) {
  auto rows = Json::array();
  for (const VerdictRow& row : verdict.rows) {
    Json entry{{"property", row.property}, {"state", name_of(row.state)}, {"measured", row.measured}};
    if (row.residual_before)
      entry.update({{"residual_before", *row.residual_before}, {"residual_after", *row.residual_after}});
    if (!row.remedy.empty()) entry["remedy"] = row.remedy;
    rows.push_back(std::move(entry));
  }
  return {{"state", name_of(verdict.state())},
          {"photographs", verdict.photographs},
          {"typical_residual", verdict.typical_residual},
          {"noise", verdict.noise},
          {"properties", rows}};
}

std::string verdict_table(const CaptureVerdict& verdict) {
  std::string table;
  const auto add = [&](const char* format, auto... values) {
    char line[512];
    std::snprintf(line, sizeof line, format, values...);
    table += line;
  };
  add("check of %d photographs: %s\n", verdict.photographs, std::string(name_of(verdict.state())).c_str());
  for (const VerdictRow& row : verdict.rows) {
    add("  %-14s  %-10s  %s", row.property.c_str(), std::string(name_of(row.state)).c_str(),
        row.measured.c_str());
    if (row.residual_before && *row.residual_before > 0.0)
      add("; residual %.3f to %.3f", *row.residual_before, *row.residual_after);
    table += '\n';
    if (!row.remedy.empty()) add("  %-14s  %-10s  → %s\n", "", "", row.remedy.c_str());
  }
  return table;
}

std::string unexplained_error(double training_error, double noise, std::optional<double> shared_error,
                              const CaptureVerdict& verdict) {
  const double unexplained = std::sqrt(std::max(0.0, training_error * training_error - noise * noise));
  const bool is_more_than_noise =
      unexplained > max_unexplained_error && (!shared_error || *shared_error > min_shared_error);
  const auto worst = std::ranges::max_element(verdict.rows, {}, &VerdictRow::state);
  const bool uncorrected = worst->state > State::corrected && worst->residual_before;
  if (!is_more_than_noise && !uncorrected) return "";
  std::string text = "the photographs do not follow from the lights: ";
  if (is_more_than_noise)
    text += "the training error of " + percent(training_error) + " is more than noise (" + percent(noise) +
            ") explains; ";
  if (worst->state > State::good)
    text += (uncorrected ? "not corrected: " : "likely cause: ") + worst->property + " (" + worst->measured +
            "): " + worst->remedy;
  else
    text += "check that each light map belongs to its photograph, that nothing moved, and the tone curve";
  return text;
}

}  // namespace refield
