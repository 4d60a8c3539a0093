// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/capture.h"

#include <cmath>
#include <future>

#include "acquire/capture/scene_mask.h"
#include "acquire/hdr/bracket_files.h"
#include "acquire/hdr/hdr_merge.h"
#include "core/base/files.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

constexpr std::uint8_t black = 0;
constexpr std::uint8_t white_level = 255;

/// Exposure times: as given, as an earlier run of this capture metered them, or metered now.
/// `note` receives what there is to say of a plan by noise.
std::vector<Seconds> choose_exposures(const CaptureRequest& request, const CameraDescription& camera,
                                      const IlluminatorDescription& display, FramePairing& pairing,
                                      std::string& note) {
  if (!request.exposures.empty()) return request.exposures;
  if (request.is_metered() && request.if_exists == IfExists::resume)
    if (stored_plan(request.folder)) return exposures_of_plan(request.folder / "plan.toml");
  ExposurePlanOptions plan = request.exposure_plan;
  if (request.is_metered()) {
    pairing.show(uniform_drive(display.width, display.height, white_level));
    const Probe probe = [&](Seconds exposure) { return pairing.photograph(exposure, request.gain); };
    if (plan.relative_noise > 0.0) {
      const NoisePlan fewest = min_exposures(meter_range(camera, request.camera, probe), plan, camera,
                                             request.camera, request.gain, request.frames_per_exposure);
      note = fewest.sentence();
      return fewest.exposures;
    }
    const Seconds metered = shortest_useful_exposure(camera, request.camera, probe);
    // The longest must fit the camera, too.
    plan.shortest = std::min(metered, camera.longest_exposure * std::pow(plan.ratio, 1 - plan.count));
  }
  return exponential_exposures(plan, camera);
}

std::vector<std::string> steps_of(const CaptureRequest& request) {
  std::vector<std::string> steps = {"ambient"};
  if (request.mask.kind != MaskSource::Kind::none) steps.push_back("mask");
  for (const CaptureLight& light : request.lights) steps.push_back(light.name);
  return steps;
}

std::string illumination_file(const CaptureLight& light) {
  return "illumination/" + light.name + ".exr";
}
std::string observed_file(const CaptureLight& light) {
  return "observed/" + light.name + ".exr";
}
std::string raw_file(const std::string& name, std::size_t exposure, std::optional<int> repeat) {
  std::string file = "raw/";
  file += name + "_e" + std::to_string(exposure);
  if (repeat) file += "_r" + std::to_string(*repeat);
  return file + ".png";
}
constexpr const char* ambient_file = "ambient.exr";
constexpr const char* mask_file = "mask.png";

/// One run of a capture: the devices, the folder, and what has been learnt on the way.
class CaptureRun {
 public:
  CaptureRun(const CaptureRequest& request, const CameraDescription& camera,
             const IlluminatorDescription& display, std::vector<Seconds> exposures, FramePairing& pairing,
             SessionWriter& session)
      : request_(request),
        camera_(camera),
        display_(display),
        exposures_(std::move(exposures)),
        pairing_(pairing),
        session_(session),
        useful_(exposures_.size(), 0.0) {}

  /// In parts of a few frames, so that memory does not grow with their number.
  void take_ambient(const RunContext& run) {
    if (session_.is_done("ambient")) {
      ambient_ = read_photograph(session_.folder() / ambient_file);
      return;
    }
    constexpr int max_part = 4;
    std::vector<std::string> files = {ambient_file};
    const int repeats = request_.ambient_count();
    Progress progress(run, "photographing the ambient light", static_cast<std::uint64_t>(repeats));
    for (int first = 0; first < repeats; first += max_part) {
      run.throw_if_stopped();
      const Repeats part{first, std::min(max_part, repeats - first), repeats};
      const bool backwards = first / max_part % 2 == 1;
      const auto frames = first == 0 ? frames_under(uniform_drive(display_.width, display_.height, black),
                                                    part.count, backwards)
                                     : frames_of_brackets(part.count, backwards);
      add(photograph("ambient", frames, part, files), static_cast<float>(part.count) / repeats, ambient_);
      progress.advance(static_cast<std::uint64_t>(part.count));
    }
    for (float& variance : ambient_.sigma.values) variance = std::sqrt(variance);
    write_photograph(session_.folder() / ambient_file, ambient_);
    session_.finish_step("ambient", files);
  }

  void make_mask() {
    if (request_.mask.kind == MaskSource::Kind::none || session_.is_done("mask")) return;
    std::vector<std::string> files = {mask_file};
    write_mask(session_.folder() / mask_file, mask(files), camera_.width, camera_.height);
    session_.finish_step("mask", files);
  }

  /// What the manifest will say of a light's frame.
  CaptureFrame frame_of(const CaptureLight& light) const {
    return {light.name,
            light.role,
            light.kind,
            session_.folder() / illumination_file(light),
            session_.folder() / observed_file(light),
            static_cast<double>(place_of(light))};
  }
  std::size_t place_of(const CaptureLight& light) const { return &light - request_.lights.data(); }

  void take_all(Progress& progress, const RunContext& run) {
    try {
      take_lights(progress, run);
    } catch (...) {
      try {
        finish_last();
      } catch (...) {  // What ended the capture is more to the point.
      }
      throw;
    }
    finish_last();
  }

  void finish() {
    CaptureSession manifest;
    manifest.folder = session_.folder();
    manifest.light = {display_.width, display_.height, Parameterisation::monitor};
    manifest.monitors = request_.monitors;
    manifest.width = camera_.width;
    manifest.height = camera_.height;
    for (const CaptureLight& light : request_.lights)
      if (!session_.is_left_out(light.name)) manifest.frames.push_back(frame_of(light));
    manifest.ambient = session_.folder() / ambient_file;
    if (request_.mask.kind != MaskSource::Kind::none) manifest.mask = session_.folder() / mask_file;
    session_.finish(manifest);
  }

  /// Bytes that the steps still to do may take, uncompressed.
  std::uint64_t bytes_needed() const {
    const std::uint64_t pixels = static_cast<std::uint64_t>(camera_.width) * camera_.height;
    const std::uint64_t texels = static_cast<std::uint64_t>(display_.width) * display_.height;
    const std::uint64_t sample = request_.precision == Precision::half ? 2 : 4;
    std::uint64_t frame = 6 * sample * pixels + 3 * sizeof(float) * texels;
    if (request_.keep_raw)
      frame += exposures_.size() * request_.frames_per_exposure * pixels * sizeof(std::uint16_t) *
               (camera_.layout == PixelLayout::rgb ? 3 : 1);
    return frame * (request_.lights.size() + 2 - std::min(session_.found_done(), request_.lights.size()));
  }

  void report(CaptureSummary& summary) const {
    summary.out_of_range_lights = out_of_range_lights_;
    summary.exposures = exposures_;
    summary.darker_than_ambient = darker_;
    if (photographs_ == 0) return;
    for (double useful : useful_) summary.useful_fraction.push_back(useful / photographs_);
    summary.clipped_fraction = clipped_ / photographs_;
  }

 private:
  /// Of the frames that a photograph has per exposure, those that are taken and merged together.
  struct Repeats {
    int first = 0;
    int count = 1;
    int all = 1;
  };
  Repeats all_frames() const { return {0, request_.frames_per_exposure, request_.frames_per_exposure}; }

  /// Adds a share of a photograph to a sum, whose sigma holds the variance.
  static void add(const Photograph& part, float share, Photograph& sum) {
    if (sum.radiance.values.empty()) {
      sum.radiance = Image(part.radiance.width, part.radiance.height, 3);
      sum.sigma = sum.radiance;
    }
    for (std::size_t i = 0; i < part.radiance.values.size(); ++i) {
      sum.radiance.values[i] += share * part.radiance.values[i];
      sum.sigma.values[i] += share * share * part.sigma.values[i] * part.sigma.values[i];
    }
  }

  /// A photograph that is merged and written while the next one is taken.
  struct Last {
    const CaptureLight* light = nullptr;
    std::vector<std::string> files;
    MergeStatistics statistics;
    std::future<Photograph> photograph;
  };

  void take_lights(Progress& progress, const RunContext& run) {
    bool enough = false;
    for (const CaptureLight& light : request_.lights) {
      run.throw_if_stopped();
      const bool counts = light.role == FrameRole::train && request_.is_enough;
      if (counts && (enough || session_.is_left_out(light.name))) {
        if (!session_.is_done(light.name)) session_.leave_out(light.name);
      } else {
        if (request_.before_light) request_.before_light(place_of(light));
        if (!session_.is_done(light.name)) take_photograph(light, run);
        if (counts) {
          finish_last();
          enough = request_.is_enough(frame_of(light));
        }
      }
      progress.advance();
    }
  }

  void take_photograph(const CaptureLight& light, const RunContext& run) {
    const LightMap wanted = read_light_map(light.wanted, Parameterisation::monitor, run);
    std::size_t too_bright = 0;
    DriveImage pattern = drive_levels(wanted.radiance, request_.monitor, &too_bright);
    out_of_range_lights_ += too_bright > 0;
    // Each second one backwards: the camera keeps its exposure from one pattern to the next.
    auto frames = frames_under(pattern, request_.frames_per_exposure, place_of(light) % 2 == 1);
    finish_last();
    last_ = std::make_unique<Last>();
    last_->light = &light;
    last_->files = {illumination_file(light), observed_file(light)};
    last_->photograph = std::async(
        std::launch::async, [this, &last = *last_, pattern = std::move(pattern), frames = std::move(frames)] {
          Photograph observed = merged(last.light->name, frames, all_frames(), last.files, last.statistics);
          subtract_ambient(observed, ambient_);
          write_exr(session_.folder() / last.files[0], emitted_above_black(pattern, request_.monitor));
          write_photograph(session_.folder() / last.files[1], observed, request_.precision);
          return observed;
        });
  }

  void finish_last() {
    if (!last_) return;
    const auto last = std::move(last_);
    const Photograph observed = last->photograph.get();
    count(last->statistics, request_.frames_per_exposure);
    if (darker_share(observed, ambient_) > clearly_darker_share) darker_.push_back(last->light->name);
    session_.finish_step(last->light->name, last->files);
    if (request_.on_photograph) request_.on_photograph(observed);
  }

  /// `repeats` frames of each exposure in growing order, taken in that order or backwards.
  std::vector<RawFrame> frames_under(const DriveImage& pattern, int repeats, bool backwards) {
    pairing_.prepare(backwards ? exposures_.back() : exposures_.front(), request_.gain);
    pairing_.show(pattern);
    return frames_of_brackets(repeats, backwards);
  }

  std::vector<RawFrame> frames_of_brackets(int repeats, bool backwards) {
    const std::size_t exposures = exposures_.size();
    const auto place = [&](std::size_t i) { return backwards ? exposures - 1 - i : i; };
    std::vector<RawFrame> frames(exposures * repeats);
    for (std::size_t i = 0; i < exposures; ++i)
      for (int repeat = 0; repeat < repeats; ++repeat)
        frames[place(i) * repeats + repeat] = pairing_.photograph(exposures_[place(i)], request_.gain);
    return frames;
  }

  /// Merges the frames. Adds the raw files that are kept to `files`.
  Photograph merged(const std::string& name, const std::vector<RawFrame>& frames, const Repeats& repeats,
                    std::vector<std::string>& files, MergeStatistics& statistics) const {
    for (std::size_t i = 0; request_.keep_raw && i < frames.size(); ++i) {
      const int repeat = repeats.first + static_cast<int>(i % repeats.count);
      files.push_back(
          raw_file(name, i / repeats.count, repeats.all > 1 ? std::optional(repeat) : std::nullopt));
      write_raw_frame(session_.folder() / files.back(), frames[i]);
    }
    Photograph photograph = merge_exposures(frames, request_.camera, {}, &statistics);
    divide(photograph, request_.camera.flat_field);
    return photograph;
  }

  void count(const MergeStatistics& statistics, int repeats) {
    for (std::size_t i = 0; i < statistics.useful_fraction.size(); ++i)
      useful_[i / repeats] += statistics.useful_fraction[i] / repeats;
    clipped_ += statistics.clipped_fraction;
    ++photographs_;
  }

  Photograph photograph(const std::string& name, const std::vector<RawFrame>& frames, const Repeats& repeats,
                        std::vector<std::string>& files) {
    MergeStatistics statistics;
    Photograph photograph = merged(name, frames, repeats, files, statistics);
    if (repeats.first == 0) count(statistics, repeats.count);
    return photograph;
  }

  Mask mask(std::vector<std::string>& files) {
    if (request_.mask.kind == MaskSource::Kind::painted)
      return read_mask(request_.mask.file, camera_.width, camera_.height);
    const auto frames = frames_under(uniform_drive(display_.width, display_.height, white_level),
                                     request_.frames_per_exposure, false);
    Photograph lit = photograph("mask", frames, all_frames(), files);
    subtract_ambient(lit, ambient_);
    if (request_.mask.file.empty()) return scene_mask(lit);
    const Photograph background = read_photograph(request_.mask.file);
    return scene_mask(lit, &background);
  }

  const CaptureRequest& request_;
  const CameraDescription camera_;
  const IlluminatorDescription display_;
  const std::vector<Seconds> exposures_;
  FramePairing& pairing_;
  SessionWriter& session_;
  Photograph ambient_;
  std::unique_ptr<Last> last_;
  std::vector<double> useful_;
  double clipped_ = 0.0;
  int photographs_ = 0;
  std::size_t out_of_range_lights_ = 0;
  std::vector<std::string> darker_;
};

}  // namespace

CaptureSummary capture(const CaptureRequest& request, Camera& camera, Illuminator& illuminator,
                       Trigger* trigger, const RunContext& run) {
  const auto start = std::chrono::steady_clock::now();
  const CameraDescription described = camera.describe();
  const IlluminatorDescription display = illuminator.describe();
  check_session_folder(request.folder, request.if_exists);
  request.check(described, display, run);
  FramePairing pairing(camera, illuminator, trigger, request.timing);
  std::string exposure_note;
  const auto exposures =
      settable_exposures(choose_exposures(request, described, display, pairing, exposure_note), described);
  SessionWriter session(request.folder, capture_plan_text(request, exposures, described, display),
                        steps_of(request), request.if_exists);
  CaptureRun captured(request, described, display, exposures, pairing, session);

  // The plan states its checksum; of a complete session it is written again where it was lost or changed.
  write_calibration(request.folder / "calibration.toml", request.camera, request.monitor, request.timing);
  if (!session.is_complete()) {
    require_free_space(request.folder, captured.bytes_needed());
    if (request.keep_raw) create_folders(request.folder / "raw");
    captured.take_ambient(run);
    captured.make_mask();
    Progress progress(run, "capturing", request.lights.size());
    captured.take_all(progress, run);
    captured.finish();
  }

  CaptureSummary summary;
  summary.exposure_note = exposure_note;
  for (const CaptureLight& light : request.lights) summary.left_out += session.is_left_out(light.name);
  summary.lights = request.lights.size() - summary.left_out;
  summary.found_done = session.found_done();
  summary.found_damaged = session.found_damaged();
  summary.discarded = pairing.counts();
  captured.report(summary);
  summary.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return summary;
}

}  // namespace refield
