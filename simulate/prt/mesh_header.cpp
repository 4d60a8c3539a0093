// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/mesh_header.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <sstream>

#include "core/errors.h"

namespace refield::prt {

namespace fs = std::filesystem;

namespace {

/// The first lines of a file; a binary one's rest is cut off.
std::istringstream begin_of(const fs::path& path) {
  constexpr std::size_t longest = std::size_t{1} << 16;
  std::string text(std::min<std::uintmax_t>(longest, fs::file_size(path)), '\0');
  std::ifstream(path, std::ios::binary).read(text.data(), static_cast<std::streamsize>(text.size()));
  return std::istringstream(text);
}

void require_room(const fs::path& path, const char* what, double count, std::uint64_t least_bytes) {
  const auto bytes = static_cast<double>(fs::file_size(path));
  if (count * static_cast<double>(least_bytes) <= bytes) return;
  std::ostringstream message;
  message.precision(12);
  message << "promises " << count << ' ' << what << ", but a file of " << bytes
          << " bytes cannot hold so many; it is damaged or cut off";
  throw FormatError(path, message.str());
}

void check_off(const fs::path& path) {
  std::istringstream text = begin_of(path);
  std::string line;
  std::getline(text, line);  // OFF, COFF, …, or with the counts in the same line
  const auto is_blank = [](const std::string& l) {
    return l.find_first_not_of(" \t\r") == std::string::npos || l.starts_with('#');
  };
  while (std::getline(text, line) && is_blank(line)) {
  }
  double vertices = 0.0, faces = 0.0;
  if (!(std::istringstream(line) >> vertices >> faces)) return;
  require_room(path, "vertices", vertices, 6);  // "0 0 0\n"
  require_room(path, "faces", faces, 4);
}

void check_ply(const fs::path& path) {
  std::istringstream text = begin_of(path);
  std::string line;
  bool ends = false;
  while (!ends && std::getline(text, line)) {
    ends = line.starts_with("end_header");
    std::istringstream words(line);
    std::string element, name;
    double count = 0.0;
    if (words >> element >> name >> count && element == "element")
      require_room(path, name == "vertex" ? "vertices" : "elements", count, name == "vertex" ? 3 : 1);
  }
  // The library would look for it for ever.
  if (!ends) throw FormatError(path, "its header does not end; it is damaged or no PLY file");
}

}  // namespace

void check_mesh_header(const fs::path& path, const std::string& format) {
  if (format == "off") check_off(path);
  if (format == "ply") check_ply(path);
}

}  // namespace refield::prt
