// SPDX-License-Identifier: Apache-2.0

#include <Eigen/LU>

#include <cmath>
#include <cstdio>

#include "core/base/files.h"
#include "core/image/image_facts.h"
#include "core/image/image_header.h"

namespace refield {

namespace {

/// "-Y 16 +X 32": the slower axis first; a minus sign says that it begins at the top or at the right.
void read_resolution(const std::string& line, RadianceHeader& header, const fs::path& path) {
  char sign[2] = {}, axis[2] = {};
  int size[2] = {};
  if (std::sscanf(line.c_str(), "%c%c %9d %c%c %9d", &sign[0], &axis[0], &size[0], &sign[1], &axis[1],
                  &size[1]) != 6 ||
      axis[0] + axis[1] != 'X' + 'Y' || (axis[0] != 'X' && axis[0] != 'Y'))
    throw FormatError(path, "states no resolution; the file is damaged or truncated");
  const bool by_rows = axis[0] == 'Y';
  const bool from_top = sign[by_rows ? 0 : 1] == '-', from_left = sign[by_rows ? 1 : 0] == '+';
  header.width = size[by_rows ? 1 : 0];
  header.height = size[by_rows ? 0 : 1];
  header.orientation = by_rows ? (from_top ? (from_left ? 1 : 2) : (from_left ? 4 : 3))
                               : (from_top ? (from_left ? 5 : 6) : (from_left ? 8 : 7));
}

RadianceHeader header_of(const std::string& bytes, const fs::path& path) {
  RadianceHeader header;
  for (std::size_t at = 0, lines = 0;; ++lines) {
    const std::size_t end = bytes.find('\n', at);
    if (end == std::string::npos)
      throw FormatError(path, "ends within its header; the file is damaged or truncated");
    std::string line = bytes.substr(at, end - at);
    if (line.ends_with('\r')) line.pop_back();
    at = end + 1;
    if (lines > 0 && line.empty()) {
      const std::size_t last = bytes.find('\n', at);
      read_resolution(bytes.substr(at, last == std::string::npos ? last : last - at), header, path);
      header.data = last == std::string::npos ? bytes.size() : last + 1;
      return header;
    }
    double v[8] = {};
    const char* text = line.c_str();
    if (line.starts_with("FORMAT=")) {
      const std::string kind = line.substr(std::min(line.find_first_not_of(" \t", 7), line.size()));
      header.is_xyz = kind.starts_with("32-bit_rle_xyze");
      if (!header.is_xyz && !kind.starts_with("32-bit_rle_rgbe"))
        throw FormatError(path, "has pixels of the kind '", kind, "'; convert it to OpenEXR");
    } else if (std::sscanf(text, "GAMMA=%lf", &v[0]) == 1 && v[0] != 1.0) {
      throw FormatError(path, "states '", line,
                        "', pixels that are not linear; convert it to linear OpenEXR");
    } else if (std::sscanf(text, "EXPOSURE=%lf", &v[0]) == 1) {
      for (double& divisor : header.divisor) divisor *= v[0];
    } else if (std::sscanf(text, "COLORCORR=%lf %lf %lf", &v[0], &v[1], &v[2]) == 3) {
      for (std::size_t c = 0; c < 3; ++c) header.divisor[c] *= v[c];
    } else if (std::sscanf(text, "PRIMARIES=%lf %lf %lf %lf %lf %lf %lf %lf", &v[0], &v[1], &v[2], &v[3],
                           &v[4], &v[5], &v[6], &v[7]) == 8) {
      auto& xy = header.primaries.emplace();
      for (std::size_t i = 0; i < xy.size(); ++i) xy[i] = {v[2 * i], v[2 * i + 1]};
    }
    for (const double divisor : header.divisor)
      if (!(divisor > 0.0) || !std::isfinite(divisor))
        throw FormatError(path, "states '", line, "', which is not above zero; correct its header");
  }
}

/// Scan lines of red, green, blue and exponent.
class ScanLines {
 public:
  ScanLines(const std::string& bytes, std::size_t at, const fs::path& path)
      : bytes_(bytes), at_(at), path_(path) {}

  void read(std::vector<std::uint8_t>& line, int row) {
    row_ = row;
    const std::size_t width = line.size() / 4;
    constexpr std::size_t min_width = 8, max_width = 0x7fff;  // of the newer compression
    if (width >= min_width && width <= max_width && at_ + 4 <= bytes_.size() && at(0) == 2 && at(1) == 2 &&
        at(2) < 128) {
      if (static_cast<std::size_t>(at(2) << 8 | at(3)) != width) fail();
      at_ += 4;
      for (std::size_t channel = 0; channel < 4; ++channel) read_channel(line, channel);
    } else {
      read_pixels(line);
    }
  }

 private:
  [[noreturn]] void fail() const {
    throw FormatError(path_, at_,
                      "row " + std::to_string(row_) +
                          " ends too early or too late; the file is damaged or truncated: copy it again");
  }
  std::uint8_t at(std::size_t offset) const { return static_cast<std::uint8_t>(bytes_[at_ + offset]); }
  std::uint8_t next() {
    if (at_ >= bytes_.size()) fail();
    return static_cast<std::uint8_t>(bytes_[at_++]);
  }

  void read_channel(std::vector<std::uint8_t>& line, std::size_t channel) {
    for (std::size_t x = 0; x < line.size() / 4;) {
      std::size_t count = next();
      const bool is_run = count > 128;
      if (is_run) count -= 128;
      if (count == 0 || x + count > line.size() / 4) fail();
      std::uint8_t value = is_run ? next() : 0;
      for (; count > 0; --count, ++x) line[4 * x + channel] = is_run ? value : next();
    }
  }

  /// Flat pixels, or the older compression: 1, 1, 1, n repeats the pixel before n times; of several such
  /// marks in succession, each counts 256 times as much as the one before.
  void read_pixels(std::vector<std::uint8_t>& line) {
    int shift = 0;
    for (std::size_t x = 0; x < line.size() / 4;) {
      const std::array<std::uint8_t, 4> pixel = {next(), next(), next(), next()};
      if (pixel[0] == 1 && pixel[1] == 1 && pixel[2] == 1) {
        if (x == 0 || shift > 16) fail();
        const std::size_t count = static_cast<std::size_t>(pixel[3]) << shift;
        if (x + count > line.size() / 4) fail();
        for (std::size_t i = 0; i < 4 * count; ++i) line[4 * x + i] = line[4 * x + i - 4];
        x += count;
        shift += 8;
      } else {
        std::copy(pixel.begin(), pixel.end(), &line[4 * x]);
        ++x;
        shift = 0;
      }
    }
  }

  const std::string& bytes_;
  std::size_t at_;
  const fs::path& path_;
  int row_ = 0;
};

}  // namespace

RadianceHeader read_radiance_header(const fs::path& path) {
  constexpr std::size_t longest = 1 << 16;  // pictures of Radiance list the commands that made them
  std::ifstream file(path, std::ios::binary);
  std::string bytes(longest, '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  RadianceHeader header = header_of(bytes, path);
  require_plausible({header.width, header.height, 3}, path);
  return header;
}

Image read_radiance(const fs::path& path) {
  const std::string bytes = read_text(path);
  const RadianceHeader header = header_of(bytes, path);
  require_plausible({header.width, header.height, 3}, path);
  std::array<double, 256> scale{};
  for (int exponent = 1; exponent < 256; ++exponent)
    scale[static_cast<std::size_t>(exponent)] = std::ldexp(1.0, exponent - 136);
  const bool is_transposed = header.orientation >= 5;
  Image stored(is_transposed ? header.height : header.width, is_transposed ? header.width : header.height, 3);
  ScanLines lines(bytes, header.data, path);
  std::vector<std::uint8_t> line(static_cast<std::size_t>(stored.width) * 4);
  for (int y = 0; y < stored.height; ++y) {
    lines.read(line, y);
    for (int x = 0; x < stored.width; ++x) {
      const std::uint8_t* pixel = &line[static_cast<std::size_t>(x) * 4];
      for (int c = 0; c < 3; ++c)
        stored.at(x, y, c) =
            static_cast<float>(pixel[c] * scale[pixel[3]] / header.divisor[static_cast<std::size_t>(c)]);
    }
  }
  if (header.is_xyz) convert_colours(stored, xyz_from_rgb(rec709_chromaticities()).inverse().cast<float>());
  return upright(stored, header.orientation);
}

}  // namespace refield
