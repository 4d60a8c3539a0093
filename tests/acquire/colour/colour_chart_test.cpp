// SPDX-License-Identifier: Apache-2.0
#include "acquire/colour/colour_chart.h"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "core/base/errors.h"
#include "core/image/colour.h"
#include "tests/support/message_of.h"

namespace refield {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr int width = 480, height = 360;

/// A chart that a camera sees: patches 0.86 of their distance wide on a dark frame, before a grey wall with
/// some squares that are not of the chart.
struct Shot {
  double tilt_degrees = 0.0;   ///< about an axis in the chart's plane
  double axis_degrees = 60.0;  ///< of that axis
  double turn_degrees = 0.0;   ///< about the line of sight
  double distance = 14.0;      ///< in distances between patches
  double focal_px = 620.0;
  Eigen::Vector2d centre{0.0,
                         0.0};  ///< of the chart from the middle of the picture, distances between patches
  bool is_mirrored = false;
  Eigen::Vector3d light{1.0, 1.0, 1.0};  ///< what the camera's channels read of white, before crosstalk
  double fall_off = 0.0;                 ///< of the light, from the left edge of the chart to its right
  double noise = 0.01;                   ///< standard deviation per pixel, of white
  std::function<bool(double column, double row)> is_covered = {};

  /// The camera's channels see each other's light. Of the order that DSLRs show.
  static Eigen::Matrix3d crosstalk() {
    return (Eigen::Matrix3d() << 0.74, 0.24, 0.02, 0.14, 0.71, 0.15, 0.03, 0.25, 0.72).finished();
  }
  Eigen::Vector3d camera_of(const Eigen::Vector3d& rec709) const {
    return light.cwiseProduct(crosstalk() * rec709);
  }

  Eigen::Matrix3d image_from_chart() const {
    constexpr double degree = std::numbers::pi / 180.0;
    const Eigen::Vector3d axis(std::cos(axis_degrees * degree), std::sin(axis_degrees * degree), 0.0);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(tilt_degrees * degree, axis).toRotationMatrix() *
        Eigen::AngleAxisd(turn_degrees * degree, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    Eigen::Matrix3d pose;
    pose.col(0) = turn.col(0);
    pose.col(1) = turn.col(1);
    pose.col(2) = turn * Eigen::Vector3d(-2.5, -1.5, 0.0) + Eigen::Vector3d(centre.x(), centre.y(), distance);
    const Eigen::Matrix3d camera =
        (Eigen::Matrix3d() << focal_px, 0.0, width / 2.0, 0.0, focal_px, height / 2.0, 0.0, 0.0, 1.0)
            .finished();
    Eigen::Matrix3d flip = Eigen::Matrix3d::Identity();
    if (is_mirrored) flip.row(0) << -1.0, 0.0, width;
    return flip * camera * pose;
  }

  Eigen::Vector3d surface(const Eigen::Vector2d& at) const {
    const double column = std::round(at.x()), row = std::round(at.y());
    if (is_covered && is_covered(at.x(), at.y())) return {0.35, 0.2, 0.15};
    const bool is_patch = column >= 0 && column < 6 && row >= 0 && row < 4;
    if (is_patch && std::max(std::abs(at.x() - column), std::abs(at.y() - row)) < 0.43)
      return rec709_from_lab(chart_lab()[static_cast<std::size_t>(6 * row + column)]);
    if (at.x() > -0.8 && at.x() < 5.8 && at.y() > -0.8 && at.y() < 3.8)
      return Eigen::Vector3d::Constant(0.02);
    if (std::fmod(std::abs(at.x()), 5.0) < 1.2 && std::fmod(std::abs(at.y()), 4.0) < 1.2)
      return {0.5, 0.45, 0.3};
    return Eigen::Vector3d::Constant(0.25);
  }

  Photograph take() const {
    Photograph photograph{Image(width, height, 3), {}};
    const Eigen::Matrix3d chart_from_image = image_from_chart().inverse();
    std::mt19937 generator(7);
    std::normal_distribution<double> normal;
    constexpr int samples = 3;  // a pixel's side
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        for (int i = 0; i < samples * samples; ++i) {
          const Eigen::Vector2d at =
              (chart_from_image *
               Eigen::Vector3d(x + (i % samples + 0.5) / samples, y + (i / samples + 0.5) / samples, 1.0))
                  .hnormalized();
          sum += (1.0 + fall_off * (at.x() - 2.5) / 6.0) * surface(at) / (samples * samples);
        }
        const Eigen::Vector3d seen = camera_of(sum);
        for (int c = 0; c < 3; ++c)
          photograph.radiance.at(x, y, c) =
              static_cast<float>(seen[c] + noise * light[c] * normal(generator));
      }
    return photograph;
  }
};

/// What the channels of a camera with a daylight balance read of white under daylight, a tungsten light and
/// a monitor's white.
const std::array<Eigen::Vector3d, 3> lights = {
    Eigen::Vector3d(1.0, 1.0, 1.0), Eigen::Vector3d(1.55, 1.0, 0.42), Eigen::Vector3d(0.55, 1.0, 0.83)};

TEST(ColourChart, IsFoundAndFittedAtAllTiltsUnderThreeLights) {
  std::array<double, 4> largest{};
  int shots = 0;
  for (const Eigen::Vector3d& light : lights)
    for (const double tilt : {5.0, 15.0, 25.0, 40.0}) {
      Shot shot;
      shot.light = light;
      shot.tilt_degrees = tilt;
      shot.axis_degrees = 50.0 * shots;
      shot.turn_degrees = 30.0 * shots++;
      SCOPED_TRACE("tilt " + std::to_string(tilt) + ", turn " + std::to_string(shot.turn_degrees));
      const ColourChart chart = find_colour_chart(shot.take(), "chart");
      for (const auto& [column, row] : {std::pair{0, 0}, {5, 0}, {0, 3}, {5, 3}}) {
        const Eigen::Vector2d truth =
            (shot.image_from_chart() * Eigen::Vector3d(column, row, 1.0)).hnormalized();
        EXPECT_LT((chart.point(column, row) - truth).norm(), 3.0) << "corner " << column << ", " << row;
      }
      const ColourFit fit = fit_colour(chart, "chart");
      EXPECT_LE(fit.median_delta_e(), 1.0);
      EXPECT_LE(fit.largest_delta_e(), 3.0);
      largest[0] = std::max(largest[0], fit.median_delta_e());
      largest[1] = std::max(largest[1], fit.largest_delta_e());
      // Without the noise that the fit has seen: the colours of the patches through the true camera.
      double worst = 0.0;
      const Eigen::Vector3d white = shot.camera_of(Eigen::Vector3d::Ones());
      for (const Eigen::Vector3d& lab : chart_lab()) {
        const Eigen::Vector3d shown =
            fit.rec709_from_camera * shot.camera_of(rec709_from_lab(lab)) / white[1];
        worst = std::max(worst, delta_e_2000(lab_from_rec709(shown), lab));
      }
      EXPECT_LE(worst, 2.0);
      largest[2] = std::max(largest[2], worst);
    }
  std::printf("largest of %d shots: median %.2f, largest %.2f; through the true camera %.2f\n", shots,
              largest[0], largest[1], largest[2]);
}

TEST(ColourChart, LightThatFallsOffDoesNotCountAsColour) {
  Shot shot;
  shot.tilt_degrees = 10.0;
  shot.fall_off = 0.3;
  const ColourFit fit = fit_colour(find_colour_chart(shot.take(), "chart"), "chart");
  EXPECT_NEAR(fit.light_change, (1.0 + 0.3 * 2.5 / 6.0) / (1.0 - 0.3 * 2.5 / 6.0) - 1.0, 0.03);
  EXPECT_LE(fit.largest_delta_e(), 3.0);
}

TEST(ColourChart, GreyKeepsItsGreen) {
  Shot shot;
  shot.light = lights[1];
  const ColourFit fit = fit_colour(find_colour_chart(shot.take(), "chart"), "chart");
  const Eigen::Vector3d grey = shot.camera_of(Eigen::Vector3d::Constant(0.4));
  EXPECT_LT((fit.rec709_from_camera * grey / grey[1] - Eigen::Vector3d::Ones()).cwiseAbs().maxCoeff(), 0.02);
}

TEST(ColourChart, SmallOnesAreFound) {
  Shot shot;
  shot.tilt_degrees = 20.0;
  shot.distance = 45.0;  // 14 pixels from patch to patch
  const ColourFit fit = fit_colour(find_colour_chart(shot.take(), "chart"), "chart");
  EXPECT_LE(fit.median_delta_e(), 1.5);
}

std::string refusal(const Shot& shot) {
  return test::message_of([&] { fit_colour(find_colour_chart(shot.take(), "shot.exr"), "shot.exr"); });
}

TEST(ColourChart, SaysWhyThereIsNone) {
  Shot mirrored;
  mirrored.tilt_degrees = 15.0;
  mirrored.is_mirrored = true;
  EXPECT_THAT(refusal(mirrored), AllOf(HasSubstr("shot.exr"), HasSubstr("mirrored")));

  Shot cut;
  cut.centre = {-4.5, 0.0};
  EXPECT_THAT(refusal(cut), HasSubstr("outside of the picture"));

  Shot hidden;  // a finger over two patches
  hidden.is_covered = [](double column, double row) { return std::abs(column - 2.0) < 0.35 && row > 1.7; };
  EXPECT_THAT(refusal(hidden), AllOf(HasSubstr("red"), HasSubstr("neutral 6.5")));

  Shot gone;
  gone.is_covered = [](double, double) { return true; };
  EXPECT_THAT(refusal(gone), HasSubstr("no chart of 24 patches was found"));
}

TEST(ColourChart, NamesClippedPatches) {
  Photograph photograph = Shot{}.take();
  // Without sigma: the sensor's limit; with it: unmeasured samples.
  for (float& value : photograph.radiance.values) value = std::min(value, 0.75f);
  const auto text = [&] { return test::message_of([&] { find_colour_chart(photograph, "shot.exr"); }); };
  EXPECT_THAT(text(), AllOf(HasSubstr("white"), HasSubstr("clipped")));
  photograph = Shot{}.take();
  photograph.sigma = Image(width, height, 3, 0.01f);
  for (std::size_t i = 0; i < photograph.sigma.values.size(); ++i)
    if (photograph.radiance.values[i] > 0.75f)
      photograph.sigma.values[i] = std::numeric_limits<float>::infinity();
  EXPECT_THAT(text(), AllOf(HasSubstr("white"), HasSubstr("clipped")));
}

TEST(ColourChart, AGridOfOtherColoursIsNotAChart) {
  Photograph photograph = Shot{}.take();
  for (std::size_t i = 0; i < photograph.radiance.values.size(); i += 3)
    std::swap(photograph.radiance.values[i], photograph.radiance.values[i + 1]);
  // Red and green swapped is a linear camera, too: the fit takes it. Squares of the brightness are none.
  EXPECT_NO_THROW(find_colour_chart(photograph, "shot.exr"));
  photograph = Shot{}.take();
  for (std::size_t i = 0; i < photograph.radiance.values.size(); i += 3)
    std::rotate(&photograph.radiance.values[i], &photograph.radiance.values[i] + (i / 3 % width) / 80 % 3,
                &photograph.radiance.values[i] + 3);
  EXPECT_THAT(test::message_of([&] { find_colour_chart(photograph, "shot.exr"); }),
              HasSubstr("not those of the chart"));
}

}  // namespace
}  // namespace refield
