// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/calibration.h"
#include "acquire/camera.h"

namespace refield {

struct ExposurePlanOptions {
  int count = 4;       ///< exposures a photograph (the paper: four)
  double ratio = 4.0;  ///< of each to the one before
  /// Above 0: count and ratio follow from the scene instead, as few exposures as keep the noise of a sample
  /// below this share of its radiance wherever the scene's range goes.
  double relative_noise = 0.0;
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

/// Checks times: positive, growing, within the camera's range. Throws InputError.
void check_exposures(const std::vector<Seconds>& exposures, const CameraDescription& camera);

/// Checks that a camera with listed exposure times has those that were given by hand, within 1 %. Throws
/// InputError naming the nearest ones.
void require_listed_exposures(const std::vector<Seconds>& exposures, const CameraDescription& camera);

/// The value below which the share `q` of the values lies: one that was measured, not one between two.
double quantile_of(std::vector<float> values, double q);

/// Takes one frame of the brightest light with the given exposure.
using Probe = std::function<RawFrame(Seconds exposure)>;

/// The longest exposure at which the brightest light clips no more than one sample in a thousand, found from
/// a few probing frames: the right choice for the shortest of the plan. Stays within the camera's range;
/// where even the camera's shortest exposure clips, that is the answer. Throws InputError when no light
/// reaches the camera at all.
Seconds shortest_useful_exposure(const CameraDescription& camera, const CameraCalibration& calibration,
                                 const Probe& probe);

/// What a scene holds, in the unit of the calibration.
struct SceneRange {
  double dark = 0.0;    ///< what noise must still be small for
  double bright = 0.0;  ///< must not clip
};

/// Meters the scene under its brightest light, white: bright is the radiance that one sample in a thousand
/// exceeds; dark is what one in twenty falls short of, under a light of a fifth of white's brightness, as
/// natural patterns have on average. Throws InputError when no light reaches the camera.
SceneRange meter_range(const CameraDescription& camera, const CameraCalibration& calibration,
                       const Probe& probe);

/// Standard deviation of a merged sample, relative to its radiance: shot, read and rounding noise of all
/// exposures that do not clip. Infinite where all do.
double predicted_noise(double radiance, const std::vector<Seconds>& exposures,
                       const CameraCalibration& calibration, double gain, int frames_per_exposure);

struct NoisePlan {
  std::vector<Seconds> exposures;
  SceneRange range;
  double worst_noise = 0.0;  ///< predicted, relative, over the range
  bool reached = false;      ///< worst_noise is as low as was asked for
  /// "2 exposures cover …", for people.
  std::string sentence() const;
};

/// The fewest exposures with which predicted_noise() stays below options.relative_noise over the range: the
/// shortest is as long as the bright end allows, each further one as long as it may be for the ones before to
/// carry the radiance that it clips, and the last no longer than the dark end needs. Since each reaches as
/// far down as possible, no other series of as many reaches further. Where the camera's range or its full
/// well end first, the plan says that it does not reach the bound. Times are whole multiples of
/// options.multiple_of.
NoisePlan min_exposures(const SceneRange& range, const ExposurePlanOptions& options,
                        const CameraDescription& camera, const CameraCalibration& calibration, double gain,
                        int frames_per_exposure);

/// The exposure nearest to `time` that the camera can be set to, within its range.
Seconds settable_exposure(Seconds time, const CameraDescription& camera);
/// All of a plan, in growing order, each once.
std::vector<Seconds> settable_exposures(const std::vector<Seconds>& exposures,
                                        const CameraDescription& camera);

/// Sentences about exposures that did not earn their time; empty when all did. `useful` as in
/// MergeStatistics.
std::vector<std::string> wasted_exposures(const std::vector<Seconds>& exposures,
                                          const std::vector<double>& useful);

}  // namespace refield
