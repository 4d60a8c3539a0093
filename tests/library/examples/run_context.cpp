// SPDX-License-Identifier: Apache-2.0
// Shows the progress of an estimate, stops it on Ctrl-C and prints what is wrong with the input.
#include "refield/run_context.h"

#include <atomic>
#include <csignal>
#include <cstdio>

#include "refield/estimate.h"

static std::atomic<bool> stop{false};

int main(int, char** arguments) {
  std::signal(SIGINT, [](int) { stop = true; });
  refield::RunContext run;
  run.stop = &stop;
  run.max_threads = 2;
  run.on_note = [](const std::string& text) { std::printf("note: %s\n", text.c_str()); };
  run.on_progress = [](const refield::StageProgress& progress) {
    if (progress.event == refield::StageProgress::Event::ended)
      std::printf("%s: done\n", progress.stage.c_str());
  };
  try {
    refield::estimate(refield::Session(arguments[1]), {}, run);
  } catch (const refield::Error& error) {
    std::printf("%s\n", error.what());
    return 2;
  } catch (const refield::Interrupted&) {
    return 130;
  }
}
