// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/session_rig.h"

#include <cstdio>

#include "cli/run_context.h"

namespace refield::cli {

namespace {

RunContext run_with_notices() {
  RunContext run = run_context();
  run.on_note = tell;
  return run;
}

std::unique_ptr<Illuminator> monitor_of(const SessionFile& session) {
  if (!session.window) return std::make_unique<DrmMonitor>(session.monitor);
  auto window = std::make_unique<WindowMonitor>(*session.window);
  if (!window->waits_for_blanking())
    tell(window->describe().name +
         ": does not wait for vertical blanking (a remote or virtual display); its time stamps may be too "
         "early, so the calibration file must contain the latency measured by 'refield acquire calibrate'");
  return window;
}

}  // namespace

SessionRig::SessionRig(const SessionFile& session)
    : camera_(session.camera, run_with_notices()), monitor_(monitor_of(session)) {
  if (session.trigger) trigger_.emplace(*session.trigger, run_context());
}

void tell(const std::string& sentence) {
  std::fprintf(stderr, "\nrefield: note: %s\n", sentence.c_str());
}

}  // namespace refield::cli
