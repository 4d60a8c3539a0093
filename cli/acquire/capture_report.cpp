// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/capture_report.h"

#include <cstdio>

#include "acquire/hdr/hdr_merge.h"
#include "cli/common/options.h"
#include "cli/report/report.h"
#include "cli/run_context.h"
#include "estimate/rig/verdict.h"

namespace refield::cli {

namespace {

Json figures_of(const CaptureSummary& summary, const UntilError* until) {
  Json exposures = Json::array();
  for (std::size_t i = 0; i < summary.exposures.size(); ++i) {
    exposures.push_back({{"seconds", summary.exposures[i].count()}});
    if (!summary.useful_fraction.empty()) exposures.back()["useful_fraction"] = summary.useful_fraction[i];
  }
  Json figures = {{"lights", summary.lights},
                  {"left_out", summary.left_out},
                  {"taken_over", summary.found_done},
                  {"damaged_and_repeated", summary.found_damaged},
                  {"exposures", exposures},
                  {"exposure_plan", summary.exposure_note},
                  {"clipped_fraction", summary.clipped_fraction},
                  {"lights_brighter_than_monitor", summary.out_of_range_lights},
                  {"frames_discarded_early", summary.discarded.early},
                  {"frames_discarded_stale", summary.discarded.stale},
                  {"frames_lost", summary.discarded.lost},
                  {"seconds", summary.seconds}};
  if (until && until->last().images > 0)
    figures["until_error"] = {
        {"target", until->target()},
        {"reached", until->reached()},
        {"predicted", until->last().predicted ? Json(*until->last().predicted) : Json(nullptr)},
        {"photograph_noise", until->last().noise},
        {"images", until->last().images},
        {"images_needed", until->images_for()}};
  return figures;
}

void print(const UntilError& until, const CaptureSummary& summary) {
  if (until.last().images == 0) return;
  if (!until.last().predicted) {
    std::printf("the error cannot be predicted from %d lights that differ; it takes %d\n",
                until.last().lights, min_lights_for_errors);
    return;
  }
  std::printf("predicted error %.2f %% after %d images, target %.2f %%: ", 100.0 * *until.last().predicted,
              until.last().images, 100.0 * until.target());
  if (until.reached())
    std::printf("reached, %zu lights skipped\n", summary.left_out);
  else if (until.last().noise > until.target())
    std::printf(
        "not reachable because the noise of the photographs is %.2f %%; take more frames per exposure\n",
        100.0 * until.last().noise);
  else if (const int needed = until.images_for(); needed > 0)
    std::printf("not reached, about %d images are needed\n", needed);
  else
    std::printf("not reached, and more images of this kind would hardly reduce the error\n");
}

void print(const CaptureSummary& summary, const fs::path& session) {
  if (summary.useful_fraction.empty()) {
    std::printf("%s: already complete, %zu photographs\n", session.c_str(), summary.lights);
    return;
  }
  std::printf("%s: %zu photographs", session.c_str(), summary.lights);
  if (summary.found_done > 0) std::printf(", %zu steps from an earlier run", summary.found_done);
  if (summary.found_damaged > 0) std::printf(", %zu damaged files repeated", summary.found_damaged);
  std::printf("\nexposures:");
  for (std::size_t i = 0; i < summary.exposures.size(); ++i)
    std::printf(" %.4g s (useful for %.1f %% of the samples)%s", summary.exposures[i].count(),
                100.0 * summary.useful_fraction[i], i + 1 < summary.exposures.size() ? "," : "\n");
  if (!summary.exposure_note.empty()) std::printf("%s\n", summary.exposure_note.c_str());
  std::printf("clipped in every exposure: %.3f %% of the samples\n", 100.0 * summary.clipped_fraction);
  std::printf(
      "discarded frames: %llu started before the pattern was stable, %llu before the last change of exposure "
      "or gain; lost frames: %llu\n",
      static_cast<unsigned long long>(summary.discarded.early),
      static_cast<unsigned long long>(summary.discarded.stale),
      static_cast<unsigned long long>(summary.discarded.lost));
  if (summary.out_of_range_lights > 0)
    std::printf(
        "%zu light maps exceed the brightness of the monitor in places; the emitted radiance is stored\n",
        summary.out_of_range_lights);
  if (is_much_clipped(summary.clipped_fraction)) std::printf("note: %s\n", clipping_remedy);
  if (summary.darker_than_ambient.size() >= enough_darker_photographs)
    std::printf("note: %s\n", darker_text("ambient.exr", summary.darker_than_ambient).c_str());
  for (const std::string& sentence : wasted_exposures(summary.exposures, summary.useful_fraction))
    std::printf("note: %s\n", sentence.c_str());
}

}  // namespace

void report_capture(const CaptureSummary& summary, const fs::path& session, const UntilError* until,
                    const Common& common) {
  // A capture that was already complete keeps the log of the run that made it.
  if (!summary.useful_fraction.empty())
    report::write_run_log(session, "acquire", summary.seconds,
                          {{"lights", summary.lights},
                           {"taken_over", summary.found_done},
                           {"exposures", summary.exposures.size()},
                           {"clipped_fraction", summary.clipped_fraction},
                           {"frames_discarded_early", summary.discarded.early},
                           {"frames_discarded_stale", summary.discarded.stale},
                           {"frames_lost", summary.discarded.lost}});
  if (common.json) {
    Json figures = figures_of(summary, until);
    report_check(session, &figures);
    print_json(figures);
    return;
  }
  print(summary, session);
  if (until) print(*until, summary);
  report_check(session);
}

void report_check(const fs::path& session, Json* figures) {
  if (!fs::exists(session / session_manifest_name)) return;
  try {
    const CaptureVerdict verdict = check_capture(read_capture_session(session), {}, run_context());
    const std::string table = verdict_table(verdict);
    const bool is_good = verdict.state() == RigFinding::State::good;
    if (figures)
      (*figures)["check"] = verdict_json(verdict);
    else
      std::printf("%s", (is_good ? table.substr(0, table.find('\n') + 1) : table).c_str());
  } catch (const InputError& error) {  // the photographs are kept all the same
    run_context().note("the photographs were not checked: ", error.what());
  }
}

void add_resume_flag(CLI::App& verb, IfExists& choice) {
  verb.add_flag_callback(
      "--resume", [&choice] { choice = IfExists::resume; }, "Continue an interrupted run");
}

IfExists if_exists(IfExists choice, const Common& common) {
  if (!common.force) return choice;
  if (choice == IfExists::resume) throw InputError("--resume excludes --force; give one of them");
  return IfExists::replace;
}

}  // namespace refield::cli
