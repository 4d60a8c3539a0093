// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs.h"

namespace refield::cli {

void add_acquire(CLI::App& app, const Common& common, Action& action) {
  CLI::App* group = app.add_subcommand(
      "acquire",
      "Photograph a scene under many light patterns as a capture session.\n"
      "\n"
      "Without a verb, in a terminal, it leads through a capture as 'refield acquire guide' does.\n"
      "\n"
      "Photographs are HDR images with the ambient light subtracted. An interrupted capture continues with "
      "the same command and --resume; the resulting session is identical, byte for byte. "
      "docs/reference/capture-session-format.md describes the folder.");
  add_acquire_guide(*group, common, action);
  add_acquire_devices(*group, common, action);
  add_acquire_calibrate(*group, common, action);
  add_acquire_run(*group, common, action);
  add_acquire_lights(*group, common, action);
  add_acquire_show(*group, common, action);
  add_acquire_import(*group, common, action);
  add_acquire_colour(*group, common, action);
  add_acquire_geometry(*group, common, action);
  add_acquire_probe(*group, common, action);
  for (CLI::App* verb : group->get_subcommands([](CLI::App*) { return true; })) verb->group("Commands");
}

}  // namespace refield::cli
