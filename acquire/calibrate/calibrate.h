// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/display_light.h"
#include "acquire/calibrate/response.h"
#include "acquire/calibrate/timing.h"

namespace refield {

/// What stands before the camera: it decides which maps can be measured.
enum class CalibrationTarget {
  scene,  ///< anything that the display lights: no map
  card,   ///< plain and evenly lit: the camera's flat field
  screen  ///< the display itself: its uniformity
};

struct CalibrateOptions {
  CalibrationTarget target = CalibrationTarget::scene;
  double gain = 1.0;      ///< of the camera, for all measurements
  Seconds patience{0.5};  ///< the display has surely settled so long after a flip
  int tone_step = 5;      ///< between drive levels that are shown; divides 255
  // Known from earlier calibrations; empty: none.
  RelativeMap flat_field;  ///< of the lens
  RelativeMap uniformity;  ///< of the screen

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// All measurements, and what capture needs of them.
struct RigMeasurements {
  CameraDescription camera_description;
  IlluminatorDescription display_description;
  CalibrationTarget target = CalibrationTarget::scene;
  double gain = 1.0;

  ControlLatency control_latency;
  BlackLevel black;
  Banding banding;
  CameraResponse response;
  PhotonTransfer noise;
  DisplayTiming display_timing;
  ToneCurve tone_curve;
  Superposition superposition;
  std::optional<UniformityMap> flat_field;
  std::optional<UniformityMap> screen;

  CameraCalibration camera;
  MonitorCalibration monitor;
  TimingCalibration timing;
  std::vector<std::string> warnings;  ///< sentences, each with what it means and what to do
};

/// Measures camera and display with the camera itself, through the device interfaces alone: control latency,
/// banding, response and black level, noise, display latency, tone curves, superposition and, by target, a
/// map. Of a camera that takes photographs, all that needs time stamps is left out: the display's latency is
/// then `patience`, and flicker is not looked for. Nothing in view may move or change but by the display.
/// `trigger` may be null. Throws InputError or DeviceError when a measurement cannot succeed, saying which
/// and why. A broken superposition does not throw: it is the caller who must refuse, see
/// Superposition::holds().
RigMeasurements calibrate(Camera& camera, Illuminator& illuminator, Trigger* trigger,
                          const CalibrateOptions& options, const RunContext& run = {});

}  // namespace refield
