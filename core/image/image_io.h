// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/image/colour.h"
#include "core/image/image.h"
#include "core/image/tone_map.h"
#include "core/light/light_map.h"

namespace refield {

/// What an image file's header says.
struct ImageHeader {
  int width = 0;
  int height = 0;
  bool has_sigma = false;  ///< carries the noise of each sample, see Photograph
  /// Rows that are stored together, counted from the first row: a tile's height, or the rows that an EXR file
  /// compresses as one block. Reading one of them reads all.
  int block_rows = 1;
};

/// Throws DeviceError for a missing file and FormatError for one that is no image.
ImageHeader read_image_header(const fs::path& path);

/// What an image is read for. Textures of meshes are sRGB, upright and opaque whatever their files state:
/// exporters leave alpha in those of opaque materials, and glTF 2.0, section 3.8.3, has profiles ignored.
enum class ImageUse { picture, texture };

/// As refield/image.h's, for a use. Check values with require_finite().
Image read_image(const fs::path& path, ImageUse use);

/// Reads rows [first, last) of a photograph, and no more of the file than the blocks that hold them.
Photograph read_photograph_rows(const fs::path& path, int first, int last);
Photograph read_photograph(const fs::path& path);

/// What becomes of a light map whose file states other primaries than Rec.709's, apart from a note.
enum class Primaries {
  as_stored,  ///< its values are kept, as photographs of the same program have the same primaries
  rec709      ///< it is converted; negative values of colours outside that gamut become zero
};

/// As refield/light_map.h's, which keeps primaries as stored.
LightMap read_light_map(const fs::path& path, Parameterisation parameterisation, const RunContext& run,
                        Primaries primaries);
/// The same of a map in memory, which messages call `name`; without the primaries.
void repair_light_map(LightMap& light, const fs::path& name, const RunContext& run = {});

void write_photograph(const fs::path& path, const Photograph& photograph,
                      Precision precision = Precision::single);

/// What a screen shows, 8 bits a channel: row-major, top row first, channels interleaved.
struct ScreenImage {
  int width = 0;
  int height = 0;
  int channels = 0;
  std::vector<std::uint8_t> levels;
};

/// A PNG file in memory.
std::vector<std::uint8_t> encode_png(const ScreenImage& image);
/// A one- or three-channel image as a PNG file in memory, or on disk (atomically).
std::vector<std::uint8_t> encode_png(const Image& image, const ToneMapping& mapping = {});
void write_png(const fs::path& path, const Image& image, const ToneMapping& mapping = {});
void write_png(const fs::path& path, const ScreenImage& image);

}  // namespace refield
