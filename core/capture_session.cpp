// SPDX-License-Identifier: Apache-2.0
#include "core/capture_session.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <set>
#include <sstream>

#include "core/errors.h"
#include "core/files.h"
#include "core/image_io.h"

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

template <class T>
T required(const toml::table& table, const char* key, const fs::path& manifest) {
  if (const auto value = table[key].value<T>()) return *value;
  throw FormatError(manifest, "has no valid '" + std::string(key) + "'" +
                                  (table.source().begin.line ? " near line " + std::to_string(table.source().begin.line)
                                                             : std::string()));
}

void require_exists(const fs::path& path, const fs::path& manifest) {
  if (!fs::is_regular_file(path))
    throw InputError(path.string() + ": is missing, though " + manifest.string() +
                     " lists it; restore the file, or resume the capture");
}

void check_size(const fs::path& path, int& width, int& height, const fs::path*& first) {
  const ImageHeader header = read_image_header(path);
  if (width == 0) {
    width = header.width;
    height = header.height;
    first = &path;
  }
  if (header.width != width || header.height != height)
    throw InputError(path.string() + ": is " + std::to_string(header.width) + "×" + std::to_string(header.height) +
                     " pixels, " + (first ? first->string() : std::string("the session")) + " is " +
                     std::to_string(width) + "×" + std::to_string(height) + "; resize it or leave it out");
}

}  // namespace

std::string_view name_of(FrameRole role) {
  switch (role) {
    case FrameRole::train: return "train";
    case FrameRole::test: return "test";
    case FrameRole::reference: return "reference";
  }
  throw InputError("unknown frame role");
}

std::vector<CaptureFrame> CaptureSession::frames_of(FrameRole role) const {
  std::vector<CaptureFrame> selected;
  std::ranges::copy_if(frames, std::back_inserter(selected), [&](const auto& f) { return f.role == role; });
  return selected;
}

void write_session_manifest(const CaptureSession& session) {
  const auto relative = [&](const fs::path& path) { return path.lexically_relative(session.folder).generic_string(); };
  toml::array frames;
  for (const CaptureFrame& frame : session.frames)
    frames.push_back(toml::table{{"name", frame.name},
                                 {"role", std::string(name_of(frame.role))},
                                 {"kind", frame.kind},
                                 {"illumination", relative(frame.illumination)},
                                 {"observed", relative(frame.observed)}});
  toml::table manifest{
      {"format", format_name},
      {"version", format_version},
      {"camera", toml::table{{"width", session.width}, {"height", session.height}}},
      {"light", toml::table{{"width", session.light.width},
                            {"height", session.light.height},
                            {"parameterisation", std::string(name_of(session.light.parameterisation))}}}};
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
    throw InputError(folder.string() + ": is not a capture session (no " + session_manifest_name +
                     "); give a folder that 'refield acquire' or 'refield simulate' made, or use --light and --observed");
  toml::table table;
  try {
    table = toml::parse(read_text(manifest), manifest.string());
  } catch (const toml::parse_error& error) {
    throw FormatError(manifest, "line " + std::to_string(error.source().begin.line) + ": " +
                                    std::string(error.description()));
  }
  if (table["format"].value_or(std::string()) != format_name)
    throw FormatError(manifest, "is not the manifest of a capture session");
  if (const int version = table["version"].value_or(0); version != format_version)
    throw FormatError(manifest, "has version " + std::to_string(version) + ", this program reads version " +
                                    std::to_string(format_version));
  const toml::table* camera = table["camera"].as_table();
  const toml::table* light = table["light"].as_table();
  const toml::array* frames = table["frame"].as_array();
  if (!camera || !light || !frames) throw FormatError(manifest, "lacks [camera], [light] or [[frame]]");

  CaptureSession session;
  session.folder = folder;
  session.width = required<int>(*camera, "width", manifest);
  session.height = required<int>(*camera, "height", manifest);
  session.light = {required<int>(*light, "width", manifest), required<int>(*light, "height", manifest),
                   parameterisation_from_name(required<std::string>(*light, "parameterisation", manifest))};
  std::set<std::string> names;
  for (const auto& node : *frames) {
    const toml::table* entry = node.as_table();
    if (!entry) throw FormatError(manifest, "a [[frame]] is no table");
    CaptureFrame frame;
    frame.name = required<std::string>(*entry, "name", manifest);
    frame.role = role_from_name(required<std::string>(*entry, "role", manifest), manifest);
    frame.kind = (*entry)["kind"].value_or(std::string());
    frame.illumination = folder / required<std::string>(*entry, "illumination", manifest);
    frame.observed = folder / required<std::string>(*entry, "observed", manifest);
    if (!names.insert(frame.name).second) throw FormatError(manifest, "lists frame '" + frame.name + "' twice");
    require_exists(frame.illumination, manifest);
    require_exists(frame.observed, manifest);
    session.frames.push_back(std::move(frame));
  }
  for (auto [key, slot] : {std::pair{"ambient", &session.ambient}, std::pair{"mask", &session.mask}})
    if (const auto value = table[key].value<std::string>()) {
      *slot = folder / *value;
      require_exists(**slot, manifest);
    }
  return session;
}

CaptureSession pair_by_globs(const std::string& light_glob, const std::string& observed_glob,
                             Parameterisation parameterisation) {
  const auto lights = expand_glob(light_glob);
  const auto photographs = expand_glob(observed_glob);
  const auto index = [](const std::vector<GlobMatch>& matches, bool by_stem) {
    std::map<std::string, fs::path> map;
    for (const GlobMatch& match : matches) map[by_stem ? match.path.stem().string() : match.wildcard] = match.path;
    return map;
  };
  const auto shares_a_key = [](const auto& a, const auto& b) {
    return std::ranges::any_of(a, [&](const auto& entry) { return b.contains(entry.first); });
  };
  auto light_of = index(lights, false);
  auto observed_of = index(photographs, false);
  if (!shares_a_key(light_of, observed_of)) {
    light_of = index(lights, true);
    observed_of = index(photographs, true);
  }
  const auto require_partner = [](const auto& from, const auto& to, const char* missing, const std::string& glob) {
    for (const auto& [key, path] : from)
      if (!to.contains(key))
        throw InputError(path.string() + ": has no " + missing + " '" + key + "' among " + glob +
                         "; add the missing image or take this one out of the series");
  };
  require_partner(light_of, observed_of, "photograph", observed_glob);
  require_partner(observed_of, light_of, "light map", light_glob);

  CaptureSession session;
  session.light.parameterisation = parameterisation;
  for (const auto& [key, path] : light_of)
    session.frames.push_back({path.stem().string(), FrameRole::train, "", path, observed_of.at(key)});
  return session;
}

void check_image_sizes(CaptureSession& session) {
  const fs::path* first_light = nullptr;
  const fs::path* first_photograph = nullptr;
  for (const CaptureFrame& frame : session.frames) {
    check_size(frame.illumination, session.light.width, session.light.height, first_light);
    check_size(frame.observed, session.width, session.height, first_photograph);
  }
}

Mask read_mask(const fs::path& path, int width, int height) {
  const Image image = read_image(path);
  if (image.width != width || image.height != height)
    throw InputError(path.string() + ": the mask is " + shape_text(image) + ", the photographs are " +
                     std::to_string(width) + "×" + std::to_string(height) + "; paint it at that size");
  Mask mask(image.pixel_count());
  for (std::size_t p = 0; p < mask.size(); ++p)
    mask[p] = std::ranges::any_of(std::span(image.values).subspan(3 * p, 3), [](float v) { return v > 0.5f; });
  return mask;
}

}  // namespace refield
