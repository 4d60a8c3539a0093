// SPDX-License-Identifier: Apache-2.0
#include "cli/report/scratch_folder.h"

#include <stdlib.h>

#include <cerrno>
#include <string>

#include "core/errors.h"

namespace refield::report {

ScratchFolder::ScratchFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "refield-report-XXXXXX").string();
  if (!::mkdtemp(pattern.data())) throw DeviceError(pattern, errno, "cannot create a temporary folder");
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace refield::report
