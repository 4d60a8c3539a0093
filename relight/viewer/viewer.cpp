// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/viewer.h"

#include <imgui.h>

#include <chrono>
#include <utility>

#include "core/interrupt.h"
#include "relight/viewer/gl_window.h"
#include "relight/viewer/panels.h"
#include "relight/viewer/script_player.h"
#include "relight/viewer/shortcuts.h"

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

class Viewer {
 public:
  explicit Viewer(const ViewerOptions& options)
      : app_(options.field), window_(options.width, options.height, !options.script) {
    if (options.script) script_.emplace(*options.script);
    if (options.light) load_light(app_, *options.light);
  }

  void run() {
    while (!window_.is_closed() && !app_.wants_to_close) {
      throw_if_interrupted();
      const bool plays = script_ && script_->step(app_, input_);
      const bool comes_to_rest = app_.state->view() != nullptr && app_.state->view()->wants_rest();
      const bool is_busy =
          plays || comes_to_rest || frames_left_ > 0 || app_.is_playing || !input_.is_empty();
      window_.collect(input_, is_busy ? 0.0 : idle_patience_s);
      if (!input_.is_empty()) frames_left_ = frames_after_event;
      const bool has_notice_passed = app_.notice && Clock::now() > app_.notice->until;
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
  /// Files and shortcuts at once; mouse and text by way of the panels.
  void handle(const std::vector<InputEvent>& events) {
    for (const InputEvent& event : events) {
      if (const auto* dropped = std::get_if<FilesDropped>(&event))
        for (const auto& file : dropped->files) open_file(app_, file);
      const auto* key = std::get_if<KeyChanged>(&event);
      if (key != nullptr && !ImGui::GetIO().WantTextInput) handle_key(app_, *key);
    }
  }

  void update_textures(const ViewState::Refreshed& done) {
    const ViewState& state = *app_.state;
    const LightDomain& light = state.panorama().shown();
    if (done.picture)
      textures_.picture.update(state.radiance().width, state.radiance().height, state.picture());
    if (done.light) textures_.light.update(light.width, light.height, state.light_picture());
    if (done.kernels) textures_.kernels.update(light.width, light.height, state.kernel_picture());
    textures_.picture.set_smooth(app_.is_smooth);
  }

  void frame() {
    const auto start = Clock::now();
    if (app_.is_playing && last_moved_)
      advance_motion(app_, milliseconds_between(*last_moved_, start) / 1000.0);
    last_moved_ = start;
    const auto events = input_.take_frame();
    window_.begin_frame(events);
    handle(events);
    draw_panels(app_, textures_);
    const ViewState::Refreshed done = app_.state->refresh();
    update_textures(done);
    if (!draw_to_screen()) note_time(start, done);
    if (titled_ != app_.field_file) {
      titled_ = app_.field_file;
      window_.set_title(titled_.filename().string() + " – refield");
    }
  }

  /// Whether a screenshot was taken, too, which makes the frame long.
  bool draw_to_screen() {
    std::filesystem::path file = script_ ? script_->take_screenshot() : std::filesystem::path();
    const bool is_asked_for = std::exchange(app_.wants_screenshot, false);
    if (is_asked_for) file = free_name("view", ".png");
    ScreenImage shot;
    window_.end_frame(file.empty() ? nullptr : &shot);
    if (file.empty()) return false;
    write_png(file, shot);
    last_end_.reset();  // the time that writing took is no frame's
    if (is_asked_for) say(app_, "Saved " + file.string());
    return true;
  }

  void note_time(Clock::time_point start, const ViewState::Refreshed& done) {
    const auto end = Clock::now();
    FrameTime time;
    time.total_ms = milliseconds_between(last_end_.value_or(start), end);
    time.relight_ms = done.relight_ms;
    time.view_ms = done.view_ms;
    time.tone_ms = done.tone_ms;
    time.draw_ms = milliseconds_between(start, end) - done.relight_ms - done.view_ms - done.tone_ms;
    last_end_ = end;
    if (script_) script_->note_frame(time);
    app_.recent_frames.push_back(time);
    if (app_.recent_frames.size() > recent_frames) app_.recent_frames.pop_front();
  }

  App app_;
  GlWindow window_;
  Textures textures_;  // gone before the window
  std::optional<ScriptPlayer> script_;
  InputQueue input_;
  int frames_left_ = frames_after_event;
  std::optional<Clock::time_point> last_end_, last_moved_;
  std::filesystem::path titled_;
};

}  // namespace

bool has_viewer() {
  return true;
}

void run_viewer(const ViewerOptions& options) {
  Viewer(options).run();
}

}  // namespace refield
