// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/global_control.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>

namespace refield {

/// How far a stage of a long operation is. A stage is reported when it starts (done = 0), at most ten times
/// per second while it runs, and once when it ends; stages may contain others.
struct StageProgress {
  enum class Event { started, advanced, ended };
  Event event = Event::advanced;
  std::string stage;        ///< for people: "estimate", "light maps"
  std::uint64_t done = 0;   ///< units of work, such as pixels or files
  std::uint64_t total = 1;  ///< at least 1; a stage that throws ends with done < total
};

struct IsolatedReading;

/// What the caller of a long operation supplies: where progress and notes go, a flag that stops the
/// operation, and a limit of threads. The default one is silent and never stops. The library writes nothing
/// to standard error and reads no global flag. Objects that work for long keep a copy.
struct RunContext {
  /// Called from any thread, for one stage never by two at once; must be quick and must not throw.
  std::function<void(const StageProgress&)> on_progress = nullptr;
  /// Receives findings that are no errors, such as frames that are left out: one line, without a line end.
  /// Called from any thread.
  std::function<void(const std::string&)> on_note = nullptr;
  /// The operation throws Interrupted soon after this becomes true. The caller owns it; a signal handler may
  /// set it. It must outlive the operation.
  const std::atomic<bool>* stop = nullptr;
  /// Reads a file in another process, for libraries that a damaged file can crash; see core/base/isolated.h.
  /// Empty: such files are read in this process, which is faster and meant for files of known origin.
  std::function<std::optional<std::string>(const IsolatedReading&)> read_isolated = nullptr;
  /// Limit of threads; 0: all that oneTBB has.
  int max_threads = 0;

  void note(const std::string& text) const {
    if (on_note) on_note(text);
  }
  bool is_stopped() const { return stop && *stop; }
  /// Throws Interrupted once a stop was requested, or the caller's group of TBB tasks was cancelled. Called
  /// between units of work whose results are already safe on disk.
  void throw_if_stopped() const;
};

/// Reports the progress of one stage. advance() may be called from any thread.
class Progress {
 public:
  /// `run` must outlive it.
  Progress(const RunContext& run, std::string stage, std::uint64_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void advance(std::uint64_t steps = 1);

 private:
  void report(StageProgress::Event event) const;
  const RunContext& run_;
  std::string stage_;
  std::uint64_t total_;
  std::atomic<std::uint64_t> done_{0};
  std::atomic<std::int64_t> next_report_ms_;
  std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
};

/// Holds oneTBB to run.max_threads while it lives, in the whole process (tbb::global_control).
class ThreadLimit {
 public:
  explicit ThreadLimit(const RunContext& run) {
    if (run.max_threads > 0)
      control_.emplace(tbb::global_control::max_allowed_parallelism,
                       static_cast<std::size_t>(run.max_threads));
  }

 private:
  std::optional<tbb::global_control> control_;
};

}  // namespace refield
