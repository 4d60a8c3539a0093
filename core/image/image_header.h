// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/image/colour.h"

namespace refield {

/// Reads a file from front to back in small pieces. Running past the end throws FormatError, as fail() does.
class ByteReader {
 public:
  explicit ByteReader(const std::filesystem::path& path);

  [[noreturn]] void fail(const std::string& what) const;
  const std::filesystem::path& path() const { return path_; }
  /// Bytes between here and the end.
  std::uint64_t left();
  void skip(std::int64_t bytes);
  int byte();
  std::uint64_t big_endian(int bytes);
  std::uint64_t little_endian(int bytes);
  std::int32_t little_endian_int32() { return static_cast<std::int32_t>(little_endian(4)); }
  /// Up to the next zero byte, which is consumed. At most `longest` bytes, else fails.
  std::string zero_terminated(std::size_t longest) { return until('\0', longest); }
  /// How often two bytes follow one another from here to the end.
  int count(std::string_view pair);

 private:
  std::string until(char end, std::size_t longest);
  std::filesystem::path path_;
  std::ifstream file_;
  std::uint64_t size_;
};

/// What an image file is, identified by its first bytes, whatever its name.
enum class ImageFormat { exr, hdr, png, jpeg, tiff, pfm };

/// What the header of an image promises, as far as it bears on the memory that decoding takes.
struct PromisedImage {
  std::int64_t width = 0;   ///< pixels
  std::int64_t height = 0;  ///< pixels
  std::int64_t channels = 0;
  std::int64_t tile_pixels = 0;  ///< 0: no tiles
  /// The fewest bytes that a file with that many pixels can have, where the format makes that plain.
  std::uint64_t least_bytes = 0;
  std::optional<Chromaticities> chromaticities{};  ///< as an EXR file states them
  std::optional<bool> is_cube{};                   ///< EXR attribute envmap: cube or lat-long
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

/// What the headers of an OpenEXR file promise, a part each. Throws FormatError for headers that are damaged
/// and for deep images, which hold no single colour a pixel. Source: "OpenEXR File Layout", version 2.
std::vector<PromisedImage> read_exr_headers(ByteReader& reader);

}  // namespace refield
