// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_series.h"

#include <algorithm>
#include <limits>
#include <map>

#include "acquire/calibration.h"
#include "acquire/import/bracket_response.h"
#include "acquire/import/import_views.h"
#include "acquire/import/series_merger.h"
#include "acquire/scene_mask.h"
#include "core/errors.h"
#include "core/files.h"
#include "core/run_context.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

/// Light above the monitor's black that a file stands for.
Image emitted(const ImportRequest& request, const fs::path& file, const RunContext& run) {
  if (request.light_content == LightContent::radiance)
    return read_light_map(file, request.parameterisation, run).radiance;
  const BracketFile levels = read_bracket_file(file);
  if (levels.bits != 8 || levels.frame.layout != PixelLayout::rgb)
    throw InputError(file.string() + ": drive levels are 8-bit RGB, as PNG holds them; this file has " +
                     std::to_string(levels.bits) + " bits; give radiance instead (--lights-hold radiance)");
  DriveImage drive{levels.frame.width, levels.frame.height, {}};
  for (std::uint16_t level : levels.frame.samples) drive.levels.push_back(static_cast<std::uint8_t>(level));
  return emitted_above_black(drive, read_monitor_calibration(request.monitor));
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

  void run(ImportSummary& summary, const RunContext& run) {
    summary.found_done = writer_.found_done();
    if (!writer_.is_complete()) {
      take_ambient();
      Progress progress(run, "importing", views_.size());
      for (std::size_t i = 0; i < views_.size(); ++i) {
        run.throw_if_stopped();
        take_view(i, run);
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

  void take_view(std::size_t i, const RunContext& run) {
    const ImportedView& view = views_[i];
    const std::vector<std::string> files = {"illumination/" + view.name + ".exr",
                                            "observed/" + view.name + ".exr"};
    session_.frames.push_back({view.name, role_of(request_, view.name, i), "", request_.folder / files[0],
                               request_.folder / files[1], order_of(i)});
    if (writer_.is_done(view.name)) return;
    Photograph observed = merger_.merge(view.bracket.paths, true);
    if (ambient_) subtract_ambient(observed, *ambient_);
    write_exr(request_.folder / files[0], emitted(request_, view.light, run));
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
  SeriesMerger merger_;
  SessionWriter writer_;
  CaptureSession session_;
  std::optional<Photograph> ambient_;
};

/// Photographs alone. Those that are there already are kept on resume: each landed whole.
void import_photographs(const ImportRequest& request, const std::vector<ImportedView>& views,
                        ImportSummary& summary, const RunContext& run) {
  const fs::path plan_path = request.folder / "import.toml";
  const std::string plan = plan_of(request, views);
  if (fs::exists(request.folder) && !fs::is_empty(request.folder)) {
    if (!fs::exists(plan_path))
      throw InputError(request.folder.string() +
                       ": holds files that are not from an import; name a new folder");
    if (request.if_exists == IfExists::refuse)
      throw InputError(
          request.folder.string() +
          ": already contains imported photographs; --resume continues the import, --force replaces them");
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
  SeriesMerger merger(request);
  std::optional<Photograph> ambient;
  if (!request.ambient.empty()) ambient = merger.merge(request.ambient, false);
  Progress progress(run, "merging exposures", views.size());
  for (const ImportedView& view : views) {
    run.throw_if_stopped();
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
    throw InputError(
        "drive levels need the monitor's calibration; give a calibration.toml with --monitor-calibration");
  if (!request.makes_session() && request.mask)
    throw InputError("a mask belongs to a session; give --lights as well");
  if (request.makes_session()) check_session_folder(request.folder, request.if_exists);
}

/// Checks the camera's response against some brackets, spread over the series, and settles it.
void settle_camera(const std::vector<ImportedView>& views, ImportRequest& request, ImportSummary& summary,
                   const RunContext& run) {
  constexpr std::size_t enough = 5;
  const auto brackets = sample_series(views, request, enough, run);
  if (std::ranges::any_of(brackets, [&](const auto& other) { return other.bits != brackets[0].bits; }))
    return;  // the merge will name the file
  summary.notes = settle_response(brackets, request.camera);
  summary.response_estimated = !request.camera.curve.empty();
}

}  // namespace

ImportSummary import_series(const ImportRequest& given, const RunContext& run) {
  const ThreadLimit limit(run);
  check(given);
  ImportRequest request = given;
  ImportSummary summary;
  const auto views = views_of(request, run);
  settle_camera(views, request, summary, run);
  // What is wrong with the options shows in the first photograph, before anything is written.
  SeriesMerger(request).merge(views.front().bracket.paths, false);
  if (request.makes_session()) emitted(request, views.front().light, run);
  summary.photographs = views.size();
  summary.timed = static_cast<std::size_t>(
      std::ranges::count_if(views, [](const auto& view) { return view.time.has_value(); }));
  if (request.makes_session())
    SessionImport(request, views).run(summary, run);
  else
    import_photographs(request, views, summary, run);
  return summary;
}

}  // namespace refield
