// SPDX-License-Identifier: Apache-2.0
#include "core/base/isolated.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <fstream>

#include "core/base/errors.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool reserves_address_space = true;  // a sanitizer's shadow takes terabytes of it
#elif defined(__has_feature)
constexpr bool reserves_address_space = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer);
#else
constexpr bool reserves_address_space = false;
#endif

void set_limit(int resource, rlim_t value) {
  const rlimit limit{value, value};
  ::setrlimit(static_cast<__rlimit_resource>(resource), &limit);
}

std::uint64_t address_space_bytes() {
  std::uint64_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

/// Whether all of it was written.
bool write_all(int descriptor, const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t wrote = ::write(descriptor, text.data() + done, text.size() - done);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote <= 0) return false;
    done += static_cast<std::size_t>(wrote);
  }
  return true;
}

[[noreturn]] void run_child(int answer, pid_t parent, const std::function<std::string()>& work,
                            const IsolationLimits& limits) {
  // Without this, a child whose parent is killed would go on as an orphan.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(1);  // it ended before the call
  // Crashes are expected here: no handler of the parent's should speak of them, no memory be dumped.
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU, SIGALRM, SIGINT, SIGTERM})
    std::signal(signal, SIG_DFL);
  ::alarm(limits.wall_seconds);
  set_limit(RLIMIT_CORE, 0);
  set_limit(RLIMIT_CPU, static_cast<rlim_t>(limits.cpu_seconds));
  if (!reserves_address_space) set_limit(RLIMIT_AS, address_space_bytes() + limits.memory_bytes);
  bool complete = false;
  try {
    complete = write_all(answer, work());
  } catch (...) {
  }
  ::_exit(complete ? 0 : 1);
}

/// nullopt when there is more than `most` or `run` is stopped.
std::optional<std::string> read_all(int descriptor, std::size_t most, const RunContext& run) {
  std::string text;
  char buffer[1 << 16];
  for (;;) {
    const ssize_t got = ::read(descriptor, buffer, sizeof buffer);
    if (got < 0 && errno == EINTR) {
      if (run.is_stopped()) return std::nullopt;
      continue;
    }
    if (got <= 0) return text;
    text.append(buffer, static_cast<std::size_t>(got));
    if (text.size() > most) return std::nullopt;
  }
}

}  // namespace

std::optional<std::string> run_isolated(const std::function<std::string()>& work,
                                        const IsolationLimits& limits, const RunContext& run) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0)
    throw DeviceError("pipe", errno, "cannot start a process to read a file");
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child == 0) run_child(ends[1], parent, work, limits);
  const int error_number = errno;
  ::close(ends[1]);
  if (child < 0) {
    ::close(ends[0]);
    throw DeviceError("process", error_number, "cannot start a process to read a file");
  }
  auto answer = read_all(ends[0], limits.answer_bytes, run);
  ::close(ends[0]);
  if (!answer) ::kill(child, SIGKILL);
  int status = 0;
  pid_t ended = 0;
  while ((ended = ::waitpid(child, &status, 0)) < 0 && errno == EINTR) {
  }
  if (!answer) run.throw_if_stopped();
  if (ended != child || !WIFEXITED(status) || WEXITSTATUS(status) != 0) return std::nullopt;
  return answer;
}

}  // namespace refield
