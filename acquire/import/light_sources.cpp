// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/light_sources.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <sstream>
#include <string_view>
#include <utility>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/units.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr const char* blanks = " \t\r\v\f";

/// A line that is not blank, without the spaces at its ends.
struct ListLine {
  int number = 0;  ///< from 1
  std::string text;
};

[[noreturn]] void refuse_line(const fs::path& file, int line, const std::string& what) {
  throw InputError(file.string() + ":" + std::to_string(line) + ": " + what);
}

std::vector<ListLine> lines_of(const fs::path& file) {
  std::istringstream text(read_text(file));
  std::vector<ListLine> lines;
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (number == 1 && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    const auto first = line.find_first_not_of(blanks);
    if (first == std::string::npos) continue;
    lines.push_back({number, line.substr(first, line.find_last_not_of(blanks) + 1 - first)});
  }
  if (lines.empty()) throw InputError(file.string() + ": is empty; it should list the light sources");
  return lines;
}

std::vector<std::string> words_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

/// A whole word as a number, which may be NaN or infinite and may have a plus sign.
template <class Number>
std::optional<Number> parsed(std::string_view word) {
  return number_from_text<Number>(word.substr(word.starts_with('+') ? 1 : 0));
}

double finite_number(const fs::path& file, int line, const std::string& word) {
  const auto value = parsed<double>(word);
  if (!value || !std::isfinite(*value))
    refuse_line(file, line, "'" + word + "' is not a finite number; correct the value");
  return *value;
}

/// What directions should be but need not: kept to report each kind once, with its first line.
struct Deviations {
  int count = 0;
  std::string first;

  void add(const fs::path& file, int line, const std::string& value) {
    if (count++ == 0)
      first = " (first: " + file.filename().string() + ":" + std::to_string(line) + ", " + value + ")";
  }
};

struct DirectionReader {
  const fs::path& file;
  Deviations lengths, below{};

  /// Of three words, x right, y up, z towards the camera; converted to the axes of lat-long maps.
  Eigen::Vector3d read(int line, const std::string* words) {
    const Eigen::Vector3d given(finite_number(file, line, words[0]), finite_number(file, line, words[1]),
                                finite_number(file, line, words[2]));
    const double length = given.norm();
    if (!(length > 1e-12) || !std::isfinite(length))
      refuse_line(file, line,
                  "the direction " + words[0] + " " + words[1] + " " + words[2] +
                      " has no length; give the vector from the object to the light source");
    constexpr double rounding = 1e-3;  // lists are written with three digits and more
    char text[64];
    std::snprintf(text, sizeof text, "length %.4g", length);
    if (std::abs(length - 1.0) > rounding) lengths.add(file, line, text);
    if (given.z() < 0.0) below.add(file, line, "z = " + words[2]);
    return Eigen::Vector3d(given.x(), given.y(), -given.z()) / length;
  }

  void report(std::vector<std::string>& notes) const {
    if (lengths.count > 0)
      notes.push_back("light directions that were normalised: " + std::to_string(lengths.count) +
                      lengths.first + "; positions of near light sources are reduced to directions");
    if (below.count > 0)
      notes.push_back("light sources behind the object, z < 0: " + std::to_string(below.count) + below.first +
                      "; they are kept. If the z axis of the list points away from the camera, negate z");
  }
};

/// Without folders, which are those of another computer: "C:\dome\img 01.jpg".
std::string file_name_of(const std::string& path) {
  return path.substr(path.find_last_of("/\\") + 1);
}

void read_named_positions(LightStage& stage, const std::vector<ListLine>& lines) {
  const int stated = *parsed<int>(lines.front().text);
  const auto listed = static_cast<int>(lines.size()) - 1;
  if (stated != listed || listed < 1)
    refuse_line(stage.file, lines.front().number,
                "states " + std::to_string(stated) + " light sources, but the file lists " +
                    std::to_string(listed) + "; correct the count, or add the missing lines");
  DirectionReader directions{stage.file, {}, {}};
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto& [number, text] = lines[i];
    const auto words = words_of(text);
    if (words.size() < 4)
      refuse_line(stage.file, number, "'" + text + "' is not 'name x y z'; complete the line");
    const std::string* last = words.data() + words.size() - 3;
    // Names may contain spaces.
    std::string name = text;
    for (int word = 0; word < 3; ++word) {
      name.erase(name.find_last_of(blanks));
      name.erase(name.find_last_not_of(blanks) + 1);
    }
    stage.sources.push_back({number, file_name_of(name), directions.read(number, last)});
  }
  directions.report(stage.notes);
}

/// Throws InputError unless `file` has one line per direction.
std::vector<ListLine> lines_beside(const LightStage& stage, const fs::path& file) {
  auto lines = lines_of(file);
  if (lines.size() != stage.sources.size())
    throw InputError(file.string() + ": has " + std::to_string(lines.size()) + " lines, " +
                     stage.file.string() + " has " + std::to_string(stage.sources.size()) +
                     " directions; give one line per light source in each");
  return lines;
}

void read_intensities(LightStage& stage, const fs::path& file) {
  const auto lines = lines_beside(stage, file);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const auto words = words_of(lines[i].text);
    if (words.size() != 3 && words.size() != 1)
      refuse_line(file, lines[i].number,
                  "'" + lines[i].text + "' is neither an intensity 'r g b' nor one value; correct the line");
    for (std::size_t c = 0; c < 3; ++c) {
      const std::string& word = words[words.size() == 3 ? c : 0];
      const auto value = static_cast<float>(finite_number(file, lines[i].number, word));
      if (!(value > 0.0f) || !std::isfinite(value))
        refuse_line(file, lines[i].number,
                    "the intensity " + word + " is not positive; correct it, or leave the light source out");
      stage.sources[i].intensity[c] = value;
    }
  }
}

void read_directions(LightStage& stage, const std::vector<ListLine>& lines) {
  DirectionReader directions{stage.file, {}, {}};
  for (const auto& [number, text] : lines) {
    const auto words = words_of(text);
    if (words.size() != 3)
      refuse_line(stage.file, number, "'" + text + "' is not a direction 'x y z'; correct the line");
    stage.sources.push_back({number, "", directions.read(number, words.data())});
  }
  directions.report(stage.notes);
  const fs::path names = stage.file.parent_path() / "filenames.txt";
  const fs::path intensities = stage.file.parent_path() / "light_intensities.txt";
  if (fs::exists(names)) {
    const auto name_lines = lines_beside(stage, names);
    for (std::size_t i = 0; i < name_lines.size(); ++i)
      stage.sources[i].photograph = file_name_of(name_lines[i].text);
  } else {
    stage.notes.push_back(names.string() +
                          " does not exist; the photographs are assigned in the order of names");
  }
  if (fs::exists(intensities))
    read_intensities(stage, intensities);
  else
    stage.notes.push_back(intensities.string() + " does not exist; all light sources have intensity 1");
}

void require_different_names(const LightStage& stage) {
  std::map<std::string, int> seen;
  for (const LightSource& source : stage.sources) {
    const auto [found, is_new] = seen.emplace(source.photograph, source.line);
    if (!source.photograph.empty() && !is_new)
      refuse_line(stage.file, source.line,
                  "'" + source.photograph + "' also belongs to the light source of line " +
                      std::to_string(found->second) + "; give each light source a photograph of its own");
  }
}

/// Gives each source its texel in a map of that height. Two sources that share one, if any.
std::optional<std::pair<std::size_t, std::size_t>> sources_in_one_texel(LightStage& stage, int height) {
  stage.domain = {2 * height, height, Parameterisation::lat_long};
  std::map<std::pair<int, int>, std::size_t> taken;
  for (std::size_t i = 0; i < stage.sources.size(); ++i) {
    LightSource& source = stage.sources[i];
    const Eigen::Vector2d at = lat_long_position(source.direction, stage.domain.width, height);
    source.column = std::min(static_cast<int>(at.x()), stage.domain.width - 1);
    source.row = std::min(static_cast<int>(at.y()), height - 1);
    const auto [found, is_new] = taken.emplace(std::pair(source.column, source.row), i);
    if (!is_new) return std::pair(found->second, i);
  }
  return std::nullopt;
}

double degrees_between(const LightSource& a, const LightSource& b) {
  return degrees_from_radians(
      std::atan2(a.direction.cross(b.direction).norm(), a.direction.dot(b.direction)));
}

[[noreturn]] void refuse_pair(const LightStage& stage, const LightSource& first, const LightSource& second) {
  char angle[64];
  std::snprintf(angle, sizeof angle, "%.3g°", degrees_between(first, second));
  refuse_line(stage.file, second.line,
              std::string("the light source is ") + angle + " from that of line " +
                  std::to_string(first.line) +
                  ", too close to have a texel of its own; correct the direction, or remove one of the two");
}

void place_sources(LightStage& stage) {
  constexpr double same = 0.1;  // degrees; directions are rarely measured better
  for (std::size_t b = 0; b < stage.sources.size(); ++b)
    for (std::size_t a = 0; a < b; ++a)
      if (degrees_between(stage.sources[a], stage.sources[b]) < same)
        refuse_pair(stage, stage.sources[a], stage.sources[b]);
  constexpr int lowest = 32, highest = 512;  // 5.6° and 0.35° per texel
  auto shared = sources_in_one_texel(stage, lowest);
  for (int height = 2 * lowest; shared && height <= highest; height *= 2)
    shared = sources_in_one_texel(stage, height);
  if (shared) refuse_pair(stage, stage.sources[shared->first], stage.sources[shared->second]);
  stage.notes.push_back(std::to_string(stage.sources.size()) +
                        " light sources, one texel each in lat-long maps of " +
                        std::to_string(stage.domain.width) + "×" + std::to_string(stage.domain.height));
}

}  // namespace

LightStage read_light_stage(const fs::path& file) {
  LightStage stage;
  stage.file = file;
  const auto lines = lines_of(file);
  const auto first = words_of(lines.front().text);
  if (first.size() == 1 && parsed<int>(first[0]))
    read_named_positions(stage, lines);
  else if (first.size() == 3 && parsed<double>(first[0]))
    read_directions(stage, lines);
  else
    refuse_line(file, lines.front().number,
                "'" + lines.front().text +
                    "' is neither the number of light sources, with which a .lp file begins, nor a direction "
                    "'x y z'; add or correct that line");
  require_different_names(stage);
  place_sources(stage);
  return stage;
}

Image light_map_of(const LightStage& stage, std::size_t source) {
  Image map(stage.domain.width, stage.domain.height, 3);
  const LightSource& lit = stage.sources.at(source);
  for (int c = 0; c < 3; ++c) map.at(lit.column, lit.row, c) = lit.intensity[static_cast<std::size_t>(c)];
  return map;
}

}  // namespace refield
