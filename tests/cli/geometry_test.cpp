// SPDX-License-Identifier: Apache-2.0
// The placement of a monitor from a session of a mirror ball, by the command.
#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "acquire/light_probe/mirror_ball.h"
#include "acquire/light_probe/monitor_by_ball.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/cli/matchers.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

/// A screen so far away that the ball is a point to it: 52 m wide at 60 m.
constexpr MonitorPlacement far_screen{52000.0, 32000.0, 60000.0, {80.0, 5.0, -3.0}, 2000.0, -1000.0};

TEST(GeometryVerb, StoresThePlacementInAnotherSession) {
  constexpr int width = 320, height = 240;
  constexpr double focal_px = 600.0;
  const test::TemporaryFolder folder;
  ASSERT_THAT(run_refield({"acquire", "lights", "--spots", "--light-size", "100x60", "-o", folder / "spots"}),
              Succeeded());
  const MirrorBall ball =
      ball_from_circle({{170.0, 115.0}, 70.0}, {focal_px, {}, {0.5 * width, 0.5 * height}});

  CaptureSession session;
  session.folder = folder / "ball";
  session.light = {100, 60, Parameterisation::monitor};
  session.width = width;
  session.height = height;
  create_folders(session.folder / "illumination");
  create_folders(session.folder / "observed");
  for (const auto& path : expand_globs({(folder / "spots").string()})) {
    const std::string name = path.stem();
    session.frames.push_back({name, FrameRole::train, "", session.folder / "illumination" / path.filename(),
                              session.folder / "observed" / path.filename()});
    const LightMap light = read_light_map(path, Parameterisation::monitor);
    write_exr(session.frames.back().illumination, light.radiance);
    Image photograph(width, height, 3, 0.3f);
    const auto spot = spot_of(light.radiance);
    const auto seen =
        spot ? ball.find(screen_direction(far_screen, spot->x(), spot->y()).normalized()) : std::nullopt;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const Eigen::Vector2d at(x + 0.5, y + 0.5);
        if (!ball.reflect(at)) continue;
        const double glow = seen ? std::exp(-0.5 * (at - seen->point).squaredNorm() / 2.0) : 0.0;
        for (int c = 0; c < 3; ++c) photograph.at(x, y, c) = static_cast<float>(0.01 + glow);
      }
    write_exr(session.frames.back().observed, photograph);
  }
  write_session_manifest(session);

  const std::string field_of_view =
      std::to_string(2.0 * std::atan(0.5 * width / focal_px) * 180.0 / std::numbers::pi);
  const std::vector<std::string> command = {"acquire",     "geometry", session.folder,
                                            "--diameter",  "100",      "--horizontal-fov",
                                            field_of_view, "--into",   session.folder};
  EXPECT_THAT(run_refield(command), RefusedNaming("ball", "--screen"));
  auto with_screen = command;
  with_screen.insert(with_screen.end(), {"--screen", "52000x32000", "--ball", "170,115,70"});
  ASSERT_THAT(run_refield(with_screen), Succeeded());

  const auto placed = read_capture_session(session.folder).monitors;
  ASSERT_EQ(placed.size(), 1U);
  for (const double u : {0.0, 1.0})
    for (const double v : {0.0, 1.0}) {
      const Eigen::Vector3d truth = far_screen.distance_mm * screen_direction(far_screen, u, v);
      EXPECT_LT((placed[0].distance_mm * screen_direction(placed[0], u, v) - truth).norm(),
                0.01 * truth.norm());
    }
}

}  // namespace
}  // namespace refield
