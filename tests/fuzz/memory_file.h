// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace refield::fuzz {

/// A file in memory (/dev/shm), for readers that want a path. Each has its own name and inode: a library that
/// failed to close a damaged file cannot mistake the next one for it.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* bytes, std::size_t size);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace refield::fuzz
