// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <span>
#include <vector>

#include "core/base/errors.h"

namespace refield {

/// How a file stores its samples.
enum class StoredSamples { uint8, uint16, other_integers, floating_point };

/// What one part of an image file stores. Only OpenEXR files have several parts, and a data window (that of
/// the stored pixels) which differs from the display window (the image).
struct StoredImage {
  std::string decoder;                ///< OpenImageIO's name of it, such as "openexr" or "raw"
  std::string part;                   ///< its name, or its number where it has none
  int left = 0, top = 0;              ///< of the data window
  int width = 0, height = 0;          ///< of the data window, pixels
  int image_left = 0, image_top = 0;  ///< of the display window
  int image_width = 0, image_height = 0;
  int depth = 1;                      ///< above 1: a volume
  std::vector<std::string> channels;  ///< names, such as "R" or "sigma.R"
  std::optional<int> straight_alpha;  ///< channel by which the others are not multiplied yet
  StoredSamples samples = StoredSamples::floating_point;
  std::int64_t tile_pixels = 0;  ///< 0: no tiles
  int block_rows = 1;            ///< rows that are stored together, see ImageHeader::block_rows
};

/// An image file that is open for reading, whatever library decodes it. Functions that fail throw
/// std::runtime_error with the library's reason.
class ImageFile {
 public:
  virtual ~ImageFile() = default;

  const StoredImage& stored() const { return stored_; }
  /// Goes to the part of that number, from 0; false, and nothing changes, if there is none.
  virtual bool select_part(int part) = 0;
  /// Rows [first, last) of the data window: the named channels, interleaved, integers divided by their
  /// largest value.
  virtual void read_rows(int first, int last, std::span<const int> channels, float* values) = 0;
  /// All integer samples as stored, channels interleaved. Throws for a file of another kind.
  virtual std::vector<std::uint16_t> read_samples() = 0;
  /// Attributes of the file by the names that OpenImageIO gives them, such as "Exif:FNumber".
  virtual std::string text(const std::string& attribute) const = 0;
  virtual std::optional<double> number(const std::string& attribute) const = 0;

 protected:
  StoredImage stored_;
};

/// What a program reads and writes other formats than OpenEXR with: OpenImageIO, which loads 250 shared
/// libraries. The program `refield` does so when it needs them (cli/image_formats.cpp); others that link
/// refield::core have them from their start.
struct ImageFormats {
  /// `decoder` is one of name_of(ImageFormat), or empty: found by the file's name (RAW files, which are
  /// developed). Throws std::runtime_error.
  std::unique_ptr<ImageFile> (*open)(const std::string& path, const std::string& decoder);
  /// Writes 16-bit samples to a file whose format its name gives. Throws std::runtime_error.
  void (*write_samples)(const std::string& path, int width, int height, int channels,
                        const std::uint16_t* samples);
};
const ImageFormats& image_formats();

/// Opens an image for reading after a check of its header. Throws DeviceError for a missing file and
/// FormatError for one that is no image.
std::unique_ptr<ImageFile> open_image_file(const fs::path& path);

/// An OpenEXR file. Throws what OpenEXR does.
std::unique_ptr<ImageFile> open_exr(const fs::path& path);
/// Writes interleaved channels (ZIP); `chromaticities`: x and y of the red, green and blue primaries and of
/// white, or empty. Equal content gives equal files. Throws what OpenEXR does.
void write_exr_channels(const fs::path& path, int width, int height, const std::vector<std::string>& names,
                        const float* values, bool as_half, std::span<const float> chromaticities);

}  // namespace refield
