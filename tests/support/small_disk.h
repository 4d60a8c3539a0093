// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

#include "tests/support/temporary_folder.h"

namespace refield::test {

/// A file system of the given size in memory, to fill up. Only root may mount one: check mounted() and skip.
class SmallDisk {
 public:
  explicit SmallDisk(int kilobytes);
  ~SmallDisk();
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool mounted() const { return mounted_; }
  std::filesystem::path operator/(const std::filesystem::path& name) const { return folder_ / name; }
  /// Takes all space but `kilobytes`.
  void fill_leaving(int kilobytes) const;
  /// Number of files, hidden ones too.
  int files() const;

 private:
  TemporaryFolder folder_;
  bool mounted_ = false;
};

inline constexpr const char* needs_mounting =
    "a full disk can only be tested where file systems may be mounted (root)";

}  // namespace refield::test
