// SPDX-License-Identifier: Apache-2.0
// refield acquire guide: the steps of a capture in their order, each a question and a command of this
// program.
#include <unistd.h>

#include <cmath>

#include "acquire/calibrate/bench.h"
#include "acquire/calibrate/calibrate.h"
#include "acquire/capture/capture.h"
#include "acquire/capture/exposure_plan.h"
#include "acquire/capture/frame_pairing.h"
#include "acquire/devices/monitors.h"
#include "acquire/devices/v4l2_device.h"
#include "acquire/hdr/hdr_merge.h"
#include "cli/acquire/session_rig.h"
#include "cli/acquire/until_error.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "estimate/rig/verdict.h"
#include "simulate/tabletop/recipe.h"

namespace refield::cli {

namespace {

struct GuideOptions {
  fs::path folder = "capture";
  std::string camera;
  fs::path truth;
  std::vector<std::string> settings;  ///< SECTION.KEY=VALUE
  std::string monitor;
  std::string light_size;
  std::string max_noise;
  std::string patterns;
  std::string until_error;
  int level_step = 0;
  bool yes = false;
};

/// Something to choose, by its number or by its name in a rig file.
struct Choice {
  std::string name;
  std::string description;
};

std::string time_text(double seconds) {
  const auto s = static_cast<int>(std::lround(seconds));
  if (s < 100) return formatted("%d s", s);
  if (s < 5400) return formatted("%d min", (s + 30) / 60);
  return formatted("%.1f h", s / 3600.0);
}

int whole_number(const std::string& text, int low, int high) {
  const auto value = number_from_text<int>(text);
  if (!value || *value < low || *value > high)
    throw InputError("'", text, "' is not valid; give a whole number from ", low, " to ", high);
  return *value;
}

std::vector<Choice> find_cameras() {
  std::vector<Choice> list;
  const auto v4l2 = find_v4l2_cameras();
  for (const V4l2Identity& camera : v4l2) {
    const auto same = std::ranges::count(v4l2, camera.card, &V4l2Identity::card);
    list.push_back(
        {same == 1 ? camera.card : camera.node.string(), "V4L2 camera " + camera.card + " at " + camera.bus});
  }
  for (const GenicamIdentity& camera : find_genicam_cameras())
    list.push_back({"genicam:" + camera.serial, "GenICam camera " + camera.vendor + " " + camera.model +
                                                    ", " + camera.protocol + " at " + camera.address});
  for (const GphotoIdentity& camera : find_gphoto_cameras())
    list.push_back({"gphoto:" + camera.model, "DSLR at " + camera.port});
  return list;
}

/// Whether a camera, as `find_cameras` or the user names it, takes a frame when it is told to: with one that
/// runs freely, each change of the exposure or the pattern costs the frame that is on its way.
bool triggers_by_software(const std::string& name) {
  const std::string kind = "genicam:";
  if (!name.starts_with(kind)) return false;
  const std::string device = name.substr(kind.size());
  for (const GenicamIdentity& camera : find_genicam_cameras()) {
    if (device != camera.serial && device != camera.address && device != camera.id && device != camera.model)
      continue;
    for (const GenicamFeature& feature : abilities_of(camera).features)
      if (feature.name == "TriggerSource") return feature.limits.find("Software") != std::string::npos;
  }
  return false;
}

/// A monitor by its name in `list`; the size is for the light maps.
struct MonitorChoice : Choice {
  int width = 0, height = 0;
};

std::vector<MonitorChoice> find_monitors() {
  std::vector<MonitorChoice> list;
  try {
    for (const WindowDisplay& display : window_displays())
      list.push_back({{"window:" + std::to_string(list.size()),
                       "full-screen window on display '" + display.name + "', " +
                           std::to_string(display.width) + "×" + std::to_string(display.height)},
                      display.width,
                      display.height});
  } catch (const DeviceError&) {  // no desktop
  }
  for (const DrmConnectorInfo& connector : find_drm_connectors()) {
    if (!connector.is_connected || connector.modes.empty()) continue;
    const auto preferred = std::ranges::find(connector.modes, true, &DrmModeInfo::is_preferred);
    const DrmModeInfo& mode = preferred == connector.modes.end() ? connector.modes.front() : *preferred;
    list.push_back({{connector.name, "monitor without a desktop, " + mode.text()}, mode.width, mode.height});
  }
  return list;
}

class Guide {
 public:
  explicit Guide(const GuideOptions& options)
      : options_(options),
        asks_(!options.yes && ::isatty(STDIN_FILENO) == 1),
        file_(options.folder / "rig.toml") {
    if (!asks_ && !options.yes)
      throw InputError(
          "standard input is not a terminal; give --yes to accept the default for every answer that no "
          "option gives, or run 'refield acquire run' with a rig file");
  }

  void run() {
    create_folders(options_.folder);
    std::printf(
        "Guided capture in the folder '%s'. Press Enter to accept the answer in brackets. Ctrl-C stops at "
        "any\n"
        "time; the same command continues.\n",
        options_.folder.c_str());
    choose_devices();
    const SessionFile session = read_session_file(file_);
    const bool is_begun = fs::exists(session.output / "plan.toml");
    if (!fs::exists(session.calibration)) {
      aim();
      test_light();
      calibrate();
    }
    if (!is_begun) {
      plan_exposures();
      make_lights();
    }
    capture_all(session);
    estimate(session);
    relight(session);
    finish();
  }

 private:
  void heading(int step, const char* text) const { std::printf("\nStep %d of 8: %s\n", step, text); }

  std::string read_line() {
    std::string line;
    std::fflush(stdout);
    while (true) {
      char c = 0;
      const ssize_t count = ::read(STDIN_FILENO, &c, 1);
      run_context().throw_if_stopped();
      if (count < 0 && errno == EINTR) continue;
      if (count <= 0) {
        std::printf("\n");
        throw Interrupted();
      }
      if (c == '\n') return line;
      line += c;
    }
  }

  /// The answer that option `name` gave, else the one that is typed, else `standard`. `accept` throws
  /// InputError or DeviceError for one that will not do; a typed one is then asked for again.
  template <class Accept>
  void ask(const std::string& name, const std::string& given, const std::string& question,
           const std::string& standard, const Accept& accept) {
    if (!given.empty() || !asks_) {
      if (given.empty() && standard.empty())
        throw InputError(name, " is missing; give it, since --yes accepts defaults only");
      const std::string& answer = given.empty() ? standard : given;
      std::printf("%s%s %s\n", question.c_str(), question.ends_with("?") ? "" : ":", answer.c_str());
      try {
        accept(answer);
      } catch (const InputError& error) {
        throw InputError(given.empty() ? "" : name + ": ", error.what());
      }
      return;
    }
    while (true) {
      std::printf("%s%s: ", question.c_str(), standard.empty() ? "" : (" [" + standard + "]").c_str());
      std::string answer = read_line();
      const auto first = answer.find_first_not_of(" \t\r"), last = answer.find_last_not_of(" \t\r");
      answer = first == std::string::npos ? standard : answer.substr(first, last - first + 1);
      try {
        if (answer.empty()) throw InputError("an answer is needed");
        return accept(answer);
      } catch (const Error& error) {
        std::printf("   %s\n", error.what());
      }
    }
  }

  bool confirm(const std::string& question, bool standard = true) {
    bool result = standard;
    ask("--yes", "", question, standard ? "yes" : "no", [&](const std::string& answer) {
      if (answer == "yes" || answer == "y")
        result = true;
      else if (answer == "no" || answer == "n")
        result = false;
      else
        throw InputError("'", answer, "' is not valid; answer yes or no");
    });
    return result;
  }

  /// One of `list`, by number or name.
  template <class Item>
  Item choose(const std::string& option, const std::string& given, const char* what,
              const std::vector<Item>& list) {
    Item chosen;
    for (std::size_t i = 0; i < list.size(); ++i)
      std::printf("   %zu  %-20s %s\n", i + 1, list[i].name.c_str(), list[i].description.c_str());
    ask(option, given, what, list.empty() ? "" : "1", [&](const std::string& answer) {
      for (const Item& item : list)
        if (item.name == answer) return void(chosen = item);
      if (!given.empty()) return void(chosen.name = given);  // may be named in another way
      if (list.empty()) throw InputError("no device was found");
      chosen = list[static_cast<std::size_t>(whole_number(answer, 1, static_cast<int>(list.size()))) - 1];
    });
    return chosen;
  }

  /// Shows another command of this program and runs it.
  void refield(const std::vector<std::string>& words) {
    std::printf("   $ refield");
    for (const std::string& word : words)
      std::printf(word.find_first_of(" '*") == std::string::npos ? " %s" : " '%s'", word.c_str());
    std::printf("\n");
    std::fflush(stdout);
    run_words(words);
  }

  /// Runs `step` until it throws no Error or the user stops; without questions an Error ends the guide.
  template <class Step>
  void until_done(const Step& step) {
    while (true) {
      try {
        return step();
      } catch (const Error& error) {
        if (!asks_) throw;
        std::printf("   %s\n", error.what());
      }
      if (!confirm("Try again?")) throw Interrupted();
    }
  }

  void set(const std::string& section, const std::string& key, const std::string& value) {
    std::string text = read_text(file_);
    set_session_value(text, section, key, value);
    write_text_atomically(file_, text);
  }

  void choose_devices() {
    heading(1, "Camera and monitor");
    while (true) try {
        if (fs::exists(file_))
          std::printf("   '%s' names them; edit that file to change them.\n", file_.c_str());
        else
          write_devices();
        const SessionFile session = read_session_file(file_);
        SessionRig rig(session);
        const CameraDescription camera = rig.camera().describe();
        const IlluminatorDescription monitor = rig.monitor().describe();
        std::printf("   camera '%s': %d×%d pixels, %s, %d bits, exposures from %.3g to %.3g s\n",
                    camera.name.c_str(), camera.width, camera.height, layout_name(camera.layout), camera.bits,
                    camera.shortest_exposure.count(), camera.longest_exposure.count());
        std::printf("   monitor '%s': light maps of %d×%d texels\n", monitor.name.c_str(), monitor.width,
                    monitor.height);
        return;
      } catch (const Error& error) {
        if (!asks_) throw;
        std::printf("   %s\n", error.what());
        if (fs::exists(file_) && confirm("Choose other devices?"))
          fs::remove(file_);
        else if (!confirm("Try again?"))
          throw Interrupted();
      }
  }

  void write_devices() {
    const std::string simulated = "virtual:";
    std::string text = session_template();
    std::vector<Choice> cameras;
    if (options_.camera.empty()) cameras = find_cameras();
    if (options_.camera.empty() && cameras.empty())
      throw InputError(
          "no camera was found. Connect it and switch it on; docs/guide/capture.md lists what each kind "
          "needs, and '--camera virtual:RECIPE.toml' rehearses the capture with a simulated one");
    std::string camera = choose("--camera", options_.camera, "Camera", cameras).name;
    int width = 0, height = 0;
    if (camera.starts_with(simulated)) {
      const fs::path recipe = camera.substr(simulated.size());
      const LightDomain texels = read_recipe(recipe).scene.monitor.texels;
      camera = simulated + fs::absolute(recipe).string();
      width = texels.width;
      height = texels.height;
      if (!options_.truth.empty())
        set_session_value(text, "camera", "truth", toml_text(fs::absolute(options_.truth)));
    } else {
      choose_monitor(text, width, height);
    }
    set_session_value(text, "camera", "device", toml_text(camera));
    if (triggers_by_software(camera)) set_session_value(text, "camera", "trigger", toml_text("Software"));
    for (const std::string& setting : options_.settings) {
      const auto dot = setting.find('.'), mark = setting.find('=');
      if (dot == std::string::npos || mark == std::string::npos || dot == 0 || dot + 1 >= mark)
        throw InputError("--set ", setting, ": give SECTION.KEY=VALUE");
      const std::string value = setting.substr(mark + 1);
      const bool is_plain =
          value == "true" || value == "false" ||
          (!value.empty() && value.find_first_not_of("+-.0123456789eE") == std::string::npos);
      const bool is_list = value.find(',') != std::string::npos &&
                           value.find_first_not_of("+-.0123456789eE,") == std::string::npos;
      set_session_value(text, setting.substr(0, dot), setting.substr(dot + 1, mark - dot - 1),
                        is_list    ? "[" + value + "]"
                        : is_plain ? value
                                   : toml_text(value));
    }
    set_session_value(text, "monitor", "width", std::to_string(width));
    set_session_value(text, "monitor", "height", std::to_string(height));
    write_text_atomically(file_, text);
  }

  void choose_monitor(std::string& text, int& width, int& height) {
    const std::string window = "window:";
    const auto monitors = find_monitors();
    if (monitors.empty() && options_.monitor.empty())
      throw InputError(
          "no monitor was found. Run this inside a desktop, or on a text console where you may open "
          "/dev/dri/card* (group video)");
    const MonitorChoice monitor =
        choose("--monitor", options_.monitor, "Monitor that lights the scene", monitors);
    if (monitor.name.starts_with(window)) {
      set_session_value(text, "monitor", "window", "true");
      set_session_value(text, "monitor", "display", monitor.name.substr(window.size()));
    } else {
      set_session_value(text, "monitor", "connector", toml_text(monitor.name));
    }
    constexpr int usual_width = 160, usual_height = 90;
    const int suited = monitor.width > 0
                           ? static_cast<int>(std::lround(1.0 * usual_width * monitor.height / monitor.width))
                           : usual_height;
    ask("--light-size", options_.light_size, "Size of the light patterns in texels",
        std::to_string(usual_width) + "x" + std::to_string(suited), [&](const std::string& answer) {
          const auto mark = answer.find('x');
          if (mark == std::string::npos)
            throw InputError("'", answer, "' is not a size; give WIDTHxHEIGHT, such as 160x90");
          width = whole_number(answer.substr(0, mark), 8, monitor.width > 0 ? monitor.width : 65536);
          height = whole_number(answer.substr(mark + 1), 8, monitor.height > 0 ? monitor.height : 65536);
        });
  }

  /// With the devices open for no longer than needed: a monitor may cover the terminal.
  void aim() {
    if (!asks_) return;
    heading(2, "Aim and focus");
    std::printf(
        "   The monitor becomes white. Frame the scene and turn the focus ring until the sharpness is "
        "largest,\n"
        "   then close the aperture by two stops and fix everything. Press Enter to end the live image; if "
        "the\n"
        "   window of the monitor has the keyboard, any arrow key in it ends it, too.\n");
    bool again = confirm("Show the live image?");
    while (again) {
      until_done([&] {
        const SessionFile session = read_session_file(file_);
        SessionRig rig(session);
        live_view(rig, session.gain);
      });
      again = confirm("Show it again?", false);
    }
  }

  void test_light() {
    heading(3, "Exposure and room light");
    std::printf("   Switch off all light but the monitor. The monitor shows white and black in turn.\n");
    until_done([&] {
      if (!confirm("Start the test?")) throw Interrupted();
      const SessionFile session = read_session_file(file_);
      double share = 0.0;
      {
        SessionRig rig(session);
        constexpr Seconds patience{0.5}, any{0.0};  // white is metered, at whatever exposure
        CalibrationBench bench(rig.camera(), rig.monitor(), rig.trigger(), session.gain, patience);
        const Metering metering = meter(bench, any, run_context());
        const BlackLevel black = measure_black_level(bench, run_context());
        share = std::max(0.0, metering.dark_dn - black.dn) / std::max(1.0, metering.lit_dn - black.dn);
        std::printf("   At an exposure of %.3g s the white monitor lights the scene well.\n",
                    metering.exposure.count());
      }
      constexpr double dark = 0.02, usable = 0.2;
      std::printf("   Light of the room: %.1f %% of that of the monitor. %s\n", 100.0 * share,
                  share <= dark ? "The room is dark enough."
                  : share <= usable
                      ? "Constant light is subtracted, but it adds noise: find its source if you can."
                      : "That is too much: close curtains, switch off lights and other monitors.");
      if (share > dark && !confirm("Continue with this room light?", share <= usable))
        throw InputError("the room is too bright; darken it and run the same command again");
    });
  }

  void calibrate() {
    heading(4, "Calibration and superposition test");
    const SessionFile session = read_session_file(file_);
    const bool photographs = std::holds_alternative<GphotoCameraOptions>(session.camera);
    std::printf(
        "   Measures latency, response, noise and tone curves, and whether light adds up (superposition): a\n"
        "   monitor that dims itself is refused. It takes %s; nothing may move in the room.\n",
        photographs ? "some 300 photographs" : "a few minutes");
    const int step = options_.level_step > 0 ? options_.level_step : photographs ? 51 : 5;
    until_done([&] {
      if (!confirm("Calibrate now?")) throw Interrupted();
      try {
        refield({"acquire", "calibrate", file_, "--level-step", std::to_string(step), "--force"});
      } catch (...) {
        fs::remove(session.calibration);  // a display whose light is not additive leaves a file behind
        throw;
      }
    });
  }

  void plan_exposures() {
    heading(5, "Exposures and number of patterns");
    const SessionFile before = read_session_file(file_);
    std::string noise = "2%";
    if (before.exposures.empty())
      ask("--max-noise", options_.max_noise, "Largest noise of a pixel in a photograph", noise,
          [&](const std::string& answer) { error_from_text(answer), noise = answer; });
    until_done([&] {
      const SessionFile session = read_session_file(file_);
      const CameraCalibration calibration = read_camera_calibration(session.calibration);
      const auto timing = read_timing_calibration(session.calibration);
      SessionRig rig(session);
      camera_ = rig.camera().describe();
      const IlluminatorDescription monitor = rig.monitor().describe();
      FramePairing pairing(rig.camera(), rig.monitor(), rig.trigger(), timing);
      pairing.show(uniform_drive(monitor.width, monitor.height, 255));
      std::vector<Seconds> exposures;
      for (const double seconds : session.exposures) exposures.emplace_back(seconds);
      if (exposures.empty()) {
        ExposurePlanOptions options;
        options.relative_noise = error_from_text(noise);
        if (timing) options.multiple_of = timing->exposure_unit;
        const auto probe = [&](Seconds exposure) { return pairing.photograph(exposure, session.gain); };
        const NoisePlan plan = min_exposures(meter_range(camera_, calibration, probe), options, camera_,
                                             calibration, session.gain, session.frames);
        std::printf("   %s\n", plan.sentence().c_str());
        exposures = settable_exposures(plan.exposures, camera_);
      }
      check_exposures(exposures, camera_);
      // What a pattern takes: two patterns that differ, as the capture takes them.
      constexpr int trials = 4;
      Photograph merged;
      const auto start = std::chrono::steady_clock::now();
      for (int trial = 0; trial < trials; ++trial) {
        pairing.prepare(exposures.front(), session.gain);
        pairing.show(uniform_drive(monitor.width, monitor.height, trial % 2 == 0 ? 128 : 255));
        std::vector<RawFrame> frames;
        for (const Seconds exposure : exposures)
          for (int i = 0; i < session.frames; ++i)
            frames.push_back(pairing.photograph(exposure, session.gain));
        merged = merge_exposures(frames, calibration);
      }
      seconds_per_pattern_ = seconds_since(start) / trials;
      print_image(merged.radiance);
      std::string list;
      for (const Seconds exposure : exposures)
        list += (list.empty() ? "[" : ", ") + formatted("%.6g", exposure.count());
      set("exposures", "seconds", list + "]");
    });
    if (!options_.until_error.empty()) {
      error_from_text(options_.until_error);
      set("session", "until_error", toml_text(options_.until_error));
      set("session", "order", "\"useful\"");
    }
  }

  void make_lights() {
    const SessionFile session = read_session_file(file_);
    const fs::path folder = options_.folder / "lights";
    if (session.lights.images != fs::absolute(folder / "train_*.exr").string() ||
        !session.lights.session.empty()) {
      std::printf("   '%s' names its own light maps; they are used.\n", file_.c_str());
      return;
    }
    const double gigabytes = 24.0 * camera_.width * camera_.height * 1e-9;
    std::printf(
        "   One pattern takes %.2g s. 36 patterns give a first field, more give sharper reflections:\n",
        seconds_per_pattern_);
    for (const int count : {36, 180, 500}) {
      const int ambient = usual_ambient_count(count - count / 6);
      std::printf("   %6d patterns: capture %s, session at most %.2g GB\n", count,
                  time_text((count + ambient) * seconds_per_pattern_).c_str(), count * gigabytes);
    }
    int count = 180;
    ask("--patterns", options_.patterns, "Number of patterns (one sixth is held out to measure the error)",
        "180", [&](const std::string& answer) { count = whole_number(answer, 12, 5000); });
    // An earlier run may have written more of them.
    std::error_code error;
    fs::remove_all(folder, error);
    until_done([&] {
      refield({"acquire", "lights", "--starter", "--patterns", std::to_string(count), "--light-size",
               std::to_string(session.monitor.width) + "x" + std::to_string(session.monitor.height), "-o",
               folder, "--force"});
    });
  }

  void capture_all(const SessionFile& session) {
    heading(6, "Capture");
    if (!fs::exists(session.output / session_manifest_name)) {
      std::printf("   Nothing may move from now on. Leave the room or sit still.\n");
      if (!confirm("Start the capture?")) throw Interrupted();
    }
    bool again = false, is_usable = false;
    while (!is_usable) {
      std::vector<std::string> words{"acquire", "run", file_, again ? "--force" : "--resume",
                                     "--follow-error"};
      if (asks_) words.insert(words.end(), {"--check-every", "20"});
      try {
        refield(words);
        is_usable = true;
      } catch (const Error& error) {
        if (!asks_) throw;
        std::printf("   %s\n", error.what());
        is_usable = false;
      }
      again = false;
      if (asks_ && (!is_usable || could_be_better(session)))
        ask("", "", "   Mend the cause if you can. Then: continue, photograph again from the start, or stop",
            "continue", [&](const std::string& answer) {
              if (answer == "stop") throw Interrupted();
              again = answer == "again";
              if (!again && answer != "continue")
                throw InputError("'", answer, "' is not valid; answer continue, again or stop");
            });
      is_usable = is_usable && !again;
    }
  }

  /// Whether the finished capture has what another one need not have.
  bool could_be_better(const SessionFile& session) const {
    const auto rows = check_capture(read_capture_session(session.output), {}, run_context()).rows;
    return std::ranges::any_of(rows, [](const VerdictRow& row) {
      return row.state != RigFinding::State::good && !is_of_the_devices(row);
    });
  }

  void estimate(const SessionFile& session) {
    heading(7, "First estimate");
    field_ = options_.folder / "scene.rfield";
    if (fs::exists(field_)) {
      std::printf("   '%s' exists.\n", field_.c_str());
      return;
    }
    until_done([&] { refield({"estimate", session_folder(session), "--dry-run"}); });
    if (!confirm("Estimate the reflectance field now?")) throw Interrupted();
    until_done([&] { refield({"estimate", session_folder(session), "-o", field_, "--resume"}); });
  }

  void relight(const SessionFile& session) {
    heading(8, "First relit picture");
    const CaptureSession captured = read_capture_session(session.output);
    const CaptureFrame* frame = &captured.frames.front();
    for (const CaptureFrame& candidate : captured.frames)
      if (candidate.role == FrameRole::test && frame->role != FrameRole::test) frame = &candidate;
    picture_ = options_.folder / "relit.png";
    const fs::path light = session_folder(session) / "illumination" / (frame->name + ".exr");
    until_done([&] { refield({"relight", field_, "--light", light, "-o", picture_}); });
    std::printf("   The photograph under the light '%s'%s:\n", frame->name.c_str(),
                frame->role == FrameRole::test ? ", which the estimate has not seen" : "");
    print_image(read_photograph(frame->observed).radiance);
    std::printf("   The relit picture:\n");
    print_image(read_image(picture_));
    if (frame->role != FrameRole::test) return;
    std::printf(
        "   Error on all photographs that the estimate has not seen; a median of a few per cent (0.03) is "
        "good:\n");
    until_done([&] { refield({"compare", field_, session_folder(session)}); });
  }

  void finish() const {
    const std::string folder = options_.folder;
    std::printf(
        "\nDone. The files are in '%s':\n"
        "   rig.toml       all answers; after a change of 'output' in it, 'refield acquire run %s'\n"
        "                  captures again without questions\n"
        "   session        photographs and lights\n"
        "   scene.rfield   reflectance field\n"
        "   relit.png      the picture above\n"
        "Next:\n"
        "   refield view %s\n"
        "   refield compare %s %s/session -o %s/report.html\n",
        folder.c_str(), file_.c_str(), field_.c_str(), field_.c_str(), folder.c_str(), folder.c_str());
  }

  /// As short as the folder was given.
  fs::path session_folder(const SessionFile& session) const {
    return session.output == fs::absolute(options_.folder) / "session" ? options_.folder / "session"
                                                                       : session.output;
  }

  const GuideOptions& options_;
  const bool asks_;
  const fs::path file_;
  CameraDescription camera_;
  double seconds_per_pattern_ = 0.0;
  fs::path field_, picture_;
};

void guide(const GuideOptions& options, const Common& common) {
  if (common.json) throw InputError("the guided capture has no JSON output; remove --json");
  try {
    Guide(options).run();
  } catch (const Interrupted&) {
    std::printf("\nStopped. The same command continues: refield acquire guide %s\n", options.folder.c_str());
    throw Detached();
  }
}

}  // namespace

void add_acquire_guide(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<GuideOptions>();
  CLI::App* verb = group.add_subcommand(
      "guide",
      "Lead through a capture, from the choice of the camera to the first relit picture.\n"
      "\n"
      "Asks step by step, in a terminal, and prints and runs the other commands: live image, exposure and "
      "room light, calibration, patterns, capture, estimate, relighting. Options give answers in advance. "
      "The answers are kept in a rig file, with which 'refield acquire run' captures again without "
      "questions. After an interruption the same command continues.\n"
      "\n"
      "Examples:\n"
      "  refield acquire guide mug\n"
      "  refield acquire guide mug --camera gphoto: --patterns 60\n"
      "  refield acquire guide rehearsal --camera virtual:recipe.toml --truth truth --yes");
  verb->add_option("folder", options->folder, "Folder for the rig file and all results")
      ->capture_default_str();
  verb->add_option("--camera", options->camera,
                   "Camera, as 'refield acquire devices' names it, or virtual:RECIPE.toml for a simulated "
                   "camera and monitor");
  add_truth_option(*verb, options->truth);
  add_monitor_option(*verb, options->monitor);
  verb->add_option("--light-size", options->light_size,
                   "Size of the light maps in texels (default: 160 wide, in the proportions of the monitor)")
      ->type_name("WIDTHxHEIGHT");
  verb->add_option("--set", options->settings,
                   "Value of the rig file, SECTION.KEY=VALUE, such as camera.pixel_format=RGGB, "
                   "camera.region=200,100,1280,800 or controls.gain=3; repeat the option for each");
  verb->add_option("--level-step", options->level_step,
                   "Step between the measured levels of the tone curves: 1, 3, 5, 15, 17, 51 or 85 (default: "
                   "5; for a DSLR 51, to take fewer photographs)");
  add_max_noise_option(*verb, options->max_noise);
  verb->add_option("--patterns", options->patterns,
                   "Number of patterns of the starter set, held-out ones included (default: 180)");
  add_until_error_option(*verb, options->until_error);
  verb->add_flag("--yes", options->yes, "Ask nothing: accept the default answer where no option gives one");
  on_command(*verb, options, common, action, guide);
  group.require_subcommand(0, 1);
  group.callback([&group, &common, &action] {
    if (!group.get_subcommands().empty()) return;
    if (::isatty(STDIN_FILENO) != 1 || ::isatty(STDOUT_FILENO) != 1)
      throw CLI::RequiredError("A subcommand (or a terminal, for the guided capture)");
    action = [&common] { guide({}, common); };
  });
}

void add_acquire(CLI::App& app, const Common& common, Action& action) {
  CLI::App* group = app.add_subcommand(
      "acquire",
      "Photograph a scene under many light patterns as a capture session.\n"
      "\n"
      "Without a command, in a terminal, it does the same as 'refield acquire guide', which asks step by "
      "step.\n"
      "\n"
      "Photographs are HDR images with the ambient light subtracted. An interrupted capture continues with "
      "the same command and --resume; the resulting session is identical, byte for byte. "
      "docs/reference/capture-session-format.md describes the folder.");
  add_acquire_guide(*group, common, action);
  add_acquire_devices(*group, common, action);
  add_acquire_calibrate(*group, common, action);
  add_acquire_run(*group, common, action);
  add_acquire_lights(*group, common, action);
  add_acquire_show(*group, common, action);
  add_acquire_import(*group, common, action);
  add_acquire_colour(*group, common, action);
  add_acquire_geometry(*group, common, action);
  add_acquire_probe(*group, common, action);
  for (CLI::App* verb : group->get_subcommands([](CLI::App*) { return true; })) verb->group("Commands");
}

}  // namespace refield::cli
