// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/capture/exposure_plan.h"
#include "acquire/capture/frame_pairing.h"
#include "acquire/illuminator.h"

namespace refield {

/// Camera and display as all measurements share them. Until their timing is known, it waits for as long as
/// any sane device could need: `patience` after a flip, a dozen frames after a change of settings.
class CalibrationBench {
 public:
  /// `trigger` may be null. `gain` is the camera's for all measurements.
  CalibrationBench(Camera& camera, Illuminator& illuminator, Trigger* trigger, double gain, Seconds patience);

  const CameraDescription& camera() const { return camera_description_; }
  const IlluminatorDescription& display() const { return display_description_; }
  double gain() const { return gain_; }
  Seconds patience() const { return patience_; }
  /// From now on waits only as long as was measured.
  void use(const TimingCalibration& timing);

  // Steady light: frames are taken once light and settings have settled, see FramePairing.
  void show(const DriveImage& image);
  void show(std::uint8_t grey_level);
  RawFrame frame(Seconds exposure, const RunContext& run = {});

  // Changing light, for measuring how it changes: nothing is waited for. show() must follow before frame().
  TimePoint show_at_once(std::uint8_t grey_level);
  TimePoint set_exposure(Seconds exposure);
  RawFrame next_frame(Seconds exposure, const RunContext& run = {});

 private:
  Camera& camera_;
  Illuminator& illuminator_;
  Trigger* trigger_;
  double gain_;
  Seconds patience_;
  CameraDescription camera_description_;
  IlluminatorDescription display_description_;
  TimingCalibration timing_;
  std::optional<FramePairing> pairing_;
};

/// What the samples of a steady frame do over time.
struct SampleMoments {
  Seconds exposure{0};          ///< as the camera states it
  std::vector<float> mean;      ///< [samples], DN
  std::vector<float> variance;  ///< [samples], DN²; of one frame, unbiased; zero from a single frame
};

/// Takes `count` frames of the pattern shown. With `linear`, a table from DN, moments are of linearised
/// samples. With `steadied` samples, each frame is first scaled so that their mean (above `black`) is that of
/// all frames: what flickers as a whole is no noise.
SampleMoments sample_moments(CalibrationBench& bench, Seconds exposure, int count,
                             const std::vector<float>* linear = nullptr,
                             std::span<const std::uint32_t> steadied = {}, double black = 0.0,
                             const RunContext& run = {});

/// The mean of some of `values`; 0 of none.
template <class Value>
double mean_over(const std::vector<Value>& values, std::span<const std::uint32_t> samples) {
  double sum = 0.0;
  for (const auto s : samples) sum += values[s];
  return samples.empty() ? 0.0 : sum / static_cast<double>(samples.size());
}

/// Growing exposures from `low` to `high`, evenly spaced in ratio, within the camera's range and whole
/// multiples of `unit` where that is not zero; fewer than `count` where multiples coincide, at least one.
std::vector<Seconds> exposure_series(const CameraDescription& camera, Seconds low, Seconds high, int count,
                                     Seconds unit);

/// Light and exposure at which the camera is well lit without clipping, before anything is known of it.
struct Metering {
  std::uint8_t level = 255;  ///< grey level shown
  Seconds exposure{0};       ///< at which the brightest hundredth of the samples reaches 0.6 of full scale
  std::vector<std::uint32_t>
      lit;               ///< samples that respond to the display at least a fifth as much as the brightest
  double lit_dn = 0.0;   ///< their mean under `level`
  double dark_dn = 0.0;  ///< and under black
};

/// Meters under a grey level chosen so that the exposure is about `wanted`, or longer where white is too dark
/// for that, or shorter where the light of the room would become three quarters of what is measured. Throws
/// InputError where the scene is too dark or too bright for the camera, or nothing in it responds to the
/// display; the message says what to change.
Metering meter(CalibrationBench& bench, Seconds wanted, const RunContext& run = {});

}  // namespace refield
