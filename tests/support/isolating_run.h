// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/isolated.h"

namespace refield::test {

/// Reads files as the command line does, with refield-reader.
inline RunContext isolating_run() {
  RunContext run;
  run.read_isolated = [](const IsolatedReading& reading) {
    return read_in_process(REFIELD_READER, reading, {});
  };
  return run;
}

}  // namespace refield::test
