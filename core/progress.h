// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>
#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

namespace refield {

/// One line for people and schedulers on standard error; where that is no terminal, the time (UTC) stands
/// before it. Nothing when silenced.
void log_line(const std::string& text);

/// Progress of one stage on standard error: a bar with the time left on a terminal; elsewhere log_line()s
/// with per cent, every ten seconds at first and at least every ten minutes in a run of hours. Nothing for
/// stages shorter than a second or when silenced. advance() may be called from any thread. Of progresses
/// within each other the outermost alone is shown.
class Progress {
 public:
  Progress(std::string label, std::uint64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void advance(std::uint64_t steps = 1);

  /// Silences all progress output (--quiet).
  static void silence();

 private:
  void draw(bool last);
  std::string label_;
  std::uint64_t total_;
  std::atomic<std::uint64_t> done_{0};
  std::atomic<std::int64_t> next_draw_ms_{1000};
  std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
  const bool nested_;
  bool drawn_ = false;
};

}  // namespace refield
