// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/task_group.h>

#include <exception>
#include <future>
#include <thread>
#include <utility>

#include "core/base/run_context.h"

namespace refield {

/// Work on a thread of its own, for a window that must not wait for it. cancel() ends its parallel loops
/// early and makes RunContext::throw_if_stopped() throw in it; the destructor cancels and waits for the end.
template <class Result>
class BackgroundJob {
 public:
  explicit BackgroundJob(std::function<Result()> work)
      : result_(promise_.get_future()), thread_([this, work = std::move(work)] { run(work); }) {}
  ~BackgroundJob() { cancel(); }
  BackgroundJob(const BackgroundJob&) = delete;
  BackgroundJob& operator=(const BackgroundJob&) = delete;

  void cancel() {
    is_cancelled_ = true;
    context_.cancel_group_execution();
  }
  bool is_cancelled() const { return is_cancelled_; }
  /// Whether it has ended.
  bool wait_for(std::chrono::microseconds patience) const {
    return result_.wait_for(patience) == std::future_status::ready;
  }
  void wait() const { result_.wait(); }
  /// Once, after the end. Throws what the work threw; Interrupted where it was cancelled before it was done.
  Result take() { return result_.get(); }

 private:
  void run(const std::function<Result()>& work) {
    try {
      std::optional<Result> result;
      tbb::task_group group(context_);
      const auto status = group.run_and_wait([&] {
        if (!is_cancelled_) result.emplace(work());
      });
      if (status == tbb::task_group_status::canceled || !result) throw Interrupted();
      promise_.set_value(std::move(*result));
    } catch (...) {
      promise_.set_exception(std::current_exception());
    }
  }

  tbb::task_group_context context_;
  std::atomic<bool> is_cancelled_{false};
  std::promise<Result> promise_;
  std::future<Result> result_;
  std::jthread thread_;
};

/// Runs work of which no part may be left out although the job around it is cancelled.
template <class Work>
void run_uncancelled(const Work& work) {
  tbb::task_group_context context(tbb::task_group_context::isolated);
  tbb::task_group(context).run_and_wait(work);
}

}  // namespace refield
