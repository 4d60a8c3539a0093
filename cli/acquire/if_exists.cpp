// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/if_exists.h"

namespace refield::cli {

void add_if_exists(CLI::App& verb, IfExists& choice, const std::string& what) {
  choice = IfExists::refuse;
  CLI::Option* resume = verb.add_flag_callback(
      "--resume", [&choice] { choice = IfExists::resume; }, "Continue an interrupted run");
  verb.add_flag_callback(
          "--force", [&choice] { choice = IfExists::replace; }, "Replace " + what + " in the output folder")
      ->excludes(resume);
}

}  // namespace refield::cli
