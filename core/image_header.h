// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace refield {

/// What an image file is, told by its first bytes, whatever its name.
enum class ImageFormat { exr, hdr, png, jpeg, tiff, pfm };

/// What the header of an image promises, as far as it bears on the memory that decoding takes.
struct PromisedImage {
  std::int64_t width = 0;   ///< pixels
  std::int64_t height = 0;  ///< pixels
  std::int64_t channels = 0;
  std::int64_t tile_pixels = 0;  ///< 0: no tiles
  /// The fewest bytes that a file with so many pixels can have, where the format makes that plain.
  std::uint64_t least_bytes = 0;
};

/// The library's name of a format.
const char* name_of(ImageFormat format);

/// nullopt for a file of another kind. Throws DeviceError when it cannot be read.
std::optional<ImageFormat> image_format(const std::filesystem::path& path);

/// Throws FormatError for dimensions that are impossible, or that promise far more pixels than the file can
/// hold: decoders reserve memory for what a header says.
void require_plausible(const PromisedImage& promised, const std::filesystem::path& path);

/// Reads an image's header without any decoder and checks it, so that a hostile file is refused before a
/// decoder sees it. EXR (Technical Introduction to OpenEXR, "OpenEXR File Layout"), Radiance HDR, PNG and
/// JPEG are looked into; others pass. Throws FormatError.
void check_image_header(const std::filesystem::path& path, ImageFormat format);

}  // namespace refield
