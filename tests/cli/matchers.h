// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gmock/gmock.h>

#include <string>

#include "tests/cli/command.h"

namespace refield::test {

/// The program refused its input: exit status 2 and a message that holds both words (the file and the
/// remedy).
MATCHER_P2(RefusedNaming, file, remedy,
           "is refused with status 2, naming '" + std::string(file) + "' and '" + std::string(remedy) + "'") {
  return arg.status == 2 && arg.err.find("refield: ") != std::string::npos &&
         arg.err.find(file) != std::string::npos && arg.err.find(remedy) != std::string::npos;
}

MATCHER(Succeeded, "succeeds") {
  return arg.status == 0;
}

}  // namespace refield::test
