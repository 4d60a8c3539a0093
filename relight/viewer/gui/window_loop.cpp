// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/gui/window_loop.h"

#include <imgui.h>

#include <chrono>
#include <cstdio>
#include <utility>

#include "core/base/run_context.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace {

using Clock = std::chrono::steady_clock;

constexpr double idle_patience_s = 0.2;
/// Panels settle their layout over a few frames after the last event.
constexpr int frames_after_event = 4;
constexpr std::size_t recent_frames = 30;

double milliseconds_between(Clock::time_point from, Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

class WindowLoop {
 public:
  WindowLoop(GlWindow& window, const std::optional<std::string>& script, const WindowContent& content)
      : content_(content), state_(content.state), window_(window) {
    if (script) script_.emplace(*script);
  }

  void run() {
    while (!window_.is_closed() && !state_.wants_to_close) {
      state_.run.throw_if_stopped();
      const bool plays = script_ && script_->step(state_, content_.stage, input_);
      const bool is_busy =
          plays || content_.wants_frame() || frames_left_ > 0 || content_.is_moving() || !input_.is_empty();
      window_.collect(input_, is_busy ? 0.0 : idle_patience_s);
      if (!input_.is_empty()) frames_left_ = frames_after_event;
      const bool has_notice_passed = state_.notice && Clock::now() > state_.notice->until;
      if (!is_busy && input_.is_empty() && !has_notice_passed) {
        last_end_.reset();
        last_moved_.reset();
        continue;
      }
      frame();
      --frames_left_;
    }
  }

 private:
  void handle(const std::vector<InputEvent>& events) {
    for (const InputEvent& event : events) {
      const bool is_key = std::holds_alternative<KeyChanged>(event);
      if (std::holds_alternative<FilesDropped>(event) || (is_key && !ImGui::GetIO().WantTextInput))
        content_.handle(event);
    }
  }

  void frame() {
    const auto start = Clock::now();
    if (content_.is_moving() && last_moved_)
      content_.advance(milliseconds_between(*last_moved_, start) / 1000.0);
    last_moved_ = start;
    const auto events = input_.take_frame();
    window_.begin_frame(events);
    handle(events);
    const FrameTime parts = content_.draw();
    if (!draw_to_screen()) note_time(start, parts);
    if (const std::string title = content_.title(); titled_ != title) {
      titled_ = title;
      window_.set_title(title + " – refield");
    }
  }

  /// Whether a screenshot was taken, too, which makes the frame long.
  bool draw_to_screen() {
    std::filesystem::path file = script_ ? script_->take_screenshot() : std::filesystem::path();
    const bool is_asked_for = std::exchange(state_.wants_screenshot, false);
    if (is_asked_for) file = free_name("view", ".png");
    ScreenImage shot;
    window_.end_frame(file.empty() ? nullptr : &shot);
    if (file.empty()) return false;
    write_png(file, shot);
    last_end_.reset();  // the time that writing took is no frame's
    if (is_asked_for) say(state_, "Saved " + file.string());
    return true;
  }

  void note_time(Clock::time_point start, FrameTime time) {
    const auto end = Clock::now();
    time.total_ms = milliseconds_between(last_end_.value_or(start), end);
    time.draw_ms = milliseconds_between(start, end) - time.wait_ms - time.view_ms - time.tone_ms;
    last_end_ = end;
    if (script_) script_->note_frame(time);
    state_.recent_frames.push_back(time);
    if (state_.recent_frames.size() > recent_frames) state_.recent_frames.pop_front();
  }

  const WindowContent& content_;
  WindowState& state_;
  GlWindow& window_;
  std::optional<ScriptPlayer> script_;
  InputQueue input_;
  int frames_left_ = frames_after_event;
  std::optional<Clock::time_point> last_end_, last_moved_;
  std::string titled_;
};

}  // namespace

bool show_message_until(GlWindow& window, const std::string& message,
                        const std::function<bool(std::chrono::milliseconds)>& is_done,
                        const RunContext& run) {
  constexpr std::chrono::milliseconds frame(50);
  const auto start = Clock::now();
  InputQueue ignored;
  while (!window.is_closed()) {
    run.throw_if_stopped();
    window.collect(ignored, 0.0);
    ignored = {};
    window.begin_frame({});
    char text[200];
    std::snprintf(text, sizeof text, "%s … %.0f s", message.c_str(),
                  milliseconds_between(start, Clock::now()) / 1000.0);
    const ImVec2 size = ImGui::CalcTextSize(text), all = ImGui::GetIO().DisplaySize;
    ImGui::GetBackgroundDrawList()->AddText(vector(0.5 * (all.x - size.x), 0.5 * (all.y - size.y)),
                                            text_colour, text);
    window.end_frame(nullptr);
    if (is_done(frame)) return true;
  }
  return false;
}

void run_window(GlWindow& window, const std::optional<std::string>& script, const WindowContent& content) {
  WindowLoop(window, script, content).run();
}

}  // namespace refield
