// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

#include "core/errors.h"
#include "core/interrupt.h"

namespace refield::test {

/// Whether `work`, which must not use threads, ends with Interrupted after Ctrl-C; tried in a process of its
/// own, since a request to stop stays.
template <class Work>
bool heeds_interruption(const Work& work) {
  constexpr int heeded = 42;
  const pid_t child = ::fork();
  if (child == 0) {
    install_interrupt_handler();
    std::raise(SIGINT);
    try {
      work();
    } catch (const Interrupted&) {
      ::_exit(heeded);
    } catch (...) {
    }
    ::_exit(1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) && WEXITSTATUS(status) == heeded;
}

}  // namespace refield::test
