// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/panels.h"

#include <imgui.h>

#include <algorithm>

#include "core/errors.h"
#include "relight/viewer/file_dialog.h"
#include "relight/viewer/shortcuts.h"
#include "relight/viewer/window_panels.h"

namespace refield {

namespace {

constexpr double gap = 8.0, status_height = 30.0;

constexpr const char* mouse_help =
    "Image: click a pixel to see its kernels over the light map; the mouse wheel zooms, the right button "
    "pans. Mesh fields: drag to rotate, wheel to zoom, right button or Shift and drag to pan.\n"
    "Light map: drag area lights, the wheel changes their size; drag elsewhere to rotate the map; hold the "
    "right button to see the contribution of a region, the wheel changes its size.\n"
    "Open light maps and fields with the button, or drop them onto the window.";

std::string name_text(const App& app) {
  const ReflectanceField& field = app.state->field();
  return app.field_file.filename().string() + "   " +
         (field.mesh.empty() ? std::to_string(field.width) + "×" + std::to_string(field.height)
                             : std::to_string(field.mesh.positions.size()) + " vertices");
}

void take_file(App& app, const std::filesystem::path& file) {
  if (app.dialog->purpose == FileDialog::Purpose::open) return open_file(app, file);
  try {
    save_picture(app, file);
  } catch (const Error& error) {
    complain(app, error.what());
  }
}

}  // namespace

void draw_panels(App& app, const Textures& textures) {
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const LightDomain& domain = app.state->panorama().shown();
  const double side = std::clamp(0.32 * window.x, 360.0, 560.0);
  const double inner_height = window.y - 2.0 * gap - status_height;
  const double left_width = window.x - side - 3.0 * gap, right = left_width + 2.0 * gap;
  const double light_height =
      std::min(side * domain.height / domain.width, std::max(140.0, 0.42 * inner_height));
  const Area left{gap, gap, left_width, inner_height};
  const Area picture = app.shows_help ? above_help(app, left) : left;
  draw_picture_panel(app, textures, picture);
  draw_light_panel(app, textures, {right, gap, side, light_height});
  draw_control_panel(app, {right, gap + light_height + gap, side, inner_height - light_height - gap});
  draw_status_bar(app, {0.0, window.y - status_height, window.x, status_height}, name_text(app),
                  pointer_text(app.picture, app.state->radiance(), "pixel") +
                      pointer_text(app.light, app.state->shown_light(), "texel"));
  draw_notice(app, picture);
  if (app.shows_help) draw_help(app, left, mouse_help, keys_of(shortcuts()));
  draw_file_dialog(app, left, app.recent.files(),
                   [&](const std::filesystem::path& file) { take_file(app, file); });
}

}  // namespace refield
