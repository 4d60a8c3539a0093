// SPDX-License-Identifier: Apache-2.0

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/base/errors.h"
#include "core/base/number_text.h"
#include "core/image/tone_map.h"
#include "relight/viewer/field/app.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace {

constexpr double gap = 8.0, status_height = 30.0;

constexpr const char* mouse_help =
    "Image: click a pixel to see its kernels over the light map; the mouse wheel zooms, the right button "
    "pans. Mesh fields: drag to rotate, wheel to zoom, right button or Shift and drag to pan.\n"
    "Light map: drag area lights, the wheel changes their size; drag elsewhere to rotate the map; hold the "
    "right button to see the contribution of a region, the wheel changes its size.\n"
    "Open light maps and fields with the button, or drop them onto the window.";

/// A warning where more than 1 % of the light comes from where no training light came from.
std::string share_text(const LightShares& shares) {
  const auto part = [](double share, const char* what) {
    return share > 0.01 ? "   " + std::to_string(std::lround(100.0 * share)) + " % of the light is " + what
                        : "";
  };
  return part(shares.interpolated, "interpolated") + part(shares.unobserved, "unobserved");
}

std::string name_text(const App& app) {
  const FieldOutline& field = app.state->field();
  return app.field_file.filename().string() + "   " +
         (field.mesh
              ? std::to_string(field.mesh->positions.size()) + " vertices"
              : std::to_string(app.state->image_width()) + "×" + std::to_string(app.state->image_height())) +
         share_text(app.state->light_shares());
}

void light_section(App& app) {
  LightSetup& setup = app.state->setup();
  heading("LIGHT");
  if (button("Add bar")) add_light_source_and_select(app, PaintedLight::Shape::bar);
  ImGui::SameLine();
  if (button("Add spot")) add_light_source_and_select(app, PaintedLight::Shape::spot);
  ImGui::SameLine();
  if (button("Probe", app.probes)) {
    app.probes = !app.probes;
    if (!app.probes) app.state->probe(std::nullopt);
  }
  ImGui::SameLine();
  if (button("Move", app.is_playing)) app.is_playing = !app.is_playing;
  label("Ambient");
  auto ambient = static_cast<float>(setup.ambient());
  if (ImGui::SliderFloat("##ambient", &ambient, 0.0f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    setup.set_ambient(ambient);
  if (setup.has_map()) {
    double gain = setup.map_gain();
    if (stops_slider("Map", "##gain", gain, -8.0f, 8.0f)) setup.set_map_gain(gain);
    const bool slides =
        setup.domain().parameterisation == Parameterisation::monitor && !setup.has_environment();
    label(slides ? "Slide" : "Turn");
    auto degrees = static_cast<float>(360.0 * setup.turns());
    if (ImGui::SliderFloat("##turn", &degrees, 0.0f, 360.0f, "%.0f°"))
      turn_light(app, degrees - 360.0 * setup.turns());
    if (setup.has_environment() && setup.domain().parameterisation == Parameterisation::monitor)
      ImGui::TextDisabled("%s, %.1f %% of its light", app.light_name.c_str(),
                          100.0 * app.state->share().energy);
    else
      ImGui::TextDisabled("%s", app.light_name.c_str());
    ImGui::SameLine();
    if (button("Remove map")) {
      setup.set_map(std::nullopt);
      app.light_name.clear();
    }
  } else {
    ImGui::TextDisabled("Open a light map, or drop one onto the window.");
  }
  double shown = app.state->light_exposure();
  if (stops_slider("Shown at", "##light exposure", shown, -16.0f, 16.0f))
    app.state->set_light_exposure(shown);
}

void light_source_section(App& app) {
  if (!app.selected || *app.selected >= app.state->setup().light_sources().size()) return;
  const PaintedLight light_source = app.state->setup().light_sources()[*app.selected];
  heading(light_source.shape == PaintedLight::Shape::bar ? "BAR" : "SPOT");
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(light_source.colour[c]);
  label("Colour");
  if (ImGui::ColorEdit3("##colour", encoded.data(), ImGuiColorEditFlags_DisplayRGB))
    change_selected(app, [&](PaintedLight& changed) {
      for (int c = 0; c < 3; ++c) changed.colour[c] = linear_from_srgb(encoded[c]);
    });
  double radiance = light_source.radiance;
  if (stops_slider("Radiance", "##radiance", radiance, -6.0f, 10.0f))
    change_selected(app, [=](PaintedLight& changed) { changed.radiance = radiance; });
  label(light_source.shape == PaintedLight::Shape::bar ? "Width" : "Radius");
  auto size = static_cast<float>(light_source.size);
  if (ImGui::SliderFloat("##size", &size, 0.002f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    change_selected(app, [=](PaintedLight& changed) { changed.size = size; });
  if (button(light_source.is_on ? "Switch off" : "Switch on"))
    change_selected(app, [](PaintedLight& changed) { changed.is_on = !changed.is_on; });
  ImGui::SameLine();
  if (button("Remove")) remove_selected(app);
}

void picture_section(App& app) {
  ViewState& state = *app.state;
  heading("PICTURE");
  const auto view_button = [&](const char* name, Shown shown) {
    if (state.has(shown) && button(name, state.shown() == shown)) state.show(shown);
    if (state.has(shown)) ImGui::SameLine();
  };
  view_button("Scene", Shown::picture);
  view_button("Stops", Shown::false_colour);
  view_button("Error", Shown::predicted_error);
  view_button("Noise", Shown::photograph_noise);
  view_button("Training", Shown::training_error);
  ImGui::NewLine();
  ToneMapping tone = state.tone();
  if (tone_controls(tone)) state.set_tone(tone);
  if (button("Auto-expose")) state.expose_picture();
  ImGui::SameLine();
  if (FreeView* view = state.view()) {
    if (button("Reset camera")) view->move().reset();
  } else {
    if (button("Fit")) app.picture.fit();
    ImGui::SameLine();
    if (button("1:1")) app.picture.zoom_to(1.0);
    ImGui::SameLine();
    if (button("Smooth", app.is_smooth)) app.is_smooth = !app.is_smooth;
  }
}

/// The power of ten that the largest weight is written with.
int common_exponent(const std::vector<PixelKernel>& kernels) {
  float highest = 0.0f;
  for (const PixelKernel& kernel : kernels) highest = std::max(highest, std::ranges::max(kernel.weight));
  return highest > 0.0f ? static_cast<int>(std::floor(std::log10(highest))) : 0;
}

/// "R ·10⁻⁶"
std::string scaled_name(const char* name, int exponent) {
  if (exponent == 0) return name;
  constexpr std::array<const char*, 10> digits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string text = std::string(name) + " ·10" + (exponent < 0 ? "⁻" : "");
  for (const char digit : std::to_string(std::abs(exponent))) text += digits[digit - '0'];
  return text;
}

void kernel_row(const PixelKernel& kernel, int exponent) {
  ImGui::TableNextRow();
  ImGui::TableNextColumn();
  ImGui::Text("%5.1f %%", 100.0 * kernel.energy_share);
  ImGui::TableNextColumn();
  const Box& box = kernel.support;
  ImGui::Text("%s %d, %d + %d×%d", kernel.hat ? "hat" : "box", box.x0, box.y0, box.width(), box.height());
  for (const float weight : kernel.weight) {
    ImGui::TableNextColumn();
    ImGui::Text("%.2f", weight / std::pow(10.0, exponent));
  }
}

constexpr std::size_t shown_kernels = 6;

double kernel_section_height(const App& app) {
  const auto rows = static_cast<double>(std::min(app.state->kernels().size(), shown_kernels) + 1);
  return rows * ImGui::GetTextLineHeightWithSpacing() + 2.0 * ImGui::GetTextLineHeightWithSpacing() +
         ImGui::GetFrameHeightWithSpacing() + 2.0 * ImGui::GetStyle().WindowPadding.y + 26.0;
}

/// Where the last light map came from, else the field.
std::filesystem::path folder_of_dialog(const App& app) {
  return std::filesystem::absolute(app.light_file.empty() ? app.field_file : app.light_file).parent_path();
}

void kernel_section(App& app) {
  ViewState& state = *app.state;
  if (!state.picked()) return;  // deselected in this frame
  heading(state.view() != nullptr ? "VERTEX" : "PIXEL");
  const PixelPosition pixel = *state.picked();
  const PixelGrid grid = state.grid();
  const Image& image = state.radiance();
  ImGui::Text("%d, %d", pixel.x, pixel.y);
  const auto at = grid.position_of(pixel);
  // Of a large field, the pixel may be none of those shown now.
  const bool is_shown = at && grid.x_of(at->x) == pixel.x && grid.y_of(at->y) == pixel.y;
  if (is_shown) {
    ImGui::SameLine();
    ImGui::Text("  radiance %.4g  %.4g  %.4g", image.at(at->x, at->y, 0), image.at(at->x, at->y, 1),
                image.at(at->x, at->y, 2));
  }
  if (is_shown && state.has(Shown::predicted_error)) {
    ImGui::SameLine();
    const std::size_t index = static_cast<std::size_t>(at->y) * state.field().width + at->x;
    ImGui::TextDisabled("± %.2g %%", 100.0 * state.field().quality.predicted_error[index]);
  }
  if (button("Over the map", app.shows_kernels)) app.shows_kernels = !app.shows_kernels;
  ImGui::SameLine();
  if (button("Deselect")) state.pick(std::nullopt);
  ImGui::SameLine();
  ImGui::TextDisabled("%zu kernels", state.kernels().size());
  constexpr ImGuiTableFlags flags =
      ImGuiTableFlags_RowBg | ImGuiTableFlags_ScrollY | ImGuiTableFlags_SizingFixedFit;
  if (!ImGui::BeginTable("##kernels", 5, flags, ImVec2(0.0f, ImGui::GetContentRegionAvail().y))) return;
  ImGui::TableSetupScrollFreeze(0, 1);
  ImGui::TableSetupColumn("share");
  ImGui::TableSetupColumn("texels (x, y + size)", ImGuiTableColumnFlags_WidthStretch);
  const int exponent = common_exponent(state.kernels());
  for (const char* channel : {"R", "G", "B"}) ImGui::TableSetupColumn(scaled_name(channel, exponent).c_str());
  ImGui::TableHeadersRow();
  for (const PixelKernel& kernel : state.kernels()) kernel_row(kernel, exponent);
  ImGui::EndTable();
}

/// Light sources, light and picture in numbers, and the picked pixel's kernels.
void draw_control_panel(App& app, const Area& area) {
  // The kernels have a panel of their own below the others, which stay where they are.
  const double kernels = app.state->picked() ? std::min(kernel_section_height(app), 0.5 * area.height) : 0.0;
  Area rest = area;
  if (kernels > 0.0) rest.height -= kernels + gap;
  begin_panel("##controls", rest, true);
  if (button("Open")) app.dialog.emplace(FileDialog::Purpose::open, folder_of_dialog(app));
  ImGui::SameLine();
  window_buttons(app, "relit");
  picture_section(app);
  light_section(app);
  light_source_section(app);
  end_panel();
  if (kernels <= 0.0) return;
  begin_panel("##kernels", {area.x, area.y + rest.height + gap, area.width, kernels}, true);
  kernel_section(app);
  end_panel();
}

/// A point of the map in fractions of its width and height.
Point fraction_at(const App& app, const ImVec2& window) {
  const Point texel = app.light.image_from_window({window.x, window.y});
  const LightDomain& domain = app.state->panorama().shown();
  return {texel.x / domain.width, texel.y / domain.height};
}

Point window_at(const App& app, double x, double y) {
  const LightDomain& domain = app.state->panorama().shown();
  return app.light.window_from_image({x * domain.width, y * domain.height});
}

/// The left button takes the light source under it, or the map itself.
void handle_drag(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemActivated()) {
    const Point at = fraction_at(app, io.MousePos);
    app.selected = app.state->setup().light_source_at(at.x, at.y);
    return;
  }
  if (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f) return;
  const LightDomain& domain = app.state->panorama().shown();
  const double dx = io.MouseDelta.x / (app.light.scale() * domain.width);
  const double dy = io.MouseDelta.y / (app.light.scale() * domain.height);
  if (app.selected)
    change_selected(app, [=](PaintedLight& light_source) {
      light_source.x += dx;
      light_source.y += dy;
    });
  else if (app.state->setup().can_turn())
    turn_light(app, 360.0 * dx);
}

void handle_wheel(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  if (io.MouseWheel == 0.0f) return;
  if (app.probes || app.state->probed()) {
    const double wanted = app.probe_texels * std::pow(1.3, io.MouseWheel);
    const int texels = io.MouseWheel > 0.0f ? static_cast<int>(std::ceil(wanted)) : static_cast<int>(wanted);
    app.probe_texels = std::clamp(texels, 1, 256);
    return;
  }
  const Point at = fraction_at(app, io.MousePos);
  if (const auto light_source = app.state->setup().light_source_at(at.x, at.y)) app.selected = light_source;
  change_selected(app,
                  [&](PaintedLight& light_source) { light_source.size *= std::pow(1.1, io.MouseWheel); });
}

void handle_mouse(App& app) {
  const ImGuiIO& io = ImGui::GetIO();
  const bool is_probing =
      ImGui::IsItemActive() && (ImGui::IsMouseDown(ImGuiMouseButton_Right) ||
                                (app.probes && ImGui::IsMouseDown(ImGuiMouseButton_Left)));
  if (is_probing)
    probe_at(app,
             app.state->panorama().texel_at(app.light.image_from_window({io.MousePos.x, io.MousePos.y})));
  else if (app.state->probed() && !app.probes)
    app.state->probe(std::nullopt);
  if (!is_probing && ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left)) handle_drag(app);
  if (!ImGui::IsItemHovered()) return;
  handle_wheel(app);
  const Point at = fraction_at(app, io.MousePos);
  if (!app.probes && app.state->setup().light_source_at(at.x, at.y))
    ImGui::SetMouseCursor(ImGuiMouseCursor_Hand);
}

ImU32 colour_of(const PaintedLight& light_source) {
  const float brightest =
      std::max({light_source.colour[0], light_source.colour[1], light_source.colour[2], 1e-6f});
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(light_source.colour[c] / brightest);
  return ImGui::ColorConvertFloat4ToU32(ImVec4(encoded[0], encoded[1], encoded[2], 1.0f));
}

/// Its outline, and a handle of its colour in the middle.
void draw_light_source(const App& app, const PaintedLight& light_source, bool is_selected) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const LightDomain& domain = app.state->panorama().shown();
  const ImU32 line = is_selected ? accent_colour : 0x90ffffff;
  const float thickness = is_selected ? 2.0f : 1.0f;
  constexpr int smooth = 48;
  Point middle = window_at(app, light_source.x, light_source.y);
  if (light_source.shape == PaintedLight::Shape::bar) {
    middle.y = window_at(app, 0.0, 0.5).y;
    for (const double side : {-0.5, 0.5}) {
      const double x = light_source.x + side * light_source.size;
      list.AddLine(vector(window_at(app, x, 0.0)), vector(window_at(app, x, 1.0)), shadow_colour,
                   thickness + 2.0f);
      list.AddLine(vector(window_at(app, x, 0.0)), vector(window_at(app, x, 1.0)), line, thickness);
    }
  } else {
    const auto radius =
        static_cast<float>(std::max(light_source.size * domain.height * app.light.scale(), 3.0));
    list.AddCircle(vector(middle), radius, shadow_colour, smooth, thickness + 2.0f);
    list.AddCircle(vector(middle), radius, line, smooth, thickness);
  }
  list.AddCircleFilled(vector(middle), is_selected ? 6.0f : 5.0f, 0xff101010);
  list.AddCircleFilled(vector(middle), is_selected ? 4.5f : 3.5f,
                       light_source.is_on ? colour_of(light_source) : 0xff505050);
}

/// The picked pixel's kernels: their density over the map, rectangles framed the stronger the more energy
/// they hold.
void draw_kernels(const App& app, const Textures& textures, const ImVec2& corner, const ImVec2& far_corner) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddImage(textures.kernels.handle(), corner, far_corner, ImVec2(0, 0), ImVec2(1, 1), 0xe8ffffff);
  for (const PixelKernel& kernel : app.state->kernels()) {
    // On a panorama a cube's squares have no straight edges.
    if (kernel.hat || kernel.energy_share <= 0.0 || app.state->panorama().is_cube()) continue;
    const Box& box = kernel.support;
    const auto alpha = static_cast<ImU32>(40.0 + 215.0 * std::sqrt(kernel.energy_share));
    list.AddRect(
        vector(app.light.window_from_image({static_cast<double>(box.x0), static_cast<double>(box.y0)})),
        vector(app.light.window_from_image({static_cast<double>(box.x1), static_cast<double>(box.y1)})),
        alpha << 24 | 0x00ffffff);
  }
  const std::string text =
      (app.state->view() != nullptr ? "Kernels of the vertex at " : "Kernels of pixel ") +
      formatted("%d, %d", app.state->picked()->x, app.state->picked()->y);
  draw_plate({app.light.area().x + 8.0, app.light.area().y + 8.0}, text.c_str(), accent_colour);
}

void draw_probe(const App& app) {
  const auto& box = app.state->probed();
  if (!box || app.state->panorama().is_cube()) return;  // there it is under the pointer
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 a =
      vector(app.light.window_from_image({static_cast<double>(box->x0), static_cast<double>(box->y0)}));
  const ImVec2 b =
      vector(app.light.window_from_image({static_cast<double>(box->x1), static_cast<double>(box->y1)}));
  constexpr float margin = 4.0f;
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), shadow_colour, 0.0f, 0,
               4.0f);
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), accent_colour, 0.0f, 0,
               2.0f);
}

/// The light map: move light sources, turn the map, probe.
void draw_light_panel(App& app, const Textures& textures, const Area& area) {
  const LightDomain& domain = app.state->panorama().shown();
  app.light.fit();
  app.light.lay_out(area, domain.width, domain.height);
  begin_panel("##light", area, false);
  ImGui::InvisibleButton("##canvas", ImGui::GetContentRegionAvail(),
                         ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight);
  handle_mouse(app);
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(vector({area.x, area.y}), vector({area.x + area.width, area.y + area.height}),
                     canvas_colour, 6.0f);
  const ImVec2 corner = vector(app.light.window_from_image({0.0, 0.0}));
  const ImVec2 far_corner = vector(window_at(app, 1.0, 1.0));
  list.AddImage(textures.light.handle(), corner, far_corner);
  list.PushClipRect(corner, far_corner, true);
  const bool shows_kernels = app.shows_kernels && app.state->picked();
  if (shows_kernels) draw_kernels(app, textures, corner, far_corner);
  const auto& light_sources = app.state->setup().light_sources();
  for (std::size_t i = 0; i < light_sources.size(); ++i)
    if (!shows_kernels || app.selected == i) draw_light_source(app, light_sources[i], app.selected == i);
  draw_probe(app);
  list.PopClipRect();
  end_panel();
}

PixelPosition pixel_at(const Canvas& canvas, const ImVec2& window) {
  const Point p = canvas.image_from_window({window.x, window.y});
  return {static_cast<int>(std::floor(p.x)), static_cast<int>(std::floor(p.y))};
}

/// Of a scene over a mesh: the left button turns it, and picks where it was not moved.
void handle_camera(App& app, FreeView& view) {
  constexpr float slack_px = 3.0f;
  constexpr double degrees_a_pixel = 0.35;
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f) view.move().approach(std::pow(1.15, io.MouseWheel));
  const bool is_left = ImGui::IsMouseDown(ImGuiMouseButton_Left);
  const bool was_dragged = ImGui::IsMouseDragging(ImGuiMouseButton_Left, slack_px);
  if (ImGui::IsItemDeactivated() && ImGui::IsMouseReleased(ImGuiMouseButton_Left) && !app.is_dragging)
    app.state->pick(pixel_at(app.picture, io.MousePos));
  app.is_dragging = ImGui::IsItemActive() && (app.is_dragging || was_dragged);
  if (!ImGui::IsItemActive() || (is_left && !app.is_dragging)) return;
  if (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f) return;
  if (is_left && !io.KeyShift)
    view.move().orbit(-degrees_a_pixel * io.MouseDelta.x, degrees_a_pixel * io.MouseDelta.y);
  else
    view.move().pan(io.MouseDelta.x, io.MouseDelta.y);
}

void handle_picture_mouse(App& app) {
  if (FreeView* view = app.state->view()) return handle_camera(app, *view);
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemHovered() && io.MouseWheel != 0.0f)
    app.picture.zoom_about({io.MousePos.x, io.MousePos.y}, std::pow(1.2, io.MouseWheel));
  if (!ImGui::IsItemActive()) return;
  if (ImGui::IsMouseDown(ImGuiMouseButton_Left))
    app.state->pick(pixel_at(app.picture, io.MousePos));
  else if (io.MouseDelta.x != 0.0f || io.MouseDelta.y != 0.0f)
    app.picture.pan(io.MouseDelta.x, io.MouseDelta.y);
}

/// A ring around the picked pixel, which itself stays free.
void draw_mark(const App& app) {
  const auto& picked = app.state->picked();
  if (!picked) return;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 middle = vector(app.picture.window_from_image({picked->x + 0.5, picked->y + 0.5}));
  const auto radius = static_cast<float>(std::max(7.0, 0.8 * app.picture.scale()));
  constexpr int smooth = 32;
  list.AddCircle(middle, radius, shadow_colour, smooth, 4.0f);
  list.AddCircle(middle, radius, accent_colour, smooth, 2.0f);
}

void draw_shown_legend(const App& app, const Area& area) {
  const ViewState& state = *app.state;
  if (state.shown() == Shown::picture) return;
  const bool in_stops = state.shown() == Shown::false_colour;
  const std::string low = in_stops ? formatted("−%.0f stops", stops_below_white) : "0 %";
  const std::string high = in_stops ? formatted("white +%.0f", stops_above_white)
                                    : formatted("%.3g %%", 100.0 * state.error_range());
  constexpr double width = 260.0, height = 48.0, margin = 12.0;
  draw_legend({area.x + margin, area.y + area.height - height - margin, width, height}, low.c_str(),
              high.c_str());
}

/// What is shown, where it is not simply the picture.
void draw_title(const App& app, const Area& area) {
  const ViewState& state = *app.state;
  const Point corner{area.x + 12.0, area.y + 12.0};
  if (state.probed()) {
    draw_plate(corner,
               formatted("Contribution of texels %d, %d + %d×%d", state.probed()->x0, state.probed()->y0,
                         state.probed()->width(), state.probed()->height())
                   .c_str(),
               accent_colour);
    return;
  }
  switch (state.shown()) {
    case Shown::picture:
      return;
    case Shown::false_colour:
      draw_plate(corner, "Luminance in stops", text_colour);
      return;
    case Shown::predicted_error:
      draw_plate(corner, "Predicted relative error on new photographs", text_colour);
      return;
    case Shown::photograph_noise:
      draw_plate(corner, "Part caused by photograph noise", text_colour);
      return;
    case Shown::training_error:
      draw_plate(corner, "Relative error on the training photographs", text_colour);
      return;
  }
}

/// The relit image: pick a pixel, zoom, pan.
void draw_picture_panel(App& app, const Textures& textures, const Area& area,
                        const std::function<void()>& refresh) {
  const ViewState& state = *app.state;
  if (FreeView* view = app.state->view()) fill_area(area, app.picture, *view);
  begin_picture_panel(area, app.picture, state.image_width(), state.image_height());
  handle_picture_mouse(app);
  refresh();
  draw_picture(app.picture, state.grid(), textures.picture);
  draw_mark(app);
  draw_shown_legend(app, area);
  draw_title(app, area);
  end_panel();
}

}  // namespace

std::optional<VisibleRegion> visible_region(const App& app) {
  const Area& area = app.picture.area();
  const Point first = app.picture.image_from_window({area.x, area.y});
  const Point last = app.picture.image_from_window({area.x + area.width, area.y + area.height});
  const int width = app.state->image_width(), height = app.state->image_height();
  const Box region{std::max(0, static_cast<int>(std::floor(first.x))),
                   std::max(0, static_cast<int>(std::floor(first.y))),
                   std::min(width, static_cast<int>(std::ceil(last.x))),
                   std::min(height, static_cast<int>(std::ceil(last.y)))};
  if (app.state->view() != nullptr || !region.inside(width, height)) return std::nullopt;
  return VisibleRegion{region, app.picture.scale()};
}

void draw_panels(App& app, const Textures& textures, const std::function<void()>& refresh) {
  const ImVec2 window = ImGui::GetIO().DisplaySize;
  const LightDomain& domain = app.state->panorama().shown();
  const double side = std::clamp(0.32 * window.x, 360.0, 560.0);
  const double inner_height = window.y - 2.0 * gap - status_height;
  const double left_width = window.x - side - 3.0 * gap, right = left_width + 2.0 * gap;
  const double light_height =
      std::min(side * domain.height / domain.width, std::max(140.0, 0.42 * inner_height));
  const Area left{gap, gap, left_width, inner_height};
  const Area picture = app.shows_help ? above_help(app, left) : left;
  draw_light_panel(app, textures, {right, gap, side, light_height});
  draw_control_panel(app, {right, gap + light_height + gap, side, inner_height - light_height - gap});
  draw_picture_panel(app, textures, picture, refresh);
  draw_status_bar(app, {0.0, window.y - status_height, window.x, status_height}, name_text(app),
                  pointer_text(app.picture, app.state->radiance(), "pixel", app.state->grid()) +
                      pointer_text(app.light, app.state->shown_light(), "texel"));
  draw_notice(app, picture);
  if (app.shows_help) draw_help(app, left, mouse_help, keys_of(shortcuts()));
  draw_file_dialog(app, left, [&](const std::filesystem::path& file) {
    app.dialog->purpose == FileDialog::Purpose::open ? open_file(app, file) : save_picture(app, file);
  });
}

}  // namespace refield
