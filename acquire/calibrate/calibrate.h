// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/bench.h"

namespace refield {

/// One sample of the sensor at one exposure, averaged over frames.
struct ResponseDatum {
  int source = 0;  ///< data of one source see the same light
  double exposure_s = 0.0;
  double dn = 0.0;
  double variance = 0.0;  ///< of `dn`
};

/// From raw samples to numbers proportional to light.
struct ResponseFit {
  std::vector<double> dn;     ///< knots, from black to saturation
  std::vector<double> light;  ///< 0 at black, 1 at saturation, never falling
  double residual = 0.0;      ///< RMS of the data about the curve, share of the range
};

/// Fits the inverse response g with g(DN) = light of the source × exposure: unknown are g at knots and the
/// light of all sources; the equations are linear in both and solved at once, weighted by the inverse of the
/// predicted variance, with a pull towards parabolas over neighbouring knots. As in Debevec and Malik 1997,
/// eq. 3, but without the logarithm (black is known, and small samples are noisy) and made monotone
/// afterwards (never_falling()). Throws InputError when data are too few or cover too little of the range.
ResponseFit fit_response(const std::vector<ResponseDatum>& data, double black_dn, double saturation_dn);

/// What the camera gives without light.
struct BlackLevel {
  double dn = 0.0;
  double clipped = 0.0;  ///< share of samples at 0 DN in the darkest frames
};

/// The brightness under black at short exposures, extrapolated to an exposure of zero: neither ambient light
/// nor dark current count, and no lens cap is needed.
BlackLevel measure_black_level(CalibrationBench& bench, const RunContext& run);

/// What the camera makes of light, measured.
struct CameraResponse {
  int bits = 12;
  std::vector<float> linear_from_dn;  ///< [2^bits]; keeps black and saturation where they are
  bool is_linear = false;             ///< within the tolerance; the table is then exactly so
  double black_level_dn = 0.0;
  double saturation_dn = 0.0;
  bool saturation_seen = false;  ///< else it is full scale, for want of light
  double darkest_share = 0.0;    ///< of the range: what lies below the data was interpolated
  double residual = 0.0;
  std::vector<std::array<double, 2>> points;  ///< (DN, share of the range), a selection for a plot
  std::vector<Seconds> exposures;             ///< that were used
};

/// Measures saturation (where samples stand still though the exposure doubles) and response. Exposures are
/// whole multiples of `exposure_unit`. Throws DeviceError where brightness does not follow exposure.
CameraResponse measure_response(CalibrationBench& bench, const BlackLevel& black, Seconds exposure_unit,
                                const RunContext& run);

/// The camera's noise.
struct PhotonTransfer {
  double electrons_per_dn = 1.0;      ///< at gain 1, of linear DN
  double read_noise_electrons = 0.0;  ///< quantisation not included
  double full_well_electrons = 0.0;   ///< at saturation, at the gain used
  /// How much the noise of the brightest samples exceeds (or falls short of) what the fit predicts, relative.
  double excess_at_the_top = 0.0;
  std::vector<std::array<double, 2>> points;  ///< (mean above black, variance), linear DN and its square
};

/// Photon transfer curve (Janesick 2007, chapter 5; EMVA 1288, section 6.6): the variance over time of
/// samples that see steady light is read noise² + signal / (electrons per DN), in linear DN at gain 1; its
/// slope over the signal gives the gain, its value without light the read noise. Fixed patterns do not enter,
/// since each sample is compared with itself; flicker of the whole frame is divided out. Exposures as
/// `response` used them. Throws InputError where noise does not grow with light, as in frames that were
/// denoised or compressed.
PhotonTransfer measure_photon_transfer(CalibrationBench& bench, const Metering& metering,
                                       const CameraResponse& response, Seconds exposure_unit,
                                       const RunContext& run = {});

/// How long the camera takes to act on its controls.
struct ControlLatency {
  int frames = 0;  ///< begun after a change of exposure that still have the old one, the more of up and down
  std::vector<double>
      level_dn;                 ///< mean of the lit samples by frame, from the change to a longer exposure on
  double expected_ratio = 0.0;  ///< of the two exposures
  double seen_ratio = 0.0;      ///< of the light in their frames
};

/// Step response: a steady scene, the exposure changed, frames counted until the image follows. Trusts the
/// image rather than the exposure that frames state. Throws DeviceError for a camera that ignores its
/// exposure.
ControlLatency measure_control_latency(CalibrationBench& bench, const Metering& metering,
                                       const RunContext& run);

/// A frame taken while the display changes.
struct ChangeFrame {
  double start_s = 0.0;  ///< of the exposure, from the flip's time stamp on
  double exposure_s = 0.0;
  double share = 0.0;  ///< of the new light in it: 0 before the change, 1 after
};

/// A change of light as capture waits for it.
struct DisplayTransition {
  Seconds latency{0};     ///< from the flip's time stamp to the first changed light
  Seconds settling{0};    ///< from there to the last
  double residual = 0.0;  ///< RMS of shares about the fit
};

struct DisplayTiming {
  DisplayTransition rise;  ///< black to grey
  DisplayTransition fall;
  Seconds latency{0};                        ///< the earlier of both
  Seconds settling{0};                       ///< until the later of both has settled
  std::vector<ChangeFrame> rising, falling;  ///< what it rests on
};

/// Fits a change that starts after a latency and goes on evenly while it settles. What a frame holds of it is
/// the integral over its exposure, so that frames much longer than the change, and a camera that runs in step
/// with the display, tell it as well. Settling is then prolonged until no frame beyond it is off by more than
/// `tolerance` (a slow tail). Times are sought in [0, longest].
DisplayTransition fit_light_change(const std::vector<ChangeFrame>& frames, Seconds longest, double tolerance);

/// Shows black and grey in turn and takes frames with exposures of all lengths across the change; pairs them
/// by time stamps alone. Throws DeviceError when the light still changes after the bench's patience, or has
/// not changed at all.
DisplayTiming measure_display_timing(CalibrationBench& bench, const CameraResponse& response,
                                     Seconds exposure_unit, const RunContext& run);

/// Brightness of one frame beside what its exposure alone would give.
struct ExposedLight {
  double start_s = 0.0;  ///< of the exposure, from any instant on
  double exposure_s = 0.0;
  double light_per_second = 0.0;  ///< in any unit, above 0
};

/// A periodic part of the light: 1 + depth · cos(2π · hz · t + phase).
struct Ripple {
  double hz = 0.0;
  double depth = 0.0;
  /// The most that an exposure's brightness can be off by, relative: depth · |sin(π hz t)| / (π hz t).
  double error_at(Seconds exposure) const;
};

/// How the display's light pulses.
struct Banding {
  Seconds refresh_period{0};         ///< from the flips' time stamps; 0: not known
  std::vector<Ripple> ripples;       ///< strongest first; none where the light is steady
  std::vector<ExposedLight> frames;  ///< what it rests on
  Seconds exposure_unit{0};          ///< whole multiples of it show no ripple; 0: any exposure will do
  std::vector<std::array<double, 2>> deviation;  ///< (exposure in s, relative brightness − 1) of the frames
  double noise = 0.0;                            ///< what of the deviation no ripple explains, RMS
};

/// Takes frames of steady light at irregular exposures and finds the frequencies at which its brightness goes
/// with the start and the length of the exposure (a periodogram by least squares, after Lomb 1976 and Scargle
/// 1982, whose basis functions are integrals over the exposure). Irregular exposures tell frequencies apart
/// that frames at a fixed rate confuse.
Banding measure_banding(CalibrationBench& bench, const Metering& metering, double black_dn,
                        const RunContext& run);

/// The same once the camera's response is known: depths are then of light, not of DN.
Banding linearised(Banding banding, double black_dn, const std::vector<float>& linear_from_dn);

/// The ripples in `light`, strongest first, at most `most`; frequencies from 20 Hz to 2 kHz. `unexplained`,
/// when given, receives the RMS of what is left, relative.
std::vector<Ripple> find_ripples(const std::vector<ExposedLight>& light, int most,
                                 double* unexplained = nullptr);

/// The shortest exposure, a whole number of periods of one ripple, at which and at whose multiples all
/// ripples stay below `tolerance`; 0 where there is no ripple.
Seconds exposure_unit_for(const std::vector<Ripple>& ripples, double tolerance);

/// The longest period of which all differences are whole multiples, from differences that are at most a few
/// periods long; 0 where there is none.
Seconds common_period(const std::vector<Seconds>& differences);

/// How the display turns drive levels into light.
struct ToneCurve {
  /// [3][256] light above black, 1 at level 255 of each channel.
  std::array<std::vector<float>, 3> light_from_level;
  std::array<std::vector<std::array<double, 2>>, 3>
      measured;                   ///< (level, light) of the levels that were shown
  std::array<double, 3> falls{};  ///< largest fall of light from a level to a higher one, share of white
};

/// Shows each channel alone at levels `step` apart and photographs it with several exposures. Light is what
/// the photograph has in common with that of the full level (projection, weighted by signal): cross-talk of
/// the camera's colour filters does no harm. In between the curve is monotone cubic. `exposures`: growing;
/// `camera` linearises. Throws DeviceError for a channel whose light does not grow.
ToneCurve measure_tone_curve(CalibrationBench& bench, const CameraCalibration& camera,
                             const std::vector<Seconds>& exposures, int step, const RunContext& run);

/// The pattern shown, photographed with all exposures, each `repeats` times; no flat field is applied.
Photograph photograph(CalibrationBench& bench, const CameraCalibration& camera,
                      const std::vector<Seconds>& exposures, int repeats, const RunContext& run = {});

/// Two patterns that share no texel, and their sum.
struct SuperpositionPair {
  std::string name;
  double error = 0.0;  ///< (I(A) + I(B) − I(black) − I(A+B)) / (I(A+B) − I(black)) over all lit samples
  double uncertainty = 0.0;  ///< standard deviation of it
  double worst_block =
      0.0;  ///< of 6 × 4 blocks of the frame, the largest error by size that noise cannot explain
};

struct Superposition {
  std::vector<SuperpositionPair> pairs;
  static constexpr double tolerance = 0.01;
  bool holds() const;
  double largest_error() const;  ///< by size
};

/// The test on which everything rests: light adds up, I(A) + I(B) − I(black) = I(A+B) (the linearity of B = T
/// L). Dynamic dimming, power limits and local dimming break it, since A and B are dimmed less than A+B.
/// Pairs: left and right half, upper and lower, the squares of a chequerboard, a small square and its
/// surround.
Superposition measure_superposition(CalibrationBench& bench, const CameraCalibration& camera,
                                    const std::vector<Seconds>& exposures, const RunContext& run = {});

/// A map of brightness over the frame or the screen.
struct UniformityMap {
  RelativeMap map;
  double least = 1.0;    ///< the map's lowest value; its highest is 1
  double texture = 0.0;  ///< RMS of what is no smooth map, relative, noise not counted
};

/// Vignetting: the camera looks at something plain that the display lights evenly, such as white card, best
/// out of focus. What varies smoothly over the photograph is the lens (and how evenly the card is lit: keep
/// it small and far from the display). Throws InputError for a target that is not plain.
UniformityMap measure_flat_field(CalibrationBench& bench, const CameraCalibration& camera,
                                 const std::vector<Seconds>& exposures, const RunContext& run = {});

/// Uniformity of the screen: the camera looks at the display itself. A white square is shown at each place of
/// a grid; its mean brightness in the photograph, divided by the camera's flat field, is the screen's there.
/// Throws InputError when places cannot be seen.
UniformityMap measure_screen_uniformity(CalibrationBench& bench, const CameraCalibration& camera,
                                        const std::vector<Seconds>& exposures, const RunContext& run = {});

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
