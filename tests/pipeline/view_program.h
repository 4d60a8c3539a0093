// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/image/image.h"
#include "core/image/image_io.h"
#include "relight/viewer/gui/canvas.h"
#include "tests/pipeline/program.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/virtual_screen.h"

namespace refield::test {

/// `view` on an X server without a screen, whose mouse and keyboard xdotool moves. The window has no frame
/// and lies in the upper left corner, so that its positions are those of the screen.
class ViewProgram : public testing::Test {
 protected:
  void SetUp() override {
    if (!is_installed("Xvfb") || !is_installed("xdotool"))
      GTEST_SKIP() << "SKIPPED: Xvfb or xdotool is not installed (Debian packages xvfb, xdotool)";
#ifdef __SANITIZE_THREAD__
    GTEST_SKIP() << "SKIPPED: the software renderer's threads are not instrumented";
#endif
    screen_ = std::make_unique<VirtualScreen>(1280, 820);
    ASSERT_TRUE(screen_->is_up()) << "Xvfb does not start";
    before_ = std::filesystem::current_path();
    std::filesystem::current_path(folder_.path());  // where keys write pictures
  }
  void TearDown() override {
    program_.reset();
    if (!before_.empty()) std::filesystem::current_path(before_);
  }

  std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }

  /// Shows a file of the folder, and waits for its window.
  void open(const std::string& shown, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"view", path(shown), "--size", "1200x760"};
    words.insert(words.end(), more.begin(), more.end());
    output_ = std::make_unique<OutputPipe>(path("output"));
    program_.emplace(words, output_->path());
    act({"search", "--sync", "--name", shown + " – refield"});
    act({"mousemove", "4", "4"});
    picture();
  }
  /// Exit status of `view` where it ends before its window opens; its message is in log_.
  int refused(const std::string& shown, const std::vector<std::string>& more = {}) {
    std::vector<std::string> words = {"view", path(shown)};
    words.insert(words.end(), more.begin(), more.end());
    const int status = run_program(words, path("log"));
    log_ = read_text(path("log"));
    return status;
  }

  /// Words of xdotool.
  void act(std::vector<std::string> words) {
    words.insert(words.begin(), "xdotool");
    ASSERT_EQ(finish_program(start_program(words)), 0) << words[1];
  }
  void press(const std::string& key, int times = 1) {
    for (int i = 0; i < times; ++i) act({"key", key});
  }
  void move_to(const Point& at) {
    act({"mousemove", std::to_string(std::lround(at.x)), std::to_string(std::lround(at.y))});
  }
  void click(const Point& at) {
    move_to(at);
    act({"click", "1"});
  }
  /// The picture while the button is down at the end, and after.
  Image drag(const Point& from, const Point& to) {
    move_to(from);
    act({"mousedown", "1"});
    picture();
    move_to(to);
    picture();
    act({"mouseup", "1"});
    return picture();
  }

  /// The linear picture of all that was done before: the first of two saved in turn may come before a
  /// panel took the last event.
  Image picture() {
    save();
    return save();
  }
  /// What the window shows.
  Image shot() {
    picture();
    press("s");
    const std::string name = numbered("view", ++shots_, ".png");
    output_->read_until("Saved " + name);
    return read_image(name);
  }
  void quit() {
    press("shift+q");
    EXPECT_EQ(program_->wait(), 0);
    program_.reset();
  }

  const TemporaryFolder folder_;
  std::unique_ptr<VirtualScreen> screen_;
  std::unique_ptr<OutputPipe> output_;
  std::optional<RunningProgram> program_;
  std::string stem_ = "relit", log_;

 private:
  static std::string numbered(const std::string& stem, int number, const std::string& extension) {
    char text[32];
    std::snprintf(text, sizeof text, "%s-%04d%s", stem.c_str(), number, extension.c_str());
    return text;
  }
  Image save() {
    press("w");
    const std::string name = numbered(stem_, ++saved_, "");
    output_->read_until("Saved " + name + ".png");
    return read_image(name + ".exr");
  }

  std::filesystem::path before_;
  int saved_ = 0, shots_ = 0;
};

inline double relative_difference(const Image& a, const Image& b) {
  if (!a.same_shape(b)) return INFINITY;
  double difference = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    difference += std::pow(a.values[i] - b.values[i], 2.0);
    sum += std::pow(b.values[i], 2.0);
  }
  return std::sqrt(difference / sum);
}

}  // namespace refield::test
