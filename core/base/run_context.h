// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/global_control.h>

#include <chrono>
#include <cstddef>
#include <mutex>

#include "core/base/errors.h"

namespace refield {

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
