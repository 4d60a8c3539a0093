// SPDX-License-Identifier: Apache-2.0
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/errors.h"
#include "core/tone_map.h"
#include "relight/viewer/drawing.h"
#include "relight/viewer/panels.h"
#include "relight/viewer/widgets.h"

namespace refield {

namespace {

void light_section(App& app) {
  LightPainter& painter = app.state->painter();
  heading("LIGHT");
  if (button(app, "Add bar")) add_lamp_and_select(app, Lamp::Shape::bar);
  ImGui::SameLine();
  if (button(app, "Add spot")) add_lamp_and_select(app, Lamp::Shape::spot);
  ImGui::SameLine();
  if (button(app, "Probe", app.probes)) {
    app.probes = !app.probes;
    if (!app.probes) app.state->probe(std::nullopt);
  }
  ImGui::SameLine();
  if (button(app, "Move", app.is_playing)) app.is_playing = !app.is_playing;
  label("Ambient");
  auto ambient = static_cast<float>(painter.ambient());
  if (ImGui::SliderFloat("##ambient", &ambient, 0.0f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    painter.set_ambient(ambient);
  if (painter.has_map()) {
    double gain = painter.map_gain();
    if (stops_slider("Map", "##gain", gain, -8.0f, 8.0f)) painter.set_map_gain(gain);
    const bool slides =
        painter.domain().parameterisation == Parameterisation::monitor && !painter.has_surroundings();
    label(slides ? "Slide" : "Turn");
    auto degrees = static_cast<float>(360.0 * painter.turns());
    if (ImGui::SliderFloat("##turn", &degrees, 0.0f, 360.0f, "%.0f°"))
      turn_light(app, degrees - 360.0 * painter.turns());
    if (painter.has_surroundings())
      ImGui::TextDisabled("%s, %.1f %% of its light", app.light_name.c_str(), 100.0 * painter.share().energy);
    else
      ImGui::TextDisabled("%s", app.light_name.c_str());
    ImGui::SameLine();
    if (button(app, "Remove map")) {
      painter.set_map(std::nullopt);
      app.light_name.clear();
    }
  } else {
    ImGui::TextDisabled("Drop a light map onto the window.");
  }
  double shown = app.state->light_exposure();
  if (stops_slider("Shown at", "##light exposure", shown, -16.0f, 16.0f))
    app.state->set_light_exposure(shown);
}

void lamp_section(App& app) {
  if (!app.selected || *app.selected >= app.state->painter().lamps().size()) return;
  const Lamp lamp = app.state->painter().lamps()[*app.selected];
  heading(lamp.shape == Lamp::Shape::bar ? "BAR" : "SPOT");
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(lamp.colour[c]);
  label("Colour");
  if (ImGui::ColorEdit3("##colour", encoded.data(), ImGuiColorEditFlags_DisplayRGB))
    change_selected(app, [&](Lamp& changed) {
      for (int c = 0; c < 3; ++c) changed.colour[c] = linear_from_srgb(encoded[c]);
    });
  double radiance = lamp.radiance;
  if (stops_slider("Radiance", "##radiance", radiance, -6.0f, 10.0f))
    change_selected(app, [=](Lamp& changed) { changed.radiance = radiance; });
  label(lamp.shape == Lamp::Shape::bar ? "Width" : "Radius");
  auto size = static_cast<float>(lamp.size);
  if (ImGui::SliderFloat("##size", &size, 0.002f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    change_selected(app, [=](Lamp& changed) { changed.size = size; });
  if (button(app, lamp.is_on ? "Switch off" : "Switch on"))
    change_selected(app, [](Lamp& changed) { changed.is_on = !changed.is_on; });
  ImGui::SameLine();
  if (button(app, "Remove")) remove_selected(app);
}

void picture_section(App& app) {
  ViewState& state = *app.state;
  heading("PICTURE");
  const auto view_button = [&](const char* name, Shown shown) {
    if (state.has(shown) && button(app, name, state.shown() == shown)) state.show(shown);
    if (state.has(shown)) ImGui::SameLine();
  };
  view_button("Scene", Shown::picture);
  view_button("Stops", Shown::false_colour);
  view_button("Error", Shown::predicted_error);
  view_button("Noise", Shown::photograph_noise);
  view_button("Training", Shown::training_error);
  ImGui::NewLine();
  ToneMapping tone = state.tone();
  if (tone_controls(app, tone)) state.set_tone(tone);
  if (button(app, "Expose anew")) state.expose_picture();
  ImGui::SameLine();
  if (FreeView* view = state.view()) {
    if (button(app, "Camera back")) view->move().reset();
  } else {
    if (button(app, "Fit")) app.picture.fit();
    ImGui::SameLine();
    if (button(app, "1:1")) app.picture.zoom_to(1.0);
    ImGui::SameLine();
    if (button(app, "Smooth", app.is_smooth)) app.is_smooth = !app.is_smooth;
  }
  window_buttons(app);
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

void kernel_section(App& app) {
  ViewState& state = *app.state;
  if (!state.picked()) return;
  heading(state.view() != nullptr ? "VERTEX" : "PIXEL");
  const PixelPosition pixel = *state.picked();
  const Image& image = state.radiance();
  ImGui::Text("%d, %d   radiance %.4g  %.4g  %.4g", pixel.x, pixel.y, image.at(pixel.x, pixel.y, 0),
              image.at(pixel.x, pixel.y, 1), image.at(pixel.x, pixel.y, 2));
  if (state.has(Shown::predicted_error)) {
    ImGui::SameLine();
    const std::size_t index = static_cast<std::size_t>(pixel.y) * state.field().width + pixel.x;
    ImGui::TextDisabled("± %.2g %%", 100.0 * state.field().predicted_error[index]);
  }
  if (button(app, "Over the map", app.shows_kernels)) app.shows_kernels = !app.shows_kernels;
  ImGui::SameLine();
  if (button(app, "Let go")) state.pick(std::nullopt);
  ImGui::SameLine();
  ImGui::TextDisabled("%zu kernels", state.kernels().size());
  const auto shown_rows = static_cast<float>(std::min<std::size_t>(state.kernels().size(), 6) + 1);
  constexpr ImGuiTableFlags flags =
      ImGuiTableFlags_RowBg | ImGuiTableFlags_ScrollY | ImGuiTableFlags_SizingFixedFit;
  if (!ImGui::BeginTable("##kernels", 5, flags,
                         ImVec2(0.0f, shown_rows * ImGui::GetTextLineHeightWithSpacing())))
    return;
  ImGui::TableSetupScrollFreeze(0, 1);
  ImGui::TableSetupColumn("share");
  ImGui::TableSetupColumn("texels (x, y + size)", ImGuiTableColumnFlags_WidthStretch);
  const int exponent = common_exponent(state.kernels());
  for (const char* channel : {"R", "G", "B"}) ImGui::TableSetupColumn(scaled_name(channel, exponent).c_str());
  ImGui::TableHeadersRow();
  for (const PixelKernel& kernel : state.kernels()) kernel_row(kernel, exponent);
  ImGui::EndTable();
}

}  // namespace

void draw_control_panel(App& app, const Area& area) {
  begin_panel("##controls", area, true);
  app.controls.clear();
  kernel_section(app);
  light_section(app);
  lamp_section(app);
  picture_section(app);
  end_panel();
}

}  // namespace refield
