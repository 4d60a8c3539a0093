// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <tbb/parallel_for.h>
#include <tbb/task_group.h>

#include <cfenv>

namespace refield {

/// While it lives, this thread rounds to nearest and keeps denormals (MXCSR without FZ and DAZ), whatever
/// other libraries of the process have set. Its destructor restores that.
class DefaultFloatingPoint {
 public:
  DefaultFloatingPoint() {
    std::fegetenv(&saved_);
    std::fesetenv(FE_DFL_ENV);
  }
  ~DefaultFloatingPoint() { std::fesetenv(&saved_); }
  DefaultFloatingPoint(const DefaultFloatingPoint&) = delete;
  DefaultFloatingPoint& operator=(const DefaultFloatingPoint&) = delete;

 private:
  std::fenv_t saved_;
};

/// Calls `work` so, and all its tasks on other threads. oneTBB gives tasks the state of the context that they
/// are started in, and that of a thread without one is kept for good as it was at the thread's first parallel
/// call. Where that call is Embree's, which flushes denormals, the thread's later results would be others.
template <class Work>
void with_default_floating_point(const Work& work) {
  const DefaultFloatingPoint here;
  tbb::task_group_context state(tbb::task_group_context::isolated, tbb::task_group_context::default_traits |
                                                                       tbb::task_group_context::fp_settings);
  tbb::parallel_for(
      0, 1, [&](int) { work(); }, state);
}

}  // namespace refield
