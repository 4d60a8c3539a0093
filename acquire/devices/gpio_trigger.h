// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>

#include "acquire/camera.h"
#include "core/base/run_context.h"
#include "core/base/units.h"

namespace refield {

/// A line of a GPIO chip. Levels are logical: active is low voltage on an `active_low` line.
struct GpioLineAddress {
  std::string chip;  ///< "/dev/gpiochip0", "gpiochip0", its label, or its number
  unsigned line = 0;
  bool active_low = false;

  std::string text() const;
};

struct GpioChipInfo {
  std::string path;
  std::string name;
  std::string label;
  unsigned lines = 0;
  std::vector<std::string> named_lines;  ///< "5 camera-trigger (used by X)", those with a name or a user
};

/// GPIO chips of this machine. Chips that may not be opened are left out.
std::vector<GpioChipInfo> find_gpio_chips();

struct GpioTriggerOptions {
  GpioLineAddress trigger;                     ///< to the camera's trigger input
  Seconds pulse_width{1e-3};                   ///< how long it stays active; cameras state their shortest
  std::optional<GpioLineAddress> ready = {};   ///< active while the camera can take a trigger; waited for
  std::optional<GpioLineAddress> strobe = {};  ///< active from the start of exposure; tells the true instant
  std::optional<GpioLineAddress> light_source = {};  ///< active as long as the trigger exists
  Seconds timeout{2.0};                              ///< for ready and strobe

  /// Throws InputError naming the option and its range.
  void check() const;
};

/// A camera's trigger line on a GPIO chip, with ready and strobe lines back and a light source line where
/// wired. fire() waits for ready, sends one pulse and returns the strobe's instant or, without a strobe line,
/// the instant just before the pulse. Throws DeviceError when ready or strobe stay away, or the chip is gone.
class GpioTrigger final : public Trigger {
 public:
  /// `run` stops waiting.
  explicit GpioTrigger(const GpioTriggerOptions& options, const RunContext& run = {});
  ~GpioTrigger() override;
  TimePoint fire() override;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace refield
