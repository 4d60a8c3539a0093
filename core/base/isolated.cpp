// SPDX-License-Identifier: Apache-2.0
#include "core/base/isolated.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>

extern char** environ;

namespace refield {

namespace {

constexpr int stop_check_ms = 100;

/// nullopt when there is more than `most` or `run` is stopped.
std::optional<std::string> read_all(int descriptor, std::size_t max_bytes, const RunContext& run) {
  std::string text;
  char buffer[1 << 16];
  for (;;) {
    if (run.is_stopped()) return std::nullopt;
    pollfd waiting{descriptor, POLLIN, 0};
    if (::poll(&waiting, 1, stop_check_ms) == 0) continue;
    const ssize_t got = ::read(descriptor, buffer, sizeof buffer);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return text;
    text.append(buffer, static_cast<std::size_t>(got));
    if (text.size() > max_bytes) return std::nullopt;
  }
}

/// Crashes are expected: none of the caller's handling of signals is inherited.
class SpawnAttributes {
 public:
  SpawnAttributes() {
    posix_spawnattr_init(&attributes_);
    sigset_t defaults, none;
    sigemptyset(&defaults);
    sigemptyset(&none);
    for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU, SIGALRM, SIGINT, SIGTERM})
      sigaddset(&defaults, signal);
    posix_spawnattr_setsigdefault(&attributes_, &defaults);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setflags(&attributes_, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
  }
  ~SpawnAttributes() { posix_spawnattr_destroy(&attributes_); }
  SpawnAttributes(const SpawnAttributes&) = delete;
  SpawnAttributes& operator=(const SpawnAttributes&) = delete;
  const posix_spawnattr_t* get() const { return &attributes_; }

 private:
  posix_spawnattr_t attributes_{};
};

pid_t start(const fs::path& program, const IsolatedReading& reading, int answer) {
  std::vector<std::string> words =
      reader_arguments(reading.reader, ::getpid(), reading.limits, reading.arguments);
  words.insert(words.begin(), program.string());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, answer, answer_descriptor);
  pid_t child = 0;
  const int failed =
      posix_spawn(&child, program.c_str(), &files, SpawnAttributes().get(), argv.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  errno = failed;
  return failed == 0 ? child : -1;
}

}  // namespace

std::optional<std::string> answer_of(const IsolatedReading& reading, FileReader read, const RunContext& run) {
  if (run.read_isolated) return run.read_isolated(reading);
  static std::mutex mutex;  // the libraries are not made for several threads
  const std::scoped_lock lock(mutex);
  try {
    return read(reading.arguments);
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

std::optional<std::string> read_in_process(const fs::path& program, const IsolatedReading& reading,
                                           const RunContext& run) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    throw DeviceError("pipe", errno, "cannot start a process to read a file");
  const pid_t child = start(program, reading, ends[1]);
  const int error_number = errno;
  ::close(ends[1]);
  if (child < 0) {
    ::close(ends[0]);
    throw DeviceError(program.string(), error_number,
                      "cannot be started; it reads HDF5 and mesh files and must lie beside refield");
  }
  auto answer = read_all(ends[0], reading.limits.answer_bytes, run);
  ::close(ends[0]);
  if (!answer) ::kill(child, SIGKILL);
  int status = 0;
  pid_t ended = 0;
  while ((ended = ::waitpid(child, &status, 0)) < 0 && errno == EINTR) {
  }
  run.throw_if_stopped();
  if (!answer || ended != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0) return std::nullopt;
  return answer;
}

}  // namespace refield
