// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "core/image/colour.h"
#include "core/image/image.h"

namespace refield {

/// What an image file's header says about its samples beyond their number. Read without a decoder.
struct ImageFacts {
  /// Where the first stored row and column belong in the upright picture: 1 (top, left) to 8. TIFF 6.0, tag
  /// 274, in TIFF, JPEG and PNG files.
  int orientation = 1;
  /// How integer samples encode light: "linear", "srgb" or "gamma:X" (sample = light^(1/X)) as the chunks
  /// cICP, sRGB and gAMA of a PNG file or an ICC profile state it, "unknown" for another curve; empty: not
  /// stated.
  std::string response;
  std::optional<double> exposure_seconds, iso, f_number, focal_length_mm;  ///< EXIF
  std::optional<int> white_balance;                                        ///< EXIF: 0 automatic, 1 manual
  std::optional<int> light_source;  ///< EXIF: 0 unknown, 1 daylight, …
  bool is_unusual = false;  ///< TIFF whose zero is white, or of L*a*b*: decoders hand these on undecoded
  bool is_raw = false;  ///< a TIFF file of sensor samples: a colour filter array, or a DNG of another name
  std::optional<Chromaticities> chromaticities;  ///< EXR, and PRIMARIES of Radiance files
  std::optional<bool> is_cube;                   ///< EXR attribute envmap: cube or lat-long
};

/// Values that a damaged header states are left out. Throws DeviceError for a missing file and FormatError
/// where an EXR header is damaged.
ImageFacts read_image_facts(const std::filesystem::path& path);

/// Turns or mirrors an image as stored into the upright one. `orientation`: 1 to 8, else 1.
Image upright(const Image& stored, int orientation);
/// The orientation that reverses the effect of another.
constexpr int inverse_orientation(int orientation) {
  return orientation == 6 ? 8 : orientation == 8 ? 6 : orientation;
}

/// Samples from 0 to 1 to linear light by ImageFacts::response; sRGB where it is empty or "unknown".
void linearise(Image& image, const std::string& response);

}  // namespace refield
