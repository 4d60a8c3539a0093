// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>
#include <utility>

#include "core/image/colour.h"
#include "core/image/image.h"

namespace refield {

/// What an image file's header says about its samples beyond their number. Read without a decoder.
struct ImageFacts {
  /// Where the first stored row and column belong in the upright picture: 1 (top, left) to 8. TIFF 6.0, tag
  /// 274, in TIFF, JPEG and PNG files.
  int orientation = 1;
  /// How samples encode light: "linear", "srgb" or "gamma:X" (sample = light^(1/X)) as the chunks cICP, sRGB
  /// and gAMA of a PNG file, an ICC profile or the DCF option file of EXIF (Adobe RGB) state it, "unknown"
  /// for another curve; empty: not stated.
  std::string response;
  std::optional<double> exposure_seconds, iso, f_number, focal_length_mm, digital_zoom;  ///< EXIF
  std::optional<int> white_balance;  ///< EXIF: 0 automatic, 1 manual
  std::optional<int> light_source;   ///< EXIF: 0 unknown, 1 daylight, …
  std::string refusal;  ///< of what decoders misread, or hand on as if it were one RGB image: what to tell;
                        ///< else empty
  bool is_raw = false;  ///< a TIFF file of sensor samples: a colour filter array, or a DNG of another name
  std::optional<Chromaticities> chromaticities;  ///< of EXR, PRIMARIES of Radiance, ICC, cHRM, cICP, EXIF
  std::optional<bool> is_cube;                   ///< EXR attribute envmap: cube or lat-long
};

/// What to tell about ImageFacts::response "unknown", where samples must be decoded.
inline constexpr const char* unknown_encoding =
    "states an encoding (ICC profile, cICP, TransferFunction or GrayResponseCurve) that is neither linear, "
    "sRGB nor a power; convert it to linear OpenEXR";

/// Values that a damaged header states are left out. Throws DeviceError for a missing file and FormatError
/// where an EXR header is damaged.
ImageFacts read_image_facts(const fs::path& path);

/// Turns or mirrors samples [height × width × channels] as stored into the upright picture, and swaps `width`
/// and `height` from orientation 5 on. `orientation`: 1 to 8, else 1. Source: TIFF 6.0, tag 274.
template <class T>
std::vector<T> upright(const std::vector<T>& stored, int& width, int& height, int orientation) {
  if (orientation < 2 || orientation > 8) return stored;
  const int from_width = width, from_height = height;
  const bool is_transposed = orientation >= 5;
  // Where the first row and the first column lie: at the far end of the axis that they run across?
  const bool row_is_last = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  const bool column_is_last = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  if (is_transposed) std::swap(width, height);
  const std::size_t channels = stored.size() / (static_cast<std::size_t>(width) * height);
  std::vector<T> picture(stored.size());
  auto from = stored.begin();
  for (int y = 0; y < from_height; ++y)
    for (int x = 0; x < from_width; ++x, from += static_cast<std::ptrdiff_t>(channels)) {
      const int row = row_is_last ? from_height - 1 - y : y, column = column_is_last ? from_width - 1 - x : x;
      const int to_x = is_transposed ? row : column, to_y = is_transposed ? column : row;
      std::copy_n(from, channels,
                  picture.begin() + static_cast<std::ptrdiff_t>(
                                        (static_cast<std::size_t>(to_y) * width + to_x) * channels));
    }
  return picture;
}
Image upright(const Image& stored, int orientation);

/// Samples to linear light by ImageFacts::response; sRGB where it is empty or "unknown".
void linearise(Image& image, const std::string& response);

}  // namespace refield
