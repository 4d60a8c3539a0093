// SPDX-License-Identifier: Apache-2.0
#include "cli/report/report.h"

#include <sys/resource.h>

#include <set>

#include "cli/report/page.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/field/drift.h"
#include "core/field_io/reflectance_field_file.h"
#include "estimate/rig/rig_model.h"
#include "relight/held_out.h"

namespace refield::report {

namespace {

/// An exact transport is large: about 16 bytes for each texel that a pixel sees. Above this the exact images
/// are used.
constexpr std::uint64_t largest_transport_bytes = 4ull << 30;

void require_fit(const ReflectanceField& field, const fs::path& path, const CaptureSession& session) {
  if (field.width != session.width || field.height != session.height)
    throw InputError(path, ": has ", size_text(field.width, field.height), " pixels, the photographs of ",
                     text_of(session), " have ", size_text(session.width, session.height),
                     "; give a field that was estimated from this session");
  if (field.basis.domain != session.light)
    throw InputError(
        path, ": is made for light maps of ", size_text(field.basis.domain.width, field.basis.domain.height),
        " (", name_of(field.basis.domain.parameterisation), "), those of ", text_of(session), " are ",
        size_text(session.light.width, session.light.height), " (", name_of(session.light.parameterisation),
        "); give a field that was estimated from this session");
}

FieldEntry load_field(const fs::path& path, const CaptureSession& session, const RunContext& run) {
  if (!fs::exists(path))
    throw InputError(path, ": the field does not exist; create it with 'refield estimate ",
                     session.folder.empty() ? "--light … --observed …" : session.folder.string(), " -o ",
                     path, "'");
  FieldEntry entry;
  entry.path = path;
  entry.field = read_image_field(path, run);
  require_fit(entry.field, path, session);
  entry.file_bytes = fs::file_size(path);
  if (const auto options = options_from_provenance(entry.field.provenance)) {
    entry.options = *options;
    entry.options_recorded = true;
  }
  entry.statistics = kernel_statistics(entry.field, entry.options_recorded ? entry.options.kernels : 0);
  return entry;
}

/// File names without extension where that tells the fields apart, else their paths.
void label_fields(std::vector<FieldEntry>& fields) {
  const auto is_unique = [&](const FieldEntry& entry) {
    return std::ranges::count_if(
               fields, [&](const FieldEntry& other) { return other.path.stem() == entry.path.stem(); }) == 1;
  };
  for (FieldEntry& entry : fields)
    entry.label = is_unique(entry) ? entry.path.stem().string() : entry.path.string();
}

/// Without the transport: the images of a simulated session, paired by frame name.
CaptureSession truth_by_name(const CaptureSession& session, const fs::path& folder) {
  const CaptureSession exact = read_capture_session(folder);
  if (exact.width != session.width || exact.height != session.height)
    throw InputError(folder, ": its images are ", size_text(exact.width, exact.height),
                     ", the photographs of ", text_of(session), " ", size_text(session.width, session.height),
                     "; give the truth that this session was acquired from");
  CaptureSession truth = session;
  truth.frames = session.frames_of(FrameRole::test);
  for (CaptureFrame& frame : truth.frames) {
    const auto match = std::ranges::find(exact.frames, frame.name, &CaptureFrame::name);
    if (match == exact.frames.end())
      throw InputError(folder, ": has no frame '", frame.name, "', which ", text_of(session),
                       " has; give the truth that this session was acquired from");
    frame.observed = match->observed;
  }
  return truth;
}

/// With it: relit by the light that the session emitted, kept as images so that they are computed once.
CaptureSession truth_by_transport(const CaptureSession& session, const ReflectanceField& transport,
                                  const fs::path& scratch, const RunContext& run) {
  CaptureSession truth = session;
  truth.frames = session.frames_of(FrameRole::test);
  const fs::path folder = scratch / "truth";
  create_folders(folder);
  Progress progress(run, "computing exact images", truth.frames.size());
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    run.throw_if_stopped();
    CaptureFrame& frame = truth.frames[i];
    const LightMap light = read_illumination(frame, session.light.parameterisation, run);
    frame.observed = folder / (std::to_string(i) + ".exr");
    write_exr(frame.observed, transport.relight(light));
    progress.advance();
  }
  return truth;
}

/// Exact images do not move.
void hold_still(CaptureSession& truth) {
  for (CaptureFrame& frame : truth.frames) {
    if (!frame.correction) continue;
    FrameCorrection still = *frame.correction;
    still.shift_px = still.turn = {};
    frame.correction = std::make_shared<const FrameCorrection>(still);
  }
}

void load_truth(ReportInput& input, const fs::path& scratch, const RunContext& run) {
  const fs::path path = input.truth_folder / "transport.rfield";
  if (!fs::is_directory(input.truth_folder))
    throw InputError(input.truth_folder,
                     ": is not a folder; give a folder written by 'refield simulate', or remove --truth");
  if (fs::exists(path) && fs::file_size(path) <= largest_transport_bytes) {
    input.transport = read_image_field(path, run);
    require_fit(*input.transport, path, input.session);
    input.truth = truth_by_transport(input.session, *input.transport, scratch, run);
    input.truth_note =
        "noise-free images from the scene's exact transport, under the light that was really emitted";
    return;
  }
  input.truth = truth_by_name(input.session, input.truth_folder);
  input.truth_note =
      fs::exists(path)
          ? "the noise-free images of the simulation; its transport (" +
                bytes_text(static_cast<double>(fs::file_size(path))) +
                ") is too large for a report, so the display's quantisation counts as error"
          : "the noise-free images of the simulation, so the display's quantisation counts as error";
}

template <class T>
std::optional<T> number(const Json& json, const char* key) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  return found->get<T>();
}

/// "estimated_memory_bytes": 457278272 reads "estimated memory 457 MB".
std::string detail(std::string key, const Json& value) {
  static constexpr std::string_view bytes = "_bytes";
  const bool in_bytes = value.is_number() && key.ends_with(bytes);
  if (in_bytes) key.resize(key.size() - bytes.size());
  std::ranges::replace(key, '_', ' ');
  key += ' ';
  if (in_bytes) return key + bytes_text(value.get<double>());
  if (value.is_number_float()) return key + significant(value.get<double>(), 3);
  return key + (value.is_string() ? value.get<std::string>() : json_text(value));
}

}  // namespace

std::optional<EstimateOptions> options_from_provenance(const std::string& provenance) {
  const auto json = json_if_valid(provenance);
  if (!json.is_object()) return std::nullopt;
  const auto& options = json.contains("options") && json["options"].is_object() ? json["options"] : json;
  if (!options.contains("mode") || !options["mode"].is_string() || !options.contains("kernels") ||
      !options["kernels"].is_number_integer())
    return std::nullopt;
  EstimateOptions result;
  try {
    result.mode = estimate_mode_from_name(options["mode"].get<std::string>());
  } catch (const InputError&) {
    return std::nullopt;  // a mode of a later program
  }
  result.kernels = options["kernels"].get<int>();
  if (const auto passes = options.find("spatial_passes");
      passes != options.end() && passes->is_number_integer())
    result.spatial_passes = passes->get<int>();
  return result;
}

ReportInput load_input(const CaptureSession& session, const std::vector<fs::path>& field_paths,
                       const fs::path& truth_folder, const fs::path& scratch, const RunContext& run) {
  ReportInput input;
  input.session = session;
  if (session.folder.empty()) check_image_sizes(input.session);
  remove_drift(input.session, run);
  if (input.session.mask)
    input.mask = read_mask(*input.session.mask, input.session.width, input.session.height);
  for (const fs::path& path : field_paths) input.fields.push_back(load_field(path, input.session, run));
  label_fields(input.fields);
  mark_held_out(input.session, input.fields.front().field.provenance);
  correct_held_out(input.fields.front().field.provenance, input.session);
  input.truth_folder = truth_folder;
  if (!truth_folder.empty() && !input.session.frames_of(FrameRole::test).empty())
    load_truth(input, scratch, run);
  if (input.truth) hold_still(*input.truth);
  return input;
}

fs::path run_log_path(const fs::path& made) {
  fs::path path = made.lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  return path += ".log.json";
}

void write_run_log(const fs::path& made, const std::string& stage, double seconds, const Json& details) {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  Json log = {{"stage", stage},
              {"seconds", seconds},
              {"peak_memory_bytes", static_cast<std::uint64_t>(usage.ru_maxrss) * 1024}};
  log.update(details);
  write_text_atomically(run_log_path(made), json_text(log, 2) + "\n");
}

std::optional<RunLog> read_run_log(const fs::path& path) {
  if (!fs::is_regular_file(path)) return std::nullopt;
  const auto json = json_if_valid(read_text(path));
  if (!json.is_object() || !json.contains("stage") || !json["stage"].is_string())
    throw FormatError(path, "is not the log of a run; remove it or run that stage again");
  RunLog log;
  log.path = path;
  log.stage = json["stage"].get<std::string>();
  log.seconds = number<double>(json, "seconds");
  log.peak_memory_bytes = number<std::uint64_t>(json, "peak_memory_bytes");
  log.threads = number<int>(json, "threads");
  // The last: names of what was made, which the path says.
  static const std::set<std::string> told_elsewhere = {"stage", "seconds", "peak_memory_bytes", "threads",
                                                       "field"};
  for (const auto& [key, value] : json.items())
    if (!told_elsewhere.contains(key) && (value.is_number() || value.is_string()))
      log.details += (log.details.empty() ? "" : ", ") + detail(key, value);
  return log;
}

std::vector<RunLog> find_run_logs(const ReportInput& input) {
  std::vector<fs::path> made;
  if (!input.truth_folder.empty()) made.push_back(input.truth_folder);
  if (!input.session.folder.empty()) made.push_back(input.session.folder);
  for (const FieldEntry& entry : input.fields) made.push_back(entry.path);
  std::vector<RunLog> logs;
  for (const fs::path& path : made)
    if (auto log = read_run_log(run_log_path(path))) logs.push_back(std::move(*log));
  return logs;
}

}  // namespace refield::report
