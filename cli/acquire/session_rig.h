// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>

#include "acquire/gpio_trigger.h"
#include "acquire/illuminator.h"
#include "acquire/v4l2_camera.h"
#include "cli/acquire/session_file.h"

namespace refield::cli {

/// The devices that a session file names, opened.
class SessionRig {
 public:
  /// Throws InputError for what a device cannot do, DeviceError where one is missing or refuses.
  explicit SessionRig(const SessionFile& session);

  V4l2Camera& camera() { return camera_; }
  Illuminator& monitor() { return *monitor_; }
  Trigger* trigger() { return trigger_ ? &*trigger_ : nullptr; }

 private:
  V4l2Camera camera_;
  std::unique_ptr<Illuminator> monitor_;
  std::optional<GpioTrigger> trigger_;
};

/// On standard error, where progress is, too: what a person should know but need not act on.
void tell(const std::string& sentence);

}  // namespace refield::cli
