// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <span>
#include <unordered_map>
#include <utility>

#include "core/reflectance_field.h"
#include "estimate/estimate_job.h"
#include "estimate/fit_pixel.h"

namespace refield {

/// Gathers the job's rows, pixel by pixel in row-major order, into a field of that height; boxes get their
/// numbers in order of first use.
class FieldAssembler {
 public:
  FieldAssembler(const EstimateJob& job, const EstimateOptions& options);
  void append(std::span<const PixelKernels> kernels);
  /// The field, with its errors predicted where the pixels came with evidence.
  ReflectanceField take();

 private:
  bool with_evidence_;
  bool is_whole_;  // parts are predicted when they are merged
  ReflectanceField field_;
  std::unordered_map<Box, std::uint32_t, BoxHash> numbers_;
};

}  // namespace refield
