// SPDX-License-Identifier: Apache-2.0
#include "cli/report/report.h"

#include <stdlib.h>
#include <nlohmann/json.hpp>

#include <cerrno>
#include <string>

#include "cli/report/evaluation.h"
#include "cli/report/page.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "estimate/job/estimate_job.h"
#include "estimate/quality/frame_check.h"

namespace refield::report {

ScratchFolder::ScratchFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "refield-report-XXXXXX").string();
  if (!::mkdtemp(pattern.data())) throw DeviceError(pattern, errno, "cannot create a temporary folder");
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

namespace {

std::vector<ChosenPixel> asked_pixels(const ReportRequest& request, const CaptureSession& session) {
  std::vector<ChosenPixel> pixels;
  for (const auto& [x, y] : request.pixels) {
    if (x < 0 || y < 0 || x >= session.width || y >= session.height)
      throw InputError("--pixel " + std::to_string(x) + "," + std::to_string(y) +
                       ": lies outside the photographs of " + text_of(session) + "; give 0 to " +
                       std::to_string(session.width - 1) + ", 0 to " + std::to_string(session.height - 1));
    pixels.push_back({x, y, "asked for"});
  }
  return pixels;
}

/// The check of a capture as it lies on disk; null where photographs are too few to estimate from.
nlohmann::ordered_json check_of(const CaptureSession& capture, const RunContext& run) try {
  RunContext quiet = run;
  quiet.on_note = {};  // the page says it
  EstimateJob job = open_job(capture, {}, quiet);
  const auto photographs = static_cast<int>(job.frames.size());
  return check_json(check_frames(job, {}, quiet), photographs);
} catch (const InputError&) {
  return nullptr;
}

}  // namespace

nlohmann::ordered_json write_report(const ReportRequest& request, const RunContext& run) {
  if (request.fields.empty()) throw InputError("a report needs a field; give --field FILE.rfield");
  const ScratchFolder scratch;
  const ReportInput input =
      load_input(request.session, request.find_held_out, request.fields, request.truth, scratch.path(), run);
  std::vector<ChosenPixel> pixels = asked_pixels(request, input.session);
  if (pixels.empty()) pixels = choose_pixels(input.fields.front().field, input.mask, run);
  const auto logs = find_run_logs(input);
  const auto evaluated = evaluate(input, run);
  const auto figures = figures_json(input, evaluated, pixels);
  const auto data = page_data(input, evaluated, study_kernels(input, pixels, run), logs, figures,
                              check_of(request.session, run), run);
  write_text_atomically(request.output, page_html(data));
  return figures;
}

}  // namespace refield::report
