// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <optional>

#include "acquire/gpio_lines.h"
#include "acquire/trigger.h"

namespace refield {

struct GpioTriggerOptions {
  GpioLineAddress trigger;                     ///< to the camera's trigger input
  Seconds pulse_width{1e-3};                   ///< how long it stays active; cameras state their shortest
  std::optional<GpioLineAddress> ready = {};   ///< active while the camera can take a trigger; waited for
  std::optional<GpioLineAddress> strobe = {};  ///< active from the start of exposure; tells the true instant
  std::optional<GpioLineAddress> lamp = {};    ///< active as long as the trigger exists
  Seconds timeout{2.0};                        ///< for ready and strobe

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// A camera's trigger line on a GPIO chip, with ready and strobe lines back and a lamp line where wired.
/// fire() waits for ready, sends one pulse and returns the strobe's instant or, without a strobe line, the
/// instant just before the pulse. Throws DeviceError when ready or strobe stay away, or the chip is gone.
class GpioTrigger final : public Trigger {
 public:
  /// `run` stops waiting.
  explicit GpioTrigger(const GpioTriggerOptions& options, const RunContext& run = {});
  TimePoint fire() override;

 private:
  void wait_until_ready();
  void pulse();
  GpioTriggerOptions options_;
  GpioOutput trigger_;
  std::optional<GpioInput> ready_, strobe_;
  std::optional<GpioOutput> lamp_;
};

}  // namespace refield
