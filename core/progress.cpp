// SPDX-License-Identifier: Apache-2.0
#include "core/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>

namespace refield {

namespace {
std::atomic<bool> silent{false};
std::atomic<int> alive{0};
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
/// Until the next line in a log: a log of a long run stays short.
std::int64_t log_interval_ms(std::int64_t elapsed_ms) {
  return std::clamp<std::int64_t>(elapsed_ms / 10, 10'000, 600'000);
}
std::string duration_text(double seconds) {
  char text[32];
  const auto s = static_cast<int>(std::lround(seconds));
  if (s >= 3600)
    std::snprintf(text, sizeof text, "%d:%02d:%02d", s / 3600, s / 60 % 60, s % 60);
  else
    std::snprintf(text, sizeof text, "%d:%02d", s / 60, s % 60);
  return text;
}
}  // namespace

void log_line(const std::string& text) {
  if (silent) return;
  if (on_terminal())
    std::fprintf(stderr, "%s\n", text.c_str());
  else
    std::fprintf(stderr, "%s %s\n", utc_now().c_str(), text.c_str());
  std::fflush(stderr);
}

void Progress::silence() {
  silent = true;
}

Progress::Progress(std::string label, std::uint64_t total)
    : label_(std::move(label)),
      total_(std::max<std::uint64_t>(total, 1)),
      start_(std::chrono::steady_clock::now()),
      nested_(alive++ > 0) {}

Progress::~Progress() {
  --alive;
  if (drawn_) draw(true);
}

void Progress::advance(std::uint64_t steps) {
  done_ += steps;
  if (silent || nested_) return;
  const auto elapsed = std::chrono::steady_clock::now() - start_;
  const auto elapsed_ms = std::chrono::duration_cast<std::chrono::milliseconds>(elapsed).count();
  if (elapsed_ms < next_draw_ms_) return;
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return;
  next_draw_ms_ = elapsed_ms + (on_terminal() ? 200 : log_interval_ms(elapsed_ms));
  draw(false);
}

void Progress::draw(bool last) {
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  const double fraction = std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
  const double left = fraction > 0.0 ? elapsed.count() * (1.0 - fraction) / fraction : 0.0;
  const std::string times = last ? "took " + duration_text(elapsed.count())
                                 : duration_text(elapsed.count()) + " gone, " +
                                       (fraction > 0.0 ? duration_text(left) : "?") + " left";
  if (on_terminal()) {
    constexpr int bar_width = 30;
    const int filled = static_cast<int>(fraction * bar_width);
    const std::string bar = std::string(filled, '#') + std::string(bar_width - filled, '.');
    std::fprintf(stderr, "\r%-24s [%s] %3.0f %%  %s\033[K%s", label_.c_str(), bar.c_str(), 100.0 * fraction,
                 times.c_str(), last ? "\n" : "");
    std::fflush(stderr);
  } else {
    char percent[16];
    std::snprintf(percent, sizeof percent, "%.0f %%", 100.0 * fraction);
    log_line(label_ + ": " + percent + ", " + times);
  }
  drawn_ = true;
}

}  // namespace refield
