// SPDX-License-Identifier: Apache-2.0
#include "core/base/errors.h"

#include <cerrno>
#include <system_error>

namespace refield {

namespace {
std::string remedy(int error_number) {
  if (error_number == ENOSPC || error_number == EDQUOT) return "; free some space there, then run again";
  if (error_number == EACCES || error_number == EROFS) return "; choose a folder with write permission";
  if (error_number == EMFILE || error_number == ENFILE)
    return "; raise the limit of open files (ulimit -n), then run again";
  if (error_number == EFBIG) return "; raise the limit of the size of files (ulimit -f), then run again";
  if (error_number == ENAMETOOLONG) return "; give a shorter name";
  if (error_number == ELOOP) return "; symbolic links lead back to themselves, remove one of them";
  return "";
}
}  // namespace

DeviceError::DeviceError(const std::string& device, int error_number, const std::string& what)
    : Error(device + ": " + what + ": " + std::generic_category().message(error_number) +
            remedy(error_number)),
      error_number_(error_number) {}

}  // namespace refield
