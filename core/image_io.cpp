// SPDX-License-Identifier: Apache-2.0
#include "core/image_io.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <memory>
#include <optional>
#include <string>

#include "core/errors.h"
#include "core/files.h"
#include "core/image_header.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// Debian's OpenImageIO prints its debugging notes to standard error unless told not to; errors reach us as
/// results.
void silence_openimageio() {
  static const bool done = OIIO::attribute("debug", 0);
  static_cast<void>(done);
}

/// The one decoder that the content asks for. OpenImageIO itself would try all of its decoders on a file that
/// the one of its name refuses, among them some that a hostile file can crash. RAW files, which are told by
/// their names, are left to it.
std::unique_ptr<OIIO::ImageInput> open_with_decoder(const fs::path& path) {
  const auto fail = [&](const std::string& why) {
    throw FormatError(path, "cannot be read as an image (" + why + "); check that the file is complete");
  };
  if (is_camera_raw(path)) {
    auto input = OIIO::ImageInput::open(path.string());
    if (!input) fail(OIIO::geterror());
    return input;
  }
  const auto format = image_format(path);
  if (!format) fail("it is none of EXR, HDR, PNG, JPEG, TIFF and PFM");
  check_image_header(path, *format);
  auto input = OIIO::ImageInput::create(name_of(*format));
  OIIO::ImageSpec spec;
  if (!input) fail(OIIO::geterror());
  if (!input->open(path.string(), spec)) fail(input->geterror());
  return input;
}

std::unique_ptr<OIIO::ImageInput> open_image(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the image");
  if (!fs::is_regular_file(path, error)) throw FormatError(path, "is not a file; name an image");
  silence_openimageio();
  auto input = open_with_decoder(path);
  const auto& spec = input->spec();
  if (spec.depth > 1) throw FormatError(path, "has impossible dimensions: it is a volume, not an image");
  require_plausible({spec.width, spec.height, spec.nchannels,
                     static_cast<std::int64_t>(spec.tile_width) * spec.tile_height, 0},
                    path);
  return input;
}

/// Numbers of the named channels in a file.
std::optional<std::array<int, 3>> find_channels(const OIIO::ImageSpec& spec, const std::string& prefix) {
  const std::array<int, 3> found = {spec.channelindex(prefix + "R"), spec.channelindex(prefix + "G"),
                                    spec.channelindex(prefix + "B")};
  if (std::ranges::any_of(found, [](int c) { return c < 0; })) return std::nullopt;
  return found;
}

std::array<int, 3> colour_channels(const OIIO::ImageSpec& spec, const fs::path& path) {
  if (auto rgb = find_channels(spec, "")) return *rgb;
  if (spec.nchannels <= 2) return {0, 0, 0};  // grey, perhaps with alpha
  // A single layer under any name, such as Combined.R.
  for (int c = 0; c < spec.nchannels; ++c) {
    const std::string& name = spec.channelnames[c];
    if (name.size() > 2 && name.ends_with(".R") && !name.starts_with("sigma"))
      if (auto rgb = find_channels(spec, name.substr(0, name.size() - 1))) return *rgb;
  }
  throw FormatError(path, "has no channels R, G, B");
}

/// All channels of rows [first, last), interleaved.
std::vector<float> read_raw_rows(OIIO::ImageInput& input, const fs::path& path, int first, int last) {
  const OIIO::ImageSpec spec = input.spec();
  const std::size_t row_size = static_cast<std::size_t>(spec.width) * spec.nchannels;
  const auto fail = [&] {
    throw FormatError(path, "cannot read rows " + std::to_string(first) + " to " + std::to_string(last) +
                                " (" + input.geterror() +
                                "); the file is damaged or truncated: copy or capture it again");
  };
  std::vector<float> raw(row_size * (last - first));
  if (spec.tile_width == 0) {
    if (!input.read_scanlines(0, 0, spec.y + first, spec.y + last, 0, 0, spec.nchannels,
                              OIIO::TypeDesc::FLOAT, raw.data()))
      fail();
    return raw;
  }
  // Tiled files come whole: they are rare, and rows of tiles do not line up with bands.
  std::vector<float> whole(row_size * spec.height);
  if (!input.read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::FLOAT, whole.data())) fail();
  std::copy_n(whole.data() + row_size * first, raw.size(), raw.data());
  return raw;
}

Image select_channels(const std::vector<float>& raw, int width, int height, int channels,
                      const std::array<int, 3>& selected) {
  Image image(width, height, 3);
  for (std::size_t p = 0; p < image.pixel_count(); ++p)
    for (int c = 0; c < 3; ++c) image.values[3 * p + c] = raw[p * channels + selected[c]];
  return image;
}

void write_channels(const fs::path& path, int width, int height, const std::vector<std::string>& names,
                    const float* values, Precision precision) {
  write_atomically(path, [&](const fs::path& temporary) {
    const auto fail = [&](const std::string& why) {
      throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot write the image (" + why + ")");
    };
    silence_openimageio();
    errno = 0;
    auto output = OIIO::ImageOutput::create(temporary.string());
    if (!output) fail(OIIO::geterror());
    OIIO::ImageSpec spec(width, height, static_cast<int>(names.size()),
                         precision == Precision::half ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT);
    spec.channelnames = names;
    spec.attribute("compression", "zip");
    // OpenImageIO stores the date and time of writing unless there is one: equal content must give equal
    // files. It leaves out an attribute whose type EXR does not know.
    constexpr std::int8_t no_date = 0;
    spec.attribute("DateTime", OIIO::TypeDesc::INT8, &no_date);
    spec.attribute("oiio:ColorSpace", "Linear");
    if (!output->open(temporary.string(), spec)) fail(output->geterror());
    if (!output->write_image(OIIO::TypeDesc::FLOAT, values)) fail(output->geterror());
    if (!output->close()) fail(output->geterror());
  });
}

}  // namespace

ImageHeader read_image_header(const fs::path& path) {
  const auto input = open_image(path);
  return {input->spec().width, input->spec().height, find_channels(input->spec(), "sigma.").has_value()};
}

Image read_image(const fs::path& path) {
  const auto input = open_image(path);
  const OIIO::ImageSpec spec = input->spec();
  const auto raw = read_raw_rows(*input, path, 0, spec.height);
  Image image = select_channels(raw, spec.width, spec.height, spec.nchannels, colour_channels(spec, path));
  if (!spec.format.is_floating_point() && spec.get_string_attribute("oiio:ColorSpace") != "Linear")
    std::ranges::transform(image.values, image.values.begin(), linear_from_srgb);
  return image;
}

Photograph read_photograph_rows(const fs::path& path, int first, int last) {
  const auto input = open_image(path);
  const OIIO::ImageSpec spec = input->spec();
  if (first < 0 || last > spec.height || first >= last)
    throw InputError(path.string() + ": has no rows " + std::to_string(first) + " to " +
                     std::to_string(last));
  if (!spec.format.is_floating_point())
    throw FormatError(path, "is not scene-linear; photographs must be OpenEXR or another float format");
  const auto raw = read_raw_rows(*input, path, first, last);
  Photograph photograph;
  photograph.radiance =
      select_channels(raw, spec.width, last - first, spec.nchannels, colour_channels(spec, path));
  if (auto sigma = find_channels(spec, "sigma."))
    photograph.sigma = select_channels(raw, spec.width, last - first, spec.nchannels, *sigma);
  return photograph;
}

Photograph read_photograph(const fs::path& path) {
  return read_photograph_rows(path, 0, read_image_header(path).height);
}

LightMap read_light_map(const fs::path& path, Parameterisation parameterisation) {
  LightMap light{read_image(path), parameterisation};
  require_finite(light.radiance, path.string(), true, "repair that texel in the light map");
  for (float& value : light.radiance.values) value = std::max(value, 0.0f);
  return light;
}

void write_exr(const fs::path& path, const Image& image, Precision precision) {
  if (image.channels != 1 && image.channels != 3)
    throw InputError("an EXR of 1 or 3 channels can be written");
  const std::vector<std::string> names =
      image.channels == 1 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
  write_channels(path, image.width, image.height, names, image.values.data(), precision);
}

void write_photograph(const fs::path& path, const Photograph& photograph, Precision precision) {
  const Image& radiance = photograph.radiance;
  if (photograph.sigma.empty()) return write_exr(path, radiance, precision);
  if (!radiance.same_shape(photograph.sigma)) throw InputError("radiance and sigma differ in shape");
  std::vector<float> six(radiance.pixel_count() * 6);
  for (std::size_t p = 0; p < radiance.pixel_count(); ++p)
    for (int c = 0; c < 3; ++c) {
      six[6 * p + c] = radiance.values[3 * p + c];
      six[6 * p + 3 + c] = photograph.sigma.values[3 * p + c];
    }
  write_channels(path, radiance.width, radiance.height, {"R", "G", "B", "sigma.R", "sigma.G", "sigma.B"},
                 six.data(), precision);
}

std::vector<std::uint8_t> encode_png(const ScreenImage& image) {
  std::vector<std::uint8_t> file;
  OIIO::Filesystem::IOVecOutput sink(file);
  auto output = OIIO::ImageOutput::create("png");
  OIIO::ImageSpec spec(image.width, image.height, image.channels, OIIO::TypeDesc::UINT8);
  if (!output || !output->set_ioproxy(&sink) || !output->open("memory.png", spec) ||
      !output->write_image(OIIO::TypeDesc::UINT8, image.levels.data()) || !output->close())
    throw InputError("cannot encode a PNG: " + (output ? output->geterror() : OIIO::geterror()));
  return file;
}

std::vector<std::uint8_t> encode_png(const Image& image, const ToneMapping& mapping) {
  return encode_png(ScreenImage{image.width, image.height, image.channels, tone_mapped(image, mapping)});
}

void write_png(const fs::path& path, const ScreenImage& image) {
  const auto file = encode_png(image);
  write_text_atomically(path, {reinterpret_cast<const char*>(file.data()), file.size()});
}

void write_png(const fs::path& path, const Image& image, const ToneMapping& mapping) {
  write_png(path, ScreenImage{image.width, image.height, image.channels, tone_mapped(image, mapping)});
}

}  // namespace refield
