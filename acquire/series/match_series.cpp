// SPDX-License-Identifier: Apache-2.0
#include "acquire/series/match_series.h"

#define TOML_EXCEPTIONS 1

#include <toml++/toml.h>

#include <cmath>
#include <sstream>

#include "acquire/capture/scene_mask.h"
#include "core/base/config_file.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/session/capture_session.h"

namespace refield {

namespace {

constexpr std::size_t max_names = 5;  // of photographs that a note lists

constexpr std::size_t least_common = 10;   // photographs that must overlap
constexpr double least_correlation = 0.5;  // below, the series do not go together
constexpr double ambiguous = 0.9;          // of the best: another offset is as good
constexpr int slow_half_width = 7;         // photographs on either side whose mean is the slow part

/// Log brightness without its slow part, over time.
struct Signal {
  std::vector<double> time;
  std::vector<double> value;
  double interval = 0.0;

  explicit Signal(std::span<const TimedBrightness> series) {
    std::vector<double> log_brightness;
    for (const TimedBrightness& sample : series) {
      time.push_back(sample.time);
      log_brightness.push_back(std::log(std::max(sample.brightness, 1e-12)));
    }
    const auto count = static_cast<std::ptrdiff_t>(time.size());
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      const std::ptrdiff_t from = std::max<std::ptrdiff_t>(0, i - slow_half_width);
      const std::ptrdiff_t to = std::min(count, i + slow_half_width + 1);
      double mean = 0.0;
      for (std::ptrdiff_t k = from; k < to; ++k) mean += log_brightness[k] / static_cast<double>(to - from);
      value.push_back(log_brightness[i] - mean);
    }
    interval = median_interval(time);
  }

  /// Between samples by a straight line; nullopt outside the series and in its gaps.
  std::optional<double> at(double t) const {
    const auto after = std::ranges::upper_bound(time, t);
    if (after == time.begin() || after == time.end()) return std::nullopt;
    const auto i = static_cast<std::size_t>(after - time.begin());
    const double step = time[i] - time[i - 1];
    if (step > 3.0 * interval) return std::nullopt;
    const double share = (t - time[i - 1]) / step;
    return (1.0 - share) * value[i - 1] + share * value[i];
  }
};

/// Correlation of the signals under a relation of their clocks; −1 where too few samples overlap.
double correlation(const Signal& first, const Signal& second, const ClockRelation& relation) {
  double n = 0.0, sum_a = 0.0, sum_b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
  for (std::size_t i = 0; i < second.time.size(); ++i) {
    const auto a = first.at(relation.first_from_second(second.time[i]));
    if (!a) continue;
    const double b = second.value[i];
    n += 1.0;
    sum_a += *a;
    sum_b += b;
    aa += *a * *a;
    bb += b * b;
    ab += *a * b;
  }
  const double shorter = static_cast<double>(std::min(first.time.size(), second.time.size()));
  if (n < std::max<double>(least_common, 0.25 * shorter)) return -1.0;
  const double variance = (aa - sum_a * sum_a / n) * (bb - sum_b * sum_b / n);
  return variance > 0.0 ? (ab - sum_a * sum_b / n) / std::sqrt(variance) : 0.0;
}

/// Climbs to the nearest maximum by steps that are halved.
void refine(const Signal& first, const Signal& second, bool with_drift, double step,
            ClockEstimate& estimate) {
  const double duration = std::max(second.time.back() - second.time.front(), 1.0);
  const auto improved = [&](double offset_change, double drift_change) {
    ClockRelation moved = estimate.relation;
    moved.offset_seconds += offset_change;
    moved.drift += drift_change;
    const double value = correlation(first, second, moved);
    if (value <= estimate.correlation) return false;
    estimate.relation = moved;
    estimate.correlation = value;
    return true;
  };
  for (; step > 1e-3 * second.interval; step *= 0.5) {
    bool moving = true;
    for (int i = 0; moving && i < 100; ++i) {
      moving = improved(step, 0.0) || improved(-step, 0.0);
      const double slope = step / duration;
      // Drift turns about the middle of the series, so that it leaves the offset's fit as it is.
      const double middle = -0.5 * slope * duration;
      if (with_drift) moving = improved(middle, slope) || improved(-middle, -slope) || moving;
    }
  }
}

struct SeriesFile {
  fs::path path;  ///< of a discarded light map: what it would have been called
  ClockSeconds time = 0.0;
  std::string discarded;
};

fs::path folder_of(const std::string& pattern) {
  fs::path path(pattern);
  if (fs::is_directory(path)) return path;
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

/// Reasons by name, from the report that probe_light() leaves.
std::map<std::string, std::string> discarded_probes(const fs::path& folder) {
  std::map<std::string, std::string> reasons;
  if (!fs::is_regular_file(folder / "probe.toml")) return reasons;
  const ConfigFile report(folder / "probe.toml", "light probe report", "docs/guide/light-probe.md");
  for (ConfigSection& photograph : report.root().tables("photograph")) {
    std::string name, reason;
    photograph.text("name", name);
    photograph.text("discarded", reason);
    if (!reason.empty()) reasons[name] = reason;
  }
  return reasons;
}

/// Names what the list of times and the files do not have in common, and files that only their names order.
void note_doubtful_times(const std::string& pattern, const std::vector<SeriesFile>& series,
                         const std::vector<std::string>& without_line,
                         const std::vector<std::string>& without_file, const RunContext& run) {
  if (!without_line.empty())
    run.note(pattern, ": not listed in ", times_file_name,
             ", left out where their metadata have no time: ", listed(without_line, max_names));
  if (!without_file.empty())
    run.note(pattern, ": listed in ", times_file_name,
             ", but there is no such file: ", listed(without_file, max_names));
  std::vector<std::string> equal;
  for (std::size_t i = 0; i < series.size(); ++i)
    if ((i > 0 && series[i].time == series[i - 1].time) ||
        (i + 1 < series.size() && series[i].time == series[i + 1].time))
      equal.push_back(series[i].path.filename().string());
  if (!equal.empty())
    run.note(pattern,
             ": files share one time, so that they are paired in the order of their names, which need "
             "not be that of their lights: ",
             listed(equal, max_names), "; list times with fractions of a second in ", times_file_name);
}

/// In order of time.
std::vector<SeriesFile> read_series(const std::string& pattern, const RunContext& run) {
  const fs::path folder = folder_of(pattern);
  const auto times = read_times(folder);
  const auto discarded = discarded_probes(folder);
  std::map<std::string, ClockSeconds> unused = times;
  for (const auto& [name, reason] : discarded) unused.erase(name);
  for (const auto& entry : fs::directory_iterator(folder))  // the pattern need not match all
    for (const fs::path& name : {entry.path().filename(), entry.path().stem()}) unused.erase(name.string());
  std::vector<SeriesFile> series;
  std::vector<std::string> without_line, without_file;
  for (const auto& [name, time] : unused) without_file.push_back(name);
  for (const GlobMatch& match : expand_glob(pattern)) {
    auto listed = times.find(match.path.stem().string());
    if (listed == times.end()) listed = times.find(match.path.filename().string());
    const auto time = listed != times.end() ? std::optional(listed->second) : capture_time(match.path);
    if (listed == times.end() && !times.empty()) without_line.push_back(match.path.filename().string());
    if (!time && !times.empty()) continue;  // not photographed, or not shown
    if (!time)
      throw InputError(match.path, ": has no capture time in its metadata or its name; list it in ",
                       folder / times_file_name, " as NAME<tab>2004-06-21T12:30:05");
    series.push_back({match.path, *time, ""});
  }
  for (const auto& [name, reason] : discarded)
    if (const auto listed = times.find(name); listed != times.end() && !fs::exists(folder / (name + ".exr")))
      series.push_back({folder / (name + ".exr"), listed->second, reason});
  std::ranges::stable_sort(series, {}, &SeriesFile::time);
  note_doubtful_times(pattern, series, without_line, without_file, run);
  return series;
}

std::vector<ClockSeconds> times_of(const std::vector<SeriesFile>& series) {
  std::vector<ClockSeconds> times;
  for (const SeriesFile& file : series) times.push_back(file.time);
  return times;
}

/// Mean luminance, each row by its weight; of files that are there.
std::vector<TimedBrightness> brightness_of(const std::vector<SeriesFile>& series, bool lat_long,
                                           Progress& progress, const RunContext& run) {
  std::vector<TimedBrightness> result;
  for (const SeriesFile& file : series) {
    run.throw_if_stopped();
    progress.advance();
    if (!file.discarded.empty()) continue;
    const Image image = read_image(file.path);
    double sum = 0.0, total = 0.0;
    for (int y = 0; y < image.height; ++y) {
      const double weight = lat_long ? std::sin(std::numbers::pi * (y + 0.5) / image.height) : 1.0;
      for (float value : image.row(y))
        if (std::isfinite(value)) {
          sum += weight * value;
          total += weight;
        }
    }
    result.push_back({file.time, total > 0.0 ? sum / total : 0.0});
  }
  return result;
}

void bring_clocks_together(const MatchRequest& request, const std::vector<SeriesFile>& observed,
                           const std::vector<SeriesFile>& probes, MatchSummary& summary,
                           const RunContext& run) {
  if (request.offset_seconds) {
    if (!request.drift_ppm)
      throw InputError(
          "the clock drift can be estimated only together with the offset; give --offset auto as well");
    summary.clocks = {*request.offset_seconds, 1e-6 * *request.drift_ppm, probes.front().time};
    return;
  }
  Progress progress(run, "measuring brightness", observed.size() + probes.size());
  const auto scene = brightness_of(observed, false, progress, run);
  const auto light =
      brightness_of(probes, request.parameterisation == Parameterisation::lat_long, progress, run);
  summary.estimate = estimate_clocks(scene, light, request.largest_offset_seconds, !request.drift_ppm);
  summary.clocks = summary.estimate->relation;
  if (request.drift_ppm) summary.clocks.drift = 1e-6 * *request.drift_ppm;
}

void pair_up(const std::vector<SeriesFile>& observed, const std::vector<SeriesFile>& probes,
             MatchSummary& summary) {
  const auto observed_times = times_of(observed);
  const auto probe_times = times_of(probes);
  std::vector<bool> observed_used(observed.size()), probe_used(probes.size());
  for (const auto& [o, p] :
       match_in_time(observed_times, probe_times, summary.clocks, summary.tolerance_seconds)) {
    observed_used[o] = probe_used[p] = true;
    if (!probes[p].discarded.empty()) {
      summary.observed_left_out.push_back(
          {observed[o].path, "its light was discarded: " + probes[p].discarded});
      summary.probes_left_out.push_back({probes[p].path, "discarded: " + probes[p].discarded});
      continue;
    }
    summary.pairs.push_back({observed[o].path, probes[p].path,
                             observed[o].time - summary.clocks.first_from_second(probes[p].time)});
  }
  const std::string reason = formatted("has no partner within %.3g s", summary.tolerance_seconds);
  for (std::size_t i = 0; i < observed.size(); ++i)
    if (!observed_used[i]) summary.observed_left_out.push_back({observed[i].path, reason});
  for (std::size_t i = 0; i < probes.size(); ++i)
    if (!probe_used[i])
      summary.probes_left_out.push_back(
          {probes[i].path, probes[i].discarded.empty() ? reason : "discarded: " + probes[i].discarded});
}

void copy_atomically(const fs::path& from, const fs::path& to) {
  write_atomically(to, [&](const fs::path& temporary) {
    std::error_code error;
    fs::copy_file(from, temporary, fs::copy_options::overwrite_existing, error);
    if (error) throw DeviceError(from.string(), error.value(), "cannot copy to ", to);
  });
}

std::string plan_of(const MatchRequest& request, const CaptureSession& session) {
  toml::array frames;
  for (const CaptureFrame& frame : session.frames) {
    const auto crc = [](const fs::path& file) {
      return formatted("%08x", inspect_file(file.parent_path(), file.filename().string()).crc32);
    };
    frames.push_back(toml::table{{"name", frame.name},
                                 {"role", std::string(name_of(frame.role))},
                                 {"illumination", crc(frame.illumination)},
                                 {"observed", crc(frame.observed)},
                                 {"order", frame.order}});
  }
  std::ostringstream text;
  text << toml::table{{"format", "refield matched series"},
                      {"version", 1},
                      {"mask", request.mask ? request.mask->filename().string() : ""},
                      {"frame", frames}}
       << "\n";
  return text.str();
}

/// The pairs as frames, named after the photograph, still at their places outside the session.
CaptureSession frames_of(const MatchRequest& request, const MatchSummary& summary,
                         const std::vector<SeriesFile>& observed) {
  CaptureSession session;
  session.light.parameterisation = request.parameterisation;
  std::map<fs::path, ClockSeconds> time;
  for (const SeriesFile& file : observed) time[file.path] = file.time;
  for (const MatchedPair& pair : summary.pairs) {
    const auto place = session.frames.size() + 1;
    const std::string light = pair.probe.stem().string();
    FrameRole role = role_of_light(light);
    if (role == FrameRole::train && request.test_every > 0 &&
        place % static_cast<std::size_t>(request.test_every) == 0)
      role = FrameRole::test;
    session.frames.push_back({pair.observed.stem().string(), role, "natural", pair.probe, pair.observed,
                              time[pair.observed] - time[summary.pairs.front().observed]});
  }
  return session;
}

void write_session(const MatchRequest& request, CaptureSession session, const RunContext& run) {
  std::vector<std::string> steps;
  if (request.mask) steps.emplace_back("mask");
  for (const CaptureFrame& frame : session.frames) steps.push_back(frame.name);
  const std::string plan = plan_of(request, session);
  SessionWriter writer(request.folder, plan, steps, request.if_exists);
  if (writer.is_complete()) return;
  session.folder = request.folder;
  if (request.mask) {
    const Mask mask = read_mask(*request.mask, session.width, session.height);
    session.mask = request.folder / "mask.png";
    if (!writer.is_done("mask")) {
      write_mask(*session.mask, mask, session.width, session.height);
      writer.finish_step("mask", {"mask.png"});
    }
  }
  Progress progress(run, "writing the session", session.frames.size());
  for (CaptureFrame& frame : session.frames) {
    run.throw_if_stopped();
    const std::vector<std::string> files = {"illumination/" + frame.name + ".exr",
                                            "observed/" + frame.name + ".exr"};
    if (!writer.is_done(frame.name)) {
      if (frame.illumination.extension() == ".exr")
        copy_atomically(frame.illumination, request.folder / files[0]);
      else  // as shown: 8-bit sRGB
        write_exr(request.folder / files[0],
                  read_light_map(frame.illumination, request.parameterisation, run).radiance);
      copy_atomically(frame.observed, request.folder / files[1]);
      writer.finish_step(frame.name, files);
    }
    frame.illumination = request.folder / files[0];
    frame.observed = request.folder / files[1];
    progress.advance();
  }
  writer.finish(session);
}

}  // namespace

double median_interval(std::span<const ClockSeconds> times) {
  std::vector<double> intervals;
  for (std::size_t i = 1; i < times.size(); ++i) intervals.push_back(times[i] - times[i - 1]);
  return upper_median(std::move(intervals));
}

ClockEstimate estimate_clocks(std::span<const TimedBrightness> first, std::span<const TimedBrightness> second,
                              double largest_offset_seconds, bool with_drift) {
  const std::string remedy = "; give the offset of the clocks with --offset";
  if (first.size() < least_common || second.size() < least_common)
    throw InputError("series of ", first.size(), " and ", second.size(),
                     " photographs are too short to estimate the clock offset from brightness", remedy);
  if (!(largest_offset_seconds > 0.0))
    throw InputError("the largest offset to try must be above zero seconds");
  const Signal a(first), b(second);
  const double step = 0.5 * std::min(a.interval, b.interval);
  if (!(step > 0.0)) throw InputError("photographs of one series share one time", remedy);

  const auto tries = static_cast<int>(std::min(2e6, std::ceil(largest_offset_seconds / step)));
  std::vector<double> found(2 * tries + 1);
  ClockEstimate best{{0.0, 0.0, b.time.front()}, -2.0, 0.0};
  for (int i = -tries; i <= tries; ++i) {
    const ClockRelation relation{i * step, 0.0, b.time.front()};
    const double value = found[i + tries] = correlation(a, b, relation);
    if (value > best.correlation) best = {relation, value, 0.0};
  }
  const int peak = static_cast<int>(std::lround(best.relation.offset_seconds / step));
  constexpr int another = 8;  // steps: four intervals away it is another offset
  for (int i = -tries; i <= tries; ++i)
    if (std::abs(i - peak) > another) best.runner_up = std::max(best.runner_up, found[i + tries]);
  refine(a, b, with_drift, step, best);
  if (best.correlation < least_correlation)
    throw InputError("the brightness of the two series is not correlated (highest correlation ",
                     best.correlation, " within ±", largest_offset_seconds, " s); ", remedy.substr(2));
  if (best.runner_up > ambiguous * best.correlation)
    throw InputError(
        "the brightness of the two series matches equally well at several offsets (correlations ",
        best.correlation, " and ", best.runner_up, ")", remedy);
  return best;
}

std::vector<std::pair<std::size_t, std::size_t>> match_in_time(std::span<const ClockSeconds> first,
                                                               std::span<const ClockSeconds> second,
                                                               const ClockRelation& relation,
                                                               double tolerance_seconds) {
  struct Candidate {
    double distance;
    std::size_t first, second;
  };
  std::vector<Candidate> candidates;
  for (std::size_t j = 0; j < second.size(); ++j) {
    const double time = relation.first_from_second(second[j]);
    const auto from = std::ranges::lower_bound(first, time - tolerance_seconds);
    for (auto at = from; at != first.end() && *at <= time + tolerance_seconds; ++at)
      candidates.push_back({std::abs(*at - time), static_cast<std::size_t>(at - first.begin()), j});
  }
  std::ranges::stable_sort(candidates, {}, &Candidate::distance);
  std::vector<bool> first_taken(first.size()), second_taken(second.size());
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (const Candidate& candidate : candidates) {
    if (first_taken[candidate.first] || second_taken[candidate.second]) continue;
    first_taken[candidate.first] = second_taken[candidate.second] = true;
    pairs.emplace_back(candidate.first, candidate.second);
  }
  std::ranges::sort(pairs);
  return pairs;
}

MatchSummary match_series(const MatchRequest& request, const RunContext& run) {
  check_session_folder(request.folder, request.if_exists);
  const auto observed = read_series(request.observed, run);
  const auto probes = read_series(request.probes, run);
  MatchSummary summary;
  bring_clocks_together(request, observed, probes, summary, run);
  summary.tolerance_seconds = request.tolerance_seconds.value_or(0.5 * median_interval(times_of(probes)));
  if (!(summary.tolerance_seconds >= 0.0))
    throw InputError("the tolerance is ", summary.tolerance_seconds, " s; it must not be negative");
  pair_up(observed, probes, summary);
  if (summary.pairs.empty())
    throw InputError("no photograph of ", request.observed, " was taken within ", summary.tolerance_seconds,
                     " s of a light map of ", request.probes, "; check the clocks (--offset) and --max-gap");
  CaptureSession session = frames_of(request, summary, observed);
  check_image_sizes(session);
  write_session(request, std::move(session), run);
  return summary;
}

}  // namespace refield
