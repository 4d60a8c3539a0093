// SPDX-License-Identifier: Apache-2.0
#include "core/base/run_context.h"

#include <tbb/task_group.h>

#include <algorithm>

namespace refield {

namespace {
constexpr std::int64_t report_interval_ms = 100;
}

void RunContext::throw_if_stopped() const {
  if (is_stopped() || tbb::is_current_task_group_canceling()) throw Interrupted();
}

Progress::Progress(const RunContext& run, std::string stage, std::uint64_t total)
    : run_(run),
      stage_(std::move(stage)),
      total_(std::max<std::uint64_t>(total, 1)),
      next_report_ms_(report_interval_ms),
      start_(std::chrono::steady_clock::now()) {
  report(StageProgress::Event::started);
}

Progress::~Progress() {
  report(StageProgress::Event::ended);
}

void Progress::advance(std::uint64_t steps) {
  done_ += steps;
  if (!run_.on_progress) return;
  const auto elapsed = std::chrono::steady_clock::now() - start_;
  const auto elapsed_ms = std::chrono::duration_cast<std::chrono::milliseconds>(elapsed).count();
  if (elapsed_ms < next_report_ms_) return;
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return;
  next_report_ms_ = elapsed_ms + report_interval_ms;
  report(StageProgress::Event::advanced);
}

void Progress::report(StageProgress::Event event) const {
  if (run_.on_progress) run_.on_progress({event, stage_, std::min<std::uint64_t>(done_, total_), total_});
}

}  // namespace refield
