// SPDX-License-Identifier: Apache-2.0
#include "tests/support/virtual_screen.h"

#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>

#include "core/base/files.h"

extern char** environ;

#ifdef __SANITIZE_ADDRESS__
// Unloaded, graphics drivers leave memory behind, under no name that could be suppressed; loaded, they still
// point to it.
extern "C" int dlclose(void*) {
  return 0;
}
#endif

namespace refield::test {

pid_t start_program(std::vector<std::string> words) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_t child = -1;
  return ::posix_spawnp(&child, argv[0], nullptr, nullptr, argv.data(), environ) == 0 ? child : -1;
}

int finish_program(pid_t child) {
  int status = -1;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool is_installed(const std::string& program) {
  return std::system(("command -v " + program + " > /dev/null 2>&1").c_str()) == 0;
}

std::vector<std::uint8_t> screenshot(const std::filesystem::path& file, std::size_t wanted_width,
                                     std::size_t wanted_height) {
  if (finish_program(start_program({"xwd", "-root", "-silent", "-out", file})) != 0) return {};
  const std::string dump = read_text(file);
  // X11/XWDFile.h: 32-bit words, most significant byte first.
  const auto word = [&](std::size_t place) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
      value = value << 8 | static_cast<std::uint8_t>(dump.at(4 * place + i));
    return value;
  };
  const std::size_t header_bytes = word(0), width = word(4), height = word(5), bits = word(11),
                    line = word(12), colours = word(19);
  const bool blue_first = word(7) == 0;
  if (bits != 32 || width != wanted_width || height != wanted_height) return {};
  std::vector<std::uint8_t> levels;
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t at = header_bytes + 12 * colours + y * line + 4 * x;
      for (std::size_t c = 0; c < 3; ++c)
        levels.push_back(static_cast<std::uint8_t>(dump.at(at + (blue_first ? 2 - c : 1 + c))));
    }
  return levels;
}

VirtualScreen::VirtualScreen(int width, int height) {
  int ends[2];
  if (::pipe(ends) != 0) return;
  // -noreset: else the server starts anew when the last window closes, and refuses the next one meanwhile.
  const std::string size = std::to_string(width) + "x" + std::to_string(height) + "x24";
  server_ = start_program(
      {"Xvfb", "-displayfd", std::to_string(ends[1]), "-screen", "0", size, "-nolisten", "tcp", "-noreset"});
  ::close(ends[1]);
  char number[16] = "";
  pollfd ready{ends[0], POLLIN, 0};
  constexpr int patience_ms = 20000;
  if (server_ > 0 && ::poll(&ready, 1, patience_ms) == 1 && ::read(ends[0], number, sizeof number - 1) > 0)
    set("DISPLAY", ":" + std::to_string(std::atoi(number)));
  ::close(ends[0]);
  is_up_ = number[0] != '\0';
  set("LIBGL_ALWAYS_SOFTWARE", "1");
  set("ASAN_OPTIONS", "detect_leaks=0");
}

VirtualScreen::~VirtualScreen() {
  if (server_ > 0) {
    ::kill(server_, SIGTERM);
    finish_program(server_);
  }
  for (const auto& [name, value] : before_)
    if (value)
      ::setenv(name.c_str(), value->c_str(), 1);
    else
      ::unsetenv(name.c_str());
}

void VirtualScreen::set(const std::string& name, const std::string& value) {
  const char* const before = std::getenv(name.c_str());
  before_.emplace(name, before ? std::optional<std::string>(before) : std::nullopt);
  ::setenv(name.c_str(), value.c_str(), 1);
}

}  // namespace refield::test
