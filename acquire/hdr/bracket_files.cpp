// SPDX-License-Identifier: Apache-2.0
#include "acquire/hdr/bracket_files.h"

#include <libraw/libraw.h>

#include <bit>
#include <cmath>
#include <numeric>

#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_facts.h"
#include "core/image/image_file.h"
#include "core/image/image_header.h"
#include "core/image/image_io.h"

namespace refield {

namespace {

std::optional<double> positive_attribute(const ImageFile& file, std::initializer_list<const char*> names) {
  for (const char* name : names)
    if (const auto value = file.number(name); value && *value > 0.0 && std::isfinite(*value)) return value;
  return std::nullopt;
}

std::optional<Seconds> exposure_of(const ImageFile& file) {
  if (const auto time = positive_attribute(file, {"ExposureTime", "Exif:ExposureTime", "expTime"}))
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
  throw FormatError(path, "has the colour filter '", pattern,
                    "', which is none of RGGB, GRBG, GBRG, BGGR; develop it to a linear 16-bit TIFF");
}

/// Throws FormatError unless LibRaw succeeded.
void check_raw(int code, const fs::path& path, const std::string& what) {
  if (code != LIBRAW_SUCCESS)
    throw FormatError(path, "cannot be ", what, " by LibRaw (", LibRaw::strerror(code),
                      "); develop it to a linear 16-bit TIFF");
}

/// Tags of a DNG that LibRaw reduces to less.
struct DngTags {
  /// Black level of each column, each row of the picture above the common one (BlackLevelDeltaH, V).
  std::array<std::vector<double>, 2> black_deltas;
  std::vector<double> active_area;  ///< top, left, bottom, right
  std::string colours;  ///< of the mosaic (CFAPattern, CFAPlaneColor), where any is not red, green or blue
  bool has_unknown_delta = false;  ///< of another type than numbers
};

/// Called by LibRaw for each tag; `stream` is at its values.
void note_tag(void* context, int tag, int type, int count, unsigned order, void* stream, INT64) {
  constexpr int cfa_pattern = 33422, cfa_plane_colour = 50710, cfa_layout = 50711;
  constexpr int delta_h = 50715, delta_v = 50716, active_area = 50829;
  constexpr int max_count = 65536;
  DngTags& tags = *static_cast<DngTags*>(context);
  auto& file = *static_cast<LibRaw_abstract_datastream*>(stream);
  const auto read = [&](std::size_t bytes) {
    std::vector<unsigned char> data(bytes);
    if (file.read(data.data(), 1, bytes) != static_cast<int>(bytes)) data.clear();
    return data;
  };
  const int number = tag & 0xffff;
  if ((tag & 0xf0000) != 0 || count <= 0 || count > max_count) return;  // of EXIF or a maker
  if (number == cfa_pattern || number == cfa_plane_colour) {
    std::string letters;
    for (const unsigned char code : read(static_cast<std::size_t>(count)))
      letters += std::string_view("RGBCMYW?")[std::min<std::size_t>(code, 7)];
    if (letters.find_first_not_of("RGB") != std::string::npos ||
        (number == cfa_plane_colour && letters != "RGB"))
      tags.colours = letters;
  } else if (number == cfa_layout) {
    const auto data = read(2);
    if (!data.empty() && data[order == 0x4949 ? 0 : 1] > 1) tags.colours = "in staggered rows or columns";
  } else if (number == delta_h || number == delta_v || number == active_area) {
    // TIFF 6.0, section 2. The specification asks for SRATIONAL; LibRaw takes all of these.
    static constexpr std::array<std::size_t, 13> bytes_of_type = {0, 1, 0, 2, 4, 8, 0, 0, 2, 4, 8, 4, 8};
    const std::size_t bytes = type > 0 && type < 13 ? bytes_of_type[static_cast<std::size_t>(type)] : 0;
    tags.has_unknown_delta = tags.has_unknown_delta || (bytes == 0 && number != active_area);
    const auto data = read(bytes * static_cast<std::size_t>(count));
    const auto bits = [&](std::size_t first, std::size_t size) {
      std::uint64_t value = 0;
      for (std::size_t i = 0; i < size; ++i)
        value = value << 8 | data[first + (order == 0x4949 ? size - 1 - i : i)];
      return value;
    };
    const auto value_at = [&](std::size_t i) -> double {
      const auto high = static_cast<std::uint32_t>(bits(i, std::min<std::size_t>(bytes, 4)));
      switch (type) {
        case 5:
        case 10: {
          const auto low = static_cast<std::uint32_t>(bits(i + 4, 4));
          return type == 5
                     ? high / static_cast<double>(low)
                     : static_cast<std::int32_t>(high) / static_cast<double>(static_cast<std::int32_t>(low));
        }
        case 8:
          return static_cast<std::int16_t>(high);
        case 9:
          return static_cast<std::int32_t>(high);
        case 11:
          return std::bit_cast<float>(high);
        case 12:
          return std::bit_cast<double>(bits(i, 8));
        default:
          return high;
      }
    };
    auto& values = number == active_area ? tags.active_area : tags.black_deltas[number == delta_v];
    values.clear();
    for (std::size_t i = 0; bytes > 0 && i + bytes <= data.size(); i += bytes)
      values.push_back(std::isfinite(value_at(i)) ? value_at(i) : 0.0);
  }
}

/// Black level of a sample of colour `c`: one level for all, one for each of four colours, and a repeating
/// pattern of rows × columns.
unsigned black_of_raw(const libraw_colordata_t& colour, std::size_t y, std::size_t x, std::size_t c) {
  const std::size_t rows = colour.cblack[4], columns = colour.cblack[5];
  const std::size_t place = 6 + (rows * columns > 0 ? y % rows * columns + x % columns : 0);
  const bool is_pattern = rows * columns > 0 && place < std::size(colour.cblack);
  return colour.black + colour.cblack[c] + (is_pattern ? colour.cblack[place] : 0);
}

/// Levels after each sample is lowered to the lowest of the black levels, which lowers saturation, too.
/// Throws FormatError where none is left.
RawLevels level_black(LibRaw& raw, const DngTags& tags, RawFrame& frame, const fs::path& path) {
  const libraw_colordata_t& colour = raw.imgdata.color;
  const std::size_t channels = frame.samples.size() / (static_cast<std::size_t>(frame.width) * frame.height);
  const bool has_colours = raw.imgdata.idata.filters != 0;
  const auto &of_columns = tags.black_deltas[0], &of_rows = tags.black_deltas[1];
  if (tags.has_unknown_delta)
    throw FormatError(
        path, "states black levels (BlackLevelDelta) of an unknown type; develop it to a linear 16-bit TIFF");
  // LibRaw leaves out the first column or row of an ActiveArea that begins at an odd one, but counts black
  // levels from there.
  const auto left_out = [&](int margin, std::size_t place) {
    return tags.active_area.size() == 4 && margin - tags.active_area[place] == 1.0 ? 1 : 0;
  };
  const int left = left_out(raw.imgdata.sizes.left_margin, 1),
            top = left_out(raw.imgdata.sizes.top_margin, 0);
  for (const auto& [deltas, length] :
       {std::pair(&of_columns, frame.width + left), std::pair(&of_rows, frame.height + top)})
    if (!deltas->empty() && std::ssize(*deltas) != length)
      throw FormatError(path, "states black levels (BlackLevelDelta) of ", deltas->size(),
                        " rows or columns, of which it has ", length, "; develop it to a linear 16-bit TIFF");
  // LibRaw adds the mean of each.
  const auto mean_of = [](const std::vector<double>& deltas) {
    return deltas.empty() ? 0.0 : std::reduce(deltas.begin(), deltas.end()) / std::ssize(deltas);
  };
  const double mean = mean_of(of_columns) + mean_of(of_rows);
  const auto black_at = [&](std::size_t i) {
    const std::size_t pixel = i / channels, y = pixel / frame.width + top, x = pixel % frame.width + left;
    const int site = has_colours ? raw.COLOR(static_cast<int>(y), static_cast<int>(x)) : 0;
    const double black =
        black_of_raw(colour, y, x, channels > 1 ? i % channels : static_cast<std::size_t>(site));
    const double delta = (of_columns.empty() ? 0.0 : of_columns[x]) + (of_rows.empty() ? 0.0 : of_rows[y]);
    return static_cast<unsigned>(std::max(0L, std::lround(black - mean + delta)));
  };
  unsigned lowest = black_at(0), highest = lowest;
  for (std::size_t i = 1; i < frame.samples.size(); ++i) {
    lowest = std::min(lowest, black_at(i));
    highest = std::max(highest, black_at(i));
  }
  if (colour.maximum <= highest)
    throw FormatError(path, "states a black level of ", highest, " and saturation at ", colour.maximum,
                      "; develop it to a linear 16-bit TIFF");
  if (lowest < highest)
    for (std::size_t i = 0; i < frame.samples.size(); ++i)
      frame.samples[i] -=
          static_cast<std::uint16_t>(std::min<unsigned>(frame.samples[i], black_at(i) - lowest));
  return {static_cast<double>(lowest), static_cast<double>(colour.maximum - (highest - lowest))};
}

/// Layout of one sample per pixel. `filters` is LibRaw's: 0 none, 9 X-Trans, else two bits per site of eight
/// rows and two columns.
PixelLayout layout_of_raw(LibRaw& raw, const DngTags& tags, std::optional<PixelLayout> given,
                          const fs::path& path) {
  const libraw_iparams_t& camera = raw.imgdata.idata;
  if (!tags.colours.empty()) return raw_layout(tags.colours, path);  // LibRaw calls them RGB
  if (camera.filters == LIBRAW_XTRANS) return raw_layout("X-Trans", path);
  if (camera.filters == 0) return given.value_or(PixelLayout::grey);
  if ((camera.filters & 0xff) * 0x01010101u != camera.filters || raw.is_fuji_rotated())
    return raw_layout("of another period than 2×2", path);
  if (given) return *given;
  std::string pattern;
  for (const auto& [row, column] : {std::pair(0, 0), std::pair(0, 1), std::pair(1, 0), std::pair(1, 1)})
    pattern += camera.cdesc[raw.COLOR(row, column)];
  return raw_layout(pattern, path);
}

std::unique_ptr<LibRaw> open_raw(const fs::path& path, DngTags* tags = nullptr) {
  auto raw = std::make_unique<LibRaw>();  // some hundred kilobytes
  if (tags) raw->set_exifparser_handler(note_tag, tags);
  check_raw(raw->open_file(path.c_str()), path, "read as a camera's RAW");
  return raw;
}

/// Samples in the order of the sensor. LibRaw turns pictures when it develops them, not when it unpacks them.
BracketFile read_raw_file(const fs::path& path, std::optional<PixelLayout> given) {
  DngTags tags;
  const auto raw = open_raw(path, &tags);
  const auto positive = [](float value) {
    return value > 0.0f && std::isfinite(value) ? std::optional<double>(value) : std::nullopt;
  };
  const libraw_imgother_t& shot = raw->imgdata.other;
  BracketFile file;
  file.is_raw = true;
  file.bits = 16;
  if (const auto seconds = positive(shot.shutter)) file.exposure = Seconds(*seconds);
  file.settings.iso = positive(shot.iso_speed);
  file.settings.f_number = positive(shot.aperture);
  file.settings.focal_length_mm = positive(shot.focal_len);
  if (raw->is_floating_point())
    throw FormatError(path, "stores floating-point samples; convert it to 16 bits, or develop it to OpenEXR");
  // LibRaw reads such tiles as if they were rows.
  libraw_decoder_info_t decoder{};
  const auto& unpacker = raw->get_internal_data_pointer()->unpacker_data;
  if (raw->get_decoder_info(&decoder) == LIBRAW_SUCCESS && decoder.decoder_name &&
      std::string_view(decoder.decoder_name).starts_with("packed_dng") &&
      unpacker.tile_width < raw->imgdata.sizes.raw_width)
    throw FormatError(path, "stores tiles without compression; convert it to a compressed DNG");
  check_raw(raw->unpack(), path, "unpacked");
  const libraw_rawdata_t& data = raw->imgdata.rawdata;
  const libraw_image_sizes_t& size = raw->imgdata.sizes;
  const bool is_linear_dng = raw->imgdata.idata.dng_version > 0 && raw->imgdata.idata.colors == 3 &&
                             (data.color3_image || data.color4_image);
  if (!data.raw_image && !is_linear_dng)
    throw FormatError(path, "has no samples of a mosaic (such as sRAW); develop it to a linear 16-bit TIFF");
  if (size.left_margin + size.width > size.raw_width || size.top_margin + size.height > size.raw_height)
    throw FormatError(path, "has a picture larger than its sensor; the file is damaged");
  file.frame.width = size.width;
  file.frame.height = size.height;
  file.frame.layout = !data.raw_image ? PixelLayout::rgb : layout_of_raw(*raw, tags, given, path);
  const std::size_t stored = data.raw_image      ? 1
                             : data.color3_image ? 3
                                                 : 4,
                    kept = std::min<std::size_t>(stored, 3);
  const std::uint16_t* first = data.raw_image      ? data.raw_image
                               : data.color3_image ? &data.color3_image[0][0]
                                                   : &data.color4_image[0][0];
  const std::size_t pitch =
      size.raw_pitch > 0 ? size.raw_pitch / sizeof(std::uint16_t) : size.raw_width * stored;
  for (std::size_t y = 0; y < size.height; ++y) {
    const std::uint16_t* row = first + (y + size.top_margin) * pitch + size.left_margin * stored;
    for (std::size_t x = 0; x < size.width; ++x)
      file.frame.samples.insert(file.frame.samples.end(), row + x * stored, row + x * stored + kept);
  }
  file.raw_levels = level_black(*raw, tags, file.frame, path);
  return file;
}

bool is_raw_file(const fs::path& path, const ImageFacts& facts) {
  return is_camera_raw(path) || facts.is_raw;
}

/// Facts of a file that exists; of RAW files they are read by LibRaw.
ImageFacts facts_of_photograph(const fs::path& path) {
  std::error_code error;
  if (!fs::exists(path, error)) throw DeviceError(path.string(), ENOENT, "cannot open the image");
  if (is_camera_raw(path)) return {};
  ImageFacts facts = read_image_facts(path);
  if (!facts.is_raw) read_image_header(path);  // for its checks
  if (!facts.refusal.empty() && !facts.is_raw) throw FormatError(path, facts.refusal);
  return facts;
}

/// One channel of `stored`, or its first three.
std::vector<std::uint16_t> read_samples(ImageFile& file, const fs::path& path, int channels) {
  try {
    auto samples = file.read_samples();
    const std::size_t stored = file.stored().channels.size();
    if (stored == static_cast<std::size_t>(channels)) return samples;
    std::vector<std::uint16_t> first;
    first.reserve(samples.size() / stored * channels);
    for (std::size_t p = 0; p + stored <= samples.size(); p += stored)
      first.insert(first.end(), samples.begin() + p, samples.begin() + p + channels);
    return first;
  } catch (const std::exception& error) {
    throw FormatError(path, "cannot be read to its end (", error.what(), "); copy it again");
  }
}

}  // namespace

BracketFile read_bracket_file(const fs::path& path, std::optional<PixelLayout> one_channel) {
  const ImageFacts facts = facts_of_photograph(path);
  if (is_raw_file(path, facts)) return read_raw_file(path, one_channel);
  BracketFile file;
  file.settings = {facts.iso,          facts.f_number,    facts.focal_length_mm, facts.white_balance,
                   facts.light_source, facts.orientation, facts.digital_zoom};
  if (facts.exposure_seconds) file.exposure = Seconds(*facts.exposure_seconds);
  const auto input = image_format(path) == ImageFormat::hdr ? nullptr : open_image_file(path);
  if (input && !file.exposure) file.exposure = exposure_of(*input);
  if (input && !file.settings.iso)
    file.settings.iso =
        positive_attribute(*input, {"Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings", "isoSpeed"});
  if (input && !file.settings.f_number)
    file.settings.f_number = positive_attribute(*input, {"FNumber", "Exif:FNumber"});
  if (!input || input->stored().samples == StoredSamples::floating_point) {
    if (read_image_header(path).has_sigma) {
      Photograph photograph = read_photograph(path);
      file.linear = std::move(photograph.radiance);
      file.sigma = std::move(photograph.sigma);
    } else {
      file.linear = read_image(path);
    }
    return file;
  }
  const StoredImage& stored = input->stored();
  if (stored.channels.size() > 4)
    throw FormatError(path, "has ", stored.channels.size(),
                      " channels, of which none is named; export red, green and blue alone");
  const int channels = stored.channels.size() >= 3 ? 3 : 1;
  file.response = facts.response;
  file.frame.width = stored.width;
  file.frame.height = stored.height;
  file.frame.layout = channels == 3 ? PixelLayout::rgb : one_channel.value_or(PixelLayout::grey);
  if (stored.samples == StoredSamples::other_integers)
    throw FormatError(
        path, "has integer samples of neither 8 nor 16 bits; convert it to one of them or to OpenEXR");
  file.bits = stored.samples == StoredSamples::uint8 ? 8 : 16;
  if (file.response.empty()) file.settings.bits = file.bits;
  file.frame.samples = read_samples(*input, path, channels);
  if (!is_bayer(file.frame.layout))
    file.frame.samples = upright(file.frame.samples, file.frame.width, file.frame.height, facts.orientation);
  return file;
}

void require_same_settings(const CameraSettings& settings, const fs::path& path,
                           const CameraSettings& expected, const fs::path& expected_path) {
  const auto require = [&](const char* name, std::optional<double> value, std::optional<double> other,
                           const char* remedy) {
    constexpr double rounding = 0.02;
    if (!value || !other || std::abs(*value - *other) <= rounding * std::abs(*other)) return;
    const auto text = [](double number) { return formatted("%.4g", number); };
    throw InputError(path, ": was taken with ", name, " ", text(*value), ", but ", expected_path, " with ",
                     text(*other), "; ", remedy);
  };
  const char* again = "photograph the series with one setting";
  require("ISO speed", settings.iso, expected.iso, again);
  require("aperture f/", settings.f_number, expected.f_number, again);
  require("focal length (mm)", settings.focal_length_mm, expected.focal_length_mm, again);
  require("EXIF DigitalZoomRatio", settings.digital_zoom, expected.digital_zoom, again);
  const char* develop = "develop all with one white balance, or give the RAW files";
  require("EXIF WhiteBalance", settings.white_balance, expected.white_balance, develop);
  require("EXIF LightSource (white balance preset)", settings.light_source, expected.light_source, develop);
  require("a depth in bits of", settings.bits, expected.bits,
          "they state no encoding, which is assumed by the depth: export all with one depth");
  require("EXIF Orientation", settings.orientation, expected.orientation,
          "turn the pictures that differ, or, if all are stored in the order of the sensor, set the tag of "
          "all to 1");
}

std::optional<Seconds> stated_exposure(const fs::path& path) {
  const ImageFacts facts = facts_of_photograph(path);
  if (is_raw_file(path, facts)) {
    const float seconds = open_raw(path)->imgdata.other.shutter;
    return seconds > 0.0f && std::isfinite(seconds) ? std::optional(Seconds(seconds)) : std::nullopt;
  }
  if (facts.exposure_seconds) return Seconds(*facts.exposure_seconds);
  if (image_format(path) == ImageFormat::hdr) return std::nullopt;
  return exposure_of(*open_image_file(path));
}

void write_raw_frame(const fs::path& path, const RawFrame& frame) {
  write_atomically(path, [&](const fs::path& temporary) {
    errno = 0;
    try {
      image_formats().write_samples(temporary.string(), frame.width, frame.height,
                                    frame.layout == PixelLayout::rgb ? 3 : 1, frame.samples.data());
    } catch (const std::exception& error) {
      throw DeviceError(path.string(), errno != 0 ? errno : EIO, "cannot write the raw frame (", error.what(),
                        ")");
    }
  });
}

}  // namespace refield
