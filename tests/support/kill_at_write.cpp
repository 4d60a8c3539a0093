// SPDX-License-Identifier: Apache-2.0
// Loaded into a program by LD_PRELOAD, ends it by SIGKILL at a chosen step of its work on disk, so that tests
// of kill -9 strike at a place and not at a time. A step is a call that writes, synchronises or renames a
// file.
//   REFIELD_KILL_AT=N        SIGKILL in place of the N-th step, from 1
//   REFIELD_KILL_NAME=TEXT   SIGKILL once a file whose new name contains TEXT was renamed
//   REFIELD_COUNT_STEPS=FILE the number of steps is written to FILE when the program ends by itself
#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

std::atomic<long> steps{0};
long kill_at = 0;
std::string kill_name, count_file;

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

void step() {
  if (++steps == kill_at) ::kill(::getpid(), SIGKILL);
}

/// Standard output and error are no work on disk.
void step_of(int descriptor) {
  if (descriptor > STDERR_FILENO) step();
}

std::string taken(const char* name) {
  const char* value = std::getenv(name);
  std::string text = value ? value : "";
  ::unsetenv(name);  // programs that this one starts are left alone
  return text;
}

[[gnu::constructor]] void begin() {
  kill_at = std::atol(taken("REFIELD_KILL_AT").c_str());
  kill_name = taken("REFIELD_KILL_NAME");
  count_file = taken("REFIELD_COUNT_STEPS");
  ::unsetenv("LD_PRELOAD");
}

[[gnu::destructor]] void end() {
  if (count_file.empty()) return;
  if (std::FILE* file = std::fopen(count_file.c_str(), "w")) {
    std::fprintf(file, "%ld\n", steps.load());
    std::fclose(file);
  }
}

}  // namespace

extern "C" {

ssize_t write(int descriptor, const void* data, size_t bytes) {
  static auto* const real = next<decltype(write)>("write");
  step_of(descriptor);
  return real(descriptor, data, bytes);
}

ssize_t writev(int descriptor, const iovec* parts, int count) {
  static auto* const real = next<decltype(writev)>("writev");
  step_of(descriptor);
  return real(descriptor, parts, count);
}

ssize_t pwrite64(int descriptor, const void* data, size_t bytes, off64_t offset) {
  static auto* const real = next<decltype(pwrite64)>("pwrite64");
  step_of(descriptor);
  return real(descriptor, data, bytes, offset);
}

int fsync(int descriptor) {
  static auto* const real = next<decltype(fsync)>("fsync");
  step();
  return real(descriptor);
}

int rename(const char* from, const char* to) noexcept {
  static auto* const real = next<int(const char*, const char*)>("rename");
  step();
  const int status = real(from, to);
  if (!kill_name.empty() && std::strstr(to, kill_name.c_str())) ::kill(::getpid(), SIGKILL);
  return status;
}
}
