// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/camera.h"
#include "core/image/image.h"

namespace refield {

/// Levels of a sensor's samples, as its RAW file states them.
struct RawLevels {
  double black = 0.0;       ///< without light, mean over the colours
  double saturation = 0.0;  ///< lowest sample that may be clipped
};

/// Settings of a camera that photographs of one scene must have in common, as far as files state them.
struct CameraSettings {
  std::optional<double> iso;
  std::optional<double> f_number;
  std::optional<double> focal_length_mm;
  // Of developed files alone: RAW samples do not depend on them.
  std::optional<int> white_balance;         ///< 0 automatic, 1 manual (EXIF)
  std::optional<int> light_source;          ///< preset of the white balance, such as 1 daylight (EXIF)
  int orientation = 1;                      ///< as ImageFacts::orientation
  std::optional<double> digital_zoom = {};  ///< EXIF DigitalZoomRatio
  std::optional<int> bits = {};  ///< of integer files that state no encoding: it is assumed by their depth
};

/// One exposure of a bracketed series, from an ordinary image file.
struct BracketFile {
  int bits = 0;    ///< 8 or 16 for integer formats; 0 for float ones
  RawFrame frame;  ///< integer formats: the samples as stored; its exposure is not filled in
  Image linear;    ///< float formats: [height × width × 3]
  Image sigma;     ///< of `linear`, where the file carries it (core/image/image_io.h, Photograph)
  std::optional<Seconds> exposure;  ///< as the file's metadata state it (EXIF ExposureTime, EXR expTime)
  CameraSettings settings;
  std::string response;  ///< of integer formats: as ImageFacts::response
  bool is_raw =
      false;  ///< a camera's own format: samples of the sensor, not interpolated, black not subtracted
  std::optional<RawLevels> raw_levels;  ///< RAW: where the file states them
};

/// Reads PNG, TIFF, JPEG (8 or 16 bits), EXR, HDR, PFM or a camera's RAW by LibRaw
/// (DNG, CR2, NEF and so on): Bayer, monochrome, or three linear samples per pixel. A one-channel integer
/// file is taken to have the layout `one_channel`; nullopt: grey, or for RAW what the file says. Pictures are
/// turned as their stated orientation says; samples of a sensor (RAW, Bayer) stay in its order. Alpha is
/// ignored. Throws DeviceError for a missing file and FormatError for one that is damaged or no image.
BracketFile read_bracket_file(const fs::path& path, std::optional<PixelLayout> one_channel = std::nullopt);

/// Throws InputError naming both files and the first setting that differs, where both state it.
void require_same_settings(const CameraSettings& settings, const fs::path& path,
                           const CameraSettings& expected, const fs::path& expected_path);

/// The exposure time that a file's metadata state; its samples are not read. Throws as read_bracket_file().
std::optional<Seconds> stated_exposure(const fs::path& path);

/// Writes a frame's samples, unchanged, as a 16-bit PNG of one or three channels, atomically. What
/// read_bracket_file() reads back is equal.
void write_raw_frame(const fs::path& path, const RawFrame& frame);

}  // namespace refield
