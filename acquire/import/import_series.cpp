// SPDX-License-Identifier: Apache-2.0
#include "acquire/import/import_series.h"

#include <cmath>
#include <regex>

#include "acquire/calibrate/calibration.h"
#include "acquire/capture/scene_mask.h"
#include "acquire/import/bracket_merge.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

/// A pattern of --names, whose only group is {light}; each wildcard takes as much as it can.
std::regex parsed(const std::string& pattern) {
  static const std::string name = "{light}";
  const auto at = pattern.find(name);
  if (at == std::string::npos || pattern.find(name, at + 1) != std::string::npos)
    throw InputError("--names '", pattern,
                     "': must contain {light} exactly once, at the position of the view's name");
  std::string expression;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    if (i == at) {
      expression += "([\\s\\S]+)";
      i += name.size() - 1;
    } else if (pattern[i] == '*' || pattern[i] == '?') {
      expression += pattern[i] == '*' ? "[\\s\\S]*" : "[\\s\\S]";
    } else {
      if (std::ispunct(static_cast<unsigned char>(pattern[i])) != 0) expression += '\\';
      expression += pattern[i];
    }
  }
  return std::regex(expression);
}

std::vector<BracketGroup> by_pattern(const std::vector<fs::path>& files, const std::string& pattern) {
  const std::regex expression = parsed(pattern);
  std::vector<BracketGroup> groups;
  for (const fs::path& file : files) {
    const std::string whole = file.filename().string(), stem = file.stem().string();
    std::smatch found;
    if (!std::regex_match(whole, found, expression) && !std::regex_match(stem, found, expression))
      throw InputError(file, ": does not match --names '", pattern,
                       "'; correct the pattern, or remove the file from the folder");
    const std::string light = found[1];
    const auto group = std::ranges::find(groups, light, &BracketGroup::name);
    if (group == groups.end())
      groups.push_back({light, {file}});
    else
      group->paths.push_back(file);
  }
  return groups;
}

std::vector<BracketGroup> by_count(const std::vector<fs::path>& files, int count) {
  if (files.size() % static_cast<std::size_t>(count) != 0)
    throw InputError(files.back(), ": ", files.size(), " files do not make brackets of ", count,
                     "; the last one is incomplete, or a file is missing before it");
  std::vector<BracketGroup> groups;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (i % static_cast<std::size_t>(count) == 0) groups.push_back({files[i].stem().string(), {}});
    groups.back().paths.push_back(files[i]);
  }
  return groups;
}

std::vector<BracketGroup> by_exposure(const std::vector<fs::path>& files,
                                      const std::vector<std::optional<Seconds>>& exposures) {
  std::vector<BracketGroup> groups;
  std::vector<double> seen;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (!exposures[i])
      throw InputError(files[i],
                       ": does not contain its exposure time, so brackets cannot be detected; give "
                       "--bracket-size or --names, and --exposures");
    const double seconds = exposures[i]->count();
    constexpr double same = 0.02;  // metadata round
    const bool repeats =
        std::ranges::any_of(seen, [&](double s) { return std::abs(s - seconds) < same * s; });
    if (groups.empty() || repeats) {
      groups.push_back({files[i].stem().string(), {}});
      seen.clear();
    }
    groups.back().paths.push_back(files[i]);
    seen.push_back(seconds);
  }
  return groups;
}

/// Light that a view was taken under: of its light source, or above the monitor's black as its file says.
Image emitted(const ImportRequest& request, const ImportedView& view, const RunContext& run) {
  if (!request.stage.sources.empty()) return light_map_of(request.stage, view.source);
  const fs::path& file = view.light;
  if (request.light_content == LightContent::radiance)
    return read_light_map(file, request.parameterisation, run).radiance;
  const BracketFile levels = read_bracket_file(file);
  if (levels.bits != 8 || levels.frame.layout != PixelLayout::rgb)
    throw InputError(file, ": drive levels are 8-bit RGB, as PNG holds them; this file has ", levels.bits,
                     " bits; give radiance instead (--light-content radiance)");
  DriveImage drive{levels.frame.width, levels.frame.height, {}};
  for (std::uint16_t level : levels.frame.samples) drive.levels.push_back(static_cast<std::uint8_t>(level));
  return emitted_above_black(drive, read_monitor_calibration(request.monitor));
}

/// Pixels of the ambient photograph that are much brighter than all around them.
int count_hot_pixels(const Photograph& ambient) {
  constexpr float brighter = 3.0f, noise = 10.0f;
  const auto sum = [](const Image& image, int x, int y) {
    return image.at(x, y, 0) + image.at(x, y, 1) + image.at(x, y, 2);
  };
  int hot = 0;
  for (int y = 1; y + 1 < ambient.radiance.height; ++y)
    for (int x = 1; x + 1 < ambient.radiance.width; ++x) {
      float around = 0.0f;
      for (int v = y - 1; v <= y + 1; ++v)
        for (int u = x - 1; u <= x + 1; ++u)
          if (u != x || v != y)
            around =
                std::max(around, brighter * sum(ambient.radiance, u, v) + noise * sum(ambient.sigma, u, v));
      hot += sum(ambient.radiance, x, y) > around;
    }
  return hot;
}

/// Share of pixels that may be hot, dusty or outside the card.
constexpr double negligible_share = 0.001;
/// Below this part of its 90th percentile, a pixel shows no card.
constexpr double least_part = 0.05;

[[noreturn]] void refuse_card(const char* what, double share, const char* remedy) {
  throw InputError(
      formatted("the white card is %s in %.1f %% of the pixels; %s", what, 100.0 * share, remedy));
}

/// One channel of the card where `weight` is not zero, smooth: 24 × 18 nodes follow the fall-off of a light
/// source at the distance of the picture's width within 0.1 %.
Image smoothed(const Image& card, const Image& weight, int channel) {
  constexpr int columns = 24, rows = 18;
  Image values(card.width, card.height, 1);
  for (std::size_t p = 0; p < values.values.size(); ++p)
    values.values[p] = card.values[3 * p + static_cast<std::size_t>(channel)];
  const RelativeMap map = fit_relative_map(values, weight, columns, rows);
  double product = 0.0, square = 0.0;
  Image result(card.width, card.height, 1);
  for (int y = 0; y < card.height; ++y)
    for (int x = 0; x < card.width; ++x) {
      const double relative = map.at_pixel(x, y, values);
      result.at(x, y, 0) = static_cast<float>(relative);
      product += weight.at(x, y, 0) * relative * values.at(x, y, 0);
      square += weight.at(x, y, 0) * relative * relative;
    }
  for (float& value : result.values) value *= static_cast<float>(product / square);
  return result;
}

/// Divides a photograph under one light source by that of a white card in the object's place under the same
/// source, and multiplies by `cos_angle`, the cosine between the source and the card's normal: radiance
/// relative to a white diffuser that faces the source. Fall-off, intensity and vignetting cancel. The card is
/// smoothed by fit_relative_map() inside `mask` (empty: all pixels); pixels outside are marked as unmeasured.
/// Throws InputError (without the file's name) where the card is of another size, or clipped or dark inside
/// the mask, or behind the light source.
void divide_by_card(Photograph& photograph, const Photograph& card, double cos_angle, const Mask& mask) {
  const Image& white = card.radiance;
  if (!white.same_shape(photograph.radiance))
    throw InputError("is ", shape_text(white), ", the photographs are ", shape_text(photograph.radiance),
                     "; photograph the white card with the same camera");
  constexpr double grazing = 0.05;  // 87°
  if (!(cos_angle > grazing))
    throw InputError(
        "the light source is not in front of the white card, which faces the camera; leave its photograph "
        "out, or import without flat fields");
  std::vector<float> levels(white.pixel_count());
  for (std::size_t p = 0; p < levels.size(); ++p)
    levels[p] = std::min({white.values[3 * p], white.values[3 * p + 1], white.values[3 * p + 2]});
  const auto least = static_cast<float>(least_part * quantile(levels, 0.9));
  Image weight(white.width, white.height, 1);
  std::size_t inside = 0, dark = 0, clipped = 0;
  for (std::size_t p = 0; p < levels.size(); ++p) {
    const bool is_inside = mask.empty() || mask[p] != 0;
    const bool is_dark = !(levels[p] > std::max(least, 0.0f));
    bool is_clipped = false;
    for (std::size_t c = 0; c < 3; ++c)
      is_clipped |= !card.sigma.empty() && std::isinf(card.sigma.values[3 * p + c]);
    inside += is_inside ? 1 : 0;
    dark += is_inside && is_dark ? 1 : 0;
    clipped += is_inside && is_clipped ? 1 : 0;
    weight.values[p] = is_inside && !is_dark && !is_clipped ? 1.0f : 0.0f;
  }
  const auto share = [&](std::size_t count) {
    return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(inside, 1));
  };
  if (share(clipped) > negligible_share)
    refuse_card("clipped", share(clipped), "expose it shorter, or bracket it (--bracket-size)");
  if (share(dark) > negligible_share)
    refuse_card("dark", share(dark),
                "it must cover the scene and face the camera; use a larger card, or give --mask");
  for (int c = 0; c < 3; ++c) {
    const Image level = smoothed(white, weight, c);
    for (std::size_t p = 0; p < level.values.size(); ++p) {
      const std::size_t sample = 3 * p + static_cast<std::size_t>(c);
      const bool is_inside = mask.empty() || mask[p] != 0;
      const auto factor = static_cast<float>(cos_angle / (is_inside ? level.values[p] : 1.0f));
      photograph.radiance.values[sample] *= factor;
      if (photograph.sigma.empty()) continue;
      float& sigma = photograph.sigma.values[sample];
      sigma = is_inside ? sigma * factor : std::numeric_limits<float>::infinity();
    }
  }
}

/// Merges one bracket after the other and keeps what they have in common.
class SeriesMerger {
 public:
  explicit SeriesMerger(const ImportRequest& request) : request_(request) {}

  /// `counts`: this photograph enters the statistics of report(). Throws InputError naming the file, also for
  /// another size than those before.
  Photograph merge(const std::vector<fs::path>& paths, bool counts) {
    Bracket bracket = read_bracket(paths, request_.camera, request_.exposures);
    require_same_settings_as_first(bracket);
    MergeStatistics statistics;
    Photograph merged;
    try {
      merged = merge_bracket(bracket, request_.camera, &statistics);
    } catch (const InputError& error) {
      throw InputError(paths.front(), ": ", error.what());
    }
    require_same_size(merged.radiance, paths.front());
    if (counts) add(statistics, bracket.exposures);
    return merged;
  }

  void report(ImportSummary& summary) const {
    summary.exposures = exposures_;
    if (saturation_) {
      summary.notes.emplace_back(
          formatted("the samples of %d photographs show that they are clipped below the level that the files "
                    "state, from %.6g; --saturation overrules it",
                    with_found_saturation_, *saturation_));
    }
    if (merged_ == 0) return;
    for (double useful : useful_) summary.useful_fraction.push_back(useful / merged_);
    summary.clipped_fraction = clipped_ / merged_;
  }

 private:
  void require_same_size(const Image& merged, const fs::path& path) {
    if (width_ == 0) {
      width_ = merged.width;
      height_ = merged.height;
    }
    if (merged.width != width_ || merged.height != height_)
      throw InputError(path, ": is ", shape_text(merged), ", the photographs before are ", width_, "×",
                       height_, "; give photographs of one camera");
  }

  void require_same_settings_as_first(const Bracket& bracket) {
    if (first_.empty())
      for (std::size_t i = 0; i < bracket.files.size(); ++i)
        first_.emplace_back(bracket.files[i].settings, bracket.paths[i]);
    for (std::size_t i = 0; i < bracket.files.size(); ++i) {
      const auto& [settings, path] = first_[std::min(i, first_.size() - 1)];
      require_same_settings(bracket.files[i].settings, bracket.paths[i], settings, path);
    }
  }

  void add(const MergeStatistics& statistics, const std::vector<Seconds>& exposures) {
    if (const auto found = statistics.found_saturation) {
      saturation_ = std::min(saturation_.value_or(*found), *found);
      ++with_found_saturation_;
    }
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
  std::vector<std::pair<CameraSettings, fs::path>> first_;  // of the first bracket's files
  std::optional<double> saturation_;  // lowest that was found in samples, and in how many photographs
  int with_found_saturation_ = 0;
  std::vector<Seconds> exposures_;
  std::vector<double> useful_;
  double clipped_ = 0.0;
  int merged_ = 0;
};

/// Excludes the ball and a border of two pixels from a mask [height × width].
void exclude_ball(Mask& mask, int width, int height, const MirrorBall& ball) {
  constexpr double border_px = 2.0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      if ((Eigen::Vector2d(x + 0.5, y + 0.5) - ball.centre_px()).norm() < ball.radius_px() + border_px)
        mask[static_cast<std::size_t>(y) * width + x] = 0;
}

/// A session while it is imported.
class SessionImport {
 public:
  SessionImport(const ImportRequest& request, const std::vector<ImportedView>& views,
                const std::optional<MirrorBall>& ball)
      : request_(request),
        views_(views),
        ball_(ball),
        merger_(request),
        writer_(request.folder, plan_of(request, views), steps(request, views), request.if_exists) {
    session_.folder = request.folder;
    session_.light.parameterisation = request.parameterisation;
    session_.monitors = request.monitors;
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
      check_placements(session_.monitors, session_.light, "--placement");
      take_mask();
      if (const int hot = ambient_ ? count_hot_pixels(*ambient_) : 0; hot > 0)
        summary.notes.push_back(std::to_string(hot) +
                                " pixels are hot: far brighter than their neighbours in the ambient "
                                "photograph; their light is subtracted, and samples that clip are left out");
      if (darker_.size() >= enough_darker_photographs)
        summary.notes.push_back(darker_text(request_.ambient.front().string(), darker_));
      std::string notes;
      for (const std::string& note : summary.notes) notes += note + "\n";
      if (!notes.empty()) write_text_atomically(request_.folder / session_notes_name, notes);
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
    if (request.mask || request.ball) names.emplace_back("mask");
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
    const Image light = emitted(request_, view, run);
    if (request_.parameterisation == Parameterisation::monitor)
      session_.frames.back().kind = kind_of_light(light);
    if (writer_.is_done(view.name)) {
      if (ambient_) compare_with_ambient(view.name, read_photograph(request_.folder / files[1]));
      return;
    }
    Photograph observed = merger_.merge(view.bracket.paths, true);
    if (ambient_) {
      subtract_ambient(observed, *ambient_);
      compare_with_ambient(view.name, observed);
    }
    if (!view.card.paths.empty()) divide_by_card_of(view, observed);
    write_exr(request_.folder / files[0], light);
    write_photograph(request_.folder / files[1], observed, request_.precision);
    writer_.finish_step(view.name, files);
  }

  void compare_with_ambient(const std::string& name, const Photograph& observed) {
    if (darker_share(observed, *ambient_) > clearly_darker_share) darker_.push_back(name);
  }

  void divide_by_card_of(const ImportedView& view, Photograph& observed) {
    Photograph card = merger_.merge(view.card.paths, false);
    if (ambient_) subtract_ambient(card, *ambient_);
    const Image& size = observed.radiance;
    if (!mask_) mask_ = mask_of(size.width, size.height);
    try {
      // The card faces the camera, which is at −Z.
      divide_by_card(observed, card, -request_.stage.sources[view.source].direction.z(), *mask_);
    } catch (const InputError& error) {
      throw InputError(view.card.paths.front(), ": ", error.what());
    }
  }

  /// Empty: all pixels.
  Mask mask_of(int width, int height) const {
    Mask mask;
    if (request_.mask) mask = read_mask(*request_.mask, width, height);
    if (request_.mask && std::ranges::count(mask, 0) == std::ssize(mask))
      throw InputError(request_.mask->string() +
                       ": the mask is dark everywhere, so no pixel would be estimated; paint the scene "
                       "brighter than one half (188 of 255, not 1)");
    if (ball_) {
      if (mask.empty()) mask.assign(static_cast<std::size_t>(width) * height, 1);
      exclude_ball(mask, width, height, *ball_);
    }
    return mask;
  }

  void take_mask() {
    if (!request_.mask && !ball_) return;
    session_.mask = request_.folder / "mask.png";
    if (writer_.is_done("mask")) return;
    write_mask(*session_.mask, mask_of(session_.width, session_.height), session_.width, session_.height);
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
  const std::optional<MirrorBall>& ball_;
  SeriesMerger merger_;
  SessionWriter writer_;
  CaptureSession session_;
  std::optional<Photograph> ambient_;
  std::vector<std::string> darker_;  // photographs that are darker than the ambient one
  std::optional<Mask> mask_;         // where white cards must be usable
};

/// Photographs alone. Those that are there already are kept on resume: each landed whole.
void import_photographs(const ImportRequest& request, const std::vector<ImportedView>& views,
                        ImportSummary& summary, const RunContext& run) {
  const fs::path plan_path = request.folder / "import.toml";
  const std::string plan = plan_of(request, views);
  if (fs::exists(request.folder) && !fs::is_empty(request.folder)) {
    if (!fs::exists(plan_path))
      throw InputError(request.folder, ": holds files that are not from an import; name a new folder");
    if (request.if_exists == IfExists::refuse)
      throw InputError(
          request.folder,
          ": already contains imported photographs; --resume continues the import, --force replaces them");
    if (request.if_exists == IfExists::resume && read_text(plan_path) != plan)
      throw InputError(
          plan_path,
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
    throw InputError("drive levels need the monitor's calibration; give a calibration.toml with --response");
  if (!request.lights.empty() + !request.stage.sources.empty() + request.ball.has_value() > 1)
    throw InputError("give --light or --light-sources, not both");
  if (!request.flat_fields.empty() && !request.has_light_sources())
    throw InputError("flat fields belong to light sources; give --light-sources as well");
  if (!request.makes_session() && request.mask)
    throw InputError("a mask belongs to a session; give --light or --light-sources as well");
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
  BracketCamera trial = request.camera;
  if (!settle_times(brackets, trial).empty()) {
    constexpr std::size_t more = 15;  // the ratio is a median over brackets
    const std::string note = settle_times(sample_series(views, request, more, run), request.camera);
    if (!note.empty()) summary.notes.push_back(note);
  }
  summary.response_estimated = !request.camera.curve.empty();
  if (request.has_light_sources() && brackets[0].bits == 8 && request.camera.response == "linear")
    summary.notes.emplace_back(
        "8-bit photographs are treated as linear (--response linear), but most cameras encode them as sRGB; "
        "sums of light sources are then wrong. Leave --response out unless the files are known to be linear");
}

/// Photographs under single light sources often state no exposure time, because it was the same for all.
/// Throws InputError where only some state it.
void settle_exposures(const std::vector<ImportedView>& views, ImportRequest& request) {
  if (!request.has_light_sources() || !request.exposures.empty() || views.front().bracket.paths.size() != 1)
    return;
  std::vector<const fs::path*> stating, silent;
  for (const ImportedView& view : views)
    for (const auto* paths : {&view.bracket.paths, &view.card.paths})
      for (const fs::path& file : *paths) (stated_exposure(file) ? stating : silent).push_back(&file);
  if (silent.empty()) return;
  if (!stating.empty())
    throw InputError(silent.front()->string() + ": does not state its exposure time, but " +
                     stating.front()->string() + " does; give --exposures 1 if all have the same");
  request.exposures = {Seconds(1.0)};
  request.stage.notes.emplace_back(
      "the photographs do not state their exposure times, which are taken to be equal");
}

/// Directions of the light sources from the highlights on the ball, one per view.
MirrorBall read_ball(const std::vector<ImportedView>& views, ImportRequest& request, const RunContext& run) {
  SeriesMerger merger(request);
  std::optional<Photograph> ambient;
  if (!request.ambient.empty()) ambient = merger.merge(request.ambient, false);
  const auto read = [&](const ImportedView& view) {
    run.throw_if_stopped();
    Photograph photograph = merger.merge(view.bracket.paths, false);
    if (ambient) subtract_ambient(photograph, *ambient);
    return std::move(photograph.radiance);
  };
  Image mean = read(views.front());
  if (!request.ball->circle) {
    Progress progress(run, "finding the ball", views.size());
    for (std::size_t i = 1; i < views.size(); ++i) {
      const Image next = read(views[i]);
      for (std::size_t k = 0; k < mean.values.size(); ++k) mean.values[k] += next.values[k];
      progress.advance();
    }
  }
  MirrorBall ball = locate_ball(*request.ball, mean);
  LightStage& stage = request.stage;
  stage.notes.emplace_back(formatted("mirror ball at --ball %.2f,%.2f,%.2f", ball.centre_px().x(),
                                     ball.centre_px().y(), ball.radius_px()));
  if (!request.ball->field_of_view_degrees)
    stage.notes.emplace_back(
        "without --horizontal-fov, directions are relative to the direction from the ball to the camera");
  if (request.flat_fields.empty())
    stage.notes.emplace_back("all light sources have intensity 1, since the ball shows directions alone");
  Progress progress(run, "reading highlights on the ball", views.size());
  for (const ImportedView& view : views) {
    LightSource source;
    source.photograph = view.bracket.paths.front().string();
    try {
      source.direction = light_direction(read(view), ball);
    } catch (const InputError& error) {
      throw InputError(source.photograph, ": ", error.what());
    }
    stage.sources.push_back(std::move(source));
    progress.advance();
  }
  place_sources(stage);
  return ball;
}

/// White cards measure what the list may state as well.
void use_cards_for_intensity(ImportRequest& request) {
  bool differ = false;
  for (LightSource& source : request.stage.sources) {
    differ |= source.intensity != std::array<float, 3>{1.0f, 1.0f, 1.0f};
    source.intensity = {1.0f, 1.0f, 1.0f};
  }
  if (differ)
    request.stage.notes.emplace_back(
        "the flat fields measure the intensities of the light sources; those of the list are not used");
}

}  // namespace

std::vector<BracketGroup> group_brackets(const std::vector<fs::path>& files,
                                         const std::vector<std::optional<Seconds>>& exposures,
                                         const GroupRule& rule) {
  if (files.empty()) throw InputError("there is no photograph to import");
  if (rule.count < 0) throw InputError("--bracket-size is ", rule.count, "; give 1 or more");
  if (!rule.pattern.empty() && rule.count > 0) throw InputError("give --names or --bracket-size, not both");
  auto groups = !rule.pattern.empty() ? by_pattern(files, rule.pattern)
                : rule.count > 0      ? by_count(files, rule.count)
                                      : by_exposure(files, exposures);
  for (const BracketGroup& group : groups)
    if (group.paths.size() != groups.front().paths.size())
      throw InputError(group.paths.front(), ": its bracket has ", group.paths.size(),
                       " exposures, the first one (", groups.front().paths.front(), ") has ",
                       groups.front().paths.size(),
                       "; a file is missing or stray, or the brackets need --names or --bracket-size");
  return groups;
}

ImportSummary import_series(const ImportRequest& given, const RunContext& run) {
  const ThreadLimit limit(run);
  check(given);
  ImportRequest request = given;
  ImportSummary summary;
  if (request.has_light_sources()) request.parameterisation = Parameterisation::lat_long;
  const auto views = views_of(request, run);
  settle_exposures(views, request);
  settle_camera(views, request, summary, run);
  std::optional<MirrorBall> ball;
  if (request.ball) ball = read_ball(views, request, run);
  if (!request.flat_fields.empty()) use_cards_for_intensity(request);
  summary.notes.insert(summary.notes.begin(), request.stage.notes.begin(), request.stage.notes.end());
  // What is wrong with the options shows in the first photograph, before anything is written.
  SeriesMerger(request).merge(views.front().bracket.paths, false);
  if (request.makes_session()) emitted(request, views.front(), run);
  summary.photographs = views.size();
  summary.timed = static_cast<std::size_t>(
      std::ranges::count_if(views, [](const auto& view) { return view.time.has_value(); }));
  if (request.makes_session())
    SessionImport(request, views, ball).run(summary, run);
  else
    import_photographs(request, views, summary, run);
  return summary;
}

}  // namespace refield
