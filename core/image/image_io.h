// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <vector>

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

/// A photograph, or a band of its rows: scene-linear radiance and, where known, each sample's standard
/// deviation. In EXR files the channels are R, G, B and sigma.R, sigma.G, sigma.B. An infinite sigma marks a
/// sample that was not measured (clipped in every exposure); its radiance is then only a lower bound.
struct Photograph {
  Image radiance;  ///< [rows × width × 3]
  Image sigma;     ///< same shape, or empty
};

enum class Precision { half, single };

/// Throws DeviceError for a missing file and FormatError for one that is no image.
ImageHeader read_image_header(const std::filesystem::path& path);

/// What an image is read for. Textures of meshes are sRGB, upright and opaque whatever their files state:
/// exporters leave alpha in those of opaque materials, and glTF 2.0, section 3.8.3, has profiles ignored.
enum class ImageUse { picture, texture };

/// Reads a file as linear RGB, upright by its stated orientation. A grey image is repeated in all channels.
/// Integer formats (PNG, JPEG) are decoded by the curve that they state, else as sRGB, then multiplied by
/// alpha, if any: transparent pixels are black. Radiance pictures are divided by their exposure. Other values
/// are returned as stored: check them with require_finite(). Throws FormatError for a truncated file or no
/// image. docs/reference/image-files.md lists the variants of the formats.
Image read_image(const std::filesystem::path& path, ImageUse use = ImageUse::picture);

/// Reads rows [first, last) of a photograph, and no more of the file than the blocks that hold them.
Photograph read_photograph_rows(const std::filesystem::path& path, int first, int last);
Photograph read_photograph(const std::filesystem::path& path);

/// What becomes of a light map whose file states other primaries than Rec.709's, apart from a note.
enum class Primaries {
  as_stored,  ///< its values are kept, as photographs of the same program have the same primaries
  rec709      ///< it is converted; negative values of colours outside that gamut become zero
};

/// Reads a light map: finite, nothing negative. Negative values of lossy compression become zero, with a
/// warning; the channels' means stay. The faces of EXR cube maps (attribute envmap) are put into the layout
/// of cube_face_axes(). Throws InputError on NaN, Inf, many negative values, naming the texel, and where the
/// attribute contradicts the parameterisation.
LightMap read_light_map(const std::filesystem::path& path, Parameterisation parameterisation,
                        const RunContext& run = {}, Primaries primaries = Primaries::as_stored);
/// The same of a map in memory, which messages call `name`; without the primaries.
void repair_light_map(LightMap& light, const std::filesystem::path& name, const RunContext& run = {});

/// Writes an EXR of Y, RGB or premultiplied RGBA (ZIP), atomically, with the attribute `chromaticities` where
/// the colour space has any. Throws DeviceError where the disk refuses.
void write_exr(const std::filesystem::path& path, const Image& image, Precision precision = Precision::single,
               ColourSpace space = ColourSpace::camera);
void write_photograph(const std::filesystem::path& path, const Photograph& photograph,
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
void write_png(const std::filesystem::path& path, const Image& image, const ToneMapping& mapping = {});
void write_png(const std::filesystem::path& path, const ScreenImage& image);

}  // namespace refield
