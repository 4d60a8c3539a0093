// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>

namespace refield::report {

/// A folder of its own among the system's temporary files, removed with all it holds at the end of its life.
class ScratchFolder {
 public:
  /// Throws DeviceError where the system refuses.
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(const ScratchFolder&) = delete;
  ScratchFolder& operator=(const ScratchFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

}  // namespace refield::report
