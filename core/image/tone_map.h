// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>

#include "core/image/image.h"
#include "core/image/metrics.h"

namespace refield {

/// How radiance that a screen cannot show is brought into its range, channel by channel. None ever falls.
///  - clip: up to 1 as it is, above it white.
///  - reinhard: x (1 + x / w²) / (1 + x) with w = 4, which becomes white. Source: Reinhard et al.,
///    "Photographic Tone Reproduction for Digital Images", 2002, eq. 4; deviation: on each channel instead of
///    luminance, so that bright area lights whiten as on film.
///  - filmic: (x (2.51 x + 0.03)) / (x (2.43 x + 0.59) + 0.14), which deepens shadows and rolls off
///    highlights. Source: Narkowicz, "ACES Filmic Tone Mapping Curve", 2016; deviation: none (his input
///    scale of 0.6 is the exposure's business).
enum class ToneOperator { clip, reinhard, filmic };

inline constexpr std::array<ToneOperator, 3> tone_operators = {ToneOperator::clip, ToneOperator::reinhard,
                                                               ToneOperator::filmic};
/// The one after it, and after the last the first.
ToneOperator next(ToneOperator curve);
std::string_view name_of(ToneOperator curve);

/// Scene-linear radiance to a screen: × exposure, through the curve, sRGB-encoded, rounded to 8 bits.
struct ToneMapping {
  double exposure = 1.0;
  ToneOperator curve = ToneOperator::clip;
  bool operator==(const ToneMapping&) const = default;
};

/// sRGB transfer functions (IEC 61966-2-1) on [0, 1].
float linear_from_srgb(float encoded);
float srgb_from_linear(float linear);

/// The level, 0 to 255, that a non-negative value is shown as. Negative values and NaN become 0.
std::uint8_t tone_mapped(float radiance, const ToneMapping& mapping);

struct LevelCells;

/// A rounded, never falling function from floats to levels, looked up instead of computed: exact, and a
/// hundred times as fast as a power. The function is evaluated some eight thousand times to make the table.
class LevelTable {
 public:
  /// `level` of a value ≥ 0 must never fall as the value grows.
  explicit LevelTable(const std::function<std::uint8_t(float)>& level);
  explicit LevelTable(const ToneMapping& mapping);

  /// As the function gives; 0 for negative values and NaN.
  std::uint8_t operator()(float value) const;
  /// The table's contents, while it lives; for the vectors of tone_map_rgba().
  LevelCells cells() const;

 private:
  // A cell is the values that share exponent and upper 7 bits of the mantissa.
  std::vector<std::uint8_t> level_at_start_of_cell_;
  std::array<float, 257> least_value_of_;  // NaN where no value reaches the level
  int steps_ = 0;                          // at most that many levels begin within one cell
};

/// A whole image, same shape. On all cores.
std::vector<std::uint8_t> tone_mapped(const Image& image, const ToneMapping& mapping);

/// A three-channel image into pixels of red, green, blue and 255. `rgba` [pixels × 4]. On all cores.
void tone_map_rgba(const Image& image, const LevelTable& table, std::span<std::uint8_t> rgba);

/// The exposure at which the 99th percentile of the brightest channel becomes white, over the pixels inside
/// the mask that show any light: a black background does not count. 1 for a black image. Every picture that
/// the program exposes by itself follows this rule: relight, simulate, the viewer, the report and the web
/// page.
double exposure_to_white(const Image& image, const Mask& mask = {});

/// Collects pixels of one or several pictures that share an exposure.
class ExposureMeter {
 public:
  void add(const Image& image, const Mask& mask = {});

  /// As exposure_to_white(), over all pixels that were added.
  double exposure_to_white();
  /// A little less (by 3 % at most), in three digits, so that fewer than one pixel in a hundred reaches the
  /// highest of 256 levels and that the printed number repeats the picture bit for bit.
  double exposure();

 private:
  std::vector<float> brightest_;  // [pixels that show light], of the channels
};

/// The share of an image's pixels that show light which reach the highest of 256 levels in any channel.
double clipped_share(const Image& image, double exposure);

/// sRGB-encoded red, green, blue in [0, 1].
using EncodedColour = std::array<float, 3>;

/// Black, violet, red, orange, pale yellow, evenly spaced; lightness rises steadily, so that the picture also
/// reads in grey print.
inline constexpr std::array<EncodedColour, 7> false_colour_stops = {{{0.00f, 0.00f, 0.02f},
                                                                     {0.18f, 0.06f, 0.37f},
                                                                     {0.47f, 0.11f, 0.43f},
                                                                     {0.76f, 0.20f, 0.33f},
                                                                     {0.93f, 0.41f, 0.15f},
                                                                     {0.98f, 0.71f, 0.10f},
                                                                     {0.99f, 1.00f, 0.75f}}};

/// The colour of 0 … 1, linear between the stops (of encoded values); outside it the nearer end's.
EncodedColour false_colour(double fraction);

/// Levels of values from 0 to `high`, evenly.
LevelTable linear_levels(double high);
/// Levels of values from 2^low to 2^high, evenly in stops; 0 and less are the lowest level.
LevelTable stop_levels(double low, double high);

/// A map of one channel, or the luminance (Rec. 709) of three, coloured by its level into pixels of red,
/// green, blue and 255. NaN is a flat grey. `rgba` [pixels × 4]. On all cores.
void false_colour_rgba(const Image& image, const LevelTable& levels, std::span<std::uint8_t> rgba);

}  // namespace refield
