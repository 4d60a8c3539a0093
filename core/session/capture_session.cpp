// SPDX-License-Identifier: Apache-2.0
#include "core/session/capture_session.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <type_traits>
#include <utility>

#include "core/base/config_file.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

constexpr const char* format_name = "refield capture session";
constexpr int format_version = 1;

FrameRole role_from_name(std::string_view name, const fs::path& manifest) {
  for (auto role : {FrameRole::train, FrameRole::test, FrameRole::reference})
    if (name == name_of(role)) return role;
  throw FormatError(manifest, "unknown role '" + std::string(name) + "'; use train, test or reference");
}

Parameterisation parameterisation(std::string_view name, const fs::path& manifest) {
  try {
    return parameterisation_from_name(name);
  } catch (const InputError& error) {
    throw FormatError(manifest, error.what());
  }
}

std::string line_of(const toml::node& node) {
  return node.source().begin.line ? "line " + std::to_string(node.source().begin.line) + ": " : std::string();
}

/// A key that is ignored would be an option that silently does nothing.
void check_keys(const toml::table& table, const std::string& where, const std::vector<std::string>& known,
                const fs::path& manifest) {
  for (const auto& [key, node] : table)
    if (const std::string name(key.str()); std::ranges::find(known, name) == known.end())
      throw FormatError(manifest, line_of(node) + where + "'" + name + "' " + unknown_name_text(name, known));
}

/// Whole numbers alone are taken as such: toml++ would convert others, and overflow where they are large.
template <class T>
std::optional<T> value_of(const toml::table& table, const char* key) {
  if constexpr (std::is_same_v<T, int>) {
    const auto value = table[key].value_exact<std::int64_t>();
    return value && std::in_range<int>(*value) ? std::optional(static_cast<int>(*value)) : std::nullopt;
  } else if constexpr (std::is_same_v<T, std::string>) {
    const auto value = table[key].value_exact<std::string>();
    return value && value->find('\0') == std::string::npos ? value : std::nullopt;
  } else {
    return table[key].value<T>();
  }
}

template <class T>
T required(const toml::table& table, const char* key, const fs::path& manifest) {
  if (const auto value = value_of<T>(table, key)) return *value;
  const toml::node* node = table.get(key);
  throw FormatError(manifest, line_of(node ? *node : table) + "has no valid '" + std::string(key) + "'" +
                                  (std::is_same_v<T, std::string> ? "; give a string in quotes" : ""));
}

void require_exists(const fs::path& path, const fs::path& manifest) {
  if (!fs::is_regular_file(path))
    throw InputError(path.string() + ": is missing, though " + manifest.string() +
                     " lists it; restore the file, or resume the capture");
}

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

/// [[light.monitor]]: angles and offsets that are left out are zero.
std::vector<MonitorPlacement> monitors_of(const toml::table& light, const LightDomain& domain,
                                          const fs::path& manifest) {
  std::vector<MonitorPlacement> monitors;
  const toml::node* given = light.get("monitor");
  if (!given) return monitors;
  if (!given->is_array_of_tables())
    throw FormatError(manifest, "light.monitor is not an array of tables; write [[light.monitor]]");
  for (const toml::node& node : *given->as_array()) {
    const toml::table& table = *node.as_table();
    check_keys(table, "[[light.monitor]] ",
               {"width_mm", "height_mm", "distance_mm", "yaw_degrees", "pitch_degrees", "roll_degrees",
                "offset_x_mm", "offset_y_mm"},
               manifest);
    const auto optional = [&](const char* key) {
      return table.contains(key) ? required<double>(table, key, manifest) : 0.0;
    };
    monitors.push_back({required<double>(table, "width_mm", manifest),
                        required<double>(table, "height_mm", manifest),
                        required<double>(table, "distance_mm", manifest),
                        {optional("yaw_degrees"), optional("pitch_degrees"), optional("roll_degrees")},
                        optional("offset_x_mm"),
                        optional("offset_y_mm")});
  }
  try {
    check_placements(monitors, domain, "[[light.monitor]]");
  } catch (const InputError& error) {
    throw FormatError(manifest, error.what());
  }
  return monitors;
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
    if (view->channels != 3)
      throw InputError(path.string() + ": has " + std::to_string(view->channels) + " channels, not 3");
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
    throw InputError(path.string() + ": is " + std::to_string(header.width) + "×" +
                     std::to_string(header.height) + " pixels, " +
                     (first ? first->string() : std::string("the session")) + " is " + std::to_string(width) +
                     "×" + std::to_string(height) + "; resize it or leave it out");
}

}  // namespace

std::string_view name_of(FrameRole role) {
  switch (role) {
    case FrameRole::train:
      return "train";
    case FrameRole::test:
      return "test";
    case FrameRole::reference:
      return "reference";
  }
  throw InputError("unknown frame role");
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
  if (session.ambient) manifest.insert("ambient", relative(*session.ambient));
  if (session.mask) manifest.insert("mask", relative(*session.mask));
  manifest.insert("frame", frames);
  std::ostringstream text;
  text << manifest << "\n";
  write_text_atomically(session.folder / session_manifest_name, text.str());
}

CaptureSession read_capture_session(const fs::path& folder) {
  const fs::path manifest = folder / session_manifest_name;
  if (!fs::is_regular_file(manifest))
    throw InputError(
        folder.string() + ": is not a capture session (no " + session_manifest_name +
        "); give a folder written by 'refield acquire' or 'refield simulate', or use --light and --observed");
  toml::table table;
  try {
    table = toml::parse(read_text(manifest), manifest.string());
  } catch (const toml::parse_error& error) {
    throw FormatError(manifest, "line " + std::to_string(error.source().begin.line) + ": " +
                                    std::string(error.description()));
  }
  if (table["format"].value_or(std::string()) != format_name)
    throw FormatError(manifest, "is not the manifest of a capture session");
  if (const int version = value_of<int>(table, "version").value_or(0); version != format_version)
    throw FormatError(manifest, "has version " + std::to_string(version) + ", this program reads version " +
                                    std::to_string(format_version));
  const toml::table* camera = table["camera"].as_table();
  const toml::table* light = table["light"].as_table();
  const toml::array* frames = table["frame"].as_array();
  if (!camera || !light || !frames) throw FormatError(manifest, "lacks [camera], [light] or [[frame]]");
  check_keys(table, "", {"format", "version", "camera", "light", "frame", "ambient", "mask"}, manifest);
  check_keys(*camera, "[camera] ", {"width", "height"}, manifest);
  check_keys(*light, "[light] ", {"width", "height", "parameterisation", "monitor"}, manifest);

  CaptureSession session;
  session.folder = folder;
  session.width = required<int>(*camera, "width", manifest);
  session.height = required<int>(*camera, "height", manifest);
  session.light = {required<int>(*light, "width", manifest), required<int>(*light, "height", manifest),
                   parameterisation(required<std::string>(*light, "parameterisation", manifest), manifest)};
  if (session.width <= 0 || session.height <= 0 || session.light.width <= 0 || session.light.height <= 0)
    throw FormatError(manifest, "states a width or height that is not above zero");
  session.monitors = monitors_of(*light, session.light, manifest);
  std::set<std::string> names;
  for (const auto& node : *frames) {
    const toml::table* entry = node.as_table();
    if (!entry) throw FormatError(manifest, "a [[frame]] is not a table");
    check_keys(*entry, "[[frame]] ", {"name", "role", "kind", "illumination", "observed", "order"}, manifest);
    CaptureFrame frame;
    frame.name = required<std::string>(*entry, "name", manifest);
    frame.role = role_from_name(required<std::string>(*entry, "role", manifest), manifest);
    if (entry->contains("kind")) frame.kind = required<std::string>(*entry, "kind", manifest);
    frame.illumination = folder / required<std::string>(*entry, "illumination", manifest);
    frame.observed = folder / required<std::string>(*entry, "observed", manifest);
    frame.order = static_cast<double>(session.frames.size());
    if (const toml::node* order = entry->get("order")) {
      const auto number = order->value<double>();
      if (!number || !std::isfinite(*number))
        throw FormatError(manifest, "frame '" + frame.name + "': order is not a finite number");
      frame.order = *number;
    }
    if (!names.insert(frame.name).second)
      throw FormatError(manifest, "lists frame '" + frame.name + "' twice");
    require_exists(frame.illumination, manifest);
    require_exists(frame.observed, manifest);
    session.frames.push_back(std::move(frame));
  }
  for (auto [key, slot] : {std::pair{"ambient", &session.ambient}, std::pair{"mask", &session.mask}})
    if (table.contains(key)) {
      *slot = folder / required<std::string>(table, key, manifest);
      require_exists(**slot, manifest);
    }
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
        throw InputError(path.string() + ": has no " + missing + " '" + key + "' among " + glob +
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

Photograph divided(Photograph photograph, const std::array<float, 3>& gain) {
  if (gain == std::array<float, 3>{1.0f, 1.0f, 1.0f}) return photograph;
  for (Image* image : {&photograph.radiance, &photograph.sigma})
    for (std::size_t i = 0; i < image->values.size(); ++i) image->values[i] /= gain[i % 3];
  return photograph;
}

}  // namespace

LightMap read_illumination(const CaptureFrame& frame, Parameterisation parameterisation,
                           const RunContext& run) {
  if (!frame.views) return read_light_map(frame.illumination, parameterisation, run);
  LightMap light{copied_rows(frame.views->light, 0, frame.views->light.height), parameterisation};
  require_finite(light.radiance, frame.illumination.string(), false, "repair that texel in the light map");
  return light;
}

Photograph read_observed(const CaptureFrame& frame) {
  if (frame.views) return divided(copied(*frame.views, 0, frame.views->photograph.height), frame.gain);
  return divided(read_photograph(frame.observed), frame.gain);
}

Photograph read_observed_rows(const CaptureFrame& frame, int first, int last) {
  if (frame.views) return divided(copied(*frame.views, first, last), frame.gain);
  return divided(read_photograph_rows(frame.observed, first, last), frame.gain);
}

Mask read_mask(const fs::path& path, int width, int height) {
  const Image image = read_image(path);
  if (image.width != width || image.height != height)
    throw InputError(path.string() + ": the mask is " + shape_text(image) + ", the photographs are " +
                     std::to_string(width) + "×" + std::to_string(height) + "; paint it at that size");
  Mask mask(image.pixel_count());
  for (std::size_t p = 0; p < mask.size(); ++p)
    mask[p] =
        std::ranges::any_of(std::span(image.values).subspan(3 * p, 3), [](float v) { return v > 0.5f; });
  return mask;
}

}  // namespace refield
