// SPDX-License-Identifier: Apache-2.0
// Loaded into a program by LD_PRELOAD, ends it by SIGKILL at a chosen step of its work on disk, so that tests
// of kill -9 strike at a place and not at a time. A step is a call that writes, synchronises or renames a
// file.
//   REFIELD_KILL_AT=N        SIGKILL in place of the N-th step, from 1
//   REFIELD_KILL_NAME=TEXT   SIGKILL once a file whose new name contains TEXT was renamed
//   REFIELD_COUNT_STEPS=FILE the number of steps is written to FILE when the program ends by itself
#include <dlfcn.h>
#include <signal.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

// Plain arrays: other threads still write while static objects are destroyed.
std::atomic<long> steps{0};
long kill_at = 0;
char kill_name[256] = "", count_file[4096] = "";

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

template <std::size_t size>
void take(const char* name, char (&text)[size]) {
  if (const char* value = std::getenv(name)) std::strncpy(text, value, size - 1);
  ::unsetenv(name);  // programs that this one starts are left alone
}

[[gnu::constructor]] void begin() {
  char number[32] = "";
  take("REFIELD_KILL_AT", number);
  kill_at = std::atol(number);
  take("REFIELD_KILL_NAME", kill_name);
  take("REFIELD_COUNT_STEPS", count_file);
  ::unsetenv("LD_PRELOAD");
}

[[gnu::destructor]] void end() {
  if (count_file[0] == '\0') return;
  if (std::FILE* file = std::fopen(count_file, "w")) {
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
  if (kill_name[0] != '\0' && std::strstr(to, kill_name)) ::kill(::getpid(), SIGKILL);
  return status;
}
}
