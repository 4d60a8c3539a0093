// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "core/base/files.h"
#include "tests/cli/matchers.h"

namespace refield::test {

/// Runs the built `refield-studies` with the given arguments and waits for it.
inline CommandResult run_studies(const std::vector<std::string>& arguments) {
  return run_program(REFIELD_STUDIES_PROGRAM, arguments);
}

/// refield-studies refused its input: exit status 2 and a message that holds both words (the file and the
/// remedy).
MATCHER_P2(StudyRefusedNaming, file, remedy,
           "is refused with status 2, naming '" + std::string(file) + "' and '" + std::string(remedy) + "'") {
  return arg.status == 2 && arg.err.find("refield-studies: ") != std::string::npos &&
         arg.err.find(file) != std::string::npos && arg.err.find(remedy) != std::string::npos;
}

/// Checks that draw.py makes these pictures of the CSV files in a folder, and that each shows points. Without
/// matplotlib, nothing is checked.
inline void draws(const std::string& folder, const std::vector<std::string>& pictures) {
  const std::string python = "/usr/bin/python3";
  if (run_program(python, {"-c", "import matplotlib"}).status != 0) {
    std::printf("python3-matplotlib is not installed: the charts are not drawn\n");
    return;
  }
  ASSERT_THAT(run_program(python, {REFIELD_SOURCE_DIR "/bench/studies/draw.py", folder}), Succeeded());
  for (const std::string& picture : pictures)
    EXPECT_NE(read_text(folder + "/" + picture).find("<use "), std::string::npos) << picture;  // a marker
}

}  // namespace refield::test
