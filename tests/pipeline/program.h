// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace refield::test {

/// The program `refield`, running as a process of its own with standard output and error in a file.
class RunningProgram {
 public:
  /// `environment` [NAME=VALUE] is added to that of this process.
  RunningProgram(std::vector<std::string> arguments, const std::filesystem::path& log,
                 const std::vector<std::string>& environment = {});
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// Waits for the end: exit status, or −signal.
  int wait();
  /// The most memory that it held, bytes; known after wait().
  std::uint64_t peak_memory_bytes() const { return peak_memory_bytes_; }

 private:
  pid_t process_ = -1;
  std::uint64_t peak_memory_bytes_ = 0;
};

/// Runs `refield` to its end and returns its exit status.
int run_program(std::vector<std::string> arguments, const std::filesystem::path& log);

/// A named pipe that a program prints into, so that a test can wait for what it prints.
class OutputPipe {
 public:
  explicit OutputPipe(std::filesystem::path path);
  ~OutputPipe();
  OutputPipe(const OutputPipe&) = delete;
  OutputPipe& operator=(const OutputPipe&) = delete;

  const std::filesystem::path& path() const { return path_; }
  void read_until(const std::string& text);
  /// What was read so far.
  const std::string& text() const { return text_; }

 private:
  std::filesystem::path path_;
  int descriptor_ = -1;
  std::string text_;
};

/// How many steps on disk (tests/support/kill_at_write.cpp) `refield` takes to its end; 0 when it failed.
long count_steps(std::vector<std::string> arguments, const std::filesystem::path& log);
/// Runs `refield` and ends it by SIGKILL in place of a step on disk, from 1. False when it ended by itself.
bool kill_at_step(std::vector<std::string> arguments, const std::filesystem::path& log, long step);
/// The same as soon as a file is complete whose path contains `name`.
bool kill_at_file(std::vector<std::string> arguments, const std::filesystem::path& log,
                  const std::string& name);

/// How often the tests of kill -9 strike: REFIELD_KILLS of the environment, else 10.
int kills_asked_for();

/// Empty when two folders hold the same files with the same bytes; else what differs (diff -r).
std::string folder_difference(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace refield::test
