// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <span>
#include <vector>

#include "core/capture_session.h"
#include "core/light_map.h"
#include "core/run_context.h"

namespace refield {

/// What lights say about each other: for each channel a few Gram matrices of the lights, seen coarsely and
/// through blurs of several widths. They are the kernels of a cheap predictor of any pixel under one light
/// from the same pixel under the others (ridge regression in its dual form; a blur stands for transport that
/// is smooth over the light map).
struct LightGrams {
  /// [channel][blur], [images × images], mean of the diagonal 1.
  std::array<std::vector<Eigen::MatrixXd>, 3> of_channel;
  int images = 0;
};

/// Reads the lights. Throws InputError for one that is black, not finite or of another size.
LightGrams light_grams(std::span<const CaptureFrame> frames, const LightDomain& domain,
                       const RunContext& run);
/// For lights in memory.
LightGrams light_grams(std::span<const LightMap> lights);

/// Leave-one-out residuals of `series` [images × series], one channel: what each sample is more than the
/// others predict of it. NaN stands for samples that were not measured; their residual is 0 and they enter no
/// prediction. Frames with `left_out` set predict nothing; their own residual is that of a new frame.
/// Each series takes the blur and ridge that predict it best.
struct LeaveOneOut {
  Eigen::MatrixXf residual;      ///< [images × series]
  Eigen::MatrixXf standardised;  ///< the same over its standard deviation: of the model by leverage, of the
                                 ///< series by its median
};
LeaveOneOut leave_one_out(const std::vector<Eigen::MatrixXd>& grams, const Eigen::MatrixXf& series,
                          const std::vector<char>& left_out, const RunContext& run = {});

}  // namespace refield
