// SPDX-License-Identifier: Apache-2.0
// A reader program that does what its reader's name says, for isolated_test.cpp.
#include <sys/mman.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <stdexcept>

#include "core/base/isolated.h"

namespace {

using Arguments = std::vector<std::string>;

/// Also where it is given an empty byte.
std::string text(const Arguments& arguments) {
  return std::string("a\0b", 3) + arguments.at(0);
}

std::string bytes(const Arguments& arguments) {
  return std::string(std::stoul(arguments.at(0)), 'x');
}

std::string segmentation_fault(const Arguments&) {
  std::raise(SIGSEGV);
  return "";
}

std::string abort(const Arguments&) {
  std::abort();
}

std::string exception(const Arguments&) {
  throw std::runtime_error("no answer");
}

std::string loop(const Arguments&) {
  for (;;) std::rand();
}

std::string pause(const Arguments& arguments) {
  if (!arguments.empty()) std::ofstream(arguments[0]) << ::getpid() << std::endl;
  for (;;) ::pause();
}

std::string allocate(const Arguments& arguments) {
  const void* given = ::mmap(nullptr, std::stoul(arguments.at(0)), PROT_READ | PROT_WRITE,
                             MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  return given != MAP_FAILED ? "given" : "refused";
}

}  // namespace

int main(int argc, char** argv) {
  refield::run_reader_process(argc, argv,
                              {{"text", text},
                               {"bytes", bytes},
                               {"segmentation fault", segmentation_fault},
                               {"abort", abort},
                               {"exception", exception},
                               {"loop", loop},
                               {"pause", pause},
                               {"allocate", allocate}});
}
