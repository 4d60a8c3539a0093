// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/predicted_error.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/texel_regression.h"
#include "estimate/job/estimate_job.h"

namespace refield {

/// What all pixels of an estimation share: it follows from the lights and from the noise of the images, not
/// from the rows asked for.
class LightTables {
 public:
  /// Reads the lights of the job's frames, as check_frames() left them. Notes to `run` where they are few, or
  /// sums of one another.
  LightTables(const EstimateJob& job, const EstimateOptions& options, const RunContext& run = {});

  LightTables(const LightTables&) = delete;
  LightTables& operator=(const LightTables&) = delete;

  const BoxTable& table() const { return table_; }
  /// Null but in refined mode; keeps what it has prepared.
  TexelRegressions* texels() { return texels_ ? &*texels_ : nullptr; }
  /// See FieldQuality; empty where errors are not predicted.
  const LightErrorModel& light_error() const { return light_error_; }
  /// Whether table() holds the images weighted by their noise, as the samples must be.
  bool weighs_images() const { return weighs_images_; }

 private:
  BoxTable table_;
  std::optional<TexelRegressions> texels_;
  LightErrorModel light_error_;
  bool weighs_images_ = false;
};

}  // namespace refield
