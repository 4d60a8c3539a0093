// SPDX-License-Identifier: Apache-2.0
#include "cli/run_context.h"

#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <ctime>

#include "core/base/isolated.h"
#include "core/base/number_text.h"

namespace refield {

namespace {

std::atomic<bool> silent{false};
std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // the signal handler writes it

bool on_terminal() {
  static const bool terminal = ::isatty(STDERR_FILENO) == 1;
  return terminal;
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text;
}

void print_line(const std::string& text) {
  if (silent) return;
  if (on_terminal())
    std::fprintf(stderr, "\r\033[K%s\n", text.c_str());  // in the place of the bar, which is drawn again
  else
    std::fprintf(stderr, "%s %s\n", utc_now().c_str(), text.c_str());
  std::fflush(stderr);
}

std::string duration_text(double seconds) {
  const auto s = static_cast<int>(std::lround(seconds));
  return s >= 3600 ? formatted("%d:%02d:%02d", s / 3600, s / 60 % 60, s % 60)
                   : formatted("%d:%02d", s / 60, s % 60);
}

/// Draws the outermost stage.
class ProgressBar {
 public:
  void report(const StageProgress& progress) {
    const std::scoped_lock lock(mutex_);
    if (progress.event == StageProgress::Event::started && running_++ == 0) {
      shown_ = progress.stage;
      start_ = Clock::now();
      next_draw_ = start_ + std::chrono::seconds(1);
      is_drawn_ = false;
    }
    if (progress.event == StageProgress::Event::ended) --running_;
    if (progress.stage != shown_ || silent) return;
    if (progress.event == StageProgress::Event::advanced && Clock::now() >= next_draw_) draw(progress, false);
    // A stage of the same name may run within the outermost one.
    if (progress.event == StageProgress::Event::ended && running_ == 0) {
      if (is_drawn_) draw(progress, true);
      shown_.clear();
    }
  }

 private:
  using Clock = std::chrono::steady_clock;

  /// Until the next drawing; in a log of a long run lines are few.
  static Clock::duration pause_after(Clock::duration elapsed) {
    using namespace std::chrono_literals;
    return on_terminal() ? Clock::duration(200ms) : std::clamp<Clock::duration>(elapsed / 10, 10s, 600s);
  }

  void draw(const StageProgress& progress, bool is_last) {
    const auto elapsed = Clock::now() - start_;
    const double seconds = std::chrono::duration<double>(elapsed).count();
    const double fraction = static_cast<double>(progress.done) / static_cast<double>(progress.total);
    const double left = fraction > 0.0 ? seconds * (1.0 - fraction) / fraction : 0.0;
    const std::string times = (is_last ? "took " + duration_text(seconds)
                                       : duration_text(seconds) + " gone, " +
                                             (fraction > 0.0 ? duration_text(left) : "?") + " left");
    if (on_terminal()) {
      constexpr int bar_width = 30;
      const int filled = static_cast<int>(fraction * bar_width);
      const std::string bar = std::string(filled, '#') + std::string(bar_width - filled, '.');
      std::fprintf(stderr, "\r%-24s [%s] %3.0f %%  %s\033[K%s", shown_.c_str(), bar.c_str(), 100.0 * fraction,
                   times.c_str(), is_last ? "\n" : "");
      std::fflush(stderr);
    } else {
      print_line(shown_ + ": " + formatted("%.0f %%", 100.0 * fraction) + ", " + times);
    }
    is_drawn_ = true;
    next_draw_ = Clock::now() + pause_after(elapsed);
  }

  std::mutex mutex_;
  int running_ = 0;
  std::string shown_;
  Clock::time_point start_, next_draw_;
  bool is_drawn_ = false;
};

/// Beside this program, or where it is installed; programs elsewhere in the build folder use the one that was
/// built with them.
fs::path reader_program() {
  std::error_code error;
  const auto folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {"refield-reader", "../libexec/refield/refield-reader"})
    if (!folder.empty() && fs::exists(folder / place, error)) return folder / place;
  return REFIELD_READER;
}

void on_signal(int) {
  stop_requested = true;
}

}  // namespace

const RunContext& run_context() {
  static ProgressBar bar;
  static const RunContext context{.on_progress = [](const StageProgress& progress) { bar.report(progress); },
                                  .on_note = print_line,
                                  .stop = &stop_requested,
                                  .read_isolated =
                                      [](const IsolatedReading& reading) {
                                        return read_in_process(reader_program(), reading, run_context());
                                      }};
  return context;
}

void silence_progress() {
  silent = true;
}

void install_interrupt_handler() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESETHAND;  // the second signal has its default effect
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

}  // namespace refield
