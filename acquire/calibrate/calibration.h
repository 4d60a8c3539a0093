// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/illuminator.h"
#include "core/image/image_io.h"

namespace refield {

/// A smooth factor over an image of any size, such as the vignetting of a lens: values at the nodes of a
/// regular grid that reaches from edge to edge, bilinear in between. Empty: 1 everywhere.
struct RelativeMap {
  int columns = 0;  ///< of nodes, at least 2 unless empty
  int rows = 0;
  std::vector<float> values;  ///< [rows × columns], top row first, above 0

  bool empty() const { return values.empty(); }
  /// `u` and `v` from 0 at the left and upper edge to 1 at the others.
  float at(double u, double v) const;
  /// At the centre of a pixel of an image.
  float at_pixel(int x, int y, const Image& image) const {
    return at((x + 0.5) / image.width, (y + 0.5) / image.height);
  }
  /// Throws InputError naming `where` when the sizes do not fit or a value is not finite and above 0.
  void check(const std::string& where) const;
};

/// The smooth map nearest to an image in the sense of weighted least squares, scaled so that its largest
/// value is 1. `weight` [height × width × 1] is 0 where the image says nothing; nodes without data follow
/// from their neighbours by a weak pull towards straightness. `image` has one channel. Throws InputError when
/// there is nothing to fit.
RelativeMap fit_relative_map(const Image& image, const Image& weight, int columns, int rows);

/// All channels of each pixel times or through the map's value there. Nothing happens for an empty map.
void multiply(Image& image, const RelativeMap& map);
void divide(Photograph& photograph, const RelativeMap& map);

/// What a camera is known to do with light. A raw sample of value DN, taken at exposure time t and gain g,
/// stands for
///   electrons = (linear_from_dn[DN] − black_level_dn) · electrons_per_dn / g
/// and on average electrons = radiance · t · electrons_per_radiance_second, with variance
///   electrons + read_noise_electrons² + (quantisation step in electrons)² / 12.
struct CameraCalibration {
  int bits = 12;                      ///< of a sample, 1 to 16
  std::vector<float> linear_from_dn;  ///< [2^bits], inverse response: raw sample to linear DN
  double black_level_dn = 0.0;        ///< what the sensor gives without light, in linear DN
  double saturation_dn = 4095.0;      ///< lowest raw sample (not linearised) that may be clipped
  double electrons_per_dn = 1.0;      ///< photo-electrons a linear DN at gain 1
  double read_noise_electrons = 0.0;  ///< standard deviation at gain 1, referred to the input
  /// Sensitivity; it sets the unit of radiance. 1 where it is not known: radiance is then in electrons a
  /// second.
  double electrons_per_radiance_second = 1.0;
  /// Share of the light that arrives at each place of the frame (vignetting of the lens), 1 where most does;
  /// empty: everywhere the same. Photographs are divided by it once their exposures are merged.
  RelativeMap flat_field;

  bool is_linear() const;
  /// Throws InputError naming `where` and the entry that is not finite, not monotone or out of range.
  void check(const std::string& where) const;
};

/// The table of a camera that is linear already.
std::vector<float> linear_response(int bits);
/// A camera that bends its samples: DN / full scale = (linear DN / full scale)^(1/gamma).
std::vector<float> gamma_response(int bits, double gamma);
/// A camera whose samples are sRGB-encoded (IEC 61966-2-1), as in ordinary PNG and JPEG files.
std::vector<float> srgb_response(int bits);

/// Radiance that each 8-bit drive level of a monitor emits: [256] for each of red, green and blue, not
/// decreasing. Level 0 is the monitor's black, which is rarely dark.
struct MonitorCalibration {
  std::array<std::vector<float>, 3> radiance_from_level;
  /// Brightness of each place of the screen relative to the brightest; empty: everywhere the same.
  RelativeMap uniformity;

  /// Throws InputError naming `where` and the entry that is not finite, negative or decreasing.
  void check(const std::string& where) const;
};

/// When light and settings change, as measured.
struct TimingCalibration {
  Seconds display_latency{0};      ///< from a flip's time stamp to the first changed light
  Seconds display_settling{0};     ///< from the first changed light to the last
  int control_latency_frames = 0;  ///< frames begun after a change of settings that still have the old ones
  Seconds refresh_period{0};       ///< of the display; 0: not known
  /// Exposures that are whole multiples of this show no banding; 0: any exposure will do.
  Seconds exposure_unit{0};

  /// Throws InputError naming `where` and the entry that is not finite or negative.
  void check(const std::string& where) const;
};

/// Drive levels whose light comes nearest to `wanted`: linear radiance above the monitor's black,
/// [height × width × 3]. Among levels that emit the same light the lowest is taken.
/// `out_of_range`, when given, receives the number of texel values brighter than the monitor can show.
DriveImage drive_levels(const Image& wanted, const MonitorCalibration& monitor,
                        std::size_t* out_of_range = nullptr);

/// Radiance *above the monitor's black* that drive levels emit, [height × width × 3]. This is what a
/// photograph sees once an ambient photograph, taken while the monitor shows black, has been subtracted. The
/// screen's uniformity is in it.
Image emitted_above_black(const DriveImage& drive, const MonitorCalibration& monitor);

/// A whole image at one drive level.
DriveImage uniform_drive(int width, int height, std::uint8_t level);

/// All calibrations that are known as a TOML file, see docs/reference/capture-session-format.md. The text
/// holds every digit.
void write_calibration(const fs::path& path, const CameraCalibration& camera,
                       const std::optional<MonitorCalibration>& monitor,
                       const std::optional<TimingCalibration>& timing = std::nullopt);
/// Throw FormatError where a table or key is missing or malformed and InputError where a value is impossible.
CameraCalibration read_camera_calibration(const fs::path& path);
MonitorCalibration read_monitor_calibration(const fs::path& path);
/// nullopt where the file has no section [timing].
std::optional<TimingCalibration> read_timing_calibration(const fs::path& path);

/// The nearest values that never fall, by weighted least squares: pools what violates the order (Ayer et al.
/// 1955). `weights` as long as `values`, above 0, or empty for equal ones.
std::vector<double> never_falling(std::vector<double> values, std::vector<double> weights = {});

/// A curve through points that rises where they rise and is flat where they are flat, smooth otherwise:
/// piecewise cubic with the slopes of Fritsch and Butland 1984. Beyond the ends it goes on straight.
class MonotoneCurve {
 public:
  /// `x` strictly growing, at least two. Throws InputError otherwise.
  MonotoneCurve(std::vector<double> x, std::vector<double> y);
  double operator()(double x) const;
  double slope(double x) const;

 private:
  std::size_t interval(double x) const;
  std::vector<double> x_;
  std::vector<double> y_;
  std::vector<double> slope_;
};

}  // namespace refield
