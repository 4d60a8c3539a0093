// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>

#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield::test {

/// Whether `work`, which is given a run context that is stopped already, ends with Interrupted.
template <class Work>
bool heeds_interruption(const Work& work) {
  const std::atomic<bool> stop{true};
  try {
    work(RunContext{.stop = &stop});
  } catch (const Interrupted&) {
    return true;
  }
  return false;
}

}  // namespace refield::test
