// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/memory_file.h"

#include <unistd.h>

#include <cstdlib>
#include <string>

namespace refield::fuzz {

MemoryFile::MemoryFile(const std::uint8_t* bytes, std::size_t size) {
  std::string name = "/dev/shm/refield-fuzz-XXXXXX";
  const int descriptor = ::mkstemp(name.data());
  // Anything else than the input itself would be reported as the reader's.
  if (descriptor < 0 || ::write(descriptor, bytes, size) != static_cast<ssize_t>(size)) std::abort();
  ::close(descriptor);
  path_ = name;
}

MemoryFile::~MemoryFile() {
  ::unlink(path_.c_str());
}

}  // namespace refield::fuzz
