// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/light_sources.h"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <map>
#include <sstream>

#include "acquire/light_probe/light_probe.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/units.h"
#include "core/session/capture_session.h"

namespace refield {

namespace {

constexpr const char* blanks = " \t\r\v\f";

/// A line that is not blank, without the spaces at its ends.
struct ListLine {
  int number = 0;  ///< from 1
  std::string text;
};

[[noreturn]] void refuse_line(const fs::path& file, int line, const std::string& what) {
  throw InputError(file, ":", line, ": ", what);
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
  if (lines.empty()) throw InputError(file, ": is empty; it should list the light sources");
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
    refuse_line(file, line, "'" + word + "' is not a finite number with a decimal point; correct it");
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

/// Reads directions or, where the object's position is known, positions.
struct DirectionReader {
  const fs::path& file;
  const std::optional<Eigen::Vector3d>& object;
  Deviations lengths{}, below{};
  std::vector<double> distances{};  // from the object, where its position is known

  /// Of three words, x right, y up, z towards the camera; converted to the axes of lat-long maps.
  Eigen::Vector3d read(int line, const std::string* words) {
    const Eigen::Vector3d given(finite_number(file, line, words[0]), finite_number(file, line, words[1]),
                                finite_number(file, line, words[2]));
    const Eigen::Vector3d towards = object ? given - *object : given;
    const double length = towards.norm();
    const std::string vector = words[0] + " " + words[1] + " " + words[2];
    if (!(length > 1e-12) || !std::isfinite(length))
      refuse_line(
          file, line,
          object ? "the light source " + vector + " is at the position of the object; correct one of them"
                 : "the direction " + vector +
                       " has no length; give the vector from the object to the light source");
    constexpr double rounding = 1e-3;  // lists are written with three digits and more
    if (object)
      distances.push_back(length);
    else if (std::abs(length - 1.0) > rounding)
      lengths.add(file, line, formatted("length %.4g", length));
    if (towards.z() < 0.0) below.add(file, line, formatted("z = %.4g", towards.z()));
    return Eigen::Vector3d(towards.x(), towards.y(), -towards.z()) / length;
  }

  void finish(LightStage& stage) const {
    if (object) weaken_with_distance(stage);
    if (lengths.count > 0)
      stage.notes.push_back(
          "light directions that were normalised: " + std::to_string(lengths.count) + lengths.first +
          "; for light sources at near positions, give the position of the object with --object-at");
    if (below.count > 0)
      stage.notes.push_back(
          "light sources behind the object, z < 0: " + std::to_string(below.count) + below.first +
          "; they are kept. If the z axis of the list points away from the camera, negate z");
  }

 private:
  /// Irradiance falls with the square of the distance; at the mean distance the intensity is the listed one.
  void weaken_with_distance(LightStage& stage) const {
    double mean = 0.0;
    for (const double distance : distances) mean += distance / static_cast<double>(distances.size());
    double weakest = 1.0, strongest = 1.0;
    for (std::size_t i = 0; i < distances.size(); ++i) {
      const double factor = std::pow(mean / distances[i], 2);
      weakest = std::min(weakest, factor);
      strongest = std::max(strongest, factor);
      for (float& value : stage.sources[i].intensity) value *= static_cast<float>(factor);
    }
    stage.notes.emplace_back(
        formatted("light sources at a mean distance of %.4g from the object, in the unit of the list; their "
                  "intensities are multiplied by (mean distance / distance)², %.3g to %.3g",
                  mean, weakest, strongest));
  }
};

/// Without folders, which are those of another computer: "C:\dome\img 01.jpg".
std::string file_name_of(const std::string& path) {
  return path.substr(path.find_last_of("/\\") + 1);
}

void require_count(const LightStage& stage, const std::vector<ListLine>& lines) {
  const int stated = *parsed<int>(lines.front().text);
  const auto listed = static_cast<int>(lines.size()) - 1;
  if (stated != listed || listed < 1)
    refuse_line(stage.file, lines.front().number,
                "states " + std::to_string(stated) + " light sources, but the file lists " +
                    std::to_string(listed) + "; correct the count, or add the missing lines");
}

void read_named_positions(LightStage& stage, const std::vector<ListLine>& lines,
                          DirectionReader& directions) {
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
}

/// Throws InputError unless `file` has one line per direction.
std::vector<ListLine> lines_beside(const LightStage& stage, const fs::path& file) {
  auto lines = lines_of(file);
  if (lines.size() != stage.sources.size())
    throw InputError(file, ": has ", lines.size(), " lines, ", stage.file, " has ", stage.sources.size(),
                     " directions; give one line per light source in each");
  return lines;
}

float positive_intensity(const fs::path& file, int line, const std::string& word) {
  const auto value = static_cast<float>(finite_number(file, line, word));
  if (!(value > 0.0f) || !std::isfinite(value))
    refuse_line(file, line,
                "the intensity " + word + " is not positive; correct it, or leave the light source out");
  return value;
}

void read_intensities(LightStage& stage, const fs::path& file) {
  const auto lines = lines_beside(stage, file);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const auto words = words_of(lines[i].text);
    if (words.size() != 3 && words.size() != 1)
      refuse_line(file, lines[i].number,
                  "'" + lines[i].text + "' is neither an intensity 'r g b' nor one value; correct the line");
    for (std::size_t c = 0; c < 3; ++c)
      stage.sources[i].intensity[c] =
          positive_intensity(file, lines[i].number, words[words.size() == 3 ? c : 0]);
  }
}

/// The file of that name, in small letters or others, in the folder of `file`.
fs::path beside(const fs::path& file, const std::string& name) {
  if (fs::exists(file.parent_path() / name)) return file.parent_path() / name;
  for (const fs::directory_entry& entry : fs::directory_iterator(fs::absolute(file).parent_path())) {
    if (lower_case(entry.path().filename()) == name) return file.parent_path() / entry.path().filename();
  }
  return file.parent_path() / name;
}

void read_directions(LightStage& stage, const std::vector<ListLine>& lines, DirectionReader& directions) {
  for (const auto& [number, text] : lines) {
    const auto words = words_of(text);
    if (words.size() != 3)
      refuse_line(stage.file, number, "'" + text + "' is not a direction 'x y z'; correct the line");
    stage.sources.push_back({number, "", directions.read(number, words.data())});
  }
  const fs::path names = beside(stage.file, "filenames.txt");
  const fs::path intensities = beside(stage.file, "light_intensities.txt");
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

/// Some programs write a list with its count but without names.
bool are_directions(std::span<const ListLine> lines) {
  return !lines.empty() && std::ranges::all_of(lines, [](const ListLine& line) {
    const auto words = words_of(line.text);
    return words.size() == 3 && parsed<double>(words[0]);
  });
}

void read_counted(LightStage& stage, std::vector<ListLine> lines, DirectionReader& directions) {
  require_count(stage, lines);
  if (!are_directions(std::span(lines).subspan(1))) return read_named_positions(stage, lines, directions);
  lines.erase(lines.begin());
  read_directions(stage, lines, directions);
}

/// Fields of a line, without spaces around them; a field in double quotes may hold the separator.
std::vector<std::string> fields_of(const std::string& text, char separator) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (const char character : text) {
    if (character == '"')
      quoted = !quoted;
    else if (character == separator && !quoted)
      fields.emplace_back();
    else
      fields.back() += character;
  }
  for (std::string& field : fields) {
    field.erase(0, std::min(field.find_first_not_of(blanks), field.size()));
    field.erase(field.find_last_not_of(blanks) + 1);
  }
  return fields;
}

/// The separator of a table whose first line names the columns, if that is what the line is.
std::optional<char> separator_of(const std::string& header) {
  for (const char separator : {',', ';', '\t'}) {
    const auto names = fields_of(header, separator);
    if (std::ranges::count(names, "x") == 1 && std::ranges::count(names, "y") == 1 &&
        std::ranges::count(names, "z") == 1)
      return separator;
  }
  return std::nullopt;
}

void read_table(LightStage& stage, const std::vector<ListLine>& lines, char separator,
                DirectionReader& directions) {
  const ListLine& header = lines.front();
  const auto names = fields_of(header.text, separator);
  const auto column_of = [&](const char* name) {
    return static_cast<std::size_t>(std::ranges::find(names, name) - names.begin());
  };
  const std::size_t file = column_of("file");
  if (file == names.size())
    refuse_line(stage.file, header.number,
                "'" + header.text +
                    "' has no column 'file'; name the columns file, x, y, z and, for intensities, r, g, b");
  const std::array<std::size_t, 3> place = {column_of("x"), column_of("y"), column_of("z")};
  const std::array<std::size_t, 3> colour = {column_of("r"), column_of("g"), column_of("b")};
  const auto colours = std::ranges::count_if(colour, [&](std::size_t c) { return c < names.size(); });
  if (colours != 0 && colours != 3)
    refuse_line(stage.file, header.number,
                "'" + header.text + "' has only some of the columns r, g and b; give all three or none");
  std::string unused;
  for (std::size_t c = 0; c < names.size(); ++c)
    if (c != file && std::ranges::find(place, c) == place.end() &&
        std::ranges::find(colour, c) == colour.end())
      unused += (unused.empty() ? "'" : ", '") + names[c] + "'";
  if (!unused.empty())
    stage.notes.push_back("columns of " + stage.file.string() + " that are ignored: " + unused +
                          "; intensities are the columns r, g and b");
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto& [number, text] = lines[i];
    const auto fields = fields_of(text, separator);
    if (fields.size() != names.size())
      refuse_line(stage.file, number,
                  "'" + text + "' has " + std::to_string(fields.size()) + " fields, the first line names " +
                      std::to_string(names.size()) + " columns; correct the line");
    if (fields[file].empty())
      refuse_line(stage.file, number, "names no file; name the photograph of the light source");
    const std::array<std::string, 3> position = {fields[place[0]], fields[place[1]], fields[place[2]]};
    LightSource source;
    source.line = number;
    source.photograph = file_name_of(fields[file]);
    source.direction = directions.read(number, position.data());
    for (std::size_t c = 0; colours == 3 && c < 3; ++c)
      source.intensity[c] = positive_intensity(stage.file, number, fields[colour[c]]);
    stage.sources.push_back(source);
  }
  if (stage.sources.empty())
    refuse_line(stage.file, header.number, "no light source follows; add one line for each");
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
  const std::string angle = formatted("%.3g°", degrees_between(first, second));
  if (stage.file.empty())
    throw InputError(second.photograph, ": the light source is ", angle, " from that of ", first.photograph,
                     ", too close to have a texel of its own; leave out one of the two photographs");
  refuse_line(stage.file, second.line,
              "the light source is " + angle + " from that of line " + std::to_string(first.line) +
                  ", too close to have a texel of its own; correct the direction, or remove one of the two");
}

/// Rays of a camera at this distance, in radii of the ball, are parallel.
constexpr double far_away = 1e4;
/// The outermost pixels show light from behind the ball, and are partly the background.
constexpr double ball_rim_px = 1.0;

std::string position_text(const Eigen::Vector2d& point) {
  return std::to_string(std::lround(point.x())) + "," + std::to_string(std::lround(point.y()));
}

/// Brightness of the pixels on the ball, zero elsewhere.
cv::Mat1f brightness_on(const MirrorBall& ball, const Image& photograph) {
  cv::Mat1f brightness = cv::Mat1f::zeros(photograph.height, photograph.width);
  const Eigen::Vector2d centre = ball.centre_px();
  const double radius = ball.radius_px() - ball_rim_px;
  const int first = std::max(0, static_cast<int>(centre.y() - radius));
  const int last = std::min(photograph.height, static_cast<int>(centre.y() + radius) + 1);
  for (int y = first; y < last; ++y)
    for (int x = 0; x < photograph.width; ++x) {
      if ((Eigen::Vector2d(x + 0.5, y + 0.5) - centre).norm() > radius) continue;
      const float value = (photograph.at(x, y, 0) + photograph.at(x, y, 1) + photograph.at(x, y, 2)) / 3.0f;
      brightness(y, x) = std::max(value, 1e-30f);  // negative after subtraction of the ambient light
    }
  return brightness;
}

}  // namespace

void place_sources(LightStage& stage) {
  constexpr double same = 0.1;  // degrees; directions are rarely measured better
  for (std::size_t b = 0; b < stage.sources.size(); ++b)
    for (std::size_t a = 0; a < b; ++a)
      if (degrees_between(stage.sources[a], stage.sources[b]) < same)
        refuse_pair(stage, stage.sources[a], stage.sources[b]);
  // 1.4° and 0.35° per texel. Directions are rounded to texels: at 5.6°, the error of interpolation between
  // the 96 sources of a light stage 6° apart was 26 % larger than with the exact directions, at 1.4° 4 %.
  constexpr int lowest = 128, highest = 512;
  auto shared = sources_in_one_texel(stage, lowest);
  for (int height = 2 * lowest; shared && height <= highest; height *= 2)
    shared = sources_in_one_texel(stage, height);
  if (shared) refuse_pair(stage, stage.sources[shared->first], stage.sources[shared->second]);
  stage.notes.push_back(std::to_string(stage.sources.size()) +
                        " light sources, one texel each in lat-long maps of " +
                        std::to_string(stage.domain.width) + "×" + std::to_string(stage.domain.height));
  if (stage.sources.size() > max_single_light_cells)
    stage.notes.push_back("there are more than " + std::to_string(max_single_light_cells) +
                          " light sources, so 'refield estimate' does not give each a weight of its own: it "
                          "fits rectangles over several of them, which is less accurate");
}

LightStage read_light_stage(const fs::path& file, const std::optional<Eigen::Vector3d>& object) {
  LightStage stage;
  stage.file = file;
  const auto lines = lines_of(file);
  const auto first = words_of(lines.front().text);
  DirectionReader directions{stage.file, object};
  if (const auto separator = separator_of(lines.front().text))
    read_table(stage, lines, *separator, directions);
  else if (first.size() == 1 && parsed<int>(first[0]))
    read_counted(stage, lines, directions);
  else if (first.size() == 3 && parsed<double>(first[0]))
    read_directions(stage, lines, directions);
  else
    refuse_line(file, lines.front().number,
                "'" + lines.front().text +
                    "' is neither the number of light sources, with which a .lp file begins, nor a direction "
                    "'x y z', nor the names of columns 'file,x,y,z'; add or correct that line");
  directions.finish(stage);
  require_different_names(stage);
  place_sources(stage);
  return stage;
}

Image light_map_of(const LightStage& stage, std::size_t source) {
  Image map(stage.domain.width, stage.domain.height, 3);
  const LightSource& lit = stage.sources.at(source);
  const double solid_angle = lat_long_solid_angle(lit.row, stage.domain.width, stage.domain.height);
  for (std::size_t c = 0; c < 3; ++c)
    map.at(lit.column, lit.row, static_cast<int>(c)) = static_cast<float>(lit.intensity[c] / solid_angle);
  return map;
}

MirrorBall locate_ball(const ChromeBall& ball, const Image& mean) {
  const auto& view = ball.field_of_view_degrees;
  const ProbeOptics optics = view ? ProbeOptics::of_view(*view, mean.width, mean.height)
                                  : ProbeOptics{{}, far_away, Eigen::Vector2d(mean.width, mean.height) / 2.0};
  MirrorBall located = ball.circle ? ball_from_circle(*ball.circle, optics) : find_ball(mean, optics).ball;
  require_usable(located, mean.width, mean.height, "the photographs");
  return located;
}

Eigen::Vector3d light_direction(const Image& photograph, const MirrorBall& ball) {
  const cv::Mat1f brightness = brightness_on(ball, photograph);
  std::vector<float> values;
  for (const float value : brightness)
    if (value > 0.0f) values.push_back(value);
  const auto largest = static_cast<float>(quantile(values, 1.0));
  const auto room = static_cast<float>(quantile(values, 0.5));
  constexpr float least_contrast = 3.0f;
  if (!(largest > least_contrast * room))
    throw InputError("the ball at ", position_text(ball.centre_px()),
                     " shows no highlight; check --ball, or leave the photograph out");
  cv::Mat1b bright = (brightness > 0.25f * largest) / 255;
  // A small highlight is partly in the pixels around it.
  cv::dilate(bright, bright, {});
  cv::Mat1i label;
  const int count = cv::connectedComponents(bright, label, 8, CV_32S);
  std::vector<double> total(static_cast<std::size_t>(count), 0.0);
  std::vector<Eigen::Vector2d> centroid(total.size(), Eigen::Vector2d::Zero());
  for (int y = 0; y < label.rows; ++y)
    for (int x = 0; x < label.cols; ++x) {
      const auto region = static_cast<std::size_t>(label(y, x));
      const double excess = brightness(y, x) - room;
      if (region == 0 || !(excess > 0.0)) continue;
      total[region] += excess;
      centroid[region] += excess * Eigen::Vector2d(x + 0.5, y + 0.5);
    }
  for (std::size_t region = 1; region < total.size(); ++region) centroid[region] /= total[region];
  const auto brightest = static_cast<std::size_t>(std::ranges::max_element(total) - total.begin());
  constexpr double similar = 0.3;  // windows and reflections in the object are weaker
  for (std::size_t region = 1; region < total.size(); ++region)
    if (region != brightest && total[region] > similar * total[brightest])
      throw InputError("the ball shows two highlights, at ", position_text(centroid[brightest]), " and ",
                       position_text(centroid[region]),
                       "; photograph under one light source at a time, subtract the ambient light "
                       "(--ambient), or leave the photograph out");
  return ball.reflect(centroid[brightest])->direction;
}

}  // namespace refield
