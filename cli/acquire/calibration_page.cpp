// SPDX-License-Identifier: Apache-2.0
#include "cli/acquire/calibration_page.h"

#include <algorithm>
#include <cmath>

#include "cli/acquire/calibration_plots.h"
#include "cli/report/html.h"
#include "cli/report/page.h"
#include "cli/report/picture.h"
#include "cli/report/sections.h"

namespace refield::cli {

namespace {

using namespace report;

std::string milliseconds(Seconds time) {
  return significant(1e3 * time.count(), 3) + "\u00a0ms";
}

std::string tile(const std::string& figure, const std::string& meaning) {
  return "<div class=\"tile\"><b>" + escaped(figure) + "</b><span>" + escaped(meaning) + "</span></div>";
}

std::string opening(const RigMeasurements& rig) {
  const CameraDescription& camera = rig.camera_description;
  const IlluminatorDescription& display = rig.display_description;
  const bool holds = rig.superposition.holds();
  std::string html =
      "<p class=\"kicker\">Calibration</p><h1>" + escaped(camera.name) + " and " + escaped(display.name) +
      "</h1><p>" +
      (holds ? "Light adds up: sessions that are captured with this calibration can be trusted as far "
               "as the figures below say."
             : "<strong>Light does not add up (superposition, below). Do not capture with these "
               "devices as they are set: no relighting made from it would be right.</strong>") +
      "</p>";
  html += "<div class=\"tiles\">" +
          tile(milliseconds(rig.timing.display_latency + rig.timing.display_settling),
               "from a flip until the light stands still") +
          tile(counted(static_cast<std::uint64_t>(rig.timing.control_latency_frames), "frame"),
               "until the camera's settings act") +
          tile(rig.timing.exposure_unit.count() > 0.0 ? milliseconds(rig.timing.exposure_unit) : "any",
               "whole multiples to expose for, against banding") +
          tile(significant(rig.camera.electrons_per_dn, 3), "electrons a DN, at gain 1") +
          tile(significant(rig.camera.read_noise_electrons, 3), "electrons of read noise") +
          tile(percent(rig.superposition.largest_error()), "largest error of superposition") + "</div>";
  if (rig.warnings.empty()) return html + "<p class=\"note\">No warnings.</p>";
  html += "<h3>Warnings</h3><ul>";
  for (const std::string& warning : rig.warnings) html += "<li>" + escaped(warning) + "</li>";
  return html + "</ul>";
}

std::string timing(const RigMeasurements& rig) {
  const DisplayTiming& display = rig.display_timing;
  return section_html("When light and settings change",
                      "<div class=\"split\"><div>" + change_plot(display) +
                          "<p>Each point is a frame taken across a change of the "
                          "display: how much of the new light it holds, by the middle of its exposure. Light "
                          "starts to change " +
                          milliseconds(display.latency) + " after the flip's time stamp and stands still " +
                          milliseconds(display.latency + display.settling) +
                          " after it (up: " + milliseconds(display.rise.settling) +
                          " of change, down: " + milliseconds(display.fall.settling) +
                          "). Capture takes a frame for a pattern only if its exposure began later than "
                          "that; nothing is slept "
                          "for.</p></div><div>" +
                          step_plot(rig.control_latency) + "<p>The exposure was made " +
                          significant(rig.control_latency.expected_ratio, 2) + " times as long at frame 0. " +
                          counted(static_cast<std::uint64_t>(rig.control_latency.frames), "frame") +
                          " still came with the old one, and capture leaves out as many after every change, "
                          "whatever the driver says "
                          "of them.</p></div></div>");
}

std::string banding(const RigMeasurements& rig) {
  const Banding& measured = rig.banding;
  std::string words;
  if (measured.ripples.empty())
    words =
        "Brightness per second does not depend on the exposure: no pulsing of the light between 20 Hz and 2 "
        "kHz is "
        "seen, so any exposure will do. The remaining deviation, " +
        percent(measured.noise) +
        " RMS from frame to frame, has no period: slow drift of the light, or noise.";
  else
    words = "The light pulses at " + significant(measured.ripples.front().hz, 5) + " Hz by " +
            percent(measured.ripples.front().depth) +
            ". An exposure that is no whole number of periods catches more or less of it; capture rounds "
            "exposures to "
            "multiples of " +
            milliseconds(measured.exposure_unit) +
            ". A pulsing that remains when you turn the "
            "display's brightness to its highest is the room's lamps: switch them off.";
  if (measured.refresh_period.count() > 0.0)
    words += " The display refreshes every " + milliseconds(measured.refresh_period) + " (" +
             significant(1.0 / measured.refresh_period.count(), 4) + " Hz).";
  return section_html("Banding", "<div class=\"split\"><div>" + banding_plot(measured) + "</div><p>" +
                                     escaped(words) + "</p></div>");
}

std::string camera(const RigMeasurements& rig) {
  const CameraResponse& response = rig.response;
  const std::string words =
      "Without light the camera gives " + significant(rig.black.dn, 4) + " DN; samples from " +
      fixed(response.saturation_dn, 0) + " DN on may be clipped" +
      (response.saturation_seen ? "" : " (full scale: no sample was seen to saturate)") +
      ". In between its samples are " +
      (response.is_linear ? "proportional to light."
                          : "bent; the table in the calibration file straightens them.") +
      " Points scatter by " + percent(response.residual) +
      " of the range. A curve with steps or a scatter of more than 1 % tells of a camera that adjusts "
      "itself.";
  const PhotonTransfer& noise = rig.noise;
  const std::string noise_words =
      "Photons come by chance, so the variance of a sample grows in proportion to light: the slope says that "
      "a DN stands "
      "for " +
      significant(noise.electrons_per_dn, 3) + " electrons (at gain 1), the start that reading adds " +
      significant(noise.read_noise_electrons, 3) + " electrons of noise. The sensor holds " +
      significant(noise.full_well_electrons, 3) +
      " electrons at saturation: a single sample can be right to " +
      percent(1.0 / std::sqrt(std::max(1.0, noise.full_well_electrons))) +
      " at best. Points that bend down at the bright end mean a camera that denoises, points that bend up a "
      "light that "
      "flickers.";
  return section_html("The camera", "<div class=\"split\"><div>" + response_plot(response) + "<p>" +
                                        escaped(words) + "</p></div><div>" + noise_plot(noise, response) +
                                        "<p>" + escaped(noise_words) + "</p></div></div>");
}

std::string display(const RigMeasurements& rig) {
  return section_html(
      "The display's tone curves",
      "<div class=\"split\"><div>" + tone_plot(rig.tone_curve) +
          "</div><p>Light of each channel by drive level, above black, white being 1: points were "
          "measured, lines go into the calibration file. Patterns are driven through their inverse, so "
          "that the light shown is the light asked for. A curve that flattens before level 255 means "
          "that contrast is set too high; one that stays dark for many levels, brightness too "
          "low.</p></div>");
}

std::string superposition(const RigMeasurements& rig) {
  std::string table =
      "<table><thead><tr><th>Patterns A and B</th><th class=\"num\">error</th><th class=\"num\">± noise</th>"
      "<th class=\"num\">worst block</th></tr></thead><tbody>";
  for (const SuperpositionPair& pair : rig.superposition.pairs)
    table += "<tr><td>" + escaped(pair.name) + "</td><td class=\"num\">" + fixed(100.0 * pair.error, 3) +
             " %</td><td class=\"num\">" + fixed(100.0 * pair.uncertainty, 3) + " %</td><td class=\"num\">" +
             fixed(100.0 * pair.worst_block, 3) + " %</td></tr>";
  table += "</tbody></table>";
  return section_html("Superposition: " + std::string(rig.superposition.holds() ? "holds" : "broken"),
                      "<p>I(A) + I(B) − I(black) must equal I(A+B); everything rests on it. An error above " +
                          percent(rig.superposition.tolerance) +
                          " is a display that dims itself: turn off dynamic contrast, local dimming, power "
                          "saving, automatic brightness "
                          "and, on OLED, lower the brightness until the power limit no longer acts.</p>" +
                          table);
}

std::string map_html(const std::string& heading, const UniformityMap& measured, const std::string& words) {
  Image picture(240, 180, 1);
  for (int y = 0; y < picture.height; ++y)
    for (int x = 0; x < picture.width; ++x) picture.at(x, y, 0) = measured.map.at_pixel(x, y, picture);
  return section_html(heading, "<div class=\"split\"><figure>" + image_html(picture, 1.0, heading) +
                                   "<figcaption>black 0, white 1; lowest " + percent(measured.least) +
                                   "</figcaption></figure><p>" + escaped(words) + "</p></div>");
}

}  // namespace

std::string calibration_page(const RigMeasurements& rig) {
  std::string body =
      opening(rig) + superposition(rig) + timing(rig) + banding(rig) + camera(rig) + display(rig);
  if (rig.flat_field)
    body += map_html(
        "Vignetting", *rig.flat_field,
        "Share of the light that arrives at each place of the frame. Photographs are divided by it. It "
        "should be smooth and round about the middle: a slope from one side to the other is a card that is "
        "lit unevenly.");
  if (rig.screen)
    body += map_html(
        "Uniformity of the screen", *rig.screen,
        "Brightness of each place of the screen as the camera sees it from where it stands. The light on "
        "record in a session is multiplied by it. LCDs also darken when seen at an angle: place the camera "
        "for this measurement where the scene stands.");
  return page_html("Calibration of " + rig.camera_description.name, body, "refield acquire calibrate");
}

}  // namespace refield::cli
