// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_series.h"

#define TOML_EXCEPTIONS 1
#include <toml++/toml.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "acquire/calibration.h"
#include "acquire/scene_mask.h"
#include "acquire/series/capture_time.h"
#include "core/capture_session.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/interrupt.h"
#include "core/progress.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// A bracket, the frame that it becomes, and its light.
struct ImportedView {
  BracketGroup bracket;
  std::string name;
  fs::path light;  ///< empty without a session
  std::optional<ClockSeconds> time;
};

bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code error;
  return fs::equivalent(a, b, error);
}

std::vector<BracketGroup> group(const ImportRequest& request) {
  std::vector<fs::path> files;
  for (const fs::path& file : request.photographs)
    if (std::ranges::none_of(request.ambient, [&](const fs::path& other) { return same_file(file, other); }))
      files.push_back(file);
  std::vector<std::optional<Seconds>> exposures(files.size());
  if (request.rule.pattern.empty() && request.rule.count == 0) {
    Progress progress("reading exposure times", files.size());
    for (std::size_t i = 0; i < files.size(); ++i) {
      throw_if_interrupted();
      exposures[i] = stated_exposure(files[i]);
      progress.advance();
    }
  }
  return group_brackets(files, exposures, request.rule);
}

std::vector<ImportedView> without_lights(const std::vector<BracketGroup>& groups) {
  std::vector<ImportedView> views;
  for (const BracketGroup& bracket : groups) views.push_back({bracket, bracket.name, {}, {}});
  return views;
}

std::vector<ImportedView> with_lights_by_order(const ImportRequest& request,
                                               const std::vector<BracketGroup>& groups) {
  if (groups.size() != request.lights.size())
    throw InputError(std::to_string(groups.size()) + " brackets (the last begins with " +
                     groups.back().paths.front().string() + ") but " + std::to_string(request.lights.size()) +
                     " lights (the last is " + request.lights.back().string() +
                     "); give as many of each, or pair them by name with --pattern");
  std::vector<ImportedView> views;
  for (std::size_t i = 0; i < groups.size(); ++i)
    views.push_back({groups[i], request.lights[i].stem().string(), request.lights[i], {}});
  return views;
}

std::vector<ImportedView> with_lights_by_name(const ImportRequest& request,
                                              const std::vector<BracketGroup>& groups) {
  std::vector<ImportedView> views;
  std::set<std::string> used;
  for (const BracketGroup& bracket : groups) {
    const auto light = std::ranges::find(request.lights, bracket.name,
                                         [](const fs::path& path) { return path.stem().string(); });
    if (light == request.lights.end())
      throw InputError(bracket.paths.front().string() + ": there is no light named '" + bracket.name +
                       "'; add it, or pair brackets and lights by --lights-by order");
    views.push_back({bracket, bracket.name, *light, {}});
    used.insert(bracket.name);
  }
  for (const fs::path& light : request.lights)
    if (!used.contains(light.stem().string()))
      throw InputError(light.string() + ": no bracket is named '" + light.stem().string() +
                       "'; add its photographs, or take the light out of the folder");
  return views;
}

std::vector<ImportedView> views_of(const ImportRequest& request) {
  const auto groups = group(request);
  std::vector<ImportedView> views = !request.makes_session()  ? without_lights(groups)
                                    : request.lights_by_order ? with_lights_by_order(request, groups)
                                                              : with_lights_by_name(request, groups);
  std::set<std::string> names;
  for (ImportedView& view : views) {
    if (!names.insert(view.name).second)
      throw InputError(view.bracket.paths.front().string() + ": two photographs would be named '" +
                       view.name + "'; rename one");
    view.time = capture_time(view.bracket.paths.front());
  }
  return views;
}

FrameRole role_of(const ImportRequest& request, const std::string& name, std::size_t place) {
  if (name.starts_with("test")) return FrameRole::test;
  if (name.starts_with("reference")) return FrameRole::reference;
  const auto every = static_cast<std::size_t>(request.test_every);
  return every > 0 && (place + 1) % every == 0 ? FrameRole::test : FrameRole::train;
}

/// Merges brackets and keeps what they have in common.
class Merger {
 public:
  explicit Merger(const ImportRequest& request) : request_(request) {}

  Photograph merge(const std::vector<fs::path>& paths, bool counts) {
    Bracket bracket = read_bracket(paths, request_.camera, request_.exposures);
    MergeStatistics statistics;
    Photograph merged;
    try {
      merged = merge_bracket(bracket, request_.camera, &statistics);
    } catch (const InputError& error) {
      throw InputError(paths.front().string() + ": " + error.what());
    }
    if (width_ == 0) {
      width_ = merged.radiance.width;
      height_ = merged.radiance.height;
    }
    if (merged.radiance.width != width_ || merged.radiance.height != height_)
      throw InputError(paths.front().string() + ": is " + shape_text(merged.radiance) +
                       ", the photographs before are " + std::to_string(width_) + "×" +
                       std::to_string(height_) + "; give photographs of one camera");
    if (counts) add(statistics, bracket.exposures);
    return merged;
  }
  int width() const { return width_; }
  int height() const { return height_; }

  void report(ImportSummary& summary) const {
    summary.exposures = exposures_;
    if (merged_ == 0) return;
    for (double useful : useful_) summary.useful_fraction.push_back(useful / merged_);
    summary.clipped_fraction = clipped_ / merged_;
  }

 private:
  void add(const MergeStatistics& statistics, const std::vector<Seconds>& exposures) {
    if (exposures_.empty()) {
      exposures_ = exposures;
      useful_.assign(exposures.size(), 0.0);
    }
    for (std::size_t i = 0; i < useful_.size(); ++i) useful_[i] += statistics.useful_fraction[i];
    clipped_ += statistics.clipped_fraction;
    ++merged_;
  }

  const ImportRequest& request_;
  int width_ = 0, height_ = 0;
  std::vector<Seconds> exposures_;
  std::vector<double> useful_;
  double clipped_ = 0.0;
  int merged_ = 0;
};

/// Light above the monitor's black that a file stands for.
Image emitted(const ImportRequest& request, const fs::path& file) {
  if (request.light_content == LightContent::radiance)
    return read_light_map(file, request.parameterisation).radiance;
  const BracketFile levels = read_bracket_file(file);
  if (levels.bits != 8 || levels.frame.layout != PixelLayout::rgb)
    throw InputError(file.string() + ": drive levels are 8-bit RGB, as PNG holds them; this file has " +
                     std::to_string(levels.bits) + " bits; give radiance instead (--lights-hold radiance)");
  DriveImage drive{levels.frame.width, levels.frame.height, {}};
  for (std::uint16_t level : levels.frame.samples) drive.levels.push_back(static_cast<std::uint8_t>(level));
  return emitted_above_black(drive, read_monitor_calibration(request.monitor));
}

std::string plan_of(const ImportRequest& request, const std::vector<ImportedView>& views) {
  const auto file_text = [](const fs::path& path) {
    std::error_code error;
    const auto bytes = fs::file_size(path, error);
    return path.filename().string() + " " + (error ? "missing" : std::to_string(bytes));
  };
  const auto list_of = [&](const std::vector<fs::path>& paths) {
    toml::array list;
    for (const fs::path& path : paths) list.push_back(file_text(path));
    return list;
  };
  toml::array frames, exposures;
  for (std::size_t i = 0; i < views.size(); ++i)
    frames.push_back(toml::table{{"name", views[i].name},
                                 {"role", std::string(name_of(role_of(request, views[i].name, i)))},
                                 {"light", file_text(views[i].light)},
                                 {"photographs", list_of(views[i].bracket.paths)}});
  for (const Seconds exposure : request.exposures) exposures.push_back(exposure.count());
  const BracketCamera& camera = request.camera;
  const auto optional_text = [](const std::optional<double>& value) {
    return value ? std::to_string(*value) : "";
  };
  toml::table plan{
      {"format", "refield import"},
      {"version", 1},
      {"response", fs::is_regular_file(camera.response) ? file_text(camera.response) : camera.response},
      {"layout", camera.layout},
      {"black", optional_text(camera.black)},
      {"saturation", optional_text(camera.saturation)},
      {"full_scale_electrons", camera.full_scale_electrons},
      {"read_noise_electrons", camera.read_noise_electrons},
      {"exposures", exposures},
      {"lights_hold", request.light_content == LightContent::radiance ? "radiance" : "drive levels"},
      {"parameterisation", std::string(name_of(request.parameterisation))},
      {"half", request.precision == Precision::half},
      {"mask", request.mask ? file_text(*request.mask) : ""},
      {"ambient", list_of(request.ambient)},
      {"frame", frames}};
  std::ostringstream text;
  text << plan << "\n";
  return text.str();
}

/// A session while it is imported.
class SessionImport {
 public:
  SessionImport(const ImportRequest& request, const std::vector<ImportedView>& views)
      : request_(request),
        views_(views),
        merger_(request),
        writer_(request.folder, plan_of(request, views), steps(request, views), request.if_exists) {
    session_.folder = request.folder;
    session_.light.parameterisation = request.parameterisation;
  }

  void run(ImportSummary& summary) {
    summary.found_done = writer_.found_done();
    if (!writer_.is_complete()) {
      take_ambient();
      Progress progress("importing", views_.size());
      for (std::size_t i = 0; i < views_.size(); ++i) {
        throw_if_interrupted();
        take_view(i);
        progress.advance();
      }
      check_image_sizes(session_);
      take_mask();
      writer_.finish(session_);
    }
    merger_.report(summary);
  }

 private:
  static std::vector<std::string> steps(const ImportRequest& request,
                                        const std::vector<ImportedView>& views) {
    std::vector<std::string> names;
    if (!request.ambient.empty()) names.emplace_back("ambient");
    for (const ImportedView& view : views) names.push_back(view.name);
    if (request.mask) names.emplace_back("mask");
    return names;
  }

  void take_ambient() {
    if (request_.ambient.empty()) return;
    session_.ambient = request_.folder / "ambient.exr";
    if (writer_.is_done("ambient")) {
      ambient_ = read_photograph(*session_.ambient);
      return;
    }
    ambient_ = merger_.merge(request_.ambient, false);
    write_photograph(*session_.ambient, *ambient_);
    writer_.finish_step("ambient", {"ambient.exr"});
  }

  void take_view(std::size_t i) {
    const ImportedView& view = views_[i];
    const std::vector<std::string> files = {"illumination/" + view.name + ".exr",
                                            "observed/" + view.name + ".exr"};
    session_.frames.push_back({view.name, role_of(request_, view.name, i), "", request_.folder / files[0],
                               request_.folder / files[1], order_of(i)});
    if (writer_.is_done(view.name)) return;
    Photograph observed = merger_.merge(view.bracket.paths, true);
    if (ambient_) subtract_ambient(observed, *ambient_);
    write_exr(request_.folder / files[0], emitted(request_, view.light));
    write_photograph(request_.folder / files[1], observed, request_.precision);
    writer_.finish_step(view.name, files);
  }

  void take_mask() {
    if (!request_.mask) return;
    session_.mask = request_.folder / "mask.png";
    if (writer_.is_done("mask")) return;
    write_mask(*session_.mask, read_mask(*request_.mask, session_.width, session_.height), session_.width,
               session_.height);
    writer_.finish_step("mask", {"mask.png"});
  }

  /// Seconds since the earliest photograph where all state their time, else the place.
  double order_of(std::size_t i) const {
    double earliest = std::numeric_limits<double>::infinity();
    for (const ImportedView& view : views_) {
      if (!view.time) return static_cast<double>(i);
      earliest = std::min(earliest, *view.time);
    }
    return *views_[i].time - earliest;
  }

  const ImportRequest& request_;
  const std::vector<ImportedView>& views_;
  Merger merger_;
  SessionWriter writer_;
  CaptureSession session_;
  std::optional<Photograph> ambient_;
};

/// Photographs alone. Those that are there already are kept on resume: each landed whole.
void import_photographs(const ImportRequest& request, const std::vector<ImportedView>& views,
                        ImportSummary& summary) {
  const fs::path plan_path = request.folder / "import.toml";
  const std::string plan = plan_of(request, views);
  if (fs::exists(request.folder) && !fs::is_empty(request.folder)) {
    if (!fs::exists(plan_path))
      throw InputError(request.folder.string() +
                       ": holds files that are not from an import; name a new folder");
    if (request.if_exists == IfExists::refuse)
      throw InputError(
          request.folder.string() +
          ": already holds imported photographs; --resume goes on with them, --force replaces them");
    if (request.if_exists == IfExists::resume && read_text(plan_path) != plan)
      throw InputError(
          plan_path.string() +
          ": the import was begun with other files or options; resume with the same, or use --force");
  }
  create_folders(request.folder);
  if (request.if_exists == IfExists::replace)
    for (const ImportedView& view : views) fs::remove(request.folder / (view.name + ".exr"));
  write_text_atomically(plan_path, plan);
  std::map<std::string, ClockSeconds> times;
  for (const ImportedView& view : views)
    if (view.time) times[view.name] = *view.time;
  write_times(request.folder, times);
  Merger merger(request);
  std::optional<Photograph> ambient;
  if (!request.ambient.empty()) ambient = merger.merge(request.ambient, false);
  Progress progress("merging exposures", views.size());
  for (const ImportedView& view : views) {
    throw_if_interrupted();
    progress.advance();
    const fs::path path = request.folder / (view.name + ".exr");
    if (fs::exists(path)) {
      ++summary.found_done;
      continue;
    }
    Photograph merged = merger.merge(view.bracket.paths, true);
    if (ambient) subtract_ambient(merged, *ambient);
    write_photograph(path, merged, request.precision);
  }
  merger.report(summary);
}

void check(const ImportRequest& request) {
  if (request.photographs.empty()) throw InputError("there is no photograph to import");
  if (request.makes_session() && request.light_content == LightContent::drive_levels &&
      request.monitor.empty())
    throw InputError("drive levels need the monitor's calibration; give a calibration.toml with --monitor");
  if (!request.makes_session() && request.mask)
    throw InputError("a mask belongs to a session; give --lights as well");
  if (request.makes_session()) check_session_folder(request.folder, request.if_exists);
}

}  // namespace

ImportSummary import_series(const ImportRequest& request) {
  check(request);
  const auto views = views_of(request);
  // What is wrong with the options shows in the first photograph, before anything is written.
  Merger(request).merge(views.front().bracket.paths, false);
  if (request.makes_session()) emitted(request, views.front().light);
  ImportSummary summary;
  summary.photographs = views.size();
  summary.timed = static_cast<std::size_t>(
      std::ranges::count_if(views, [](const auto& view) { return view.time.has_value(); }));
  if (request.makes_session())
    SessionImport(request, views).run(summary);
  else
    import_photographs(request, views, summary);
  return summary;
}

}  // namespace refield
