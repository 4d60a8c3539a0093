// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/json.h"
#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"
#include "estimate/options.h"

namespace refield::report {

/// A field under report.
struct FieldEntry {
  fs::path path;
  std::string label;  ///< short and unique among the fields
  std::uint64_t file_bytes = 0;
  ReflectanceField field;
  /// As the field's provenance records them; defaults where it does not.
  EstimateOptions options;
  bool options_recorded = false;
  KernelStatistics statistics;
};

/// All that a report starts from.
struct ReportInput {
  CaptureSession session;
  Mask mask;
  std::vector<FieldEntry> fields;
  fs::path truth_folder;                ///< empty: none given
  std::optional<CaptureSession> truth;  ///< the session's held-out frames with exact images as photographs
  std::optional<ReflectanceField> transport;  ///< the exact transport, where the truth folder holds it
  std::string truth_note;                     ///< how the exact images were made

  /// What pictures and errors are set against: the exact images where known, else the photographs.
  const CaptureSession& reference() const { return truth ? *truth : session; }
  std::string reference_name() const { return truth ? "exact image" : "photograph"; }
};

/// The options of an estimation as its field's provenance (JSON) records them; nullopt where it does not.
std::optional<EstimateOptions> options_from_provenance(const std::string& provenance);

/// Reads a session's fields and, unless `truth_folder` is empty, the exact images of its held-out frames.
/// Exact images are those under the light that the session says was emitted: a display's 8-bit drive differs
/// from the map that it was asked for. They are kept in `scratch`, which must outlive the input. Throws
/// InputError for a missing field and for one that does not fit the session. The first field tells which
/// frames it was not estimated from (mark_held_out()).
ReportInput load_input(const CaptureSession& session, const std::vector<fs::path>& field_paths,
                       const fs::path& truth_folder, const fs::path& scratch, const RunContext& run);

/// What a stage wrote about its own run, beside what it made.
struct RunLog {
  fs::path path;
  std::string stage;
  std::optional<double> seconds;
  std::optional<std::uint64_t> peak_memory_bytes;
  std::optional<int> threads;
  std::string details;  ///< the other entries, "bands 4, images 180"
};

/// MADE.log.json, beside the file or folder that a stage made. Beside, not inside: a folder that a resumed
/// run finished holds the same bytes as one that was made in one go.
fs::path run_log_path(const fs::path& made);

/// Writes the log of a run that made `made`, with the most memory that this process has held, then `details`
/// (an object).
void write_run_log(const fs::path& made, const std::string& stage, double seconds, const Json& details);

/// Reads a run log: a JSON object of stage, seconds, peak_memory_bytes, threads and more. nullopt when there
/// is none. Throws FormatError when it is no such object.
std::optional<RunLog> read_run_log(const fs::path& path);

/// The logs of the stages that led to the report, in the data's order: simulate, acquire, estimate.
std::vector<RunLog> find_run_logs(const ReportInput& input);

}  // namespace refield::report
