// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <map>

#include "core/base/run_context.h"
#include "core/field/drift.h"
#include "core/field/reflectance_field.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"
#include "core/session/journal.h"
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/sample_pooling.h"
#include "estimate/job/refinement.h"
#include "estimate/options.h"
#include "estimate/rig/rig_model.h"

namespace refield {

/// The input of an estimation, opened and checked: the training frames of a session, whose images fit
/// together, and the mask.
struct EstimateJob {
  CaptureSession session;
  std::vector<CaptureFrame> frames;
  Mask mask;
  RowRange rows;  ///< of the picture, to be estimated
  std::vector<CaptureFrame> references;
  Drift drift;                        ///< what reference frames show; removed where significant
  double mean_square = 0.0;           ///< of the photographs' samples, see BlockFitter
  NoiseModel noise;                   ///< of the photographs, measured by check_frames()
  RigModel rig;                       ///< what the frames are corrected for
  std::vector<std::string> left_out;  ///< names of training frames that check_frames() took out
  std::vector<std::string> held_out;  ///< names of the test frames
  std::map<std::string, std::string> light_patterns;  ///< by names of frames, from check_frames()
  /// The field that takes in new images; null for a fresh start.
  std::shared_ptr<Refinement> refinement = nullptr;
};

/// Checks options, the number of training images and the header of every image, reads the mask, and sets the
/// frames' gain to the drift that reference frames show. Throws
/// InputError for input that cannot be estimated from.
EstimateJob open_job(const CaptureSession& session, const EstimateOptions& options,
                     const RunContext& run = {});

/// What messages call a capture: its folder or, for one given by patterns, its first photograph's folder.
std::string name_of(const CaptureSession& session);

/// The files that the session's journal names, by path; none without a journal.
std::map<std::string, JournalFile> journal_files(const CaptureSession& session);

/// Throws InputError, naming `name`, for a mask without any pixel.
void require_any_inside(const Mask& mask, const std::string& name);

/// Throws InputError when the job has too few frames for the options; open_job() has asked.
void require_enough_frames(const EstimateJob& job, const EstimateOptions& options);

/// Names everything that the result depends on, the same on every host: options, and a digest of the names,
/// sizes and checksums of all input files (sampled content of files that no journal names), but no folder or
/// time. Shards are merged, and the bands of
/// an interrupted estimation taken over, only where this text is the same. Throws DeviceError where a file
/// cannot be read.
std::string job_key(const EstimateJob& job, const EstimateOptions& options);

/// What a field says of its making: JSON without time, host or absolute path.
std::string provenance_of(const EstimateJob& job, const EstimateOptions& options);

/// Gathers the job's rows, pixel by pixel in row-major order, into a field of that height; boxes get their
/// numbers in order of first use.
class FieldAssembler {
 public:
  FieldAssembler(const EstimateJob& job, const EstimateOptions& options);
  void append(std::span<const PixelKernels> kernels);
  /// The same without the columns and weights of the transfer, for fields too large to stand in memory:
  /// transfer_of() gives these once all pixels were noted.
  void note(std::span<const PixelKernels> kernels);
  SparseTransfer transfer_of(std::span<const PixelKernels> kernels) const;
  /// Whether any weight is not zero.
  bool has_weights() const { return has_weights_; }
  /// The field, with its errors predicted where it is whole and the pixels came with evidence. What note()
  /// took in stands in transfer.row_start alone.
  ReflectanceField take(std::vector<Box> observed_light, LightErrorModel light_error);
  /// [pixels] or empty.
  std::vector<ErrorEvidence> take_evidence() { return std::move(error_evidence_); }

 private:
  bool with_evidence_;
  bool has_weights_ = false;
  bool is_whole_;  // parts are predicted when they are merged
  double images_;
  ReflectanceField field_;
  std::vector<ErrorEvidence> error_evidence_;
  std::unordered_map<Box, std::uint32_t, BoxHash> numbers_;
};

}  // namespace refield
