// SPDX-License-Identifier: Apache-2.0
#include "tests/pipeline/program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <stdexcept>

#include "core/base/files.h"

namespace refield::test {

namespace fs = std::filesystem;

RunningProgram::RunningProgram(std::vector<std::string> arguments, const fs::path& log,
                               const std::vector<std::string>& environment) {
  arguments.insert(arguments.begin(), REFIELD_PROGRAM);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  std::vector<char*> variables;
  for (const std::string& variable : environment) variables.push_back(const_cast<char*>(variable.c_str()));
  for (char** variable = environ; *variable; ++variable) variables.push_back(*variable);
  variables.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  const int error =
      ::posix_spawn(&process_, REFIELD_PROGRAM, &actions, nullptr, argv.data(), variables.data());
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

int run_program(std::vector<std::string> arguments, const fs::path& log) {
  return RunningProgram(std::move(arguments), log).wait();
}

OutputPipe::OutputPipe(fs::path path) : path_(std::move(path)) {
  // Also for writing, so that the program need not wait for a reader.
  if (::mkfifo(path_.c_str(), 0600) == 0) descriptor_ = ::open(path_.c_str(), O_RDWR | O_CLOEXEC);
}

OutputPipe::~OutputPipe() {
  ::close(descriptor_);
}

void OutputPipe::read_until(const std::string& text) {
  char letter = 0;
  while (!text_.ends_with(text) && ::read(descriptor_, &letter, 1) == 1) text_ += letter;
}

namespace {

/// `refield` with kill_at_write.cpp loaded into it.
int run_watched(std::vector<std::string> arguments, const fs::path& log, const std::string& variable) {
  return RunningProgram(std::move(arguments), log, {"LD_PRELOAD=" REFIELD_KILL_AT_WRITE, variable}).wait();
}

}  // namespace

long count_steps(std::vector<std::string> arguments, const fs::path& log) {
  const fs::path file = log.string() + ".steps";
  const int status = run_watched(std::move(arguments), log, "REFIELD_COUNT_STEPS=" + file.string());
  return status == 0 ? std::stol(read_text(file)) : 0;
}

bool kill_at_step(std::vector<std::string> arguments, const fs::path& log, long step) {
  return run_watched(std::move(arguments), log, "REFIELD_KILL_AT=" + std::to_string(step)) == -SIGKILL;
}

bool kill_at_file(std::vector<std::string> arguments, const fs::path& log, const std::string& name) {
  return run_watched(std::move(arguments), log, "REFIELD_KILL_NAME=" + name) == -SIGKILL;
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
