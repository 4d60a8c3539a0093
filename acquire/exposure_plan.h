// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "acquire/calibration.h"
#include "acquire/camera.h"
#include "acquire/hdr_merge.h"

namespace refield {

struct ExposurePlanOptions {
  int count = 4;        ///< exposures a photograph (the paper: four)
  double ratio = 4.0;   ///< of each to the one before
  Seconds shortest{0};  ///< 0: from a probing frame
  /// Every exposure becomes a whole multiple of this, where it is not zero: the monitor's refresh period or
  /// that of its backlight, without which bands appear.
  Seconds multiple_of{0};

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// Exposure times in growing order: shortest · ratio^i.
/// Source: Matusik et al. 2004, section 6, "four pictures with exponentially increasing exposure times".
/// Throws InputError when one lies outside the camera's range; the message says which options fit.
std::vector<Seconds> exponential_exposures(const ExposurePlanOptions& options,
                                           const CameraDescription& camera);

/// Checks times given by hand: positive, growing, within the camera's range. Throws InputError.
void check_exposures(const std::vector<Seconds>& exposures, const CameraDescription& camera);

/// Takes one frame of the brightest light with the given exposure.
using Probe = std::function<RawFrame(Seconds exposure)>;

/// The longest exposure at which the brightest light clips no more than one sample in a thousand, found from
/// a few probing frames: the right choice for the shortest of the plan. Stays within the camera's range;
/// where even the camera's shortest exposure clips, that is the answer. Throws InputError when no light
/// reaches the camera at all.
Seconds shortest_useful_exposure(const CameraDescription& camera, const CameraCalibration& calibration,
                                 const Probe& probe);

/// Sentences about exposures that did not earn their time; empty when all did. `useful` as in
/// MergeStatistics.
std::vector<std::string> wasted_exposures(const std::vector<Seconds>& exposures,
                                          const std::vector<double>& useful);

}  // namespace refield
