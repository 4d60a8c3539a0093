// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/base/errors.h"

namespace refield {

/// Throws InputError when writing `output` would replace an input. An input is a file, a quoted pattern, or a
/// folder, which stands for the capture session or the images in it. Files are compared by identity, so links
/// count as the file that they lead to. Empty inputs are none.
void require_not_an_input(const fs::path& output, const std::vector<fs::path>& inputs);

/// Throws InputError when an input lies in `folder`, whose content is about to be replaced.
void require_outside(const fs::path& folder, const std::vector<fs::path>& inputs);

/// Reserves an output, a file or a folder, for this process while it lives. Construct it before any long
/// work. The lock is the operating system's and ends with the process, however that ends. For a file it is
/// held by
/// `.lock-NAME` beside the output. What earlier runs that were killed left of the same output is removed.
class OutputLock {
 public:
  /// Creates the parent folder. Throws InputError when
  /// - the name does not end in `extension` (".rfield"), where one is given, or is that of a folder,
  /// - the output is also an input, see require_not_an_input(),
  /// - another process holds the output; the message says which.
  /// Throws DeviceError where the system refuses.
  OutputLock(const fs::path& output, const std::vector<fs::path>& inputs, const std::string& extension = "");
  ~OutputLock();
  OutputLock(const OutputLock&) = delete;
  OutputLock& operator=(const OutputLock&) = delete;

 private:
  fs::path file_;        ///< empty when the output is a folder that is locked itself
  int descriptor_ = -1;  ///< -1: the file system has no locks
};

}  // namespace refield
