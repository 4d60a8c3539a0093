// SPDX-License-Identifier: Apache-2.0

#include "core/base/number_text.h"
#include "core/image/tone_map.h"
#include "relight/viewer/field/field_viewer.h"
#include "relight/viewer/gui/widgets.h"

namespace refield {

namespace {

/// A warning where more than 1 % of the light comes from where no training light came from.
std::string share_text(const LightShares& shares) {
  const auto part = [](double share, const char* what) {
    return share > 0.01 ? "   " + std::to_string(std::lround(100.0 * share)) + " % of the light is " + what
                        : "";
  };
  return part(shares.interpolated, "interpolated") + part(shares.unobserved, "unobserved");
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

ImU32 colour_of(const PaintedLight& light_source) {
  const float brightest =
      std::max({light_source.colour[0], light_source.colour[1], light_source.colour[2], 1e-6f});
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(light_source.colour[c] / brightest);
  return ImGui::ColorConvertFloat4ToU32(ImVec4(encoded[0], encoded[1], encoded[2], 1.0f));
}

constexpr std::size_t shown_kernels = 6;

/// Of what is not simply the picture.
const char* title_of(Shown shown) {
  switch (shown) {
    case Shown::picture:
      return "";
    case Shown::false_colour:
      return "Luminance in stops";
    case Shown::predicted_error:
      return "Predicted relative error on new photographs";
    case Shown::photograph_noise:
      return "Part caused by photograph noise";
    case Shown::training_error:
      return "Relative error on the training photographs";
  }
  return "";
}
}  // namespace

const char* FieldViewer::mouse_help() const {
  return "Image: click a pixel to see its kernels over the light map; the mouse wheel zooms, the right "
         "button pans. Mesh fields: drag to rotate, wheel to zoom, right button or Shift and drag to pan.\n"
         "Light map: drag area lights, the wheel changes their size; drag elsewhere to rotate the map; hold "
         "the right button to see the contribution of a region, the wheel changes its size.\n"
         "Open light maps and fields with the button, or drop them onto the window.";
}

std::string FieldViewer::name() const {
  const FieldOutline& field = state_->field();
  return field_file_.filename().string() + "   " +
         (field.mesh ? std::to_string(field.mesh->positions.size()) + " vertices"
                     : std::to_string(state_->image_width()) + "×" + std::to_string(state_->image_height())) +
         share_text(state_->light_shares());
}

void FieldViewer::light_section() {
  LightSetup& setup = state_->setup();
  heading("LIGHT");
  if (button("Add bar")) add_and_select(PaintedLight::Shape::bar);
  ImGui::SameLine();
  if (button("Add spot")) add_and_select(PaintedLight::Shape::spot);
  ImGui::SameLine();
  if (button("Probe", probes_)) toggle_probing();
  ImGui::SameLine();
  if (button("Move", is_playing)) is_playing = !is_playing;
  label("Ambient");
  auto ambient = static_cast<float>(setup.ambient);
  if (ImGui::SliderFloat("##ambient", &ambient, 0.0f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    setup.ambient = ambient;
  if (setup.has_map()) {
    double gain = setup.map_gain;
    if (stops_slider("Map", "##gain", gain, -8.0f, 8.0f)) setup.map_gain = gain;
    const bool slides = setup.domain.parameterisation == Parameterisation::monitor && !setup.environment;
    label(slides ? "Slide" : "Turn");
    auto degrees = static_cast<float>(360.0 * setup.turns);
    if (ImGui::SliderFloat("##turn", &degrees, 0.0f, 360.0f, "%.0f°"))
      turn_light(degrees - 360.0 * setup.turns);
    if (setup.environment && setup.domain.parameterisation == Parameterisation::monitor)
      ImGui::TextDisabled("%s, %.1f %% of its light", light_name_.c_str(), 100.0 * state_->share().energy);
    else
      ImGui::TextDisabled("%s", light_name_.c_str());
    ImGui::SameLine();
    if (button("Remove map")) {
      setup.set_map(std::nullopt);
      light_name_.clear();
    }
  } else {
    ImGui::TextDisabled("Open a light map, or drop one onto the window.");
  }
  double shown = state_->light_exposure();
  if (stops_slider("Shown at", "##light exposure", shown, -16.0f, 16.0f)) state_->set_light_exposure(shown);
}

void FieldViewer::light_source_section() {
  if (!selected || *selected >= state_->setup().light_sources.size()) return;
  const PaintedLight light_source = state_->setup().light_sources[*selected];
  heading(light_source.shape == PaintedLight::Shape::bar ? "BAR" : "SPOT");
  std::array<float, 3> encoded;
  for (int c = 0; c < 3; ++c) encoded[c] = srgb_from_linear(light_source.colour[c]);
  label("Colour");
  if (ImGui::ColorEdit3("##colour", encoded.data(), ImGuiColorEditFlags_DisplayRGB))
    change_selected([&](PaintedLight& changed) {
      for (int c = 0; c < 3; ++c) changed.colour[c] = linear_from_srgb(encoded[c]);
    });
  double radiance = light_source.radiance;
  if (stops_slider("Radiance", "##radiance", radiance, -6.0f, 10.0f))
    change_selected([=](PaintedLight& changed) { changed.radiance = radiance; });
  label(light_source.shape == PaintedLight::Shape::bar ? "Width" : "Radius");
  auto size = static_cast<float>(light_source.size);
  if (ImGui::SliderFloat("##size", &size, 0.002f, 1.0f, "%.3f", ImGuiSliderFlags_Logarithmic))
    change_selected([=](PaintedLight& changed) { changed.size = size; });
  if (button(light_source.is_on ? "Switch off" : "Switch on"))
    change_selected([](PaintedLight& changed) { changed.is_on = !changed.is_on; });
  ImGui::SameLine();
  if (button("Remove")) remove_selected();
}

void FieldViewer::picture_section() {
  heading("PICTURE");
  const auto view_button = [&](const char* name, Shown shown) {
    if (!state_->has(shown)) return;
    if (button(name, state_->shown() == shown)) state_->show(shown);
    ImGui::SameLine();
  };
  view_button("Scene", Shown::picture);
  view_button("Stops", Shown::false_colour);
  view_button("Error", Shown::predicted_error);
  view_button("Noise", Shown::photograph_noise);
  view_button("Training", Shown::training_error);
  ImGui::NewLine();
  tone_section();
}

double FieldViewer::kernel_section_height() const {
  const auto rows = static_cast<double>(std::min(state_->kernels().size(), shown_kernels) + 1);
  return rows * ImGui::GetTextLineHeightWithSpacing() + 2.0 * ImGui::GetTextLineHeightWithSpacing() +
         ImGui::GetFrameHeightWithSpacing() + 2.0 * ImGui::GetStyle().WindowPadding.y + 26.0;
}

void FieldViewer::kernel_section() {
  ViewState& state = *state_;
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
  if (button("Over the map", shows_kernels_)) shows_kernels_ = !shows_kernels_;
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

/// The light map; light sources, light and picture in numbers; and the picked pixel's kernels.
void FieldViewer::draw_controls(const Area& area) {
  take_opened();
  const LightDomain& domain = state_->panorama().shown();
  const double light_height =
      std::min(area.width * domain.height / domain.width, std::max(140.0, 0.42 * area.height));
  draw_light_panel({area.x, area.y, area.width, light_height});
  Area rest{area.x, area.y + light_height + panel_gap, area.width, area.height - light_height - panel_gap};
  // The kernels have a panel of their own below the others, which stay where they are.
  const double kernels = state_->picked() ? std::min(kernel_section_height(), 0.5 * rest.height) : 0.0;
  if (kernels > 0.0) rest.height -= kernels + panel_gap;
  begin_panel("##controls", rest, true);
  if (button("Open"))
    dialog.emplace(FileDialog::Purpose::open,
                   fs::absolute(light_file_.empty() ? field_file_ : light_file_).parent_path());
  ImGui::SameLine();
  window_buttons();
  picture_section();
  light_section();
  light_source_section();
  end_panel();
  if (kernels <= 0.0) return;
  begin_panel("##kernels", {rest.x, rest.y + rest.height + panel_gap, rest.width, kernels}, true);
  kernel_section();
  end_panel();
}

Point FieldViewer::fraction_at(const Point& window) const {
  const Point texel = light_.image_from_window(window);
  const LightDomain& domain = state_->panorama().shown();
  return {texel.x / domain.width, texel.y / domain.height};
}

Point FieldViewer::window_at(double x, double y) const {
  const LightDomain& domain = state_->panorama().shown();
  return light_.window_from_image({x * domain.width, y * domain.height});
}

/// The left button takes the light source under it, or the map itself.
void FieldViewer::handle_light_drag() {
  const ImGuiIO& io = ImGui::GetIO();
  if (ImGui::IsItemActivated()) {
    const Point at = fraction_at({io.MousePos.x, io.MousePos.y});
    selected = state_->setup().light_source_at(at.x, at.y);
    return;
  }
  if (io.MouseDelta.x == 0.0f && io.MouseDelta.y == 0.0f) return;
  const LightDomain& domain = state_->panorama().shown();
  const double dx = io.MouseDelta.x / (light_.scale() * domain.width);
  const double dy = io.MouseDelta.y / (light_.scale() * domain.height);
  if (selected)
    change_selected([=](PaintedLight& light_source) {
      light_source.x += dx;
      light_source.y += dy;
    });
  else if (state_->setup().can_turn())
    turn_light(360.0 * dx);
}

void FieldViewer::handle_light_wheel() {
  const ImGuiIO& io = ImGui::GetIO();
  if (io.MouseWheel == 0.0f) return;
  if (probes_ || state_->probed()) {
    const double wanted = probe_texels_ * std::pow(1.3, io.MouseWheel);
    const int texels = io.MouseWheel > 0.0f ? static_cast<int>(std::ceil(wanted)) : static_cast<int>(wanted);
    probe_texels_ = std::clamp(texels, 1, 256);
    return;
  }
  const Point at = fraction_at({io.MousePos.x, io.MousePos.y});
  if (const auto light_source = state_->setup().light_source_at(at.x, at.y)) selected = light_source;
  change_selected([&](PaintedLight& light_source) { light_source.size *= std::pow(1.1, io.MouseWheel); });
}

void FieldViewer::handle_light_mouse() {
  const ImGuiIO& io = ImGui::GetIO();
  const bool is_probing = ImGui::IsItemActive() && (ImGui::IsMouseDown(ImGuiMouseButton_Right) ||
                                                    (probes_ && ImGui::IsMouseDown(ImGuiMouseButton_Left)));
  if (is_probing)
    probe_at(state_->panorama().texel_at(light_.image_from_window({io.MousePos.x, io.MousePos.y})));
  else if (state_->probed() && !probes_)
    state_->probe(std::nullopt);
  if (!is_probing && ImGui::IsItemActive() && ImGui::IsMouseDown(ImGuiMouseButton_Left)) handle_light_drag();
  if (!ImGui::IsItemHovered()) return;
  handle_light_wheel();
  const Point at = fraction_at({io.MousePos.x, io.MousePos.y});
  if (!probes_ && state_->setup().light_source_at(at.x, at.y)) ImGui::SetMouseCursor(ImGuiMouseCursor_Hand);
}

/// Its outline, and a handle of its colour in the middle.
void FieldViewer::draw_light_source(const PaintedLight& light_source, bool is_selected) const {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const LightDomain& domain = state_->panorama().shown();
  const ImU32 line = is_selected ? accent_colour : 0x90ffffff;
  const float thickness = is_selected ? 2.0f : 1.0f;
  constexpr int smooth = 48;
  Point middle = window_at(light_source.x, light_source.y);
  if (light_source.shape == PaintedLight::Shape::bar) {
    middle.y = window_at(0.0, 0.5).y;
    for (const double side : {-0.5, 0.5}) {
      const double x = light_source.x + side * light_source.size;
      list.AddLine(vector(window_at(x, 0.0)), vector(window_at(x, 1.0)), shadow_colour, thickness + 2.0f);
      list.AddLine(vector(window_at(x, 0.0)), vector(window_at(x, 1.0)), line, thickness);
    }
  } else {
    const auto radius = static_cast<float>(std::max(light_source.size * domain.height * light_.scale(), 3.0));
    list.AddCircle(vector(middle), radius, shadow_colour, smooth, thickness + 2.0f);
    list.AddCircle(vector(middle), radius, line, smooth, thickness);
  }
  list.AddCircleFilled(vector(middle), is_selected ? 6.0f : 5.0f, 0xff101010);
  list.AddCircleFilled(vector(middle), is_selected ? 4.5f : 3.5f,
                       light_source.is_on ? colour_of(light_source) : 0xff505050);
}

/// The picked pixel's kernels: their density over the map, rectangles framed the stronger the more energy
/// they hold.
void FieldViewer::draw_kernels() const {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddImage(kernel_texture_.handle(), vector(window_at(0.0, 0.0)), vector(window_at(1.0, 1.0)),
                ImVec2(0, 0), ImVec2(1, 1), 0xe8ffffff);
  for (const PixelKernel& kernel : state_->kernels()) {
    // On a panorama a cube's squares have no straight edges.
    if (kernel.hat || kernel.energy_share <= 0.0 || state_->panorama().is_cube()) continue;
    const Box& box = kernel.support;
    const auto alpha = static_cast<ImU32>(40.0 + 215.0 * std::sqrt(kernel.energy_share));
    list.AddRect(vector(light_.window_from_image({static_cast<double>(box.x0), static_cast<double>(box.y0)})),
                 vector(light_.window_from_image({static_cast<double>(box.x1), static_cast<double>(box.y1)})),
                 alpha << 24 | 0x00ffffff);
  }
  const std::string text = (state_->view() != nullptr ? "Kernels of the vertex at " : "Kernels of pixel ") +
                           formatted("%d, %d", state_->picked()->x, state_->picked()->y);
  draw_plate({light_.area().x + 8.0, light_.area().y + 8.0}, text.c_str(), accent_colour);
}

void FieldViewer::draw_probe() const {
  const auto& box = state_->probed();
  if (!box || state_->panorama().is_cube()) return;  // there it is under the pointer
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 a =
      vector(light_.window_from_image({static_cast<double>(box->x0), static_cast<double>(box->y0)}));
  const ImVec2 b =
      vector(light_.window_from_image({static_cast<double>(box->x1), static_cast<double>(box->y1)}));
  constexpr float margin = 4.0f;
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), shadow_colour, 0.0f, 0,
               4.0f);
  list.AddRect(ImVec2(a.x - margin, a.y - margin), ImVec2(b.x + margin, b.y + margin), accent_colour, 0.0f, 0,
               2.0f);
}

/// The light map: move light sources, turn the map, probe.
void FieldViewer::draw_light_panel(const Area& area) {
  const LightDomain& domain = state_->panorama().shown();
  light_.fit();
  light_.lay_out(area, domain.width, domain.height);
  begin_canvas("##light", area);
  handle_light_mouse();
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImVec2 corner = vector(window_at(0.0, 0.0)), far_corner = vector(window_at(1.0, 1.0));
  list.AddImage(light_texture_.handle(), corner, far_corner);
  list.PushClipRect(corner, far_corner, true);
  const bool shows_kernels = shows_kernels_ && state_->picked();
  if (shows_kernels) draw_kernels();
  const auto& light_sources = state_->setup().light_sources;
  for (std::size_t i = 0; i < light_sources.size(); ++i)
    if (!shows_kernels || selected == i) draw_light_source(light_sources[i], selected == i);
  draw_probe();
  list.PopClipRect();
  end_panel();
}

/// A ring around the picked pixel, which itself stays free; a legend and a title, where what is shown is not
/// simply the picture.
void FieldViewer::draw_over_picture() {
  const ViewState& state = *state_;
  const Area& area = canvas.area();
  if (const auto& picked = state.picked())
    draw_ring(canvas.window_from_image({picked->x + 0.5, picked->y + 0.5}),
              std::max(7.0, 0.8 * canvas.scale()));
  if (state.shown() != Shown::picture) {
    const bool in_stops = state.shown() == Shown::false_colour;
    const std::string low = in_stops ? formatted("−%.0f stops", stops_below_white) : "0 %";
    const std::string high = in_stops ? formatted("white +%.0f", stops_above_white)
                                      : formatted("%.3g %%", 100.0 * state.error_range());
    constexpr double width = 260.0, height = 48.0, margin = 12.0;
    draw_legend({area.x + margin, area.y + area.height - height - margin, width, height}, low.c_str(),
                high.c_str());
  }
  const auto& probed = state.probed();
  const std::string title = probed ? formatted("Contribution of texels %d, %d + %d×%d", probed->x0,
                                               probed->y0, probed->width(), probed->height())
                                   : title_of(state.shown());
  if (!title.empty())
    draw_plate({area.x + 12.0, area.y + 12.0}, title.c_str(), probed ? accent_colour : text_colour);
}

std::optional<VisibleRegion> FieldViewer::visible_region() const {
  const Area& area = canvas.area();
  const Point first = canvas.image_from_window({area.x, area.y});
  const Point last = canvas.image_from_window({area.x + area.width, area.y + area.height});
  const int width = state_->image_width(), height = state_->image_height();
  const Box region{std::max(0, static_cast<int>(std::floor(first.x))),
                   std::max(0, static_cast<int>(std::floor(first.y))),
                   std::min(width, static_cast<int>(std::ceil(last.x))),
                   std::min(height, static_cast<int>(std::ceil(last.y)))};
  if (state_->view() != nullptr || !region.inside(width, height)) return std::nullopt;
  return VisibleRegion{region, canvas.scale()};
}

std::string FieldViewer::pointer() const {
  const Image& light = state_->shown_light();
  return ViewerWindow::pointer() +
         pointer_text(light_, light, "texel", {{0, 0, light.width, light.height}, 1});
}

}  // namespace refield
