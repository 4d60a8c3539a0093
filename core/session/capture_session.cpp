// SPDX-License-Identifier: Apache-2.0
#include "core/session/capture_session.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <Eigen/LU>
#include <cmath>
#include <sstream>

#include "core/base/config_file.h"
#include "core/base/files.h"
#include "core/image/image_header.h"
#include "core/image/image_io.h"
#include "core/light/light_map.h"

namespace refield {

namespace {

constexpr const char* format_name = "refield capture session";
constexpr int format_version = 1;

toml::array tables_of(const std::vector<MonitorPlacement>& monitors) {
  toml::array tables;
  for (const MonitorPlacement& m : monitors)
    tables.push_back(toml::table{{"width_mm", m.width_mm},
                                 {"height_mm", m.height_mm},
                                 {"distance_mm", m.distance_mm},
                                 {"yaw_degrees", m.turn.yaw},
                                 {"pitch_degrees", m.turn.pitch},
                                 {"roll_degrees", m.turn.roll},
                                 {"offset_x_mm", m.offset_x_mm},
                                 {"offset_y_mm", m.offset_y_mm}});
  return tables;
}

constexpr int max_size = std::numeric_limits<int>::max();

/// Throws InputError when the file under `key` is missing.
fs::path existing_file(ConfigSection& section, const char* key, const fs::path& folder) {
  std::string name;
  section.text(key, name);
  if (!fs::is_regular_file(folder / name))
    section.fail(key, "this file of " + folder.string() + " is missing; restore it, or resume the capture");
  return folder / name;
}

toml::table table_of(const CameraColour& colour) {
  toml::array matrix;
  for (int i = 0; i < 9; ++i) matrix.push_back(colour.rec709_from_camera(i / 3, i % 3));
  return toml::table{{"rec709_from_camera", matrix},
                     {"chart", colour.chart},
                     {"delta_e_2000_median", colour.median_delta_e},
                     {"delta_e_2000_largest", colour.largest_delta_e}};
}

CameraColour read_colour(ConfigSection table) {
  constexpr double largest_element = 1e3;
  CameraColour colour;
  table.require("rec709_from_camera");
  std::vector<double> numbers;
  table.numbers("rec709_from_camera", numbers, -largest_element, largest_element);
  if (numbers.size() != 9) table.fail("rec709_from_camera", "is not 9 numbers, row by row");
  for (int i = 0; i < 9; ++i) colour.rec709_from_camera(i / 3, i % 3) = numbers[i];
  if (std::abs(colour.rec709_from_camera.determinant()) < 1e-9)
    table.fail("rec709_from_camera", "maps different colours to one (its determinant is 0)");
  table.text("chart", colour.chart, true);
  table.number("delta_e_2000_median", colour.median_delta_e, 0.0, ConfigSection::unlimited);
  table.number("delta_e_2000_largest", colour.largest_delta_e, 0.0, ConfigSection::unlimited);
  table.finish();
  return colour;
}

void read_camera(ConfigSection camera, CaptureSession& session) {
  for (const char* key : {"width", "height"}) camera.require(key);
  camera.integer("width", session.width, 1, max_size);
  camera.integer("height", session.height, 1, max_size);
  if (auto colour = camera.table("colour")) session.colour = read_colour(std::move(*colour));
  camera.finish();
}

void read_light_domain(ConfigSection light, CaptureSession& session) {
  for (const char* key : {"width", "height", "parameterisation"}) light.require(key);
  light.integer("width", session.light.width, 1, max_size);
  light.integer("height", session.light.height, 1, max_size);
  light.enumerator("parameterisation", session.light.parameterisation, Parameterisation::monitor,
                   Parameterisation::lat_long, Parameterisation::cube);
  for (ConfigSection& table : light.tables("monitor")) {
    table.require("width_mm");
    read_placement(table, session.monitors.emplace_back());
    table.finish();
  }
  light.finish();
  check_placements(session.monitors, session.light,
                   (session.folder / session_manifest_name).string() + ": [[light.monitor]]");
}

CaptureFrame read_frame(ConfigSection& entry, const CaptureSession& session) {
  for (const char* key : {"name", "role", "illumination", "observed"}) entry.require(key);
  CaptureFrame frame;
  entry.text("name", frame.name);
  entry.enumerator("role", frame.role, FrameRole::train, FrameRole::test, FrameRole::reference);
  entry.text("kind", frame.kind, true);
  frame.illumination = existing_file(entry, "illumination", session.folder);
  frame.observed = existing_file(entry, "observed", session.folder);
  frame.order = static_cast<double>(session.frames.size());
  if (session.colour) frame.rec709_from_camera = session.colour->rec709_from_camera.cast<float>();
  entry.number("order", frame.order, -ConfigSection::unlimited, ConfigSection::unlimited);
  entry.finish();
  return frame;
}

using FilesByKey = std::map<std::string, fs::path>;

void add_file(FilesByKey& files, const std::string& key, const fs::path& path) {
  if (const auto [other, added] = files.emplace(key, path); !added)
    throw InputError(path.string() + ": has the name '" + key + "' in common with " + other->second.string() +
                     ", so the pairing is ambiguous; rename or remove one of them");
}

FilesByKey by_wildcard(const std::vector<GlobMatch>& matches) {
  FilesByKey files;
  for (const GlobMatch& match : matches) add_file(files, match.wildcard, match.path);
  return files;
}

FilesByKey by_stem(const std::vector<GlobMatch>& matches) {
  FilesByKey files;
  for (const GlobMatch& match : matches) add_file(files, match.path.stem().string(), match.path);
  return files;
}

void check_size(const fs::path& path, const ImageView* view, int& width, int& height,
                const fs::path*& first) {
  struct Size {
    int width, height;
  } header{};
  if (view) {
    header = {view->width, view->height};
    if (view->channels != 3) throw InputError(path, ": has ", view->channels, " channels, not 3");
  } else {
    const ImageHeader read = read_image_header(path);
    header = {read.width, read.height};
  }
  if (width == 0) {
    width = header.width;
    height = header.height;
    first = &path;
  }
  if (header.width != width || header.height != height)
    throw InputError(path, ": is ", header.width, "×", header.height, " pixels, ",
                     first ? first->string() : std::string("the session"), " is ", width, "×", height,
                     "; resize it or leave it out");
}

}  // namespace

std::string_view v0_2::name_of(FrameRole role) {
  constexpr std::array names = {"train", "test", "reference"};
  return names.at(static_cast<std::size_t>(role));
}

std::vector<CaptureFrame> CaptureSession::frames_of(FrameRole role) const {
  std::vector<CaptureFrame> selected;
  std::ranges::copy_if(frames, std::back_inserter(selected), [&](const auto& f) { return f.role == role; });
  return selected;
}

void write_session_manifest(const CaptureSession& session) {
  const auto relative = [&](const fs::path& path) {
    return path.lexically_relative(session.folder).generic_string();
  };
  // Frames that were never given an order all have zero; their place says it.
  const bool ordered = std::ranges::any_of(session.frames, [](const auto& f) { return f.order != 0.0; });
  toml::array frames;
  for (const CaptureFrame& frame : session.frames) {
    toml::table entry{{"name", frame.name},
                      {"role", std::string(name_of(frame.role))},
                      {"kind", frame.kind},
                      {"illumination", relative(frame.illumination)},
                      {"observed", relative(frame.observed)}};
    if (ordered && frame.order != static_cast<double>(frames.size())) entry.insert("order", frame.order);
    frames.push_back(std::move(entry));
  }
  toml::table manifest{
      {"format", format_name},
      {"version", format_version},
      {"camera", toml::table{{"width", session.width}, {"height", session.height}}},
      {"light", toml::table{{"width", session.light.width},
                            {"height", session.light.height},
                            {"parameterisation", std::string(name_of(session.light.parameterisation))}}}};
  if (!session.monitors.empty()) manifest["light"].as_table()->insert("monitor", tables_of(session.monitors));
  if (session.colour) manifest["camera"].as_table()->insert("colour", table_of(*session.colour));
  if (session.ambient) manifest.insert("ambient", relative(*session.ambient));
  if (session.mask) manifest.insert("mask", relative(*session.mask));
  manifest.insert("frame", frames);
  std::ostringstream text;
  text << manifest << "\n";
  write_text_atomically(session.folder / session_manifest_name, text.str());
}

void read_calibration_of_manifest(const fs::path& manifest, CaptureSession& session) {
  const ConfigFile file(manifest, "capture session", "docs/reference/capture-session-format.md");
  CaptureSession found;
  found.folder = manifest.parent_path();
  read_camera(file.section("camera"), found);
  read_light_domain(file.section("light"), found);
  session.colour = found.colour;
  if (!found.monitors.empty()) session.monitors = found.monitors;
}

CaptureSession read_capture_session(const fs::path& folder) {
  const fs::path manifest = folder / session_manifest_name;
  if (!fs::is_regular_file(manifest))
    throw InputError(
        folder, ": is not a capture session (no ", session_manifest_name,
        "); give a folder written by 'refield acquire' or 'refield simulate', or use --light and --observed");
  const ConfigFile file(manifest, "capture session", "docs/reference/capture-session-format.md");
  ConfigSection root = file.root();
  std::string format;
  int version = 0;
  root.text("format", format);
  if (format != format_name) root.fail("format", "is not the manifest of a capture session");
  root.integer("version", version, 0, max_size);
  if (version != format_version)
    root.fail("version", "this program reads version " + std::to_string(format_version));
  file.check_names({"format", "version", "camera", "light", "frame", "ambient", "mask"});

  CaptureSession session;
  session.folder = folder;
  read_camera(file.section("camera"), session);
  read_light_domain(file.section("light"), session);
  std::set<std::string> names;
  for (ConfigSection& entry : file.sections("frame")) {
    session.frames.push_back(read_frame(entry, session));
    if (!names.insert(session.frames.back().name).second)
      entry.fail("name", "an earlier frame has this name; give each frame a name of its own");
  }
  if (root.has("ambient")) session.ambient = existing_file(root, "ambient", folder);
  if (root.has("mask")) session.mask = existing_file(root, "mask", folder);
  return session;
}

std::vector<std::pair<fs::path, fs::path>> pair_files(const std::string& first_glob,
                                                      const std::string& second_glob,
                                                      const std::string& first_kind,
                                                      const std::string& second_kind) {
  const auto first_matches = expand_glob(first_glob);
  const auto second_matches = expand_glob(second_glob);
  auto first = by_wildcard(first_matches);
  auto second = by_wildcard(second_matches);
  if (std::ranges::none_of(first, [&](const auto& entry) { return second.contains(entry.first); })) {
    first = by_stem(first_matches);
    second = by_stem(second_matches);
  }
  const auto require_partner = [](const auto& from, const auto& to, const std::string& missing,
                                  const std::string& glob) {
    for (const auto& [key, path] : from)
      if (!to.contains(key))
        throw InputError(path, ": has no ", missing, " '", key, "' among ", glob,
                         "; add the missing image or remove this one from the series");
  };
  require_partner(first, second, second_kind, second_glob);
  require_partner(second, first, first_kind, first_glob);
  std::vector<std::pair<fs::path, fs::path>> pairs;
  for (const auto& [key, path] : first) pairs.emplace_back(path, second.at(key));
  return pairs;
}

CaptureSession pair_by_globs(const std::string& light_glob, const std::string& observed_glob,
                             Parameterisation parameterisation) {
  CaptureSession session;
  session.light.parameterisation = parameterisation;
  for (const auto& [light, observed] : pair_files(light_glob, observed_glob, "light map", "photograph"))
    session.frames.push_back({light.stem().string(), FrameRole::train, "", light, observed,
                              static_cast<double>(session.frames.size())});
  return session;
}

void check_image_sizes(CaptureSession& session) {
  const fs::path* first_light = nullptr;
  const fs::path* first_photograph = nullptr;
  for (const CaptureFrame& frame : session.frames) {
    const auto* views = frame.views ? &*frame.views : nullptr;
    check_size(frame.illumination, views ? &views->light : nullptr, session.light.width, session.light.height,
               first_light);
    check_size(frame.observed, views ? &views->photograph : nullptr, session.width, session.height,
               first_photograph);
    if (views && !views->sigma.empty())
      check_size(frame.observed.string() + " (sigma)", &views->sigma, session.width, session.height,
                 first_photograph);
  }
}

namespace {

Photograph copied(const CaptureFrame::Views& views, int first, int last) {
  Photograph photograph{copied_rows(views.photograph, first, last), {}};
  if (!views.sigma.empty()) photograph.sigma = copied_rows(views.sigma, first, last);
  return photograph;
}

void convert(Photograph& photograph, const Eigen::Matrix3f& matrix) {
  const Eigen::Matrix3f squares = matrix.cwiseAbs2();
  convert_colours(photograph.radiance, matrix);
  for (std::size_t i = 0; i < photograph.sigma.values.size(); i += 3) {
    Eigen::Map<Eigen::Vector3f> sigma(&photograph.sigma.values[i]);
    if ((sigma.array() == std::numeric_limits<float>::infinity()).any())
      sigma.setConstant(std::numeric_limits<float>::infinity());
    else
      sigma = (squares * sigma.cwiseAbs2()).cwiseSqrt().eval();
  }
}

/// From the camera's channels and brightness to the frame's.
Photograph corrected(Photograph photograph, const CaptureFrame& frame) {
  if (frame.rec709_from_camera) convert(photograph, *frame.rec709_from_camera);
  const auto& gain = frame.gain;
  if (gain == std::array<float, 3>{1.0f, 1.0f, 1.0f}) return photograph;
  for (Image* image : {&photograph.radiance, &photograph.sigma})
    for (std::size_t i = 0; i < image->values.size(); ++i) image->values[i] /= gain[i % 3];
  return photograph;
}

/// The light that was emitted, of what the light map says.
LightMap emitted(LightMap light, const FrameCorrection* correction) {
  if (!correction || correction->tone == std::array<float, 3>{1.0f, 1.0f, 1.0f}) return light;
  for (std::size_t i = 0; i < light.radiance.values.size(); ++i) {
    float& value = light.radiance.values[i];
    const float exponent = correction->tone[i % 3];
    if (exponent != 1.0f && value > 0.0f)
      value = correction->white * std::pow(value / correction->white, exponent);
  }
  return light;
}

}  // namespace

LightMap read_illumination(const CaptureFrame& frame, Parameterisation parameterisation,
                           const RunContext& run) {
  if (!frame.views)
    return emitted(read_light_map(frame.illumination, parameterisation, run), frame.correction.get());
  LightMap light{copied_rows(frame.views->light, 0, frame.views->light.height), parameterisation};
  require_finite(light.radiance, frame.illumination.string(), false, "repair that texel in the light map");
  return emitted(std::move(light), frame.correction.get());
}

std::array<double, 2> FrameCorrection::displacement(int x, int y) const {
  const double u = x - 0.5 * (width_px - 1), v = y - 0.5 * (height_px - 1);
  return {shift_px[0] + turn[1] * u - turn[0] * v, shift_px[1] + turn[0] * u + turn[1] * v};
}

std::string pattern_of(CaptureFrame frame, Parameterisation parameterisation, const RunContext& run) {
  frame.correction.reset();
  return pattern_of(read_illumination(frame, parameterisation, run).radiance,
                    !frame.views && image_format(frame.illumination) == ImageFormat::jpeg);
}

int rig_margin(const FrameCorrection* correction) {
  if (!correction) return 0;
  const double shift =
      std::abs(correction->shift_px[1]) + 0.5 * (std::abs(correction->turn[0]) * correction->width_px +
                                                 std::abs(correction->turn[1]) * correction->height_px);
  return 1 + (shift == 0.0 ? 0 : static_cast<int>(std::ceil(shift)) + 2);  // 1: for bound_of()
}

std::array<float, 4> cubic_weights(double t) {
  const double u = 1.0 - t;
  return {static_cast<float>(-0.5 * t * u * u), static_cast<float>(1.0 - t * t * (2.5 - 1.5 * t)),
          static_cast<float>(1.0 - u * u * (2.5 - 1.5 * u)), static_cast<float>(-0.5 * u * t * t)};
}

namespace {

/// Row `y` of the wanted picture, moved.
void interpolate_row(const Image& rows, int first_row, int y, const std::array<double, 2>& shift,
                     std::span<float> out) {
  const double x_floor = std::floor(shift[0]), y_floor = std::floor(shift[1]);
  const auto across = cubic_weights(shift[0] - x_floor), down = cubic_weights(shift[1] - y_floor);
  const int width = rows.width;
  std::vector<float> column_sums(std::size_t{3} * width, 0.0f);
  for (int i = 0; i < 4; ++i) {
    if (down[i] == 0.0f) continue;
    const int from = std::clamp(y + static_cast<int>(y_floor) + i - 1 - first_row, 0, rows.height - 1);
    const auto row = rows.row(from);
    for (std::size_t k = 0; k < row.size(); ++k) column_sums[k] += down[i] * row[k];
  }
  const int x_first = static_cast<int>(x_floor) - 1;
  for (int x = 0; x < width; ++x)
    for (int c = 0; c < 3; ++c) {
      float sum = 0.0f;
      for (int i = 0; i < 4; ++i)
        if (across[i] != 0.0f)
          sum += across[i] * column_sums[std::size_t{3} * std::clamp(x + x_first + i, 0, width - 1) + c];
      out[std::size_t{3} * x + c] = sum;
    }
}

/// Row `y` of the wanted picture, moved and turned.
void interpolate_turned_row(const Image& rows, int first_row, int y, const FrameCorrection& correction,
                            std::span<float> out) {
  for (int x = 0; x < rows.width; ++x) {
    const auto [right, below] = correction.displacement(x, y);
    const double x_floor = std::floor(right), y_floor = std::floor(below);
    const auto across = cubic_weights(right - x_floor), down = cubic_weights(below - y_floor);
    const auto pixel = out.subspan(std::size_t{3} * x, 3);
    std::ranges::fill(pixel, 0.0f);
    for (int v = 0; v < 4; ++v)
      for (int u = 0; u < 4; ++u) {
        const int column = std::clamp(x + static_cast<int>(x_floor) + u - 1, 0, rows.width - 1),
                  row = std::clamp(y + static_cast<int>(y_floor) + v - 1 - first_row, 0, rows.height - 1);
        for (int c = 0; c < 3; ++c) pixel[c] += down[v] * across[u] * rows.at(column, row, c);
      }
  }
}

/// What undo_rig() does to samples that were all measured.
Image moved_and_unmixed(const Image& rows, int first_row, int first, int last,
                        const FrameCorrection& correction) {
  Image result(rows.width, last - first, 3);
  const std::array<double, 2> none{};
  const bool mixes = correction.primaries_from_camera != Eigen::Matrix3f::Identity();
  for (int y = first; y < last; ++y) {
    const auto out = result.row(y - first);
    if (correction.turn != none)
      interpolate_turned_row(rows, first_row, y, correction, out);
    else if (correction.shift_px != none)
      interpolate_row(rows, first_row, y, correction.shift_px, out);
    else
      std::ranges::copy(rows.row(y - first_row), out.begin());
    for (std::size_t i = 0; i < out.size(); i += 3) {
      Eigen::Map<Eigen::Vector3f> pixel(&out[i]);
      for (int c = 0; c < 3; ++c) pixel[c] /= correction.gain[c];
      if (mixes) pixel = (correction.primaries_from_camera * pixel).eval();
    }
  }
  return result;
}

/// The better of two lower bounds of an unmeasured sample: what it shows, and the mean of its neighbours that
/// were measured (it may be a dead pixel).
float bound_of(const Image& rows, const std::vector<char>& unmeasured, int x, int y, int c) {
  float sum = 0.0f, count = 0.0f;
  for (const auto& [u, v] : {std::pair(x - 1, y), {x + 1, y}, {x, y - 1}, {x, y + 1}}) {
    if (u < 0 || v < 0 || u >= rows.width || v >= rows.height) continue;
    const std::size_t i = (static_cast<std::size_t>(v) * rows.width + u) * 3 + c;
    if (unmeasured[i]) continue;
    sum += rows.values[i];
    count += 1.0f;
  }
  const float shown = rows.at(x, y, c), mean = count > 0.0f ? sum / count : 0.0f;
  return std::isfinite(shown) ? std::max(shown, mean) : mean;
}

}  // namespace

Image undo_rig(const Image& rows, const std::vector<char>& unmeasured, int first_row, int first, int last,
               const FrameCorrection& correction) {
  if (std::ranges::count(unmeasured, 1) == 0)
    return moved_and_unmixed(rows, first_row, first, last, correction);
  constexpr float max_share =
      0.25f;  // clipped samples may lack half their light: then errors are 25 % and less
  Image filled = rows, lost(rows.width, rows.height, 3);
  for (int y = 0; y < rows.height; ++y)
    for (int x = 0; x < rows.width; ++x)
      for (int c = 0; c < 3; ++c)
        if (unmeasured[(static_cast<std::size_t>(y) * rows.width + x) * 3 + c])
          filled.at(x, y, c) = lost.at(x, y, c) = bound_of(rows, unmeasured, x, y, c);
  Image result = moved_and_unmixed(filled, first_row, first, last, correction);
  const Image part = moved_and_unmixed(lost, first_row, first, last, correction);
  for (int y = first; y < last; ++y)
    for (int x = 0; x < rows.width; ++x) {
      const auto [right, down] = correction.displacement(x, y);
      const int v = std::clamp(y + static_cast<int>(std::lround(down)) - first_row, 0, rows.height - 1),
                u = std::clamp(x + static_cast<int>(std::lround(right)), 0, rows.width - 1);
      for (int c = 0; c < 3; ++c) {
        float& value = result.at(x, y - first, c);
        if (unmeasured[(static_cast<std::size_t>(v) * rows.width + u) * 3 + c] ||
            std::abs(part.at(x, y - first, c)) > max_share * std::abs(value))
          value = std::numeric_limits<float>::quiet_NaN();
      }
    }
  return result;
}

namespace {

/// Undoes the frame's correction.
Photograph undone(Photograph photograph, const CaptureFrame& frame) {
  if (!frame.correction) return photograph;
  constexpr float unknown = std::numeric_limits<float>::infinity();
  auto &radiance = photograph.radiance, &sigma = photograph.sigma;
  std::vector<char> unmeasured;
  for (const float value : sigma.values) unmeasured.push_back(value == unknown);
  radiance = undo_rig(radiance, unmeasured, 0, 0, radiance.height, *frame.correction);
  for (std::size_t i = 0; i < sigma.values.size(); ++i)
    if (std::isnan(radiance.values[i])) {
      radiance.values[i] = 0.0f;
      sigma.values[i] = unknown;
    }
  return photograph;
}

}  // namespace

Photograph read_observed(const CaptureFrame& frame) {
  if (frame.views)
    return undone(corrected(copied(*frame.views, 0, frame.views->photograph.height), frame), frame);
  return undone(corrected(read_photograph(frame.observed), frame), frame);
}

Photograph read_observed_rows(const CaptureFrame& frame, int first, int last) {
  if (frame.views) return corrected(copied(*frame.views, first, last), frame);
  return corrected(read_photograph_rows(frame.observed, first, last), frame);
}

Mask read_mask(const fs::path& path, int width, int height) {
  const Image image = read_image(path);
  if (image.width != width || image.height != height)
    throw InputError(path, ": the mask is ", shape_text(image), ", the photographs are ", width, "×", height,
                     "; paint it at that size");
  Mask mask(image.pixel_count());
  for (std::size_t p = 0; p < mask.size(); ++p)
    mask[p] =
        std::ranges::any_of(std::span(image.values).subspan(3 * p, 3), [](float v) { return v > 0.5f; });
  const float brightest = *std::ranges::max_element(image.values);
  if (brightest > 0.0f && brightest <= 0.5f)
    throw InputError(path, ": no pixel is brighter than half of white (the brightest has the linear value ",
                     brightest, "); a mask is white (255) where the scene is, not 1");
  return mask;
}

}  // namespace refield
