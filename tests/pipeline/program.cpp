// SPDX-License-Identifier: Apache-2.0
#include "tests/pipeline/program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>
#include <thread>

#include "core/base/files.h"

namespace refield::test {

namespace fs = std::filesystem;

RunningProgram::RunningProgram(std::vector<std::string> arguments, const fs::path& log) {
  arguments.insert(arguments.begin(), REFIELD_PROGRAM);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  const int error = ::posix_spawn(&process_, REFIELD_PROGRAM, &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::runtime_error("cannot start " REFIELD_PROGRAM);
}

RunningProgram::~RunningProgram() {
  if (process_ > 0) {
    ::kill(process_, SIGKILL);
    wait();
  }
}

int RunningProgram::wait() {
  int status = 0;
  rusage usage{};
  ::wait4(process_, &status, 0, &usage);
  peak_memory_bytes_ = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
  process_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

bool RunningProgram::kill_after(std::chrono::duration<double> delay) {
  std::this_thread::sleep_for(delay);
  ::kill(process_, SIGKILL);
  return wait() == -SIGKILL;
}

bool RunningProgram::kill_at(const fs::path& sign, std::chrono::duration<double> patience) {
  const auto end = std::chrono::steady_clock::now() + patience;
  while (!fs::exists(sign) && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return kill_after(std::chrono::duration<double>(0));
}

int run_program(std::vector<std::string> arguments, const fs::path& log) {
  return RunningProgram(std::move(arguments), log).wait();
}

int kills_asked_for() {
  const char* text = std::getenv("REFIELD_KILLS");
  return text ? std::max(1, std::atoi(text)) : 10;
}

std::string folder_difference(const fs::path& a, const fs::path& b) {
  const auto list = [](const fs::path& root) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(root))
      files.push_back(entry.path().lexically_relative(root));
    std::ranges::sort(files);
    return files;
  };
  std::string difference;
  const auto files_a = list(a);
  const auto files_b = list(b);
  for (const fs::path& file : files_a)
    if (!fs::exists(b / file)) difference += "only in " + (a / file).string() + "\n";
  for (const fs::path& file : files_b)
    if (!fs::exists(a / file)) difference += "only in " + (b / file).string() + "\n";
  for (const fs::path& file : files_a)
    if (fs::is_regular_file(a / file) && fs::is_regular_file(b / file) &&
        read_text(a / file) != read_text(b / file))
      difference += file.string() + " differs\n";
  return difference;
}

}  // namespace refield::test
