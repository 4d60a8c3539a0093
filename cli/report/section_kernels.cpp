// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "cli/report/html.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"
#include "core/image_io.h"

namespace refield::report {

namespace {

constexpr int max_kernel_width = 160;

std::string letter(std::size_t index) {
  return std::string(1, static_cast<char>('A' + index % 26));
}

/// The photograph with rings around the pixels.
std::string marked_photograph(const ReportInput& input, const KernelStudy& study) {
  const auto kinds = kinds_of(input.session);
  const CaptureFrame frame =
      kinds.empty() ? input.session.frames.front() : spread_frames(input.session, kinds.front(), 1).front();
  const Image photograph = read_photograph(frame.observed).radiance;
  const double exposure = display_exposure(photograph, input.mask);
  const int width = photograph.width, height = photograph.height;
  std::string svg =
      "<svg class=\"marked\" viewBox=\"0 0 " + std::to_string(width) + " " + std::to_string(height) +
      "\" role=\"img\" aria-label=\"photograph with the chosen pixels marked\"><image width=\"" +
      std::to_string(width) + "\" height=\"" + std::to_string(height) +
      "\" preserveAspectRatio=\"none\" href=\"" +
      png_address(shrunk(photograph, 2 * max_picture_width), exposure) + "\"/>";
  const double unit = width / 100.0;
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const ChosenPixel& pixel = study.pixels[i].pixel;
    const double x = pixel.x + 0.5, y = pixel.y + 0.5;
    // The letter goes to the side where there is room.
    const bool left = x > 0.9 * width;
    svg += "<g class=\"mark\" style=\"--unit:" + fixed(unit, 3) + "px\"><circle class=\"halo\" cx=\"" +
           fixed(x, 1) + "\" cy=\"" + fixed(y, 1) + "\" r=\"" + fixed(1.6 * unit, 2) + "\"/><circle cx=\"" +
           fixed(x, 1) + "\" cy=\"" + fixed(y, 1) + "\" r=\"" + fixed(1.6 * unit, 2) +
           "\"/><text text-anchor=\"" + (left ? "end" : "start") + "\" x=\"" +
           fixed(x + (left ? -2.6 : 2.6) * unit, 1) + "\" y=\"" + fixed(y + 1.7 * unit, 1) + "\">" +
           letter(i) + "</text></g>";
  }
  return svg + "</svg>";
}

std::string panel(const Image& density, const std::string& alt) {
  const float highest = *std::ranges::max_element(density.values);
  return "<td>" +
         image_html(shrunk_by_maximum(density, max_kernel_width), highest > 0.0f ? 1.0 / highest : 1.0, alt,
                    "kernel") +
         "</td>";
}

}  // namespace

std::string kernels_html(const ReportInput& input, const KernelStudy& study) {
  if (study.pixels.empty()) return "";
  const bool has_exact = study.pixels.front().exact.has_value();
  std::string html = "<div class=\"split\"><div>" + marked_photograph(input, study) +
                     "</div><div><p>The reflectance of a pixel is a sum of kernels: rectangles of the light "
                     "map, each with a weight. The estimation starts with one rectangle and splits it where "
                     "this reduces the error most. The panels show the weights over the light map for the "
                     "marked pixels after a number of splits (before spatial correction), in the field “" +
                     escaped(input.fields.front().label) + "”";
  html += has_exact ? ", and in the exact light transport of the scene" : "";
  html +=
      ". Grey levels show the weight: white is the highest weight of the panel, black is zero.</p><table "
      "class=\"facts letters\">";
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const ChosenPixel& pixel = study.pixels[i].pixel;
    html += "<tr><th>" + letter(i) + "</th><td>" + escaped(pixel.kind) + " <small>(" +
            std::to_string(pixel.x) + ", " + std::to_string(pixel.y) + ")</small></td></tr>";
  }
  html += "</table></div></div><div class=\"wide\"><table class=\"kernels\"><thead><tr><th></th>";
  for (const int count : study.subdivisions) html += "<th>" + std::to_string(count) + "</th>";
  bool any_done = false;
  html += "<th>field</th>" + std::string(has_exact ? "<th>exact</th>" : "") + "</tr></thead><tbody>";
  for (std::size_t i = 0; i < study.pixels.size(); ++i) {
    const PixelKernels& kernels = study.pixels[i];
    const std::string name = "pixel " + letter(i) + ", ";
    html += "<tr><th>" + letter(i) + "</th>";
    for (std::size_t s = 0; s < kernels.after.size(); ++s) {
      if (kernels.after[s])
        html += panel(*kernels.after[s], name + std::to_string(study.subdivisions[s]) + " subdivisions");
      else
        html += "<td class=\"done\">–</td>";
      any_done = any_done || !kernels.after[s];
    }
    html += panel(kernels.in_field, name + "in the field");
    if (kernels.exact) html += panel(*kernels.exact, name + "exact");
    html += "</tr>";
  }
  html +=
      "</tbody></table></div><p class=\"note\">Up to " + std::to_string(study.kernels) + " kernels, mode " +
      std::string(name_of(input.fields.front().options.mode)) +
      ". Pixel classes are determined from the spread of the kernel energy, not from the scene description.";
  if (any_done) html += " “–”: no further split reduced the error.";
  if (input.session.light.width > max_kernel_width)
    html += " Each point of a panel shows the highest weight of the texels that it covers.";
  return section_html("Kernels of selected pixels", html + "</p>");
}

}  // namespace refield::report
