// SPDX-License-Identifier: Apache-2.0
// refield acquire geometry: the monitor's placement from its reflections in a mirror ball.
#include <cmath>

#include "acquire/light_probe/mirror_ball.h"
#include "acquire/light_probe/monitor_by_ball.h"
#include "acquire/light_probe/unwrap.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/session/capture_session.h"

namespace refield::cli {

namespace {

struct GeometryOptions {
  fs::path session;
  std::string ball = "find";
  std::optional<double> diameter_mm;
  std::optional<double> horizontal_fov;
  std::string screen;
  fs::path into;
};

/// Width and height of the screen in mm.
std::pair<double, double> screen_of(const GeometryOptions& options, const CaptureSession& session) {
  if (options.screen.empty()) {
    if (session.monitors.size() == 1) return {session.monitors[0].width_mm, session.monitors[0].height_mm};
    throw InputError(
        options.session,
        ": does not hold the size of the screen; give its width and height in mm, such as --screen 520x320");
  }
  double width = 0.0, height = 0.0;
  int end = 0;
  if (std::sscanf(options.screen.c_str(), "%lfx%lf%n", &width, &height, &end) != 2 ||
      options.screen[static_cast<std::size_t>(end)] != '\0' || !(width > 0.0 && height > 0.0))
    throw InputError("--screen ", options.screen,
                     ": give width and height of the screen in mm, such as 520x320");
  return {width, height};
}

/// A frame that shows one spot.
struct SpotFrame {
  Eigen::Vector2d screen;
  const CaptureFrame* frame;
};

std::vector<SpotFrame> spot_frames(const CaptureSession& session) {
  std::vector<SpotFrame> spots;
  for (const CaptureFrame& frame : session.frames)
    if (const auto spot =
            spot_of(read_illumination(frame, session.light.parameterisation, run_context()).radiance))
      spots.push_back({*spot, &frame});
  if (spots.empty())
    throw InputError(
        session.folder,
        ": has no light map of a single spot; capture the ball under 'refield acquire lights --spots'");
  return spots;
}

MirrorBall ball_of(const GeometryOptions& options, const CaptureSession& session,
                   const std::vector<SpotFrame>& spots) {
  const auto optics = ProbeOptics::of_view(*options.horizontal_fov, session.width, session.height);
  if (const auto circle = circle_from_text(options.ball)) return ball_from_circle(*circle, optics);
  Image sum(session.width, session.height, 3);
  for (const SpotFrame& spot : spots) {
    const Image photograph = read_photograph(spot.frame->observed).radiance;
    std::ranges::transform(sum.values, photograph.values, sum.values.begin(), std::plus());
  }
  return find_ball(sum, optics).ball;
}

void geometry(const GeometryOptions& options, const Common& common) {
  CaptureSession session = read_capture_session(options.session);
  if (session.light.parameterisation != Parameterisation::monitor)
    throw InputError(options.session, ": is not lit by a monitor");
  const auto [width_mm, height_mm] = screen_of(options, session);
  const std::vector<SpotFrame> frames = spot_frames(session);
  const MirrorBall ball = ball_of(options, session, frames);
  std::vector<SpotReflection> spots;
  std::vector<std::string> names, left_out;
  for (const SpotFrame& spot : frames) {
    const Photograph photograph = read_photograph(spot.frame->observed);
    if (const auto image = highlight_in(photograph.radiance, ball)) {
      spots.push_back({spot.screen, *image});
      names.push_back(spot.frame->name);
    } else {
      left_out.push_back(spot.frame->name);
    }
  }
  const MonitorSighting found = place_monitor(spots, {ball, *options.diameter_mm}, width_mm, height_mm);
  for (const std::size_t i : found.left_out) left_out.push_back(names[i]);
  if (!options.into.empty()) {
    const OutputLock lock(options.into, {});
    CaptureSession target = read_capture_session(options.into);
    target.monitors = {found.placement};
    check_placements(target.monitors, target.light, options.into.string());
    write_session_manifest(target);
  }
  const Eigen::Vector2d centre = ball.centre_px();
  const std::string circle = formatted("%.1f,%.1f,%.1f", centre.x(), centre.y(), ball.radius_px());
  if (common.json) {
    Json corners = Json::array();
    for (const Eigen::Vector3d& corner : found.corners_mm)
      corners.push_back({corner.x(), corner.y(), corner.z()});
    print_json(Json{{"placement", text_of(found.placement)},
                    {"corners_mm", corners},
                    {"corner_sigma", found.corner_sigma},
                    {"spot_rms_px", found.rms_px},
                    {"spots", spots.size() - found.left_out.size()},
                    {"left_out", left_out},
                    {"ball", circle}});
    return;
  }
  std::printf("--placement %s\n", text_of(found.placement).c_str());
  std::printf(
      "corners: standard deviation %.2f %% of their distance; %zu spots, %.2f pixels off (RMS)\nball: --ball "
      "%s\n",
      100.0 * found.corner_sigma, spots.size() - found.left_out.size(), found.rms_px, circle.c_str());
  for (const std::string& name : left_out)
    std::printf("note: the reflection of %s was not found where the screen is\n", name.c_str());
  if (!options.into.empty())
    std::printf("%s: placement stored\n", (options.into / session_manifest_name).c_str());
}

}  // namespace

void add_acquire_geometry(CLI::App& group, const Common& common, Action& action) {
  const auto options = std::make_shared<GeometryOptions>();
  CLI::App* verb = group.add_subcommand(
      "geometry",
      "Measure the placement of the monitor with a mirror ball.\n"
      "\n"
      "The session shows a mirror ball, in the place of the object, under the spots of 'refield acquire "
      "lights --spots'. Their reflections give the placement for 'refield relight --env': the option "
      "--placement is printed, or stored in another session. docs/guide/rig-geometry.md describes the "
      "photographs.\n"
      "\n"
      "Examples:\n"
      "  refield acquire geometry ball --diameter 60 --horizontal-fov 24 --screen 520x320\n"
      "  refield acquire geometry ball --diameter 60 --horizontal-fov 24 --into session");
  verb->add_option("session", options->session, "Capture session (folder) of the ball")->required();
  add_diameter_option(*verb, options->diameter_mm)->required();
  add_horizontal_fov_option(*verb, options->horizontal_fov)->required();
  verb->add_option("--screen", options->screen,
                   "Width and height of the screen in mm, as in 520x320 (default: from the session)");
  add_ball_option(*verb, options->ball, "");
  verb->add_option("--into", options->into,
                   "Capture session to store the placement in (default: only printed)");
  on_command(*verb, options, common, action, geometry);
}

}  // namespace refield::cli
