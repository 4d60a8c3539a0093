// SPDX-License-Identifier: Apache-2.0
#include "acquire/devices/gpio_trigger.h"

#include <gpiod.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
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
  throw DeviceError(address.text(), error, what + remedy);
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
      throw InputError(address.text() + ": the chip has lines 0 to " +
                       std::to_string(gpiod_chip_num_lines(chip.get()) - 1));
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

template <class Line>
std::optional<Line> opened(const std::optional<GpioLineAddress>& address, const auto&... more) {
  return address ? std::optional<Line>(std::in_place, *address, more...) : std::nullopt;
}

GpioTriggerOptions checked(const GpioTriggerOptions& options) {
  options.check();
  return options;
}

}  // namespace

std::string GpioLineAddress::text() const {
  return chip + " line " + std::to_string(line);
}

struct GpioOutput::State : OpenLine {
  using OpenLine::OpenLine;
};

GpioOutput::GpioOutput(const GpioLineAddress& address) : state_(std::make_unique<State>(address)) {
  if (gpiod_line_request_output_flags(state_->line, consumer, state_->flags(), 0) != 0) state_->refused();
}
GpioOutput::GpioOutput(GpioOutput&&) noexcept = default;
GpioOutput::~GpioOutput() {
  if (state_) gpiod_line_set_value(state_->line, 0);
}

void GpioOutput::set(bool active) {
  if (gpiod_line_set_value(state_->line, active ? 1 : 0) != 0) fail(state_->address, "cannot be driven");
}

struct GpioInput::State : OpenLine {
  using OpenLine::OpenLine;
  RunContext run;

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
};

GpioInput::GpioInput(const GpioLineAddress& address, RunContext run)
    : state_(std::make_unique<State>(address)) {
  state_->run = std::move(run);
  if (gpiod_line_request_both_edges_events_flags(state_->line, consumer, state_->flags()) != 0)
    state_->refused();
}
GpioInput::GpioInput(GpioInput&&) noexcept = default;
GpioInput::~GpioInput() = default;

bool GpioInput::is_active() {
  const int value = gpiod_line_get_value(state_->line);
  if (value < 0) fail(state_->address, "cannot be read");
  return value == 1;
}

void GpioInput::forget_changes() {
  while (state_->wait(Seconds(0))) state_->read();
}

std::optional<TimePoint> GpioInput::wait_for_active(Seconds timeout) {
  const auto deadline = std::chrono::steady_clock::now() + timeout;
  while (true) {
    state_->run.throw_if_stopped();
    const Seconds left = deadline - std::chrono::steady_clock::now();
    if (!state_->wait(std::min(left, look_for_stop))) {
      is_active();  // a chip that is gone gives no events, but says so here
      if (left.count() <= 0.0) return std::nullopt;
      continue;
    }
    const gpiod_line_event event = state_->read();
    if (event.event_type == GPIOD_LINE_EVENT_RISING_EDGE)
      return TimePoint(std::chrono::seconds(event.ts.tv_sec) + std::chrono::nanoseconds(event.ts.tv_nsec));
  }
}

std::vector<GpioChipInfo> find_gpio_chips() {
  std::vector<GpioChipInfo> chips;
  std::error_code none;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", none)) {
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
      light_source_(opened<GpioOutput>(options.light_source)) {
  if (light_source_) light_source_->set(true);
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
