// SPDX-License-Identifier: Apache-2.0
#define GLFW_INCLUDE_NONE

#include <GLFW/glfw3.h>

#include <cmath>

#include "relight/viewer/gui/viewer_window.h"
#include "relight/viewer/gui/widgets.h"
#include "relight/viewer/scene/scene_state.h"

namespace refield {

namespace {

constexpr double third_stop = 1.0 / 3.0;
constexpr double turn_step = 5.0;     // degrees
constexpr double nudge_share = 0.02;  // of the distance from the camera

/// The viewer of moving scenes.
class SceneViewer final : public ViewerWindow {
 public:
  SceneViewer(MovingScene scene, const RunContext& context)
      : ViewerWindow(context, "scene"), state_(std::move(scene)) {
    min_side = max_side = 380.0;
  }

 private:
  std::string title() const override { return state_.scene().name; }
  const Image& radiance() const override { return state_.radiance(); }
  std::span<const std::uint8_t> levels() const override { return state_.picture(); }
  FreeView* camera() override { return &state_.view(); }
  ToneMapping tone() const override { return state_.tone(); }
  void set_tone(const ToneMapping& tone) override { state_.set_tone(tone); }
  void expose() override { state_.expose(); }
  void advance(double seconds) override { state_.advance(seconds); }
  Refreshed refresh() override { return state_.refresh(); }
  const char* mouse_help() const override {
    return "Drag moving objects and area lights over the floor; with Shift, up and down. Select other "
           "objects with a click first. Drag elsewhere to rotate the scene, wheel to zoom, right button to "
           "pan.";
  }
  void open(const fs::path&) override {
    complain("Files cannot be dropped onto a dynamic scene; open them with 'refield view'");
  }
  void save(const fs::path& file) override {
    state_.view().settle();
    state_.refresh();
    write_picture(file, state_.tone());
  }
  void deselect() override { selected.reset(); }
  void pick(const PixelPosition& pixel) override {
    const auto seen = state_.seen_at(pixel.x, pixel.y);
    selected = seen ? std::optional(seen->thing) : std::nullopt;
  }

  std::vector<Shortcut> shortcuts() override;
  bool take_hold(const PixelPosition& pixel) override;
  void drag_held(const Point& from, const Point& to, bool with_shift) override;
  void draw_controls(const Area& area) override;
  void draw_over_picture() override;

  const SceneThing& thing() const { return state_.scene().things[*selected]; }
  void change_handling(const std::function<void(Handling&)>& change);
  void nudge(const Eigen::Vector3f& direction);
  void turn(double degrees);
  void brighten(double stops);
  Eigen::Vector2f image_point(const Point& window) const;
  void motion_section();
  void things_section();

  SceneState state_;
  std::size_t held_thing_ = 0;
  Eigen::Vector3f held_ = Eigen::Vector3f::Zero();  // the point by which it is held
};

/// Changes the selected thing, where there is one.
void SceneViewer::change_handling(const std::function<void(Handling&)>& change) {
  if (!selected) return;
  Handling handling = state_.handling(*selected);
  change(handling);
  state_.handle(*selected, handling);
}

void SceneViewer::nudge(const Eigen::Vector3f& direction) {
  if (!selected) return;
  const Eigen::Vector3f middle = state_.middle(*selected);
  const float distance = (middle - state_.view().camera().position).norm();
  state_.put(*selected, middle + static_cast<float>(nudge_share) * distance * direction);
}

void SceneViewer::turn(double degrees) {
  if (selected && thing().can_turn)
    change_handling([=](Handling& handling) { handling.turn_degrees += degrees; });
}

void SceneViewer::brighten(double stops) {
  if (selected && thing().is_area_light)
    change_handling([=](Handling& handling) { handling.gain *= std::exp2(stops); });
}

std::vector<Shortcut> SceneViewer::shortcuts() {
  using V = Eigen::Vector3f;
  const std::string things = "Objects and area lights", motion = "Motion and light", picture = "Image";
  return {
      {things, "Tab", GLFW_KEY_TAB, false, "select the next",
       [this] { selected = selected ? (*selected + 1) % state_.scene().things.size() : 0; }},
      {things, "Left", GLFW_KEY_LEFT, false, "move it along −X", [this] { nudge(-V::UnitX()); }},
      {things, "Right", GLFW_KEY_RIGHT, false, "along +X", [this] { nudge(V::UnitX()); }},
      {things, "Up", GLFW_KEY_UP, false, "along +Z", [this] { nudge(V::UnitZ()); }},
      {things, "Down", GLFW_KEY_DOWN, false, "along −Z", [this] { nudge(-V::UnitZ()); }},
      {things, "PageUp", GLFW_KEY_PAGE_UP, false, "up", [this] { nudge(V::UnitY()); }},
      {things, "PageDown", GLFW_KEY_PAGE_DOWN, false, "down", [this] { nudge(-V::UnitY()); }},
      {things, ".", GLFW_KEY_PERIOD, false, "turn by 5°", [this] { turn(turn_step); }},
      {things, ",", GLFW_KEY_COMMA, false, "turn back", [this] { turn(-turn_step); }},
      {things, "]", GLFW_KEY_RIGHT_BRACKET, false, "area light brighter by ⅓ stop",
       [this] { brighten(third_stop); }},
      {things, "[", GLFW_KEY_LEFT_BRACKET, false, "dimmer", [this] { brighten(-third_stop); }},
      {things, "Delete", GLFW_KEY_DELETE, false, "reset object",
       [this] { change_handling([](Handling& handling) { handling = {}; }); }},
      {motion, "Space", GLFW_KEY_SPACE, false, "start or stop the scene motion",
       [this] { is_playing = !is_playing; }},
      {motion, "R", GLFW_KEY_R, false, "reset all objects and the time", [this] { state_.start_over(); }},
      {motion, "B", GLFW_KEY_B, false, "one bounce more",
       [this] { state_.set_bounces(state_.bounces() + 1); }},
      {motion, "Shift+B", GLFW_KEY_B, true, "one less", [this] { state_.set_bounces(state_.bounces() - 1); }},
      {picture, "A", GLFW_KEY_A, false, "auto-expose", [this] { expose(); }},
  };
}

Eigen::Vector2f SceneViewer::image_point(const Point& window) const {
  const Point p = canvas.image_from_window(window);
  return {static_cast<float>(p.x), static_cast<float>(p.y)};
}

/// What moves by itself or shines can be taken at once, walls and floors only once they are selected: else
/// there would be nowhere to take the camera by.
bool SceneViewer::take_hold(const PixelPosition& pixel) {
  const auto seen = state_.seen_at(pixel.x, pixel.y);
  if (!seen) return false;
  const SceneThing& thing = state_.scene().things[seen->thing];
  if (!thing.moves && !thing.is_area_light && selected != seen->thing) return false;
  selected = held_thing_ = seen->thing;
  held_ = seen->point;
  return true;
}

void SceneViewer::drag_held(const Point& from, const Point& to, bool with_shift) {
  const Eigen::Vector3f shift =
      dragged_shift(state_.view().camera(), held_, image_point(from), image_point(to),
                    with_shift ? DragPlane::upright : DragPlane::level);
  held_ += shift;
  state_.put(held_thing_, state_.middle(held_thing_) + shift);
}

/// A ring where the middle of the selected thing is seen, and its name.
void SceneViewer::draw_over_picture() {
  if (!selected) return;
  const auto place = state_.view().camera().image_point(state_.middle(*selected));
  if (!place) return;
  const Point p = canvas.window_from_image({place->x(), place->y()});
  if (!canvas.area().holds(p.x, p.y)) return;
  draw_ring(p, 9.0);
  draw_plate({p.x + 14.0, p.y - 12.0}, thing().name.c_str(), accent_colour);
}

void SceneViewer::motion_section() {
  heading("MOTION");
  if (state_.scene().duration > 0.0) {
    if (button("Play", is_playing)) is_playing = !is_playing;
    ImGui::SameLine();
  }
  if (button("Start over")) state_.start_over();
  if (state_.scene().duration > 0.0) {
    label("Time");
    auto time = static_cast<float>(state_.time());
    if (ImGui::SliderFloat("##time", &time, 0.0f, static_cast<float>(state_.scene().duration), "%.2f s"))
      state_.set_time(time);
  }
  label("Bounces");
  int bounces = state_.bounces();
  if (ImGui::SliderInt("##bounces", &bounces, 0, SceneState::max_bounces)) state_.set_bounces(bounces);
}

void SceneViewer::things_section() {
  heading("OBJECTS AND AREA LIGHTS");
  const float right = ImGui::GetWindowPos().x + ImGui::GetWindowContentRegionMax().x;
  const auto& things = state_.scene().things;
  for (std::size_t thing = 0; thing < things.size(); ++thing) {
    const float width = ImGui::CalcTextSize(things[thing].name.c_str()).x +
                        2.0f * ImGui::GetStyle().FramePadding.x + ImGui::GetStyle().ItemSpacing.x;
    if (thing > 0 && ImGui::GetItemRectMax().x + width < right) ImGui::SameLine();
    if (button(things[thing].name.c_str(), selected == thing)) selected = thing;
  }
  if (!selected) return;
  ImGui::Dummy(ImVec2(0.0f, 2.0f));
  label("Position");
  Eigen::Vector3f middle = state_.middle(*selected);
  if (ImGui::DragFloat3("##position", middle.data(), 0.01f, 0.0f, 0.0f, "%.2f"))
    state_.put(*selected, middle);
  if (thing().can_turn) {
    label("Turn");
    auto degrees = static_cast<float>(state_.handling(*selected).turn_degrees);
    if (ImGui::SliderFloat("##turn", &degrees, -180.0f, 180.0f, "%.0f°"))
      change_handling([=](Handling& handling) { handling.turn_degrees = degrees; });
  }
  if (thing().is_area_light) {
    double gain = state_.handling(*selected).gain;
    if (stops_slider("Brighter", "##gain", gain, -8.0f, 8.0f))
      change_handling([=](Handling& handling) { handling.gain = gain; });
  }
  if (button("Reset object")) change_handling([](Handling& handling) { handling = {}; });
}

void SceneViewer::draw_controls(const Area& area) {
  begin_panel("##controls", area, true);
  window_buttons();
  heading("PICTURE");
  tone_section();
  motion_section();
  things_section();
  end_panel();
}

}  // namespace

void run_scene_viewer(const std::string& name, const std::function<MovingScene()>& read,
                      const WindowOptions& options, const RunContext& run) {
  open_window(
      name, "Precomputing the light transport of", [&] { return std::make_unique<SceneViewer>(read(), run); },
      options, run);
}

}  // namespace refield
