// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/bracket_files.h"

#include <OpenImageIO/imageio.h>
#if REFIELD_HAS_LIBRAW
#include <libraw/libraw.h>
#endif

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <memory>
#include <string_view>
#include <utility>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

std::optional<double> positive_attribute(const OIIO::ImageSpec& spec,
                                         std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (const float value = spec.get_float_attribute(name, 0.0f); value > 0.0f && std::isfinite(value))
      return value;
  return std::nullopt;
}

std::optional<Seconds> exposure_of(const OIIO::ImageSpec& spec) {
  if (const auto time = positive_attribute(spec, {"ExposureTime", "Exif:ExposureTime", "expTime"}))
    return Seconds(*time);
  return std::nullopt;
}

/// The layout of a pattern that names the colours of the first two by two sites, such as "RGGB".
PixelLayout raw_layout(const std::string& pattern, const fs::path& path) {
  for (const PixelLayout layout :
       {PixelLayout::bayer_rggb, PixelLayout::bayer_grbg, PixelLayout::bayer_gbrg, PixelLayout::bayer_bggr}) {
    std::string letters(layout_name(layout));
    letters.erase(0, std::string_view("bayer_").size());
    std::ranges::transform(letters, letters.begin(), [](unsigned char c) { return std::toupper(c); });
    if (pattern.starts_with(letters)) return layout;
  }
  throw FormatError(
      path, "has the colour filter '" + pattern +
                "', which is none of RGGB, GRBG, GBRG, BGGR; give its layout with --layout, or develop "
                "it to a linear 16-bit TIFF");
}

struct RawFacts {
  std::optional<RawLevels> levels;
  std::string pattern;  ///< colours of the first two by two sites; empty: not known
};

/// What OpenImageIO does not hand on, and the pattern, since version 2.4 takes RGGB for GMCY. Cameras without
/// a stated black level have it in masked pixels, from which LibRaw takes it when it unpacks the samples.
RawFacts facts_of_raw([[maybe_unused]] const fs::path& path) {
  RawFacts facts;
#if REFIELD_HAS_LIBRAW
  const auto raw = std::make_unique<LibRaw>();  // some hundred kilobytes
  if (raw->open_file(path.c_str()) != LIBRAW_SUCCESS || raw->unpack() != LIBRAW_SUCCESS) return facts;
  constexpr unsigned special_filters = 1000;  // below it, the number names other patterns, such as X-Trans
  if (raw->imgdata.idata.filters >= special_filters)
    for (const auto& [row, column] : {std::pair(0, 0), std::pair(0, 1), std::pair(1, 0), std::pair(1, 1)})
      facts.pattern += raw->imgdata.idata.cdesc[raw->COLOR(row, column)];
  const libraw_colordata_t& colour = raw->imgdata.color;
  // One level for all, one for each of four colours, then a repeating pattern of rows × columns.
  double black = colour.black;
  for (int c = 0; c < 4; ++c) black += colour.cblack[c] / 4.0;
  const unsigned pattern = colour.cblack[4] * colour.cblack[5];
  for (unsigned i = 0; i < pattern && 6 + i < std::size(colour.cblack); ++i)
    black += colour.cblack[6 + i] / static_cast<double>(pattern);
  const double saturation = colour.maximum;
  if (saturation > black) facts.levels = RawLevels{black, saturation};
#endif
  return facts;
}

template <class T>
std::vector<std::uint16_t> read_samples(OIIO::ImageInput& input, const fs::path& path, int channels) {
  const OIIO::ImageSpec& spec = input.spec();
  const std::size_t pixels = static_cast<std::size_t>(spec.width) * spec.height;
  std::vector<T> stored(pixels * spec.nchannels);
  if (!input.read_image(0, 0, 0, spec.nchannels, OIIO::BaseTypeFromC<T>::value, stored.data()))
    throw FormatError(path, "cannot be read to its end (" + input.geterror() + "); copy it again");
  std::vector<std::uint16_t> samples(pixels * channels);
  for (std::size_t p = 0; p < pixels; ++p)
    for (int c = 0; c < channels; ++c) samples[p * channels + c] = stored[p * spec.nchannels + c];
  return samples;
}

}  // namespace

BracketFile read_bracket_file(const fs::path& path, std::optional<PixelLayout> one_channel) {
  const ImageHeader header = read_image_header(path);  // also for its checks
  BracketFile file;
  // Samples must come as stored: no division by alpha, no conversion.
  OIIO::ImageSpec as_stored;
  as_stored.attribute("oiio:UnassociatedAlpha", 1);
  as_stored.attribute("raw:Demosaic", "none");
  auto input = OIIO::ImageInput::open(path.string(), &as_stored);
  if (!input) throw FormatError(path, "cannot be read as an image (" + OIIO::geterror() + ")");
  const OIIO::ImageSpec& spec = input->spec();
  file.exposure = exposure_of(spec);
  file.iso = positive_attribute(spec, {"Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings", "isoSpeed"});
  file.f_number = positive_attribute(spec, {"FNumber", "Exif:FNumber"});
  if (spec.format.is_floating_point()) {
    input.reset();
    if (header.has_sigma) {
      Photograph photograph = read_photograph(path);
      file.linear = std::move(photograph.radiance);
      file.sigma = std::move(photograph.sigma);
    } else {
      file.linear = read_image(path);
    }
    return file;
  }
  const int channels = spec.nchannels >= 3 ? 3 : 1;
  // Not the header's: undeveloped, a RAW file may have more pixels than developed.
  file.frame.width = spec.width;
  file.frame.height = spec.height;
  file.is_raw = std::string_view(input->format_name()) == "raw";
  RawFacts facts;
  if (file.is_raw) facts = facts_of_raw(path);
  if (facts.pattern.empty()) facts.pattern = spec.get_string_attribute("raw:FilterPattern");
  file.raw_levels = facts.levels;
  file.frame.layout = channels == 3 ? PixelLayout::rgb
                      : one_channel ? *one_channel
                      : file.is_raw ? raw_layout(facts.pattern, path)
                                    : PixelLayout::grey;
  if (spec.format == OIIO::TypeDesc::UINT8) {
    file.bits = 8;
    file.frame.samples = read_samples<std::uint8_t>(*input, path, channels);
  } else if (spec.format == OIIO::TypeDesc::UINT16) {
    file.bits = 16;
    file.frame.samples = read_samples<std::uint16_t>(*input, path, channels);
  } else {
    throw FormatError(path, "has samples of type " + std::string(spec.format.c_str()) +
                                "; convert it to 8 or 16 bits or to OpenEXR");
  }
  return file;
}

std::optional<Seconds> stated_exposure(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the image");
  read_image_header(path);  // for its checks
  const auto input = OIIO::ImageInput::open(path.string());
  if (!input) throw FormatError(path, "cannot be read as an image (" + OIIO::geterror() + "); copy it again");
  return exposure_of(input->spec());
}

void write_raw_frame(const fs::path& path, const RawFrame& frame) {
  write_atomically(path, [&](const fs::path& temporary) {
    errno = 0;
    const auto fail = [&](const std::string& why) {
      throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot write the raw frame (" + why + ")");
    };
    auto output = OIIO::ImageOutput::create(temporary.string());
    if (!output) fail(OIIO::geterror());
    const OIIO::ImageSpec spec(frame.width, frame.height, frame.layout == PixelLayout::rgb ? 3 : 1,
                               OIIO::TypeDesc::UINT16);
    if (!output->open(temporary.string(), spec) ||
        !output->write_image(OIIO::TypeDesc::UINT16, frame.samples.data()) || !output->close())
      fail(output->geterror());
  });
}

}  // namespace refield
