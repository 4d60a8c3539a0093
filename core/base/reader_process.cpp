// SPDX-License-Identifier: Apache-2.0
#include "core/base/isolated.h"

#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <fstream>

namespace refield {

namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool reserves_address_space = true;  // a sanitizer's shadow takes terabytes of it
#elif defined(__has_feature)
constexpr bool reserves_address_space = __has_feature(address_sanitizer) || __has_feature(thread_sanitizer);
#else
constexpr bool reserves_address_space = false;
#endif

constexpr int fixed_arguments = 6;  // program, reader, parent, memory, processor time, wall time

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

}  // namespace

std::vector<std::string> reader_arguments(const std::string& reader, long parent,
                                          const IsolationLimits& limits,
                                          const std::vector<std::string>& arguments) {
  std::vector<std::string> words = {reader, std::to_string(parent), std::to_string(limits.memory_bytes),
                                    std::to_string(limits.cpu_seconds), std::to_string(limits.wall_seconds)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return words;
}

[[noreturn]] void run_reader_process(int argc, char** argv,
                                     const std::map<std::string, FileReader>& readers) {
  // Without this, a process whose parent is killed would go on as an orphan.
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  const auto reader = argc >= fixed_arguments ? readers.find(argv[1]) : readers.end();
  if (reader == readers.end()) ::_exit(2);
  try {
    if (::getppid() != std::stol(argv[2])) ::_exit(1);  // it ended before the call
    ::alarm(static_cast<unsigned>(std::stoul(argv[5])));
    set_limit(RLIMIT_CORE, 0);
    set_limit(RLIMIT_CPU, static_cast<rlim_t>(std::stoul(argv[4])));
    if (!reserves_address_space) set_limit(RLIMIT_AS, address_space_bytes() + std::stoull(argv[3]));
    ::_exit(write_all(answer_descriptor, reader->second({argv + fixed_arguments, argv + argc})) ? 0 : 1);
  } catch (...) {
    ::_exit(1);
  }
}

}  // namespace refield
