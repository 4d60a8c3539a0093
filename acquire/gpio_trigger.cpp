// SPDX-License-Identifier: Apache-2.0
#include "acquire/gpio_trigger.h"

#include <cerrno>
#include <thread>

#include "core/errors.h"

namespace refield {

namespace {

template <class Line>
std::optional<Line> opened(const std::optional<GpioLineAddress>& address, const auto&... more) {
  return address ? std::optional<Line>(std::in_place, *address, more...) : std::nullopt;
}

GpioTriggerOptions checked(const GpioTriggerOptions& options) {
  options.check();
  return options;
}

}  // namespace

void GpioTriggerOptions::check() const {
  if (!(pulse_width.count() > 0.0 && pulse_width.count() <= 1.0))
    throw InputError("trigger: a pulse width of " + std::to_string(pulse_width.count()) +
                     " s lies outside 0 to 1 s");
  if (!(timeout.count() > 0.0 && timeout.count() <= 3600.0))
    throw InputError("trigger: a time-out of " + std::to_string(timeout.count()) +
                     " s lies outside 0 to 3600 s");
}

GpioTrigger::GpioTrigger(const GpioTriggerOptions& options, const RunContext& run)
    : options_(checked(options)),
      trigger_(options.trigger),
      ready_(opened<GpioInput>(options.ready, run)),
      strobe_(opened<GpioInput>(options.strobe, run)),
      lamp_(opened<GpioOutput>(options.lamp)) {
  if (lamp_) lamp_->set(true);
}

void GpioTrigger::wait_until_ready() {
  if (!ready_) return;
  ready_->forget_changes();
  if (ready_->is_active() || ready_->wait_for_active(options_.timeout)) return;
  throw DeviceError(options_.ready->text(), ETIMEDOUT,
                    "the camera did not become ready within " + std::to_string(options_.timeout.count()) +
                        " s; check its power, the wire and the line's polarity");
}

void GpioTrigger::pulse() {
  trigger_.set(true);
  std::this_thread::sleep_for(options_.pulse_width);
  trigger_.set(false);
}

TimePoint GpioTrigger::fire() {
  wait_until_ready();
  if (strobe_) strobe_->forget_changes();
  const TimePoint before(std::chrono::steady_clock::now().time_since_epoch());
  pulse();
  if (!strobe_) return before;
  if (const auto begun = strobe_->wait_for_active(options_.timeout)) return *begun;
  throw DeviceError(options_.strobe->text(), ETIMEDOUT,
                    "no strobe within " + std::to_string(options_.timeout.count()) +
                        " s of the trigger; check that the camera is in its trigger mode and that both wires "
                        "are connected");
}

}  // namespace refield
