// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace refield::test {

/// Starts a program of the path; −1 when it cannot be.
pid_t start_program(std::vector<std::string> words);
/// Waits for its end: exit status; −1 when a signal ended it.
int finish_program(pid_t child);
bool is_installed(const std::string& program);

/// An X server without a screen (Xvfb) for as long as it lives; DISPLAY points to it. Programs started
/// meanwhile draw in software and do not look for leaks: the driver leaves memory behind, and by then it is
/// unloaded, so that no list of exceptions can name it.
class VirtualScreen {
 public:
  VirtualScreen(int width, int height);
  ~VirtualScreen();
  VirtualScreen(const VirtualScreen&) = delete;
  VirtualScreen& operator=(const VirtualScreen&) = delete;
  bool is_up() const { return is_up_; }

 private:
  void set(const std::string& name, const std::string& value);

  std::map<std::string, std::optional<std::string>> before_;  ///< what the environment held
  pid_t server_ = -1;
  bool is_up_ = false;
};

/// The screen's content by xwd, which leaves its dump in `file`: levels red, green, blue; empty when it
/// cannot be read or has another size.
std::vector<std::uint8_t> screenshot(const std::filesystem::path& file, std::size_t wanted_width,
                                     std::size_t wanted_height);

}  // namespace refield::test
