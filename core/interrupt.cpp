// SPDX-License-Identifier: Apache-2.0
#include "core/interrupt.h"

#include <signal.h>
#include <tbb/task_group.h>

#include "core/errors.h"

namespace refield {

namespace {
volatile sig_atomic_t stop_requested = 0;
void on_signal(int) {
  stop_requested = 1;
}
}  // namespace

void install_interrupt_handler() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = SA_RESETHAND;  // the second signal has its default effect
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupted() {
  return stop_requested != 0;
}

void throw_if_interrupted() {
  if (interrupted() || tbb::is_current_task_group_canceling()) throw Interrupted();
}

}  // namespace refield
