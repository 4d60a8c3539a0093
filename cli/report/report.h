// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/json.h"
#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"
#include "estimate/estimate.h"
#include "estimate/options.h"
#include "relight/held_out.h"

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

/// How the light that a pixel answers to lies in the light map. Energy of a kernel: weight × area, mean of
/// the channels.
struct KernelSpread {
  double energy = 0.0;  ///< the pixel's value under white light of radiance one
  double spread = 0.0;  ///< standard deviation of the position of energy, as a share of the map's diagonal
  double peak = 0.0;    ///< highest weight of a kernel over the mean weight of the whole map, unitless
};

/// [pixels]
std::vector<KernelSpread> kernel_spreads(const ReflectanceField& field, const RunContext& run = {});

/// A pixel whose kernels the report shows.
struct ChosenPixel {
  int x = 0;
  int y = 0;
  std::string kind;  ///< in a few words, why it was chosen
};

/// Pixels of different kind, read off the kernels alone: concentrated (as mirrors and glass are), narrow, a
/// peak over a broad base (glossy), the middle one, broad and even (diffuse), and one that fits its own
/// training images badly. Dark pixels are left out, and a pixel is assessed by the median of its 3 × 3
/// neighbourhood, so that no single noisy pixel is taken. Fewer for tiny images.
std::vector<ChosenPixel> choose_pixels(const ReflectanceField& field, const Mask& mask,
                                       const RunContext& run = {});

/// The reflectance function that kernels add up to: at each texel the sum of the weights (mean of the
/// channels) of the boxes over it, [height × width × 1] of the light map.
Image kernel_density(const LightDomain& domain, std::span<const Box> boxes,
                     std::span<const std::array<float, 3>> weights);

/// How the kernels of a pixel unfold (Matusik et al. 2004, figure 8).
struct PixelKernels {
  ChosenPixel pixel;
  /// [subdivisions], densities; nullopt where no further split was worth it.
  std::vector<std::optional<Image>> after;
  Image in_field;              ///< as the field holds them, after spatial correction
  std::optional<Image> exact;  ///< the pixel's row of the exact transport
};

struct KernelStudy {
  std::vector<int> subdivisions;
  int kernels = 0;  ///< allowed when all subdivisions are done
  std::vector<PixelKernels> pixels;
};

/// Follows the kernels of `pixels` through 1, 2, 3, 4, 5, 10, 20 and 24 subdivisions, as far as the session's
/// training images allow, estimated in the first field's mode.
KernelStudy study_kernels(const ReportInput& input, const std::vector<ChosenPixel>& pixels,
                          const RunContext& run);

/// Errors of one field against one reference, by kind of light in the order of kinds_of().
struct ReferenceErrors {
  std::string reference;  ///< "photographs" or "exact images"
  std::vector<HeldOutError> kinds;
};

/// A field's figures.
struct FieldFigures {
  std::vector<ReferenceErrors> errors;  ///< empty where the session holds nothing out
  double relight_seconds = 0.0;         ///< a frame, median, all cores
};

/// The kinds of light among held-out frames: natural, bar, square and white first, black last, others
/// between.
std::vector<std::string> kinds_of(const CaptureSession& session);

/// Evaluates all fields, one after the other.
std::vector<FieldFigures> evaluate(const ReportInput& input, const RunContext& run = {});

/// Up to `count` frames of a kind, evenly spread over its held-out frames: no hand picks them.
std::vector<CaptureFrame> spread_frames(const CaptureSession& session, const std::string& kind,
                                        std::size_t count);

/// The page's figures for machines. Errors are relative RMSE, fractions; numbers that are not finite become
/// null.
Json figures_json(const ReportInput& input, const std::vector<FieldFigures>& figures,
                  const std::vector<ChosenPixel>& pixels);

/// What the page of a report draws (cli/report/report.js): `figures` (figures_json()), to which pictures,
/// kernels, maps and the logs of stages are added. `check` is check_json() of the capture, or null.
Json page_data(const ReportInput& input, const std::vector<FieldFigures>& evaluated, const KernelStudy& study,
               const std::vector<RunLog>& logs, Json figures, Json check, const RunContext& run);

/// What a check of the photographs finds (estimate/rig/verdict.h): verdict, path of the camera, gains, colour
/// mixing, residual of each photograph.
Json check_json(const FrameReport& found, int photographs);

}  // namespace refield::report
