// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cerrno>
#include <cstdlib>

#include "core/base/errors.h"

namespace refield {

/// A folder of its own among the system's temporary files, removed with all it holds at the end of its life.
class TemporaryFolder {
 public:
  /// Throws DeviceError where the system refuses.
  TemporaryFolder() {
    std::string name = fs::temp_directory_path() / "refield-XXXXXX";
    if (!::mkdtemp(name.data())) throw DeviceError(name, errno, "cannot create a temporary folder");
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace refield
