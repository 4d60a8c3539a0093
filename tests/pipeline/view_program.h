// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "core/base/files.h"
#include "core/image/image.h"
#include "tests/pipeline/program.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/virtual_screen.h"

namespace refield::test {

/// `view` on an X server without a screen, and what its script printed.
class ViewProgram : public testing::Test {
 protected:
  void SetUp() override {
    if (!is_installed("Xvfb")) GTEST_SKIP() << "SKIPPED: Xvfb is not installed (Debian package xvfb)";
#ifdef __SANITIZE_THREAD__
    GTEST_SKIP() << "SKIPPED: the software renderer's threads are not instrumented";
#endif
    screen_ = std::make_unique<VirtualScreen>(1280, 820);
    ASSERT_TRUE(screen_->is_up()) << "Xvfb does not start";
  }

  /// Shows a file of the folder. Exit status; what the script printed goes to output_.
  int play(const std::string& script, const std::string& shown) {
    write_text_atomically(path("script"), script);
    const int status =
        run_program({"view", path(shown), "--script", path("script"), "--size", "1200x760"}, path("log"));
    output_ = read_text(path("log"));
    return status;
  }
  std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }

  /// The lines that `where` printed.
  std::vector<nlohmann::json> places() const {
    std::vector<nlohmann::json> found;
    std::istringstream lines(output_);
    for (std::string line; std::getline(lines, line);)
      if (line.rfind("{\"image\"", 0) == 0)
        found.push_back(nlohmann::json::parse(line.substr(0, line.rfind('}') + 1)));
    return found;
  }

  const TemporaryFolder folder_;
  std::unique_ptr<VirtualScreen> screen_;
  std::string output_;
};

inline double relative_difference(const Image& a, const Image& b) {
  double difference = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    difference += std::pow(a.values[i] - b.values[i], 2.0);
    sum += std::pow(b.values[i], 2.0);
  }
  return std::sqrt(difference / sum);
}

}  // namespace refield::test
