// SPDX-License-Identifier: Apache-2.0
#include "core/image/image_facts.h"

#include <zlib.h>

#include <cmath>
#include <map>

#include "core/image/image_header.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

using namespace std::string_view_literals;

constexpr std::uint64_t max_profile_bytes = 1 << 22;

Chromaticities chromaticities_of(const std::array<double, 8>& xy) {
  return {Eigen::Vector2d(xy[0], xy[1]), Eigen::Vector2d(xy[2], xy[3]), Eigen::Vector2d(xy[4], xy[5]),
          Eigen::Vector2d(xy[6], xy[7])};
}

/// The curve of an ICC profile's red channel or grey, rTRC or kTRC; that of a profile of tables is unknown.
/// Its primaries are adapted to the white D50. Source: ICC.1:2010, 9.2, 10.5 and 10.15.
void read_profile(std::string_view icc, ImageFacts& facts) {
  const auto number = [&](std::size_t at, int bytes) {
    std::uint32_t value = 0;
    for (int i = 0; i < bytes; ++i)
      value = value << 8 | (at + i < icc.size() ? static_cast<unsigned char>(icc[at + i]) : 0u);
    return value;
  };
  const auto place_of = [&](std::string_view tag) -> std::size_t {
    for (std::size_t k = 0; k < std::min(number(128, 4), 100u); ++k)
      if (icc.substr(std::min(icc.size(), 132 + 12 * k), 4) == tag) return number(132 + 12 * k + 4, 4);
    return 0;
  };
  const auto fixed_at = [&](std::size_t at) { return static_cast<std::int32_t>(number(at, 4)) / 65536.0; };
  facts.response = "unknown";
  std::array<double, 8> xy = {0, 0, 0, 0, 0, 0, 0.3457, 0.3585};
  bool has_primaries = true;
  for (std::size_t c = 0; c < 3; ++c) {
    const std::size_t at = place_of(std::array{"rXYZ", "gXYZ", "bXYZ"}[c]) + 8;
    const double sum = fixed_at(at) + fixed_at(at + 4) + fixed_at(at + 8);
    has_primaries &= at > 8 && sum > 0.0;
    xy[2 * c] = fixed_at(at) / sum;
    xy[2 * c + 1] = fixed_at(at + 4) / sum;
  }
  facts.chromaticities = has_primaries ? std::optional(chromaticities_of(xy)) : std::nullopt;
  const std::size_t curve = std::max(place_of("rTRC"), place_of("kTRC"));
  if (curve == 0 || curve + 12 > icc.size()) return;
  const auto fixed = [&](std::size_t i) { return fixed_at(curve + 12 + 4 * i); };
  const bool is_table = icc.substr(curve, 4) == "curv";
  const std::uint32_t count = is_table ? number(curve + 8, 4) : 0, kind = is_table ? 0 : number(curve + 8, 2);
  const auto light = [&](double x) {
    if (is_table && count == 0) return x;
    if (is_table && count == 1) return std::pow(x, number(curve + 12, 2) / 256.0);
    if (is_table) {
      const double place = x * (count - 1);
      const auto below = static_cast<std::size_t>(place);
      return std::lerp(number(curve + 12 + 2 * below, 2), number(curve + 14 + 2 * below, 2),
                       place - std::floor(place)) /
             65535.0;
    }
    if (kind == 0) return std::pow(x, fixed(0));
    const double a = fixed(1), b = fixed(2), c = fixed(3);
    if (kind < 3) return x >= -b / a ? std::pow(a * x + b, fixed(0)) : 0.0;  // apart from an offset
    return x >= fixed(4) ? std::pow(a * x + b, fixed(0)) : c * x;
  };
  constexpr double tolerance = 0.002;
  const double gamma = std::log(light(0.5)) / std::log(0.5);
  const auto is_curve = [&](auto&& expected) {
    return std::ranges::all_of(std::array{0.1, 0.25, 0.5, 0.75, 0.9},
                               [&](double x) { return std::abs(light(x) - expected(x)) < tolerance; });
  };
  if (is_curve([](double x) { return x; }))
    facts.response = "linear";
  else if (is_curve([](double x) { return linear_from_srgb(static_cast<float>(x)); }))
    facts.response = "srgb";
  else if (is_curve([&](double x) { return std::pow(x, gamma); }) && gamma > 0.1 && gamma < 10.0)
    facts.response = "gamma:" + std::to_string(gamma);
}

constexpr const char* levels_refusal =
    "states levels of black and white that are not the full range (ReferenceBlackWhite, CS=ITU601, cICP); "
    "export it as RGB of the full range";
constexpr const char* cmyk_refusal = "stores inks (CMYK), which are no light; export it as RGB";

/// The first directory of a TIFF structure that begins at `base`, and its EXIF directory. Source: TIFF 6.0,
/// section 2; EXIF 2.3, section 4.6; BigTIFF has numbers of 8 bytes.
void read_tiff(FileBytes& file, std::uint64_t base, ImageFacts& facts) {
  const std::string start = file.text(base, 4);
  if (start.size() < 4 || (!start.starts_with("II") && !start.starts_with("MM"))) return;
  const bool is_big_endian = start[0] == 'M';
  const auto number = [&](std::uint64_t at, int bytes) { return file.number(at, bytes, is_big_endian); };
  const bool is_big_tiff = number(base + 2, 2) == 43;
  const int word = is_big_tiff ? 8 : 4;
  double full = 255.0;  // the largest sample
  bool is_jpeg = false, is_chroma = false;
  std::array<double, 2> white = {0.3127, 0.329};
  const auto read_directory = [&](std::uint64_t at, const auto& self, int depth) -> void {
    constexpr std::uint64_t max_entries = 4096;
    const std::uint64_t entries = std::min(number(at, is_big_tiff ? 8 : 2), max_entries);
    const std::uint64_t first = at + (is_big_tiff ? 8 : 2), entry_bytes = is_big_tiff ? 20 : 12;
    for (std::uint64_t entry = first; entry < first + entries * entry_bytes && entry < file.size();
         entry += entry_bytes) {
      const std::uint64_t tag = number(entry, 2), type = number(entry + 2, 2),
                          count = number(entry + 4, word);
      static constexpr std::array<int, 17> bytes_of_type = {0, 1, 1, 2, 4, 8, 1, 1, 2,
                                                            4, 8, 4, 8, 4, 0, 0, 8};
      const int bytes = type < bytes_of_type.size() ? bytes_of_type[type] : 0;
      if (bytes == 0 || count == 0) continue;
      const std::uint64_t inside = entry + 4 + static_cast<std::uint64_t>(word);
      const std::uint64_t place =
          count * static_cast<std::uint64_t>(bytes) <= static_cast<std::uint64_t>(word)
              ? inside
              : base + number(inside, word);
      const bool is_rational = type == 5 || type == 10;
      const auto item = [&](int i) {
        const std::uint64_t begin = place + static_cast<std::uint64_t>(i) * static_cast<std::uint64_t>(bytes);
        if (type == 10)
          return static_cast<std::int32_t>(number(begin, 4)) /
                 static_cast<double>(static_cast<std::int32_t>(number(begin + 4, 4)));
        const auto whole = static_cast<double>(number(begin, is_rational ? 4 : bytes));
        return is_rational ? whole / static_cast<double>(number(begin + 4, 4)) : whole;
      };
      const double value = std::isfinite(item(0)) ? item(0) : 0.0;
      const std::optional<double> positive = value > 0.0 ? std::optional(value) : std::nullopt;
      if (tag == 274 && value >= 1.0 && value <= 8.0) facts.orientation = static_cast<int>(value);
      if (tag == 262) {
        facts.is_raw |= value == 32803.0 || value == 34892.0;  // colour filter array, LinearRaw
        if (value == 0.0 || (value >= 8.0 && value <= 10.0))
          facts.refusal = "stores white as zero, or L*a*b* (PhotometricInterpretation); export it as RGB";
        if (value == 32844.0 || value == 32845.0) facts.refusal = "stores LogLuv; convert it to OpenEXR";
        if (value == 5.0) facts.refusal = cmyk_refusal;
      }
      if (tag == 258) full = std::pow(2.0, value) - 1.0;
      if (tag == 259) is_jpeg = value == 7.0;
      if (tag == 262) is_chroma = value == 6.0;
      if (tag == 322 && (full > 0x1p63 || (is_jpeg && is_chroma)))  // OpenImageIO 2.4 cannot decode these
        facts.refusal = "stores 64-bit samples or JPEG in tiles; convert it to rows of 8, 16 or 32 bits";
      // GrayResponseCurve, TransferFunction
      if ((tag == 291 || tag == 301) && base == 0 && facts.response.empty()) facts.response = "unknown";
      if (tag == 318 && count == 2) white = {item(0), item(1)};  // WhitePoint
      if (tag == 319 && count == 6)                              // PrimaryChromaticities
        facts.chromaticities =
            chromaticities_of({item(0), item(1), item(2), item(3), item(4), item(5), white[0], white[1]});
      // ReferenceBlackWhite, which libtiff respects for luminance and chroma that are no JPEG
      if (tag == 532 && base == 0 && count == 6 && (is_jpeg || !is_chroma))
        for (int i = 0; i < 6; ++i)
          if (item(i) != (i % 2 ? full : 0.0) && !(is_chroma && i > 1 && item(i) == (full + 1.0) / 2.0))
            facts.refusal = levels_refusal;
      if (depth == 0 && ((tag == 254 && number(place, 4) & 1u) || (tag == 255 && value == 2.0)))
        facts.refusal = "begins with a thumbnail (NewSubfileType); export the image alone";
      if (tag == 50706) facts.is_raw = true;  // DNGVersion
      if (tag == 33434) facts.exposure_seconds = positive;
      if (tag == 33437) facts.f_number = positive;
      // SensitivityType and those behind it: 34855 cannot hold more than 65535. ShutterSpeedValue and
      // ApertureValue are logarithms to base 2. Source: EXIF 2.3, tables 6 and 8.
      if (tag == 34855 || (tag > 34864 && tag < 34868 && facts.iso.value_or(65535.0) >= 65535.0))
        facts.iso = positive;
      const double power = std::exp2(tag == 37377 ? -item(0) : item(0) / 2.0);
      if (tag == 37377 && !facts.exposure_seconds && std::isnormal(power)) facts.exposure_seconds = power;
      if (tag == 37378 && !facts.f_number && std::isnormal(power)) facts.f_number = power;
      if (tag == 37386) facts.focal_length_mm = positive;
      if (tag == 37384) facts.light_source = static_cast<int>(value);
      if (tag == 41987) facts.white_balance = static_cast<int>(value);
      if (tag == 41988) facts.digital_zoom = value > 0.0 ? value : 1.0;  // 0: it was not used
      if (tag == 34675) read_profile(file.text(place, std::min(count, max_profile_bytes)), facts);
      // The directories of EXIF and, in it, of interoperability, which marks Adobe RGB. Source: DCF 2.0, 3.
      if ((tag == 34665 && depth == 0) || (tag == 40965 && depth == 1))
        self(base + static_cast<std::uint64_t>(value), self, depth + 1);
      if (tag == 1 && depth == 2 && file.text(place, 3) == "R03") {
        facts.response = "gamma:2.199219";
        facts.chromaticities = chromaticities_of({0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.329});
      }
    }
  };
  const std::uint64_t first = base + number(base + (is_big_tiff ? 8 : 4), word);
  read_directory(first, read_directory, 0);
  if (base != 0 || facts.is_raw || !facts.refusal.empty())
    return;  // in a JPEG or PNG file, or read by LibRaw
  const std::uint64_t head = is_big_tiff ? 8 : 2, entry_bytes = is_big_tiff ? 20 : 12;
  const auto value_of = [&](std::uint64_t directory, std::uint64_t tag) -> std::optional<std::uint64_t> {
    for (std::uint64_t i = 0; i < std::min<std::uint64_t>(number(directory, static_cast<int>(head)), 4096);
         ++i)
      if (const std::uint64_t at = directory + head + i * entry_bytes; number(at, 2) == tag)
        return number(at + 4 + static_cast<std::uint64_t>(word), number(at + 2, 2) == 3 ? 2 : 4);
    return std::nullopt;
  };
  if (!value_of(first, 258))  // decoders take one bit for eight then
    facts.refusal = "states no number of bits (BitsPerSample), so that it has one; convert it to 8 bits";
  const std::uint64_t end = first + head + number(first, static_cast<int>(head)) * entry_bytes;
  const std::uint64_t next = number(end, word);
  const bool is_other = next != 0 && value_of(next, 254).value_or(0) == 0;  // no thumbnail, no mask
  if (is_other && value_of(first, 256) == value_of(next, 256) && value_of(first, 257) == value_of(next, 257))
    facts.refusal =
        "holds several images of one size (pages), such as a stack or separate channels; export each image "
        "as a file, colours together";
}

/// Segments up to the first scan: APP1 holds EXIF, APP2 the profile, perhaps in parts.
void read_jpeg(FileBytes& file, ImageFacts& facts) {
  std::map<std::uint64_t, std::string> parts;  // of the profile, by number: ICC.1:2010, B.4
  for (std::uint64_t at = 2; at + 4 < file.size();) {
    const std::uint64_t marker = file.number(at, 2, true), length = file.number(at + 2, 2, true);
    if (marker == 0xffff) {  // padding
      ++at;
      continue;
    }
    if (marker >> 8 != 0xff || marker == 0xffda || length < 2) break;
    if (is_jpeg_frame(marker) && file.number(at + 9, 1, true) == 4) facts.refusal = cmyk_refusal;
    if (marker == 0xfffe && file.text(at + 4, 9) == "CS=ITU601") facts.refusal = levels_refusal;  // FFmpeg
    if (marker == 0xffe1 && file.text(at + 4, 6) == "Exif\0\0"sv) read_tiff(file, at + 10, facts);
    if (marker == 0xffe2 && file.text(at + 4, 12) == "ICC_PROFILE\0"sv && length > 16)
      parts[file.number(at + 16, 1, true)] += file.text(at + 18, length - 16);
    at += 2 + length;
  }
  std::string profile;
  for (const auto& [number, part] : parts) profile += part;
  if (!profile.empty()) read_profile(profile, facts);
}

std::string inflated(const std::string& compressed) {
  std::string bytes(max_profile_bytes, '\0');
  uLongf size = bytes.size();
  if (uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size,
                 reinterpret_cast<const Bytef*>(compressed.data()), compressed.size()) != Z_OK)
    return {};
  bytes.resize(size);
  return bytes;
}

/// Of several chunks that state a curve, cICP counts first, then iCCP, sRGB, and gAMA with cHRM. Source: PNG,
/// third edition, section 4.3.
void read_png(FileBytes& file, ImageFacts& facts) {
  std::array<ImageFacts, 4> chunks;
  for (std::uint64_t at = 8; at + 12 <= file.size();) {
    const std::uint64_t length = file.number(at, 4, true), data = at + 8;
    const std::string name = file.text(at + 4, 4);
    if (name == "cICP") {  // ITU-T H.273, table 3
      const std::uint64_t primaries = file.number(data, 1, true), transfer = file.number(data + 1, 1, true);
      if (primaries == 9)
        chunks[0].chromaticities =
            chromaticities_of({0.708, 0.292, 0.17, 0.797, 0.131, 0.046, 0.3127, 0.329});
      if (primaries == 12)
        chunks[0].chromaticities = chromaticities_of({0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329});
      const bool is_known = primaries <= 2 || chunks[0].chromaticities;
      if (file.number(data + 3, 1, true) == 0) facts.refusal = levels_refusal;
      chunks[0].response = is_known && transfer == 13  ? "srgb"
                           : is_known && transfer == 8 ? "linear"
                                                       : "unknown";
    }
    if (name == "iCCP") {
      const std::string content = file.text(data, std::min(length, max_profile_bytes));
      if (const auto end = content.find('\0'); end != std::string::npos && end + 2 < content.size())
        read_profile(inflated(content.substr(end + 2)), chunks[1]);
    }
    if (name == "sRGB") chunks[2].response = "srgb";
    if (name == "gAMA") {
      const double gamma = 1e5 / static_cast<double>(std::max<std::uint64_t>(file.number(data, 4, true), 1));
      if (gamma >= 0.1 && gamma <= 10.0)  // else the chunk is invalid
        chunks[3].response = std::abs(gamma - 1.0) < 0.01 ? "linear" : "gamma:" + std::to_string(gamma);
    }
    if (name == "cHRM") {  // white first
      std::array<double, 8> xy{};
      for (std::size_t i = 0; i < xy.size(); ++i)
        xy[(i + 6) % 8] = static_cast<double>(file.number(data + 4 * i, 4, true)) / 1e5;
      chunks[3].chromaticities = chromaticities_of(xy);
    }
    if (name == "eXIf") read_tiff(file, data, facts);
    at = data + length + 4;
  }
  for (const ImageFacts& chunk : chunks) {
    if (chunk.response.empty() && !chunk.chromaticities) continue;
    facts.response = chunk.response;
    facts.chromaticities = chunk.chromaticities;
    break;
  }
}

}  // namespace

ImageFacts read_image_facts(const fs::path& path) {
  ImageFacts facts;
  const auto format = image_format(path);
  if (format == ImageFormat::exr) {
    for (const PromisedImage& part : read_exr_headers(path)) {
      if (part.chromaticities) facts.chromaticities = part.chromaticities;
      if (part.is_cube) facts.is_cube = part.is_cube;
    }
    return facts;
  }
  if (format == ImageFormat::hdr) {
    facts.chromaticities = read_radiance_header(path).primaries;
    return facts;
  }
  FileBytes file(path);
  if (format == ImageFormat::png) read_png(file, facts);
  if (format == ImageFormat::jpeg) read_jpeg(file, facts);
  if (format == ImageFormat::tiff) read_tiff(file, 0, facts);
  return facts;
}

Image upright(const Image& stored, int orientation) {
  Image image = stored;
  image.values = upright(stored.values, image.width, image.height, orientation);
  return image;
}

void linearise(Image& image, const std::string& response) {
  if (response == "linear") return;
  if (response.starts_with("gamma:")) {
    const float gamma = std::stof(response.substr(6));
    for (float& value : image.values) value = std::copysign(std::pow(std::abs(value), gamma), value);
  } else {
    std::ranges::transform(image.values, image.values.begin(), linear_from_srgb);
  }
}

}  // namespace refield
