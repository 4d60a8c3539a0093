// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/monitor_by_ball.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <random>

#include "acquire/light_probe/mirror_ball.h"
#include "tests/support/message_of.h"

namespace refield {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int width = 1280, height = 960;
constexpr double focal_px = 1900.0;

/// A mirror ball before a camera, and a monitor somewhere; traced ray by ray from the camera, without what
/// place_monitor() computes with.
struct Rig {
  MonitorPlacement monitor;
  Eigen::Vector3d ball_mm{20.0, -15.0, 800.0};
  double diameter_mm = 100.0;
  double noise = 0.01;

  ProbeCamera camera() const { return {focal_px, {width / 2.0, height / 2.0}}; }
  MirrorBall seen_ball() const {
    return {camera(), ball_mm.normalized(), 2.0 * ball_mm.norm() / diameter_mm};
  }

  /// Screen coordinates where a ray from a point relative to the ball's centre meets the screen's plane.
  Eigen::Vector2d meet(const Eigen::Vector3d& from, const Eigen::Vector3d& direction) const {
    const Eigen::Matrix3d turn = rotation_of(monitor.turn);
    const Eigen::Vector3d start = turn.transpose() * from, way = turn.transpose() * direction;
    const double along = (monitor.distance_mm - start.z()) / way.z();
    if (!(along > 0.0)) return {-1.0, -1.0};
    const Eigen::Vector3d hit = start + along * way;
    return {(hit.x() - monitor.offset_x_mm) / monitor.width_mm + 0.5,
            0.5 - (hit.y() - monitor.offset_y_mm) / monitor.height_mm};
  }

  /// Under light that is 1 within `half` of a point of the screen, in heights of the screen, and 0.02
  /// elsewhere on the screen: its black.
  Image photograph(const Eigen::Vector2d& spot, double half, unsigned seed) const {
    Image image(width, height, 3, 0.05f);  // a wall behind, with noise about the ball
    std::mt19937 generator(seed);
    std::normal_distribution<float> grain(0.0f, static_cast<float>(noise));
    const double radius_mm = 0.5 * diameter_mm;
    const MirrorBall ball = seen_ball();
    const Eigen::Vector2d middle = ball.centre_px();
    const double reach = ball.radius_px() + 3.0;
    constexpr int side = 3;
    const int margin = static_cast<int>(reach) + 12;
    const int left = static_cast<int>(middle.x()) - margin, top = static_cast<int>(middle.y()) - margin;
    for (int y = top; y < top + 2 * margin; ++y)
      for (int x = left; x < left + 2 * margin; ++x) {
        double sum = 0.05 * side * side;
        if (std::abs(x - middle.x()) < reach && std::abs(y - middle.y()) < reach) {
          sum = 0.0;
          for (int i = 0; i < side * side; ++i) {
            const Eigen::Vector3d ray =
                camera().ray({x + (i % side + 0.5) / side, y + (i / side + 0.5) / side});
            const double along = ray.dot(ball_mm);
            const double miss2 = ball_mm.squaredNorm() - along * along;
            if (miss2 >= radius_mm * radius_mm) {
              sum += 0.05;
              continue;
            }
            const Eigen::Vector3d surface =
                (along - std::sqrt(radius_mm * radius_mm - miss2)) * ray - ball_mm;
            const Eigen::Vector3d normal = surface / radius_mm;
            const Eigen::Vector2d at = meet(surface, ray - 2.0 * ray.dot(normal) * normal);
            const bool is_screen = at.x() > 0.0 && at.x() < 1.0 && at.y() > 0.0 && at.y() < 1.0;
            const bool is_lit = std::abs(at.x() - spot.x()) * monitor.width_mm / monitor.height_mm < half &&
                                std::abs(at.y() - spot.y()) < half;
            sum += is_screen ? (is_lit ? 1.0 : 0.02) : 0.01;
          }
        }
        for (int c = 0; c < 3; ++c)
          image.at(x, y, c) = static_cast<float>(sum / (side * side)) + grain(generator);
      }
    return image;
  }

  std::vector<SpotReflection> reflections(const MirrorBall& ball) const {
    std::vector<SpotReflection> spots;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 5; ++column) {
        const Eigen::Vector2d screen(0.1 + 0.2 * column, 1.0 / 6.0 + row / 3.0);
        const auto image = highlight_in(photograph(screen, 0.05, static_cast<unsigned>(spots.size())), ball);
        if (image) spots.push_back({screen, *image});
      }
    return spots;
  }

  /// The largest error of a corner, relative to its distance from the ball.
  double corner_error(const MonitorSighting& found) const {
    constexpr std::array<std::array<double, 2>, 4> corners = {
        {{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}}};
    double largest = 0.0;
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector3d truth =
          monitor.distance_mm * screen_direction(monitor, corners[i][0], corners[i][1]);
      largest = std::max(largest, (found.corners_mm[i] - truth).norm() / truth.norm());
      // The placement says the same.
      const MonitorPlacement& p = found.placement;
      EXPECT_LT(
          (p.distance_mm * screen_direction(p, corners[i][0], corners[i][1]) - found.corners_mm[i]).norm(),
          1e-6);
    }
    return largest;
  }
};

/// To the right of the camera, to its left and turned, and beside the camera facing the ball from in front.
const std::array<MonitorPlacement, 3> places = {{{520.0, 320.0, 600.0, {90.0, 0.0, 0.0}, 0.0, 0.0},
                                                 {600.0, 340.0, 450.0, {-75.0, 12.0, -4.0}, 40.0, -25.0},
                                                 {520.0, 320.0, 700.0, {165.0, -20.0, 3.0}, -30.0, 60.0}}};

TEST(MonitorByBall, CornersAreWithinAPercentOfTheirDistance) {
  for (const MonitorPlacement& place : places) {
    SCOPED_TRACE(text_of(place));
    const Rig rig{place};
    const MirrorBall ball = rig.seen_ball();
    const MonitorSighting found =
        place_monitor(rig.reflections(ball), {ball, rig.diameter_mm}, place.width_mm, place.height_mm);
    const double error = rig.corner_error(found);
    std::printf("%s: %s, corners within %.2f %% (stated %.2f %%), spots %.2f px\n", text_of(place).c_str(),
                text_of(found.placement).c_str(), 100.0 * error, 100.0 * found.corner_sigma, found.rms_px);
    EXPECT_LT(error, 0.01);
    EXPECT_LT(error, 3.0 * found.corner_sigma);
    EXPECT_LT(found.corner_sigma, 0.01);
    EXPECT_THAT(found.left_out, IsEmpty());
  }
}

TEST(MonitorByBall, FindsTheBallByItself) {
  const Rig rig{places[1]};
  const OutlineFit outline =
      find_ball(rig.photograph({0.5, 0.5}, 2.0, 99), {focal_px, {}, {width / 2.0, height / 2.0}});
  const MonitorSighting found =
      place_monitor(rig.reflections(outline.ball), {outline.ball, rig.diameter_mm}, 600.0, 340.0);
  const double error = rig.corner_error(found);
  std::printf("ball of the outline: corners within %.2f %% (stated %.2f %%)\n", 100.0 * error,
              100.0 * found.corner_sigma);
  EXPECT_LT(error, 0.01);
}

/// What the user must know: the field of view and the ball's diameter, and how wrong the corners are where
/// these are.
TEST(MonitorByBall, WrongLengthsMoveTheCornersByLessThanTheirOwnError) {
  const Rig rig{places[0]};
  const auto spots = rig.reflections(rig.seen_ball());
  const MonitorSighting wrong_ball =
      place_monitor(spots, {rig.seen_ball(), 1.05 * rig.diameter_mm}, 520.0, 320.0);
  EXPECT_LT(rig.corner_error(wrong_ball), 0.01) << "5 % of the ball";
  const ProbeCamera camera{1.03 * focal_px, {width / 2.0, height / 2.0}};
  const MirrorBall ball = ball_from_circle({rig.seen_ball().centre_px(), rig.seen_ball().radius_px()},
                                           {camera.focal_px, {}, camera.principal_px});
  EXPECT_LT(rig.corner_error(place_monitor(spots, {ball, rig.diameter_mm}, 520.0, 320.0)), 0.03)
      << "3 % of the focal length";
}

TEST(MonitorByBall, ReflectionsOfOtherThingsAreLeftOut) {
  const Rig rig{places[0]};
  auto spots = rig.reflections(rig.seen_ball());
  spots[7].image_px += Eigen::Vector2d(9.0, -6.0);
  const MonitorSighting found = place_monitor(spots, {rig.seen_ball(), rig.diameter_mm}, 520.0, 320.0);
  EXPECT_EQ(found.left_out, std::vector<std::size_t>{7});
  EXPECT_LT(rig.corner_error(found), 0.01);
  for (std::size_t i = 0; i < spots.size(); ++i)
    spots[i].screen = {0.1 + 0.05 * static_cast<double>(i * 7 % 15),
                       0.2 + 0.04 * static_cast<double>(i * 4 % 15)};
  EXPECT_THAT(test::message_of([&] {
                place_monitor(spots, {rig.seen_ball(), rig.diameter_mm}, 520.0, 320.0);
              }),
              HasSubstr("spots of the screen"));
}

TEST(MonitorByBall, SpotsAreSmallAndNamedByTheirMiddle) {
  Image light(40, 30, 3);
  for (int y = 6; y < 9; ++y)
    for (int x = 10; x < 13; ++x) light.at(x, y, 1) = 0.7f;
  const auto spot = spot_of(light);
  ASSERT_TRUE(spot);
  EXPECT_NEAR(spot->x(), 11.5 / 40.0, 1e-9);
  EXPECT_NEAR(spot->y(), 7.5 / 30.0, 1e-9);
  EXPECT_FALSE(spot_of(Image(40, 30, 3)));
  EXPECT_FALSE(spot_of(Image(40, 30, 3, 1.0f)));
}

}  // namespace
}  // namespace refield
