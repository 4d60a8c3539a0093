// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <fstream>

#include "core/image/colour.h"
#include "core/image/image.h"

namespace refield {

/// Numbers and texts at any place of a file. What lies beyond its end reads as zero, or is missing.
class FileBytes {
 public:
  explicit FileBytes(const fs::path& path);

  std::uint64_t size() const { return size_; }
  std::string text(std::uint64_t at, std::uint64_t count);
  std::uint64_t number(std::uint64_t at, int bytes, bool is_big_endian);

 private:
  std::ifstream file_;
  std::uint64_t size_;
};

/// Header of a Radiance picture (.hdr, .pic).
struct RadianceHeader {
  int width = 0;                                    ///< of the upright picture
  int height = 0;                                   ///< rows
  int orientation = 1;                              ///< of the scan lines, as ImageFacts::orientation
  bool is_xyz = false;                              ///< CIE XYZ instead of RGB
  std::array<double, 3> divisor = {1.0, 1.0, 1.0};  ///< product of all EXPOSURE and COLORCORR lines
  std::optional<Chromaticities> primaries;          ///< of RGB, where stated
  std::size_t data = 0;                             ///< byte where the first scan line begins
};

/// Throws FormatError.
RadianceHeader read_radiance_header(const fs::path& path);

/// Reads a Radiance picture as linear RGB, upright and divided by its exposure: the radiance that was stored
/// before programs changed its brightness. CIE XYZ becomes linear Rec.709. Scan lines may be flat or
/// compressed in the new or the old way. Throws FormatError for a damaged or truncated file. Source: G. Ward,
/// "Real Pixels", Graphics Gems II, 1991; Radiance file formats (filefmts.pdf), "Picture file format".
Image read_radiance(const fs::path& path);

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
std::optional<ImageFormat> image_format(const fs::path& path);

/// Throws FormatError for dimensions that are impossible, or that promise far more pixels than the file can
/// hold: decoders reserve memory for what a header says.
void require_plausible(const PromisedImage& promised, const fs::path& path);

/// Reads an image's header without decoding and checks it, so that a hostile file is refused before a
/// decoder sees it. EXR, Radiance HDR, PNG and JPEG are looked into; others pass. Throws FormatError.
void check_image_header(const fs::path& path, ImageFormat format);

/// What the headers of an OpenEXR file promise, a part each, read by its library without what follows them.
/// Throws FormatError for headers that are damaged, and for images that hold no single colour a pixel: deep,
/// sub-sampled, or of whole numbers.
std::vector<PromisedImage> read_exr_headers(const fs::path& path);

/// Whether a marker of a JPEG file begins a frame header, which states its size (ITU T.81, table B.1).
bool is_jpeg_frame(std::uint64_t marker);

}  // namespace refield
