// SPDX-License-Identifier: Apache-2.0
#include "cli/report/html.h"
#include "cli/report/sections.h"

namespace refield::report {

std::string timing_html(const ReportInput& input, const std::vector<FieldFigures>& figures,
                        const std::vector<RunLog>& logs) {
  std::string rows;
  const auto row = [&](const std::string& stage, const std::string& what, const std::string& time,
                       const std::string& memory, const std::string& threads, const std::string& details) {
    rows += "<tr><td>" + escaped(stage) + "</td><td class=\"made\"><code>" + escaped(what) +
            "</code></td><td class=\"num\">" + time + "</td><td class=\"num\">" + memory +
            "</td><td class=\"num\">" + threads + "</td><td><small>" + escaped(details) +
            "</small></td></tr>";
  };
  for (const RunLog& log : logs) {
    std::string made = log.path.string();
    if (const auto end = made.rfind(".log.json"); end != std::string::npos) made.resize(end);
    row(log.stage, made, log.seconds ? duration_text(*log.seconds) : "–",
        log.peak_memory_bytes ? bytes_text(static_cast<double>(*log.peak_memory_bytes)) : "–",
        log.threads ? std::to_string(*log.threads) : "–", log.details);
  }
  for (std::size_t f = 0; f < figures.size(); ++f)
    if (figures[f].relight_seconds > 0.0)
      row("relight", input.fields[f].path.string(), duration_text(figures[f].relight_seconds) + " per frame",
          bytes_text(static_cast<double>(input.fields[f].field.transfer.entries()) * 16.0), "all",
          "measured for this page: " + fixed(1.0 / figures[f].relight_seconds, 0) +
              " frames per second; memory: the field");
  if (rows.empty()) return "";
  return section_html(
      "Time and memory",
      "<div class=\"wide\"><table><thead><tr><th>Stage</th><th>Made</th><th "
      "class=\"num\">Time</th><th class=\"num\">Peak "
      "memory</th><th class=\"num\">Threads</th><th>Details</th></tr></thead><tbody>" +
          rows +
          "</tbody></table></div><p class=\"note\">From the logs of the last run of each stage. For "
          "comparison: the 2004 paper reports two hours for a field of 1024 × 768 pixels from 180 images, "
          "and 0.5 frames per second for relighting, on a PC of that time.</p>");
}

}  // namespace refield::report
