// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/input.h"

namespace refield {

std::vector<InputEvent> InputQueue::take_frame() {
  std::vector<InputEvent> frame;
  bool had_button = false;
  while (!events_.empty()) {
    const bool is_button = std::holds_alternative<MouseButtonChanged>(events_.front());
    if (had_button && (is_button || std::holds_alternative<MouseMoved>(events_.front()))) break;
    had_button |= is_button;
    frame.push_back(std::move(events_.front()));
    events_.pop_front();
  }
  return frame;
}

}  // namespace refield
