// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "core/base/run_context.h"
#include "core/field/predicted_error.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/texel_regression.h"
#include "estimate/job/estimate_job.h"

namespace refield {

/// What all pixels of an estimation share: it follows from the lights and from the noise of the images, not
/// from the rows asked for. Reading and summing the lights is most of the work of a small shard. So shards of
/// one folder share the tables as a file, which the system keeps in memory once for all processes of a node.
class LightTables {
 public:
  /// Reads the lights of the job's frames, as check_frames() left them.
  LightTables(const EstimateJob& job, const EstimateOptions& options, const RunContext& run = {});
  /// The same from `file` where it holds them; else reads the lights, and writes the file if the disk has
  /// room for it and no other process is writing it. A file of other inputs or options, or a damaged one, is
  /// replaced.
  static std::unique_ptr<LightTables> shared(const std::filesystem::path& file, const EstimateJob& job,
                                             const EstimateOptions& options, const RunContext& run = {});

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
  struct Content;
  explicit LightTables(Content content);
  void write(const std::filesystem::path& file, const std::string& key) const;

  BoxTable table_;
  std::optional<TexelRegressions> texels_;
  LightErrorModel light_error_;
  bool weighs_images_ = false;
};

}  // namespace refield
