// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "refield/field.h"
#include "refield/session.h"

/// Estimation of a reflectance field from photographs under known lights (Matusik et al. 2004).
namespace refield {

struct RigModel;

inline namespace v0_2 {

/// `refined`: a smooth part and few rectangles, as many as the data bear (docs/method/estimation.md): most
/// accurate. `paper`: Matusik et al. 2004 as published: even splits, every candidate split re-solved by NNLS.
/// `fast`: the paper's splits scored by projected gain, without spatial correction.
enum class EstimateMode { refined, paper, fast };

REFIELD_API std::string_view name_of(EstimateMode mode);
/// Throws InputError for an unknown name.
REFIELD_API EstimateMode estimate_mode_from_name(std::string_view name);

struct REFIELD_API EstimateOptions {
  EstimateMode mode = EstimateMode::refined;
  int kernels = 0;                          ///< cap on the kernels of a pixel, 1 to 255; 0: by the data
  int spatial_passes = 1;                   ///< sweeps of spatial correction in paper mode; 0: none
  std::uint64_t memory_bytes = 4ull << 30;  ///< limit that row bands are planned for
  /// Samples at or above this radiance are clipped and left out, besides those that the capture marked.
  float clip_level = std::numeric_limits<float>::infinity();
  bool keep_drift = false;     ///< leave brightness as it is where reference frames show drift
  bool keep_outliers = false;  ///< estimate from frames that do not fit the others, too
  bool keep_rig = false;       ///< do not look for what contradicts B = T L
  /// The rig to correct for; null: estimated from the photographs. rig_model() reads one.
  std::shared_ptr<const RigModel> rig = nullptr;
  /// Rows of the picture to estimate, for a job array: the output is then a part of a field. Empty: all.
  std::optional<RowRange> rows;
  int threads = 0;             ///< 0: all cores. The result does not depend on it.
  bool predict_errors = true;  ///< cross-validate a lattice of pixels: a fifth more time

  /// A field of the same capture (.rfield) that takes in the images it was not made from. Empty: a fresh
  /// start.
  std::filesystem::path refine = {};
  /// The cap that `kernels` stands for.
  int max_kernels() const;
  /// Sweeps of spatial correction that the mode makes.
  int sweeps() const { return mode == EstimateMode::paper ? spatial_passes : 0; }

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// A rig from JSON text, as `refield estimate` writes it into OUTPUT.log.json. Throws InputError naming
/// `name` for text that is none.
REFIELD_API std::shared_ptr<const RigModel> rig_model(const std::string& text, const std::string& name);
/// The same from a file.
REFIELD_API std::shared_ptr<const RigModel> rig_model(const std::filesystem::path& file);

/// A capture in memory: photograph j was taken under light j; both are scene-linear RGB. The caller keeps the
/// arrays while they are used.
struct CaptureArrays {
  std::span<const LightMapView> lights;    ///< [images], all of one size and parameterisation
  std::span<const ImageView> photographs;  ///< [images], [height × width × 3], ambient light subtracted
  /// [images] or empty: standard deviation of each sample, infinite where nothing was measured.
  std::span<const ImageView> sigma{};
  Mask mask{};                               ///< [height × width]: pixels of value 0 are not estimated
  std::vector<MonitorPlacement> monitors{};  ///< where the monitor stood, kept in the field
};

/// Estimates the field of a session's training frames. Findings such as photographs that are left out go to
/// run.on_note. Throws InputError for input that cannot be estimated from, and Interrupted.
/// Source: Matusik et al. 2004, sections 3 to 5.
REFIELD_API Field estimate(const Session& session, const EstimateOptions& options = {},
                           const RunContext& run = {});
/// The same from arrays; reads and writes no file. Throws InputError for arrays that do not fit together,
/// counting images from 0. Bands of rows are copied as they are needed.
REFIELD_API Field estimate(const CaptureArrays& capture, const EstimateOptions& options = {},
                           const RunContext& run = {});

/// What an estimation will need, known before it starts.
struct EstimatePlan {
  int images = 0;
  int threads = 0;
  RowRange rows;      ///< of the picture
  int band_rows = 0;  ///< rows estimated at a time
  int held_rows = 0;  ///< rows of photographs held at a time, with those beyond the bands that bands share
  int bands = 0;
  std::uint64_t memory_bytes = 0;  ///< estimated peak
};

/// What an estimation did.
struct EstimateReport {
  EstimatePlan plan;
  int resumed_bands = 0;  ///< found finished on disk
  double seconds = 0.0;
  std::uint64_t peak_memory_bytes = 0;            ///< resident, of the whole process
  double mean_kernels = 0.0;                      ///< non-zero kernels per pixel
  double median_training_error = 0.0;             ///< relative RMSE over the training images
  std::optional<double> median_predicted_error;   ///< relative RMSE to be expected on new photographs
  std::optional<double> median_photograph_noise;  ///< the part of that which is the photographs' noise
  std::vector<std::string> left_out;              ///< training frames that do not fit the others
  std::string verdict;  ///< table of what contradicts B = T L and what to do; empty where all is good
  std::string advice;   ///< one sentence on the error or on more photographs; may be empty
  std::string log;      ///< JSON of all this and more: what `refield estimate` writes as OUTPUT.log.json
};

/// Estimates the field of a session's training frames into `file` (.rfield), out of core by bands of rows;
/// with options.rows set, those rows into a part of a field. Parts in one folder share the check of frames.
/// Finished bands are kept in the folder `file`.partial; with `resume` they are taken over, and the result is
/// the same bit for bit. `announce` is told the plan before the work begins. Throws as estimate(), and
/// InputError for another extension, for a file that is also an input or that another process writes.
REFIELD_API EstimateReport estimate_to_file(const Session& session, const EstimateOptions& options,
                                            const std::filesystem::path& file, bool resume = false,
                                            const RunContext& run = {},
                                            const std::function<void(const EstimatePlan&)>& announce = {});

/// What an estimation would take on this machine.
struct EstimateCost {
  EstimatePlan plan;
  double check_seconds = 0.0;        ///< comparing the frames with each other
  double lights_seconds = 0.0;       ///< reading all lights and building their table
  double photographs_seconds = 0.0;  ///< reading all bands of all photographs
  double fit_seconds = 0.0;
  int sampled_pixels = 0;  ///< that were fitted to find out
  std::string log;         ///< JSON of all this and of what the check of frames found
  double seconds() const { return check_seconds + lights_seconds + photographs_seconds + fit_seconds; }
};

/// Checks options and all input as an estimation does (the header of every image, the values of every light,
/// the values of the photographs' rows that the sample reads) and measures what the work costs: reads all
/// lights, some rows of all photographs, and fits tiles of pixels spread over the picture for about two
/// seconds. Writes nothing. Throws InputError for input that cannot be estimated from.
REFIELD_API EstimateCost estimate_cost(const Session& session, const EstimateOptions& options = {},
                                       const RunContext& run = {});

/// Rows of the `shard`-th of `shards` parts of a picture, from 1, of about equal height. They are cut where
/// the fewest stored blocks of photographs are read by two parts. Throws InputError unless 1 ≤ shard ≤ shards
/// ≤ rows.
REFIELD_API RowRange rows_of_shard(const Session& session, int shard, int shards,
                                   const EstimateOptions& options = {});

}  // namespace v0_2
}  // namespace refield
