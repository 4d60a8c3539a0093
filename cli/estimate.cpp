// SPDX-License-Identifier: Apache-2.0
#include "cli/verbs.h"

namespace refield::cli {

void add_estimate(CLI::App&, const Common&, Action&) {}

}  // namespace refield::cli
