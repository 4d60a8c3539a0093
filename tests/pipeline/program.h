// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace refield::test {

/// The program `refield`, running as a process of its own with standard output and error in a file.
class RunningProgram {
 public:
  RunningProgram(std::vector<std::string> arguments, const std::filesystem::path& log);
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// Waits for the end: exit status, or −signal.
  int wait();
  /// The most memory that it held, bytes; known after wait().
  std::uint64_t peak_memory_bytes() const { return peak_memory_bytes_; }
  /// Waits for that long, then kill -9. False when the program had ended by itself.
  bool kill_after(std::chrono::duration<double> delay);
  /// Waits until `sign` exists, for `patience` at most, then kill -9. False when the program had ended by
  /// itself.
  bool kill_at(const std::filesystem::path& sign, std::chrono::duration<double> patience);

 private:
  pid_t process_ = -1;
  std::uint64_t peak_memory_bytes_ = 0;
};

/// Runs `refield` to its end and returns its exit status.
int run_program(std::vector<std::string> arguments, const std::filesystem::path& log);

/// How often the tests of kill -9 strike: REFIELD_KILLS of the environment, else 10.
int kills_asked_for();

/// Empty when two folders hold the same files with the same bytes; else what differs (diff -r).
std::string folder_difference(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace refield::test
