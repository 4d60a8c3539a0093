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
  LightSetup& setup = app.state->setup();
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
    if (button(app, "Remove map")) {
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

void lamp_section(App& app) {
  if (!app.selected || *app.selected >= app.state->setup().lamps().size()) return;
  const Lamp lamp = app.state->setup().lamps()[*app.selected];
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
  if (button(app, "Auto-expose")) state.expose_picture();
  ImGui::SameLine();
  if (FreeView* view = state.view()) {
    if (button(app, "Reset camera")) view->move().reset();
  } else {
    if (button(app, "Fit")) app.picture.fit();
    ImGui::SameLine();
    if (button(app, "1:1")) app.picture.zoom_to(1.0);
    ImGui::SameLine();
    if (button(app, "Smooth", app.is_smooth)) app.is_smooth = !app.is_smooth;
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
  if (button(app, "Deselect")) state.pick(std::nullopt);
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

}  // namespace

void draw_control_panel(App& app, const Area& area) {
  app.controls.clear();
  // The kernels have a panel of their own below the others, which stay where they are.
  constexpr double gap = 8.0;
  const double kernels = app.state->picked() ? std::min(kernel_section_height(app), 0.5 * area.height) : 0.0;
  Area rest = area;
  if (kernels > 0.0) rest.height -= kernels + gap;
  begin_panel("##controls", rest, true);
  if (button(app, "Open")) app.dialog.emplace(FileDialog::Purpose::open, folder_of_dialog(app));
  ImGui::SameLine();
  window_buttons(app, "relit");
  picture_section(app);
  light_section(app);
  lamp_section(app);
  end_panel();
  if (kernels <= 0.0) return;
  begin_panel("##kernels", {area.x, area.y + rest.height + gap, area.width, kernels}, true);
  kernel_section(app);
  end_panel();
}

}  // namespace refield
