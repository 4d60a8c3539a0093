// SPDX-License-Identifier: Apache-2.0
#include "estimate/quality/frame_check.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/base/run_context.h"
#include "core/image/metrics.h"

namespace refield {

namespace {

void log_drift(const Drift& drift, const RunContext& run) {
  if (drift.points.empty()) return;
  run.note(formatted("drift: brightness changed by up to %.2f %% over %zu reference frames: %s",
                     100.0 * drift.largest, drift.points.size(),
                     drift.significant ? "divided out" : "below the measurement uncertainty, not corrected"));
  for (const DriftPoint& point : drift.points)
    if (!point.used) run.note("drift: ", point.frame, " does not fit the curve of the others and is ignored");
}

/// The fit squares products of samples and sums of light in single precision, which further off are infinite
/// or zero. Such photographs come from a conversion gone wrong, which scaling them silently would hide.
void require_usual_brightness(const EstimateJob& job) {
  constexpr double min_mean = 1e-9, max_mean = 1e7;
  const double typical = std::sqrt(job.mean_square);
  if (typical == 0.0 || (typical >= min_mean && typical <= max_mean)) return;
  throw InputError(name_of(job.session),
                   formatted(": the photographs' samples are about %.1e, too %s for the computation; scale "
                             "all photographs by the same factor to values around 1",
                             typical, typical < min_mean ? "small" : "large"));
}

double share_not_measured(const PixelSample& sample) {
  const auto count = std::ranges::count_if(sample.values, [](float value) { return std::isnan(value); });
  return sample.values.empty() ? 0.0 : static_cast<double>(count) / static_cast<double>(sample.values.size());
}

/// Throws where a channel was measured nowhere, which would leave it black; notes where some pixels lack one.
void require_measured_channels(const EstimateJob& job, const PixelSample& sample, const RunContext& run) {
  static constexpr const char* channels[] = {"red", "green", "blue"};
  int lacking = 0;
  std::array<bool, 3> measured{};
  for (int p = 0; p < sample.pixels; ++p) {
    bool lacks = false;
    for (int c = 0; c < 3; ++c) {
      const bool any = std::any_of(sample.series(c, p), sample.series(c, p) + sample.images,
                                   [](float value) { return std::isfinite(value); });
      measured[c] = measured[c] || any;
      lacks = lacks || !any;
    }
    lacking += lacks;
  }
  if (lacking == 0) return;
  for (int c = 0; c < 3; ++c)
    if (!measured[c])
      throw InputError(name_of(job.session), ": no photograph measured the ", channels[c],
                       " channel (all its samples are clipped or marked by sigma = inf), so it would be "
                       "black; check sigma, the exposure and --clip");
  run.note(
      formatted("about %.2g %% of the pixels have a channel that no photograph measured (sigma = inf or "
                "clipped): it is black there, and the error of these pixels is not predicted",
                100.0 * lacking / sample.pixels));
}

/// A photograph or light map that changed since it was taken changes the field.
void require_intact(const EstimateJob& job, const RunContext& run) {
  const auto files = journal_files(job.session);
  std::vector<fs::path> paths;
  for (const auto* frames : {&job.frames, &job.references})
    for (const CaptureFrame& frame : *frames) {
      paths.push_back(frame.illumination);
      paths.push_back(frame.observed);
    }
  tbb::parallel_for(std::size_t{0}, paths.size(), [&](std::size_t i) {
    run.throw_if_stopped();
    const auto file = files.find(paths[i].lexically_relative(job.session.folder).generic_string());
    if (file != files.end() && !is_intact(job.session.folder, file->second))
      throw FormatError(
          paths[i],
          "differs from the checksum in the session's journal: it was damaged or changed after the capture; "
          "take it again with --resume, or remove the file 'journal' if the change is intended");
  });
}

/// By these a field recognises the light maps of its training images, whatever their files are called.
void note_patterns(EstimateJob& job, const RunContext& run) {
  std::vector<std::string> patterns(job.frames.size());
  tbb::parallel_for(std::size_t{0}, patterns.size(), [&](std::size_t j) {
    run.throw_if_stopped();
    patterns[j] = pattern_of(job.frames[j], job.session.light.parameterisation, run);
  });
  for (std::size_t j = 0; j < patterns.size(); ++j) job.light_patterns[job.frames[j].name] = patterns[j];
}

/// Fewer photographs predict those under single primaries badly: 13 to 33 of a ball made them outliers.
constexpr int enough_for_primaries = 60;

/// What the frames are compared by.
struct FrameEvidence {
  PixelSample sample;
  LightFeatures lights;
  OutlierSearch search;

  FrameEvidence(const EstimateJob& job, const EstimateOptions& options, bool can_assess,
                const RunContext& run)
      : sample(read_pixel_sample(job.frames, job.session.width, job.session.height, job.mask,
                                 options.clip_level, run)) {
    if (!can_assess) return;
    lights = light_features(job.frames, job.session.light, run);
    search = find_outlier_frames(light_grams(lights), sample, run);
    if (sample.images >= enough_for_primaries) return;
    for (const auto& images : primary_images(lights))
      std::erase_if(search.outliers, [&](const OutlierFrame& outlier) {
        return std::ranges::find(images, outlier.frame) != images.end();
      });
  }
};

/// Corrects the frames for the rig.
void correct(EstimateJob& job, const RigModel& rig, FrameReport& report) {
  apply_rig(rig, job.session, job.frames);
  for (std::size_t j = 0; j < rig.light_of.size(); ++j)
    if (rig.light_of[j] < 0) job.left_out.push_back(rig.photographs[j]);
  job.session.frames = job.frames;
  job.rig = rig;
  report.rig.model = rig;
}

void log_rig(const RigReport& rig, const RunContext& run) {
  for (const RigFinding& finding : rig.findings) {
    if (finding.state == RigFinding::State::good) continue;
    const bool is_corrected = finding.state == RigFinding::State::corrected;
    const std::string outcome =
        formatted("; %s, residual %.4f to %.4f", is_corrected ? "corrected" : "not corrected",
                  finding.residual_before, finding.residual_after);
    run.note("rig, ", finding.effect, ": ", finding.measured, outcome);
  }
}

/// Values of the photographs that have a light become those of all.
template <class Value>
void fill_gaps(const std::vector<int>& light_of, std::vector<Value>& values) {
  if (values.empty() || light_of.empty()) return;
  std::vector<Value> all;
  std::size_t next = 0;
  for (const int light : light_of) {
    all.push_back(values[std::min(next, values.size() - 1)]);
    next += light >= 0;
  }
  values = std::move(all);
}

/// Estimates the rig and corrects the frames for it, unless they are to be kept as they are: then the
/// findings are told alone. `evidence` is taken anew where they are.
void estimate_and_correct(EstimateJob& job, const EstimateOptions& options, FrameEvidence& evidence,
                          FrameReport& report, const RunContext& run) {
  RigFinding& pairing = report.rig.findings.emplace_back();
  RigModel rig;
  for (const CaptureFrame& frame : job.frames) rig.photographs.push_back(frame.name);
  rig.light_of = find_pairing(evidence.lights, evidence.sample, job.frames, !evidence.search.outliers.empty(),
                              pairing, run);
  EstimateJob paired = job;
  std::optional<FrameEvidence> of_pairs;
  if (!rig.light_of.empty()) {
    apply_rig(rig, job.session, paired.frames);
    of_pairs.emplace(paired, options, true, run);
  }
  const FrameEvidence& used = of_pairs ? *of_pairs : evidence;
  for (CaptureFrame& frame : paired.frames) frame.correction = nullptr;
  RigReport found;
  if (!used.search.too_many) {  // else there is no majority to measure by
    std::vector<char> left_out(paired.frames.size(), 0);
    for (const OutlierFrame& outlier : used.search.outliers) left_out[outlier.frame] = 1;
    constexpr int min_last_outliers = 3;  // the camera may have moved before them
    const auto resting = std::find(left_out.rbegin(), left_out.rend(), 0);
    if (std::distance(left_out.rbegin(), resting) >= min_last_outliers)
      std::fill(left_out.rbegin(), resting, 0);
    const auto primaries = primary_images(used.lights);
    if (std::ranges::none_of(primaries, &std::vector<int>::empty))
      for (const auto& images : primaries)
        for (const int image : images) left_out[image] = 0;
    found =
        estimate_rig(paired.frames, left_out, job.session, job.mask, options.clip_level, used.lights, run);
  }
  report.rig.findings.insert(report.rig.findings.end(), found.findings.begin(), found.findings.end());
  if (options.keep_rig) {
    for (RigFinding& finding : report.rig.findings)
      if (finding.state == RigFinding::State::corrected) finding.state = RigFinding::State::suspicious;
    return;
  }
  fill_gaps(rig.light_of, found.model.shift_px);
  fill_gaps(rig.light_of, found.model.turn);
  fill_gaps(rig.light_of, found.model.gain);
  fill_gaps(rig.light_of, found.model.room);
  found.model.photographs = rig.photographs;
  found.model.light_of = rig.light_of;
  if (found.model.is_identity()) return;
  correct(job, found.model, report);
  evidence = FrameEvidence(job, options, true, run);
}

/// How many times the ambient photograph outlier `image` shows besides what the others predict of it; nullopt
/// where that leaves much of the difference.
std::optional<double> room_light_in(const EstimateJob& job, const EstimateOptions& options,
                                    const FrameEvidence& evidence, int image, const RunContext& run) {
  constexpr double max_rest = 0.3;  // of the difference, where the room light explains it
  if (!job.session.ambient) return std::nullopt;
  CaptureFrame dark = job.frames[image];
  dark.observed = *job.session.ambient;
  dark.views.reset();
  if (dark.correction) {
    FrameCorrection correction = *dark.correction;
    correction.room = 0.0f;
    dark.correction = std::make_shared<const FrameCorrection>(correction);
  }
  const std::vector<CaptureFrame> frames{dark};
  const PixelSample ambient =
      read_pixel_sample(frames, job.session.width, job.session.height, job.mask, options.clip_level, run);
  const PixelSample& sample = evidence.sample;
  std::vector<char> left_out(static_cast<std::size_t>(sample.images), 0);
  for (const OutlierFrame& outlier : evidence.search.outliers) left_out[outlier.frame] = 1;
  const LightGrams grams = light_grams(evidence.lights);
  // Medians over samples, relative to what the pixel shows: hot pixels and highlights would decide else.
  struct Sample {
    double room, difference, scale;
  };
  std::vector<Sample> samples;
  for (int c = 0; c < 3; ++c) {
    const Eigen::Map<const Eigen::MatrixXf> series(sample.series(c, 0), sample.images, sample.pixels);
    const auto loo = leave_one_out(grams.of_channel[c], series, left_out, grams.repeats, run);
    for (int p = 0; p < sample.pixels; ++p) {
      double power = 0.0;
      for (int j = 0; j < sample.images; ++j)
        if (std::isfinite(series(j, p))) power += std::pow(series(j, p), 2);
      if (const double room = *ambient.series(c, p); room > 0.0 && power > 0.0)
        samples.push_back({room, loo.residual(image, p), 1.0 / std::sqrt(power)});
    }
  }
  if (samples.empty()) return std::nullopt;
  const auto median = [&](auto value) {
    std::vector<double> values;
    for (const Sample& of : samples) values.push_back(value(of));
    return upper_median(std::move(values));
  };
  const double times = median([](const Sample& of) { return of.difference / of.room; });
  const double before = median([](const Sample& of) { return of.scale * std::abs(of.difference); });
  const double after =
      median([&](const Sample& of) { return of.scale * std::abs(of.difference - times * of.room); });
  return times > 0.0 && after < max_rest * before ? std::optional(times) : std::nullopt;
}

/// Finds the frames to leave out, and those that are doubtful.
void assess_frames(const EstimateJob& job, const EstimateOptions& options, const FrameEvidence& evidence,
                   FrameReport& report, const RunContext& run) {
  report.typical_residual = evidence.search.typical_residual;
  auto& list = evidence.search.too_many ? report.doubtful : report.left_out;
  for (const OutlierFrame& outlier : evidence.search.outliers) {
    std::string why = description_of(outlier);
    std::optional<double> room;
    if (outlier.kind != OutlierFrame::Kind::region && !evidence.search.too_many)
      room = room_light_in(job, options, evidence, outlier.frame, run);
    if (room)
      why = formatted(
          "the room light was on: it shows %.3g times the ambient photograph besides what its light explains",
          *room);
    list.push_back({job.frames[outlier.frame].name, why, outlier});
  }
}

void log_frames(const FrameReport& report, std::size_t images, const RunContext& run) {
  for (const LeftOutFrame& frame : report.left_out) run.note(frame.name, " is left out: ", frame.why);
  if (!report.doubtful.empty())
    run.note(report.doubtful.size(), " of ", images,
             " photographs do not fit the others, too many to leave out; check the capture. The first: ",
             report.doubtful.front().name, ": ", report.doubtful.front().why);
}

void leave_out(EstimateJob& job, const FrameReport& report, const EstimateOptions& options) {
  if (report.left_out.empty()) return;
  for (const LeftOutFrame& frame : report.left_out) job.left_out.push_back(frame.name);
  std::erase_if(job.frames, [&](const CaptureFrame& frame) {
    return std::ranges::find(report.left_out, frame.name, &LeftOutFrame::name) != report.left_out.end();
  });
  job.session.frames = job.frames;
  require_enough_frames(job, options);
}

Json json_of(const std::vector<LeftOutFrame>& frames) {
  auto list = Json::array();
  for (const LeftOutFrame& frame : frames)
    list.push_back({{"name", frame.name},
                    {"why", frame.why},
                    {"frame", frame.found.frame},
                    {"kind", static_cast<int>(frame.found.kind)},
                    {"times_typical", frame.found.times_typical},
                    {"residual", frame.found.residual},
                    {"brightness", frame.found.brightness},
                    {"share", frame.found.share},
                    {"x", frame.found.x},
                    {"y", frame.found.y}});
  return list;
}

Json json_of(const std::vector<RigFinding>& findings) {
  auto list = Json::array();
  for (const RigFinding& finding : findings)
    list.push_back({{"effect", finding.effect},
                    {"state", static_cast<int>(finding.state)},
                    {"amount", finding.amount},
                    {"measured", finding.measured},
                    {"residual_before", finding.residual_before},
                    {"residual_after", finding.residual_after}});
  return list;
}

std::vector<RigFinding> findings_from(const Json& list) {
  std::vector<RigFinding> findings;
  for (const auto& entry : list)
    findings.push_back({entry.at("effect"), static_cast<RigFinding::State>(entry.at("state").get<int>()),
                        entry.at("amount"), entry.at("measured"), entry.at("residual_before"),
                        entry.at("residual_after")});
  return findings;
}

std::vector<LeftOutFrame> frames_from(const Json& list, std::span<const CaptureFrame> frames_there) {
  std::vector<LeftOutFrame> frames;
  for (const auto& entry : list) {
    OutlierFrame found;
    entry.at("frame").get_to(found.frame);
    found.kind = static_cast<OutlierFrame::Kind>(entry.at("kind").get<int>());
    entry.at("times_typical").get_to(found.times_typical);
    entry.at("residual").get_to(found.residual);
    entry.at("brightness").get_to(found.brightness);
    entry.at("share").get_to(found.share);
    entry.at("x").get_to(found.x);
    entry.at("y").get_to(found.y);
    // By number: a name need not be UTF-8.
    if (found.frame < 0 || found.frame >= std::ssize(frames_there)) throw std::out_of_range("frame");
    frames.push_back({frames_there[found.frame].name, entry.at("why"), found});
  }
  return frames;
}

struct FrameCheck {
  FrameReport report;
  double mean_square = 0.0;
  NoiseModel noise;
  std::map<std::string, std::string> light_patterns;
};

/// Nothing where the file is not there, damaged or of other inputs: the frames are checked again then.
std::optional<FrameCheck> read_frame_check(const fs::path& file, const EstimateJob& job,
                                           const std::string& key) try {
  if (!fs::exists(file)) return std::nullopt;
  const auto json = json_from_text(read_text(file));
  if (json.at("job") != key) return std::nullopt;
  FrameCheck check;
  check.report.rig.model = rig_from_text(json_text(json.at("rig")), file.string());
  check.report.rig.findings = findings_from(json.at("rig_findings"));
  std::vector<CaptureFrame> frames = job.frames;
  apply_rig(check.report.rig.model, job.session, frames);
  check.report.left_out = frames_from(json.at("left_out"), frames);
  check.report.doubtful = frames_from(json.at("doubtful"), frames);
  json.at("typical_residual").get_to(check.report.typical_residual);
  json.at("clipped_share").get_to(check.report.clipped_share);
  json.at("relative_noise").get_to(check.report.noise);
  json.at("mean_square").get_to(check.mean_square);
  json.at("light_patterns").get_to(check.light_patterns);
  const auto& noise = json.at("noise");
  noise.at("log_level").get_to(check.noise.log_level);
  noise.at("log_variance").get_to(check.noise.log_variance);
  noise.at("samples_per_image").get_to(check.noise.samples_per_image);
  noise.at("image_weights").get_to(check.noise.image_weights);
  const std::size_t weights = check.noise.image_weights.size();
  const bool fits = weights == 0 || weights + check.report.left_out.size() == frames.size();
  if (!fits || check.noise.log_level.size() != check.noise.log_variance.size()) return std::nullopt;
  return check;
} catch (const Json::exception&) {
  return std::nullopt;
} catch (const std::out_of_range&) {
  return std::nullopt;
} catch (const InputError&) {  // not a rig model of this capture
  return std::nullopt;
}

}  // namespace

FrameReport check_frames(EstimateJob& job, const EstimateOptions& options, const RunContext& run) {
  FrameReport report;
  report.drift = job.drift;
  log_drift(job.drift, run);
  const auto images = static_cast<int>(job.frames.size());
  const bool can_assess = !options.keep_outliers && images >= min_frames_to_assess;
  const bool finds_rig = (options.keep_rig || !options.rig) && images >= min_frames_for_rig;
  if (options.rig && !options.keep_rig) correct(job, *options.rig, report);
  require_intact(job, run);
  note_patterns(job, run);
  FrameEvidence evidence(job, options, can_assess || finds_rig, run);
  job.mean_square = evidence.sample.mean_square({});
  report.clipped_share = share_not_measured(evidence.sample);
  require_measured_channels(job, evidence.sample, run);
  require_usual_brightness(job);
  report.residuals_before = evidence.search.residuals;
  if (finds_rig) {
    estimate_and_correct(job, options, evidence, report, run);
    job.mean_square = evidence.sample.mean_square({});
  }
  log_rig(report.rig, run);
  report.residuals = evidence.search.residuals;
  const PixelSample& sample = evidence.sample;
  if (can_assess) assess_frames(job, options, evidence, report, run);
  log_frames(report, job.frames.size(), run);
  std::vector<int> dropped;
  for (const LeftOutFrame& frame : report.left_out) dropped.push_back(frame.found.frame);
  job.noise = measure_noise(sample.windows, sample.images, dropped);
  if (!job.noise.log_level.empty())
    report.noise = std::sqrt(job.noise.relative_variance(sample.mean_square(dropped)));
  if (!dropped.empty()) job.mean_square = sample.mean_square(dropped);
  leave_out(job, report, options);
  return report;
}

std::string frame_check_key(const EstimateJob& job, const EstimateOptions& options) {
  // The gains are what the order of frames, which is no content of a file, does to the photographs.
  auto gains = Json::array();
  if (job.drift.significant)
    for (const CaptureFrame& frame : job.frames) gains.push_back(frame.gain);
  return job_key(job, options) + json_text(Json{{"keep_outliers", options.keep_outliers},
                                                {"keep_drift", options.keep_drift},
                                                {"keep_rig", options.keep_rig},
                                                {"rig", options.rig ? rig_text(*options.rig) : ""},
                                                {"gains", gains}});
}

std::string frame_check_text(const EstimateJob& job, const FrameReport& report, const std::string& key) {
  // Numbers are written with all digits that they need to be read back to the bit.
  const Json json = {{"job", key},
                     {"rig", json_from_text(rig_text(report.rig.model))},
                     {"rig_findings", json_of(report.rig.findings)},
                     {"left_out", json_of(report.left_out)},
                     {"doubtful", json_of(report.doubtful)},
                     {"typical_residual", report.typical_residual},
                     {"clipped_share", report.clipped_share},
                     {"relative_noise", report.noise},
                     {"mean_square", job.mean_square},
                     {"light_patterns", job.light_patterns},
                     {"noise",
                      {{"log_level", job.noise.log_level},
                       {"log_variance", job.noise.log_variance},
                       {"samples_per_image", job.noise.samples_per_image},
                       {"image_weights", job.noise.image_weights}}}};
  return json_text(json, 1) + "\n";
}

FrameReport check_frames_once(EstimateJob& job, const EstimateOptions& options, const fs::path& file,
                              const RunContext& run) {
  const std::string key = frame_check_key(job, options);
  if (auto check = read_frame_check(file, job, key)) {
    check->report.drift = job.drift;
    log_drift(job.drift, run);
    if (!check->report.rig.model.is_identity())
      correct(job, RigModel(check->report.rig.model), check->report);
    log_rig(check->report.rig, run);
    log_frames(check->report, job.frames.size(), run);
    job.mean_square = check->mean_square;
    job.noise = std::move(check->noise);
    job.light_patterns = std::move(check->light_patterns);
    leave_out(job, check->report, options);
    return check->report;
  }
  FrameReport report = check_frames(job, options, run);
  write_text_atomically(file, frame_check_text(job, report, key));
  return report;
}

}  // namespace refield
