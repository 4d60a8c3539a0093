// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/camera.h"
#include "acquire/illuminator.h"
#include "core/base/units.h"
#include "core/image/image.h"
#include "core/light/light_map.h"

namespace refield {

/// How a virtual monitor turns drive levels into light, and when. read_recipe() checks the ranges.
struct MonitorModel {
  std::array<double, 3> gamma{2.2, 2.2, 2.2};  ///< exponent of each channel's tone curve
  double black_level = 0.002;                  ///< radiance at level 0, as a fraction of white_radiance
  double white_radiance = 1.0;                 ///< radiance at level 255, relative
  Seconds refresh_interval{1.0 / 60.0};        ///< a flip happens at a multiple of it
  Seconds latency{2.0 / 60.0};                 ///< from the flip's time stamp to the first changed light
  Seconds settling{0.012};  ///< from the first changed light to the last; linear in between

  double falloff =
      0.0;  ///< share by which the screen's corners are darker; grows with the square of the distance
  /// Dynamic dimming: a pattern of mean radiance m (as a fraction of white) is darker by the share dimming ·
  /// m, as OLED screens and backlights with a power limit do. Breaks superposition.
  double dimming = 0.0;
  double pwm_hz = 0.0;  ///< of the backlight, which is on bright and dark for half a period each; 0: steady
  double pwm_depth = 0.0;  ///< the halves are brighter and darker than the mean by this share

  /// The exponents that a calibration states, where they are not the true ones.
  std::optional<std::array<double, 3>> stated_gamma;

  /// How much brighter each channel is at the end of a capture than at its start, −0.05: 5 % darker.
  std::array<double, 3> drift{};
  /// Share of the capture in which 1 − 1/e of the change happens, as an area light warms up; 0: evenly.
  double drift_settling = 0.0;

  /// Brightness of a channel, relative to the start, when the share `done` (0 to 1) of the capture is over.
  double gain(int channel, double done) const;

  /// Mean brightness of the pulsing backlight over [start, end], 1 in the long run. A bright half begins at
  /// 0.
  double backlight(TimePoint start, TimePoint end) const;

  /// The monitor that a calibration describes.
  MonitorModel as_stated() const;

  /// Radiance [256] that each 8-bit drive level of a channel emits:
  /// white_radiance · (black_level + (1 − black_level) · (level / 255)^gamma).
  std::array<std::vector<double>, 3> tone_curve() const;

  /// The radiance that the monitor emits when it is driven with `image`, falloff and dimming included.
  LightMap emitted(const DriveImage& image) const;
};

/// What changes around a virtual rig during a capture. Each row holds from its share of the capture (0 to 1)
/// on, until the next one; rows ascend.
struct Disturbances {
  struct Move {
    double from = 0.0;
    double right_px = 0.0, down_px = 0.0;  ///< of the picture, against that of the start
  };
  struct RoomLight {
    double from = 0.0;
    double factor = 1.0;  ///< of the ambient image
  };
  std::vector<Move> moves{};  ///< of the camera, which turns about its centre of projection
  std::vector<RoomLight> room_light{};
  double room_variation = 0.0;  ///< share by which the room light swings up and down, too

  /// Where the camera stands when the share `done` of the capture is over: the last row, or `from` = 0.
  Move position(double done) const;
  double room(double done) const;  ///< light, relative to the ambient image
};

/// How a virtual sensor turns scene radiance into digital numbers (DN). The linear camera model of EMVA 1288:
///   electrons = min(full well, Poisson(sensitivity · radiance · exposure) + read noise)
///   DN        = black level + gain · electrons / electrons per DN
/// then clipped to the full scale, bent by the response curve and rounded. read_recipe() checks the ranges.
struct SensorModel {
  PixelLayout layout = PixelLayout::rgb;
  int bits = 12;                         ///< 8, 10 or 12; full scale is 2^bits − 1
  double sensitivity = 200000.0;         ///< electrons per sample for unit radiance and one second
  double electrons_per_dn = 4.0;         ///< at gain 1
  double full_well_electrons = 15000.0;  ///< a well holds no more
  double read_noise_electrons = 3.0;     ///< standard deviation
  double black_level_dn = 64.0;  ///< added before quantisation, so that noise around zero is not cut off
  double vignetting =
      0.0;  ///< share of the light that the corners lose; grows with the square of the distance
  double response_gamma = 1.0;  ///< DN/full scale becomes its power 1/response_gamma; 1: linear
  double largest_gain = 16.0;   ///< gains from 1 to this
  Seconds shortest_exposure{1.0 / 4000};
  Seconds longest_exposure{4.0};
  Seconds frame_interval{1.0 / 30};  ///< shortest time from one exposure's start to the next
  int control_latency_frames = 0;    ///< frames that still begin with the old settings after a change of them
  int latency_frames = 1;            ///< frames that wait in the driver's queue: the next frame is this old

  /// Share of each primary of the monitor (column) that a channel (row) sees; its diagonal is 1.
  std::array<std::array<double, 3>, 3> mixing{{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
  /// Exposures are powers of 2^(1/3) s, as of cameras that state 1/30 s for 1/32 s.
  bool rounds_exposures = false;
  double gain_jitter =
      0.0;  ///< standard deviation of a photograph's brightness, relative (flicker, aperture)
  double balance_jitter = 0.0;  ///< of each of its channels (automatic white balance)

  /// How long the shutter is open for a stated exposure.
  Seconds true_exposure(Seconds stated) const;
  /// Factor of each channel in the photograph that `key` names.
  std::array<double, 3> jitter(std::uint64_t key) const;
  /// What the channels see of `radiance` [height × width × 3] by primaries.
  Image mixed(Image radiance) const;
  Eigen::Matrix3f mixing_matrix() const;

  int full_scale() const { return (1 << bits) - 1; }

  /// One frame of `radiance` [height × width × 3] behind the vignetting lens; a Bayer sample sees its own
  /// channel, a grey one the mean of three. The noise is a function of `noise_key` alone; runs on all cores.
  std::vector<std::uint16_t> expose(const Image& radiance, Seconds exposure, double gain,
                                    std::uint64_t noise_key) const;
};

}  // namespace refield
