// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/gpio_trigger.h"

#include <gpiod.h>

#include <algorithm>
#include <cerrno>
#include <thread>

namespace refield {

namespace {

constexpr const char* consumer = "refield";
constexpr Seconds look_for_stop{0.2};

struct CloseChip {
  void operator()(gpiod_chip* chip) const { gpiod_chip_close(chip); }
};
using Chip = std::unique_ptr<gpiod_chip, CloseChip>;

[[noreturn]] void fail(const GpioLineAddress& address, const std::string& what) {
  const int error = errno;
  std::string remedy;
  if (error == ENODEV || error == ENOENT || error == ENXIO)
    remedy = "; the chip does not exist: 'refield acquire devices' lists chips";
  else if (error == EACCES || error == EPERM)
    remedy = "; permission denied: become a member of the chip's group or run as root";
  throw DeviceError(address.text(), error, what, remedy);
}

/// A line with its chip, not yet asked for.
struct OpenLine {
  GpioLineAddress address;
  Chip chip;
  gpiod_line* line = nullptr;

  explicit OpenLine(const GpioLineAddress& wanted)
      : address(wanted), chip(gpiod_chip_open_lookup(wanted.chip.c_str())) {
    if (!chip) fail(address, "cannot be opened");
    if (address.line >= gpiod_chip_num_lines(chip.get()))
      throw InputError(address.text(), ": the chip has lines 0 to ", gpiod_chip_num_lines(chip.get()) - 1);
    line = gpiod_chip_get_line(chip.get(), address.line);
    if (!line) fail(address, "cannot be found");
  }
  int flags() const { return address.active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0; }
  [[noreturn]] void refused() const {
    const int error = errno;
    const char* user = gpiod_line_update(line) == 0 ? gpiod_line_consumer(line) : nullptr;
    errno = error;
    fail(address, error == EBUSY && user
                      ? std::string("is used by ") + user + "; stop that program, or use another line"
                      : "cannot be taken");
  }
};

timespec timespec_of(Seconds s) {
  const auto whole = std::chrono::ceil<std::chrono::nanoseconds>(std::max(s, Seconds(0))).count();
  return {static_cast<time_t>(whole / 1'000'000'000), static_cast<long>(whole % 1'000'000'000)};
}

/// A line that this program drives. It is inactive when the object is made and again when it goes.
class OutputLine : OpenLine {
 public:
  /// Throws DeviceError when the chip is missing, the line is taken (the message says by whom) or not an
  /// output.
  explicit OutputLine(const GpioLineAddress& wanted) : OpenLine(wanted) {
    if (gpiod_line_request_output_flags(line, consumer, flags(), 0) != 0) refused();
  }
  ~OutputLine() { gpiod_line_set_value(line, 0); }
  void set(bool active) const {
    if (gpiod_line_set_value(line, active ? 1 : 0) != 0) fail(address, "cannot be driven");
  }
};

/// A line that something else drives, watched for its changes.
class InputLine : OpenLine {
 public:
  /// Throws as OutputLine does. `run` stops waiting.
  InputLine(const GpioLineAddress& wanted, RunContext run) : OpenLine(wanted), run_(std::move(run)) {
    if (gpiod_line_request_both_edges_events_flags(line, consumer, flags()) != 0) refused();
  }

  bool is_active() const {
    const int value = gpiod_line_get_value(line);
    if (value < 0) fail(address, "cannot be read");
    return value == 1;
  }
  void forget_changes() const {
    while (wait(Seconds(0))) read();
  }
  /// Waits for the next change to active since the last call; its instant as the kernel saw it, on the
  /// monotonic clock. nullopt after `timeout`. Throws DeviceError when the chip is gone, Interrupted when
  /// asked to stop.
  std::optional<TimePoint> wait_for_active(Seconds timeout) const {
    const auto deadline = std::chrono::steady_clock::now() + timeout;
    while (true) {
      run_.throw_if_stopped();
      const Seconds left = deadline - std::chrono::steady_clock::now();
      if (!wait(std::min(left, look_for_stop))) {
        is_active();  // a chip that is gone gives no events, but says so here
        if (left.count() <= 0.0) return std::nullopt;
        continue;
      }
      const gpiod_line_event event = read();
      if (event.event_type == GPIOD_LINE_EVENT_RISING_EDGE)
        return TimePoint(std::chrono::seconds(event.ts.tv_sec) + std::chrono::nanoseconds(event.ts.tv_nsec));
    }
  }

 private:
  /// True when an event waits to be read.
  bool wait(Seconds timeout) const {
    const timespec time = timespec_of(timeout);
    const int status = gpiod_line_event_wait(line, &time);
    if (status < 0 && errno != EINTR) fail(address, "cannot be watched");
    return status > 0;
  }
  gpiod_line_event read() const {
    gpiod_line_event event{};
    if (gpiod_line_event_read(line, &event) != 0) fail(address, "cannot be read");
    return event;
  }
  RunContext run_;
};

}  // namespace

std::string GpioLineAddress::text() const {
  return chip + " line " + std::to_string(line);
}

std::vector<GpioChipInfo> find_gpio_chips() {
  std::vector<GpioChipInfo> chips;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator("/dev", none)) {
    if (!entry.path().filename().string().starts_with("gpiochip")) continue;
    const Chip chip(gpiod_chip_open(entry.path().c_str()));
    if (!chip) continue;
    GpioChipInfo info{entry.path(),
                      gpiod_chip_name(chip.get()),
                      gpiod_chip_label(chip.get()),
                      gpiod_chip_num_lines(chip.get()),
                      {}};
    for (unsigned i = 0; i < info.lines; ++i) {
      gpiod_line* line = gpiod_chip_get_line(chip.get(), i);
      if (!line) continue;
      const char* name = gpiod_line_name(line);
      const char* user = gpiod_line_consumer(line);
      if (!name && !user) continue;
      info.named_lines.push_back(std::to_string(i) + (name ? std::string(" ") + name : "") +
                                 (user ? std::string(" (used by ") + user + ")" : ""));
    }
    chips.push_back(std::move(info));
  }
  std::ranges::sort(chips, {}, &GpioChipInfo::path);
  return chips;
}

void GpioTriggerOptions::check() const {
  if (!(pulse_width.count() > 0.0 && pulse_width.count() <= 1.0))
    throw InputError("trigger: a pulse width of ", pulse_width.count(), " s lies outside 0 to 1 s");
  if (!(timeout.count() > 0.0 && timeout.count() <= 3600.0))
    throw InputError("trigger: a time-out of ", timeout.count(), " s lies outside 0 to 3600 s");
}

struct GpioTrigger::State {
  GpioTriggerOptions options;
  OutputLine trigger;
  std::optional<InputLine> ready, strobe;
  std::optional<OutputLine> light_source;

  State(const GpioTriggerOptions& given, const RunContext& run) : options(given), trigger(given.trigger) {
    if (given.ready) ready.emplace(*given.ready, run);
    if (given.strobe) strobe.emplace(*given.strobe, run);
    if (given.light_source) light_source.emplace(*given.light_source).set(true);
  }

  void wait_until_ready() const {
    if (!ready) return;
    ready->forget_changes();
    if (ready->is_active() || ready->wait_for_active(options.timeout)) return;
    throw DeviceError(options.ready->text(), ETIMEDOUT, "the camera did not become ready within ",
                      options.timeout.count(), " s; check its power, the wire and the line's polarity");
  }
};

GpioTrigger::GpioTrigger(const GpioTriggerOptions& options, const RunContext& run) {
  options.check();
  state_ = std::make_unique<State>(options, run);
}
GpioTrigger::~GpioTrigger() = default;

TimePoint GpioTrigger::fire() {
  const auto& [options, trigger, ready, strobe, light_source] = *state_;
  state_->wait_until_ready();
  if (strobe) strobe->forget_changes();
  const TimePoint before(std::chrono::steady_clock::now().time_since_epoch());
  trigger.set(true);
  std::this_thread::sleep_for(options.pulse_width);
  trigger.set(false);
  if (!strobe) return before;
  if (const auto begun = strobe->wait_for_active(options.timeout)) return *begun;
  throw DeviceError(options.strobe->text(), ETIMEDOUT, "no strobe within ", options.timeout.count(),
                    " s of the trigger; check that the camera is in its trigger mode and that both wires "
                    "are connected");
}

}  // namespace refield
