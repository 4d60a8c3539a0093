// SPDX-License-Identifier: Apache-2.0
// refield acquire show: patterns on a monitor, for a camera that this program does not drive.
#include <time.h>

#include <thread>

#include "acquire/calibrate/calibration.h"
#include "acquire/devices/monitors.h"
#include "acquire/series/capture_time.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/image/image_io.h"

namespace refield::cli {

namespace {

using Clock = std::chrono::steady_clock;

struct ShowOptions {
  std::vector<std::string> patterns;
  std::string every;
  std::string start_in = "10s";
  std::string monitor = "window:0";
  std::string from;
};

/// "5s", "5", "500ms" or "2min".
Seconds duration_of(const std::string& text, const char* option) {
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  const std::string unit(end);
  const double scale = unit.empty() || unit == "s" ? 1.0 : unit == "ms" ? 1e-3 : unit == "min" ? 60.0 : 0.0;
  if (end == text.c_str() || scale == 0.0 || !(number >= 0.0 && number * scale <= 86400.0))
    throw InputError(option, ": '", text, "' is not a duration; give one such as 5s or 1min");
  return Seconds(number * scale);
}

/// The number of the desktop display in "window:N".
int display_of(const std::string& monitor) {
  int display = 0;
  char rest = '\0';
  if (std::sscanf(monitor.c_str(), "window:%d%c", &display, &rest) != 1 || display < 0)
    throw InputError("--monitor ", monitor,
                     ": patterns are shown in a window; give window:0 for the first display of the desktop");
  return display;
}

/// Now, as a camera's clock would say: local time.
ClockSeconds local_time() {
  const double now =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  const auto whole = static_cast<time_t>(now);
  tm local{};
  ::localtime_r(&whole, &local);
  return now + static_cast<double>(local.tm_gmtoff);
}

std::string time_of_day(ClockSeconds time) {
  return text_from_clock_seconds(time).substr(11, 8);
}

std::string left_text(double seconds) {
  return seconds < 90.0 ? formatted("%.0f s left", seconds) : formatted("%.0f min left", seconds / 60.0);
}

DriveImage levels_of(const fs::path& file) {
  const Image image = read_light_map(file, Parameterisation::monitor, run_context()).radiance;
  return {image.width, image.height, tone_mapped(image, ToneMapping{})};
}

/// Patterns one after the other, the first and the last black.
class Slides {
 public:
  Slides(const ShowOptions& options, std::vector<fs::path> files)
      : every_(options.every.empty() ? Seconds(0) : duration_of(options.every, "--every")),
        start_in_(duration_of(options.start_in, "--start-in")),
        files_(std::move(files)),
        log_(files_.front().parent_path() / times_file_name) {
    if (!options.every.empty() && every_.count() < 0.2)
      throw InputError("--every: ", options.every, " is too short for a photograph; give 0.2s or more");
    if (!options.from.empty()) {
      const auto start =
          std::ranges::find(files_, options.from, [](const fs::path& file) { return file.stem().string(); });
      if (start == files_.end())
        throw InputError("--from: there is no pattern '", options.from, "'; the first is '",
                         files_.front().stem(), "'");
      place_ = static_cast<std::size_t>(start - files_.begin());
      times_ = read_times(log_.parent_path());
    }
    const DriveImage first = levels_of(files_.front());
    width_ = first.width;
    height_ = first.height;
    for (const fs::path& file : files_) {
      const ImageHeader header = read_image_header(file);
      if (header.width != width_ || header.height != height_)
        throw InputError(file, ": is ", header.width, "×", header.height, ", but earlier patterns are ",
                         width_, "×", height_, "; all patterns must have the same size");
    }
    monitor_ =
        std::make_unique<WindowMonitor>(WindowMonitorOptions{display_of(options.monitor), width_, height_});
  }

  std::size_t shown() const { return times_.size(); }
  const fs::path& log() const { return log_; }

  void run() {
    std::printf("%s: %zu patterns of %d×%d texels, each a square of %d pixels\n",
                monitor_->describe().name.c_str(), files_.size(), width_, height_,
                monitor_->pixels_per_texel());
    std::printf("keys in the window: space or → next, ← back, P pause, Esc stop\n");
    show_black();
    if (every_.count() > 0.0 && start_in_.count() > 0.0) {
      std::printf("black; the first pattern follows in %.0f s: start the interval timer of the camera then\n",
                  start_in_.count());
      std::fflush(stdout);
      if (!hold(start_in_)) return;
    }
    announce("black (photograph the ambient light)");
    if (!hold(every_)) return;
    while (place_ < files_.size()) {
      const fs::path& file = files_[place_];
      monitor_->show(levels_of(file));
      announce(file.stem().string());
      const ClockSeconds began = local_time();
      step_ = 1;
      const bool goes_on = hold(every_);
      // The middle of its time: what is photographed while it stands is nearest to that.
      times_[file.stem().string()] = 0.5 * (began + local_time());
      write_times(log_.parent_path().empty() ? fs::path(".") : log_.parent_path(), times_);
      if (!goes_on) break;
      if (step_ > 0 || place_ > 0) place_ += static_cast<std::size_t>(step_);
    }
    show_black();
    if (place_ < files_.size())
      std::printf("stopped at %s; continue with --from %s\n", files_[place_].stem().c_str(),
                  files_[place_].stem().c_str());
  }

 private:
  void show_black() { monitor_->show(uniform_drive(width_, height_, 0)); }

  void announce(const std::string& name) const {
    std::printf("%s  %-12s", time_of_day(local_time()).c_str(), name.c_str());
    if (!name.starts_with("black")) std::printf("  %zu of %zu", place_ + 1, files_.size());
    if (every_.count() > 0.0)
      std::printf("  %s", left_text(every_.count() * static_cast<double>(files_.size() - place_)).c_str());
    std::printf("\n");
    std::fflush(stdout);
  }

  /// Waits for that long, or for a key where `time` is 0. False when it is to stop.
  bool hold(Seconds time) {
    auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
    bool paused = time.count() == 0.0;
    while (paused || Clock::now() < end) {
      run_context().throw_if_stopped();
      for (const WindowKey key : monitor_->keys()) {
        if (key == WindowKey::stop) return false;
        if (key == WindowKey::pause && time.count() > 0.0) {
          paused = !paused;
          end = Clock::now() + std::chrono::duration_cast<Clock::duration>(time);
          std::printf(paused ? "paused; press P to continue\n" : "continued\n");
          std::fflush(stdout);
          continue;
        }
        step_ = key == WindowKey::back ? -1 : 1;
        if (key != WindowKey::pause) return true;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return true;
  }

  Seconds every_, start_in_;
  std::vector<fs::path> files_;
  fs::path log_;
  int width_ = 0, height_ = 0;
  std::size_t place_ = 0;
  int step_ = 1;
  std::map<std::string, ClockSeconds> times_;
  std::unique_ptr<WindowMonitor> monitor_;
};

void show(const ShowOptions& options) {
  Slides slides(options, expand_globs(options.patterns));
  slides.run();
  if (slides.shown() > 0)
    std::printf("%s: display times of %zu patterns\n", slides.log().c_str(), slides.shown());
}

}  // namespace

void add_acquire_show(CLI::App& group, const Common& /*common*/, Action& action) {
  const auto options = std::make_shared<ShowOptions>();
  CLI::App* verb = group.add_subcommand(
      "show",
      "Show light patterns full screen for a separately operated camera.\n"
      "\n"
      "The camera may be a DSLR with an interval timer or operated by hand. Black is shown first, to "
      "photograph the ambient light, and last. Levels are sent as stored in sRGB images; each texel is a "
      "square of whole pixels without interpolation.\n"
      "\n"
      "Keys in the window: Space or Right next, Left back, P pause, Esc stop. The display time of each "
      "pattern is logged in times.tsv next to the patterns, in local time; 'refield acquire import --pair-by "
      "time' uses it to pair photographs with patterns if the series has gaps. docs/guide/capture.md "
      "describes a manual capture.\n"
      "\n"
      "Examples:\n"
      "  refield acquire show patterns --every 5s\n"
      "  refield acquire show patterns                   # press a key for each pattern\n"
      "  refield acquire show patterns --every 5s --from train_097");
  verb->add_option("images", options->patterns, "Images: patterns to show, folders, files or quoted patterns")
      ->required();
  verb->add_option("--every", options->every,
                   "Display time of each pattern, such as 5s (default: until a key is pressed)");
  verb->add_option("--start-in", options->start_in, "Time on black before the first pattern, with --every")
      ->capture_default_str();
  add_monitor_option(*verb, options->monitor)->capture_default_str();
  verb->add_option("--from", options->from, "Name of the first pattern to show, to continue a series");
  verb->callback([options, &action] { action = [options] { show(*options); }; });
}

}  // namespace refield::cli
