// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/units.h"

namespace refield {

/// A line that starts a camera's exposure.
class Trigger {
 public:
  virtual ~Trigger() = default;
  /// Sends one pulse and returns the instant of its active edge. Throws DeviceError when the line is gone.
  virtual TimePoint fire() = 0;
};

}  // namespace refield
