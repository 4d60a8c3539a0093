// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "core/base/run_context.h"

namespace refield {

/// What work in a process of its own may use. Generous for what reads the structure of a file.
struct IsolationLimits {
  std::uint64_t memory_bytes = std::uint64_t{1} << 30;  ///< above what the parent has; not kept under ASan
  int cpu_seconds = 20;
  unsigned wall_seconds = 120;  ///< ends work that waits for something without using the processor
  std::size_t answer_bytes = std::size_t{64} << 20;
};

/// Runs `work` in a child process and returns its answer: for libraries that a hostile file can crash, hang
/// or make eat memory. nullopt where it did any of that, threw, or answered too long. `work` must not use
/// threads or leave anything behind. Keeps accidents in, not intruders: the child has the parent's rights.
/// The child ends with the parent. Throws DeviceError when the system gives no process, Interrupted when
/// `run` is stopped while the child worked.
std::optional<std::string> run_isolated(const std::function<std::string()>& work,
                                        const IsolationLimits& limits = {}, const RunContext& run = {});

}  // namespace refield
