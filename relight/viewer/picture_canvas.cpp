// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/picture_canvas.h"

#include <imgui.h>

#include <algorithm>

#include "relight/viewer/drawing.h"

namespace refield {

void fill_area(const Area& area, Canvas& canvas, FreeView& view) {
  canvas.fit();
  const int width = std::max(1, static_cast<int>(area.width)),
            height = std::max(1, static_cast<int>(area.height));
  if (view.camera().width != width || view.camera().height != height) view.move().set_size(width, height);
}

void begin_picture_panel(const Area& area, Canvas& canvas, const Image& picture) {
  canvas.lay_out(area, picture.width, picture.height);
  begin_panel("##picture", area, false);
  ImGui::InvisibleButton("##canvas", ImGui::GetContentRegionAvail(),
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight |
                             ImGuiButtonFlags_MouseButtonMiddle);
}

void draw_picture(const Canvas& canvas, const Image& picture, const Texture& texture) {
  const Area& area = canvas.area();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(vector(area.x, area.y), vector(area.x + area.width, area.y + area.height), canvas_colour,
                     6.0f);
  list.AddImage(texture.handle(), vector(canvas.window_from_image({0.0, 0.0})),
                vector(canvas.window_from_image(
                    {static_cast<double>(picture.width), static_cast<double>(picture.height)})));
}

}  // namespace refield
