// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "refield/run_context.h"

namespace refield {
namespace fs = std::filesystem;  // what every source of the stages calls it
}
