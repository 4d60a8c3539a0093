// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>

#include "core/base/errors.h"

namespace refield::test {

/// What the error says that `action` throws.
template <class Thrown = Error, class Action>
std::string message_of(const Action& action) {
  try {
    action();
  } catch (const Thrown& error) {
    return error.what();
  }
  return "(nothing was thrown)";
}

}  // namespace refield::test
