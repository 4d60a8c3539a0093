// SPDX-License-Identifier: Apache-2.0
// refield acquire colour: a colour chart gives the matrix from the camera's channels to linear Rec.709.
#include <cmath>
#include <cstdio>

#include "acquire/colour/colour_chart.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/json.h"
#include "core/base/output_lock.h"
#include "core/image/colour.h"
#include "core/image/tone_map.h"
#include "core/session/capture_session.h"

namespace refield::cli {

namespace {

struct ColourOptions {
  fs::path session;
  fs::path chart;
  fs::path picture;
};

/// Screens are darker at their edges, and their white is not quite that of light maps.
bool is_white(const Image& light) {
  const auto [low, high] = std::ranges::minmax(light.values);
  return high > 0.0f && low > 0.7f * high;
}

/// The photograph of the session that was taken under a white light map.
fs::path white_photograph(const CaptureSession& session) {
  auto white = std::ranges::find(session.frames, "white", &CaptureFrame::kind);
  if (white == session.frames.end())
    white = std::ranges::find_if(session.frames, [&](const CaptureFrame& frame) {
      return is_white(read_illumination(frame, session.light.parameterisation, run_context()).radiance);
    });
  if (white != session.frames.end()) return white->observed;
  throw InputError(session.folder,
                   ": has no photograph under a white light map; give a photograph of the chart under the "
                   "white monitor with --chart");
}

Photograph chart_photograph(const fs::path& path) {
  if (path.extension() != ".exr")
    throw InputError(path,
                     ": is not an OpenEXR file; the chart must be photographed like the session, "
                     "scene-linear: convert RAW files or brackets with 'refield acquire import'");
  Photograph photograph = read_photograph(path);
  require_finite(photograph.radiance, path.string(), true, "photograph the chart again");
  return photograph;
}

/// The chart in linear Rec.709, each patch with a square of the colour that it should have.
Image picture_of(const Photograph& photograph, const ColourChart& chart, const ColourFit& fit) {
  Image picture = photograph.radiance;
  convert_colours(picture, fit.rec709_from_camera.cast<float>());
  // Brightness of a reflectance of 1: the mean over the patches, weighted by their brightness.
  double shown = 0.0, expected = 0.0;
  for (int k = 0; k < chart_patches; ++k) {
    shown += (fit.rec709_from_camera * chart.camera[k]).sum();
    expected += rec709_from_lab(chart_lab()[k]).sum();
  }
  for (int k = 0; k < chart_patches; ++k) {
    const Eigen::Vector3f colour = (rec709_from_lab(chart_lab()[k]) * shown / expected).cast<float>();
    constexpr double half_side = 0.2, step = 0.004;
    for (double y = -half_side; y < half_side; y += step)
      for (double x = -half_side; x < half_side; x += step) {
        const Eigen::Vector2d at = chart.point(k % chart_columns + x, k / chart_columns + y);
        const auto px = static_cast<int>(std::floor(at.x())), py = static_cast<int>(std::floor(at.y()));
        for (int c = 0; c < 3; ++c) picture.at(px, py, c) = colour[c];
      }
  }
  return picture;
}

Json rows_of(const Eigen::Matrix3d& matrix) {
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r) rows.push_back({matrix(r, 0), matrix(r, 1), matrix(r, 2)});
  return rows;
}

void print(const std::string& name, const Eigen::Matrix3d& matrix) {
  std::printf("%s from camera RGB:\n", name.c_str());
  for (int r = 0; r < 3; ++r) std::printf("  %9.5f %9.5f %9.5f\n", matrix(r, 0), matrix(r, 1), matrix(r, 2));
}

void calibrate_colour(const ColourOptions& options, const Common& common) {
  const OutputLock lock(options.session, {});
  CaptureSession session = read_capture_session(options.session);
  const fs::path path = options.chart.empty() ? white_photograph(session) : options.chart;
  const Photograph photograph = chart_photograph(path);
  const ColourChart chart = find_colour_chart(photograph, path.string());
  const ColourFit fit = fit_colour(chart, path.string());
  if (!options.picture.empty()) {
    const Image picture = picture_of(photograph, chart, fit);
    write_png(options.picture, picture, {exposure_to_white(picture)});
  }
  session.colour = {fit.rec709_from_camera, path.filename().string(), fit.median_delta_e(),
                    fit.largest_delta_e()};
  write_session_manifest(session);

  const Eigen::Matrix3d acescg =
      rgb_from_rgb(rec709_chromaticities(), acescg_chromaticities()) * fit.rec709_from_camera;
  if (common.json) {
    Json patches = Json::object();
    for (int k = 0; k < chart_patches; ++k) patches[std::string(chart_patch_name(k))] = fit.delta_e[k];
    const Json figures{
        {"chart", path.string()},
        {"rec709_from_camera", rows_of(fit.rec709_from_camera)},
        {"acescg_from_camera", rows_of(acescg)},
        {"delta_e_2000",
         {{"median", fit.median_delta_e()}, {"largest", fit.largest_delta_e()}, {"patches", patches}}},
        {"light_change", fit.light_change}};
    print_json(figures);
    return;
  }
  const Eigen::Vector2d first = chart.point(0, 0), last = chart.point(chart_columns - 1, chart_rows - 1);
  std::printf(
      "%s: chart from (%.0f, %.0f), dark skin, to (%.0f, %.0f), black; its light changes by %.0f %%\n",
      path.c_str(), first.x(), first.y(), last.x(), last.y(), 100.0 * fit.light_change);
  print("linear Rec.709", fit.rec709_from_camera);
  print("ACEScg", acescg);
  std::printf("colour error (CIEDE2000): median %.2f, largest %.2f (%s)\n", fit.median_delta_e(),
              fit.largest_delta_e(), std::string(chart_patch_name(fit.worst_patch())).c_str());
  std::printf("%s: photographs are now read as linear Rec.709; estimate fields again\n",
              (options.session / session_manifest_name).c_str());
}

}  // namespace

void add_acquire_colour(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<ColourOptions>();
  CLI::App* verb =
      group.add_subcommand("colour",
                           "Calibrate the colours of a session with a chart of 24 patches.\n"
                           "\n"
                           "Finds the chart in a photograph under the white monitor, estimates the matrix "
                           "from camera RGB to linear Rec.709 and stores it in the session. Its photographs, "
                           "and fields estimated from it, are then in linear Rec.709, the light of the "
                           "photograph being white. docs/guide/colour.md describes the photograph.\n"
                           "\n"
                           "Examples:\n"
                           "  refield acquire colour session\n"
                           "  refield acquire colour session --chart chart.exr -o check.png");
  verb->add_option("session", options->session, "Capture session (folder)")->required();
  verb->add_option("--chart", options->chart,
                   "Photograph of the chart (.exr, scene-linear) by the same camera under the white monitor "
                   "(default: the photograph of the session under a white light map)");
  verb->add_option("-o,--output", options->picture,
                   "Image to write (.png): the photograph after calibration, with the expected colour in the "
                   "middle of each patch");
  on_command(*verb, options, common, action, calibrate_colour);
}

}  // namespace refield::cli
