// SPDX-License-Identifier: Apache-2.0
#include "core/errors.h"

#include <cerrno>
#include <system_error>

namespace refield {

namespace {
std::string remedy(int error_number) {
  if (error_number == ENOSPC || error_number == EDQUOT) return "; free some space there, then run again";
  if (error_number == EACCES || error_number == EROFS) return "; choose a place that you may write to";
  return "";
}
}  // namespace

DeviceError::DeviceError(const std::string& device, int error_number, const std::string& what)
    : Error(device + ": " + what + ": " + std::generic_category().message(error_number) +
            remedy(error_number)),
      error_number_(error_number) {}

}  // namespace refield
