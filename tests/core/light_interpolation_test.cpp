// SPDX-License-Identifier: Apache-2.0
// Interpolation between the sources of a light stage, on a generated one: a sphere under 80 sources.
#include "core/field/light_interpolation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <set>
#include <vector>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/base/units.h"
#include "core/field/light_error.h"
#include "core/field/reflectance_field.h"

namespace refield {
namespace {

constexpr LightDomain domain{256, 128, Parameterisation::lat_long};
constexpr double dome_degrees = 70.0;  // from −Z, where the camera is
constexpr int source_count = 80;       // about 13° apart
constexpr int side = 12;               // of the picture

/// Radiance of a point with this normal per irradiance from a direction, both in the axes of light maps.
using Reflectance = std::function<double(const Eigen::Vector3d& normal, const Eigen::Vector3d& light)>;

double lambert(const Eigen::Vector3d& normal, const Eigen::Vector3d& light) {
  return std::max(0.0, normal.dot(light));
}
/// With a highlight: the higher the exponent, the narrower.
Reflectance glossy(double exponent) {
  return [=](const Eigen::Vector3d& normal, const Eigen::Vector3d& light) {
    const Eigen::Vector3d half = (light - Eigen::Vector3d::UnitZ()).normalized();
    return 0.05 * lambert(normal, light) + std::pow(std::max(0.0, normal.dot(half)), exponent);
  };
}
/// Behind a wall: each point is lit from one side of an edge only, the edge being another for each point.
double behind_wall(const Eigen::Vector3d& normal, const Eigen::Vector3d& light) {
  return light.x() > 0.5 * normal.x() ? lambert(normal, light) : 0.0;
}

double shadowed_gloss(const Eigen::Vector3d& normal, const Eigen::Vector3d& light) {
  return light.x() > 0.5 * normal.x() ? glossy(30.0)(normal, light) : 0.0;
}

Eigen::Vector3d direction_of(int x, int y) {
  return lat_long_direction(x + 0.5, y + 0.5, domain.width, domain.height);
}
double degrees_from_axis(const Eigen::Vector3d& direction) {
  return degrees_from_radians(std::acos(std::clamp(-direction.z(), -1.0, 1.0)));
}

/// Of the pixels of a sphere seen from −Z.
std::vector<Eigen::Vector3d> normals() {
  std::vector<Eigen::Vector3d> all;
  for (int row = 0; row < side; ++row)
    for (int column = 0; column < side; ++column) {
      const Eigen::Vector2d at((2.0 * column + 1.0) / side - 1.0, 1.0 - (2.0 * row + 1.0) / side);
      const Eigen::Vector2d on = 0.65 * at;  // inside the disc
      all.emplace_back(on.x(), on.y(), -std::sqrt(1.0 - on.squaredNorm()));
    }
  return all;
}

std::vector<Box> dome_sources() {
  std::vector<Box> sources;
  const double lowest = std::cos(radians_from_degrees(dome_degrees));
  for (int i = 0; i < source_count; ++i) {
    const double z = 1.0 - (i + 0.5) / source_count * (1.0 - lowest), radius = std::sqrt(1.0 - z * z);
    const double angle = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
    const Eigen::Vector2d at = lat_long_position({radius * std::cos(angle), radius * std::sin(angle), -z},
                                                 domain.width, domain.height);
    const auto x = static_cast<int>(at.x()), y = static_cast<int>(at.y());
    sources.push_back({x, y, x + 1, y + 1});
  }
  return sources;
}

/// What estimation makes of photographs under one source at a time, with Gaussian noise of a part of each
/// pixel's mean.
ReflectanceField stage_field(const Reflectance& reflectance, double noise = 0.0) {
  ReflectanceField field;
  Rng rng(3);
  field.width = field.height = side;
  field.basis.domain = domain;
  field.basis.boxes = field.observed_light = dome_sources();
  for (const Eigen::Vector3d& normal : normals()) {
    std::vector<std::uint32_t> columns;
    std::vector<float> weights;
    double sum = 0.0;
    for (const Box& box : field.basis.boxes) sum += reflectance(normal, direction_of(box.x0, box.y0));
    for (std::uint32_t s = 0; s < source_count; ++s) {
      const Box& box = field.basis.boxes[s];
      columns.push_back(s);
      for (int c = 0; c < 3; ++c) {
        const double response =
            reflectance(normal, direction_of(box.x0, box.y0)) + noise * sum / source_count * rng.normal();
        weights.push_back(
            static_cast<float>(response * lat_long_solid_angle(box.y0, domain.width, domain.height)));
      }
    }
    field.transfer.append_row(columns, weights);
  }
  field.quality.predicted_error.assign(normals().size(), 0.0f);
  field.quality.photograph_noise = field.quality.training_signal = field.quality.predicted_error;
  field.fit_interpolation();
  return field;
}

LightMap dark() {
  return {Image(domain.width, domain.height, 3), domain.parameterisation};
}
/// One texel of irradiance 1.
LightMap light_from(int x, int y) {
  LightMap light = dark();
  for (int c = 0; c < 3; ++c)
    light.radiance.at(x, y, c) =
        static_cast<float>(1.0 / lat_long_solid_angle(y, domain.width, domain.height));
  return light;
}

/// Texels between the sources, at most so far from the axis.
std::vector<std::pair<int, int>> texels_between(int count, double max_degrees) {
  std::set<std::pair<int, int>> lit;
  for (const Box& box : dome_sources()) lit.emplace(box.x0, box.y0);
  Rng rng(7);
  std::vector<std::pair<int, int>> texels;
  while (static_cast<int>(texels.size()) < count) {
    const std::pair at(static_cast<int>(rng.uniform() * domain.width),
                       static_cast<int>(rng.uniform() * domain.height));
    if (degrees_from_axis(direction_of(at.first, at.second)) < max_degrees && !lit.contains(at))
      texels.push_back(at);
  }
  return texels;
}

/// Relative RMSE over all pixels of pictures under single lights at `texels`.
double error_at(const ReflectanceField& field, const Reflectance& reflectance,
                const std::vector<std::pair<int, int>>& texels) {
  double squared = 0.0, all = 0.0;
  for (const auto& [x, y] : texels) {
    const Image image = field.relight(light_from(x, y));
    std::size_t p = 0;
    for (const Eigen::Vector3d& normal : normals()) {
      const double expected = reflectance(normal, direction_of(x, y));
      squared += std::pow(image.values[3 * p++] - expected, 2.0);
      all += expected * expected;
    }
  }
  return std::sqrt(squared / all);
}

TEST(LightInterpolation, LambertianSphereUnderASourceBetweenTheSources) {
  const ReflectanceField field = stage_field(lambert);
  ASSERT_TRUE(field.basis.interpolation);
  // Sources 13° apart know a function of the second order well; directions near the rim are extrapolated.
  EXPECT_LT(error_at(field, lambert, texels_between(40, 60.0)), 0.01);
  EXPECT_LT(error_at(field, lambert, texels_between(40, dome_degrees)), 0.02);
  ReflectanceField without = field;
  without.basis.interpolation.reset();
  EXPECT_EQ(error_at(without, lambert, texels_between(40, 60.0)), 1.0) << "dark between the sources";
}

TEST(LightInterpolation, ConstantEnvironmentHasItsWholeEnergy) {
  const ReflectanceField field = stage_field(lambert);
  LightMap cap = dark();
  std::vector<double> expected(normals().size(), 0.0);
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x) {
      const Eigen::Vector3d direction = direction_of(x, y);
      if (degrees_from_axis(direction) > dome_degrees) continue;
      for (int c = 0; c < 3; ++c) cap.radiance.at(x, y, c) = 1.0f;
      std::size_t p = 0;
      for (const Eigen::Vector3d& normal : normals())
        expected[p++] += lambert(normal, direction) * lat_long_solid_angle(y, domain.width, domain.height);
    }
  const Image image = field.relight(cap);
  for (std::size_t p = 0; p < expected.size(); ++p)
    EXPECT_NEAR(image.values[3 * p] / expected[p], 1.0, 0.005) << "pixel " << p;
}

TEST(LightInterpolation, ASourceIsExactWhateverItsNeighboursShow) {
  const ReflectanceField field = stage_field(glossy(400.0));
  ReflectanceField without = field;
  without.basis.interpolation.reset();
  for (const int s : {0, 17, 79}) {
    const LightMap light = light_from(field.basis.boxes[s].x0, field.basis.boxes[s].y0);
    EXPECT_EQ(field.relight(light).values, without.relight(light).values);
    EXPECT_EQ(field.light_shares(light.radiance).interpolated, 0.0);
  }
}

TEST(LightInterpolation, PicturesMoveContinuouslyThroughASource) {
  const ReflectanceField field = stage_field(glossy(400.0));
  const Box& source = field.basis.boxes[20];
  const Image at = field.relight(light_from(source.x0, source.y0));
  const Image beside = field.relight(light_from(source.x0 + 1, source.y0));
  const Image far = field.relight(light_from(source.x0 + 5, source.y0));
  double near_change = 0.0, far_change = 0.0;
  for (std::size_t i = 0; i < at.values.size(); ++i) {
    near_change = std::max<double>(near_change, std::abs(beside.values[i] - at.values[i]));
    far_change = std::max<double>(far_change, std::abs(far.values[i] - at.values[i]));
  }
  EXPECT_LT(near_change, 0.35 * far_change) << "1.4° and 7° from the source";
}

TEST(LightInterpolation, LightFarFromAllSourcesHasNoEffectAndIsReported) {
  const ReflectanceField field = stage_field(lambert);
  const auto share_at = [&](double degrees) {  // to the right of the axis
    const double angle = radians_from_degrees(degrees);
    const Eigen::Vector2d at =
        lat_long_position({std::sin(angle), 0.01, -std::cos(angle)}, domain.width, domain.height);
    return light_from(static_cast<int>(at.x()), static_cast<int>(at.y()));
  };
  const LightMap between = share_at(33.0), beyond = share_at(120.0), behind = share_at(178.0);
  EXPECT_NEAR(field.light_shares(between.radiance).interpolated, 1.0, 1e-6);
  const LightShares faded = field.light_shares(beyond.radiance);
  EXPECT_GT(faded.interpolated, 0.1);
  EXPECT_GT(faded.unobserved, 0.1);
  EXPECT_NEAR(faded.interpolated + faded.unobserved, 1.0, 1e-6);
  EXPECT_NEAR(field.light_shares(behind.radiance).unobserved, 1.0, 1e-6);
  const Image image = field.relight(behind);
  EXPECT_TRUE(std::ranges::all_of(image.values, [](float value) { return value == 0.0f; }));
  // Shares are of irradiance, not of texel values, which are huge near the poles.
  LightMap one = share_at(180.0);
  for (std::size_t i = 0; i < one.radiance.values.size(); ++i)
    one.radiance.values[i] += between.radiance.values[i];
  EXPECT_NEAR(field.light_shares(one.radiance).unobserved, 0.5, 1e-6);
}

// Where interpolation fails, what changes faster than the sources stand.
TEST(LightInterpolation, ShadowEdgesAndNarrowHighlightsAreLost) {
  const auto texels = texels_between(40, 60.0);
  const auto error_of = [&](const Reflectance& reflectance) {
    return error_at(stage_field(reflectance), reflectance, texels);
  };
  EXPECT_LT(error_of(glossy(10.0)), 0.05) << "a highlight of 43° full width";
  EXPECT_GT(error_of(glossy(1000.0)), 0.4) << "a highlight of 4.3°";
  const double edges = error_of(behind_wall);
  EXPECT_GT(edges, 0.1);
  EXPECT_LT(edges, 0.4);
}

/// Smooth light with two bright spots, from the dome alone: 0 to 1, brightest 5.
LightMap natural_light(Rng& rng) {
  LightMap light = dark();
  std::vector<Eigen::Vector3d> waves, spots;
  for (int i = 0; i < 8; ++i)
    waves.emplace_back(4.0 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()));
  for (int i = 0; i < 2; ++i)
    spots.push_back(Eigen::Vector3d(0.5 * rng.normal(), 0.5 * rng.normal(), -1.0).normalized());
  for (int y = 0; y < domain.height; ++y)
    for (int x = 0; x < domain.width; ++x) {
      const Eigen::Vector3d direction = direction_of(x, y);
      if (degrees_from_axis(direction) > dome_degrees) continue;
      double value = 0.5;
      for (const Eigen::Vector3d& wave : waves) value += std::cos(wave.dot(direction)) / 16.0;
      for (const Eigen::Vector3d& spot : spots) value += 4.0 * std::exp(60.0 * (direction.dot(spot) - 1.0));
      for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(value);
    }
  return light;
}

/// Predicted to true error over all pixels and some lights, without the noise of new photographs.
double predicted_to_true(const ReflectanceField& field, const Reflectance& reflectance,
                         const std::vector<LightMap>& lights) {
  std::vector<double> squared(normals().size(), 0.0);
  double predicted = 0.0;
  for (const LightMap& light : lights) {
    const Image image = field.relight(light);
    std::vector<double> expected(squared.size(), 0.0);
    for (int y = 0; y < domain.height; ++y)
      for (int x = 0; x < domain.width; ++x) {
        if (light.radiance.at(x, y, 0) == 0.0f) continue;
        const double irradiance =
            light.radiance.at(x, y, 0) * lat_long_solid_angle(y, domain.width, domain.height);
        std::size_t p = 0;
        for (const Eigen::Vector3d& normal : normals())
          expected[p++] += irradiance * reflectance(normal, direction_of(x, y));
      }
    for (std::size_t p = 0; p < squared.size(); ++p)
      for (std::size_t c = 0; c < 3; ++c) squared[p] += std::pow(image.values[3 * p + c] - expected[p], 2.0);
    const std::vector<double> own = own_squared_error_under(field, light.radiance);
    for (std::size_t p = 0; p < own.size(); ++p) predicted += own[p];
  }
  return std::sqrt(predicted / std::accumulate(squared.begin(), squared.end(), 0.0));
}

// Photographs under single sources do not show how wrong light in between is; leaving sources out does. The
// bounds hold for real photographs, too. Noise counts as detail; reflectance without edges or noise is
// smoother than the interpolation takes it for, and its error lower than predicted.
TEST(LightInterpolation, ErrorOfLightBetweenTheSourcesIsPredicted) {
  std::vector<LightMap> between, natural;
  for (const auto& [x, y] : texels_between(24, 60.0)) between.push_back(light_from(x, y));
  Rng rng(11);
  for (int i = 0; i < 3; ++i) natural.push_back(natural_light(rng));
  const struct {
    const char* name;
    Reflectance reflectance;
    double noise;
  } stages[] = {{"edges of shadows", behind_wall, 0.0},
                {"shadows, highlights and noise", shadowed_gloss, 0.03}};
  for (const auto& stage : stages) {
    const ReflectanceField field = stage_field(stage.reflectance, stage.noise);
    ASSERT_TRUE(knows_light_error(field));
    const double single = predicted_to_true(field, stage.reflectance, between);
    const double mixed = predicted_to_true(field, stage.reflectance, natural);
    EXPECT_GT(single, 0.7) << stage.name;
    EXPECT_LT(single, 1.4) << stage.name;
    EXPECT_GT(mixed, 0.7) << stage.name;
    EXPECT_LT(mixed, 1.4) << stage.name;
    const Box& source = field.basis.boxes[20];
    for (const double own : own_squared_error_under(field, light_from(source.x0, source.y0).radiance))
      EXPECT_NEAR(own, 0.0, 1e-12);
  }
}

TEST(LightInterpolation, LengthsFollowTheScene) {
  const auto of = [](const Reflectance& reflectance) {
    return *stage_field(reflectance).basis.interpolation;
  };
  EXPECT_GT(of(lambert).length, of(behind_wall).length);
  EXPECT_LT(of(lambert).fine_share, of(glossy(1000.0)).fine_share + 1e-12);
}

TEST(LightInterpolation, SourcesOfSeveralTexelsAreLitAsAWhole) {
  ReflectanceField field = stage_field(lambert);
  LightInterpolation of = *field.basis.interpolation;
  of.sources[3].x1 += 2;  // three texels
  const LightInterpolator interpolator(of, domain);
  Image light = light_from(of.sources[3].x1 + 1, of.sources[3].y0).radiance;
  interpolator.gather(light);
  const float first = light.at(of.sources[3].x0, of.sources[3].y0, 0);
  EXPECT_GT(first, 0.0f);
  EXPECT_EQ(light.at(of.sources[3].x1 - 1, of.sources[3].y0, 0), first);
}

TEST(LightInterpolation, OnlyForSeparateSourcesInLatLongMaps) {
  const std::vector<Box> sources = dome_sources();
  EXPECT_TRUE(can_interpolate(sources, domain));
  EXPECT_FALSE(can_interpolate(sources, {domain.width, domain.height, Parameterisation::monitor}));
  EXPECT_FALSE(can_interpolate({sources.begin(), sources.begin() + 7}, domain));
  std::vector<Box> wide = sources;
  wide[0] = {0, 40, 12, 41};
  EXPECT_FALSE(can_interpolate(wide, domain)) << "17°";
  std::vector<Box> all;
  for (int x = 0; x < 8; ++x)
    for (int y = 0; y < 4; ++y) all.push_back({x, y, x + 1, y + 1});
  EXPECT_FALSE(can_interpolate(all, {8, 4, Parameterisation::lat_long})) << "nothing is dark";
  EXPECT_FALSE(fit_light_interpolation(sources, domain, Eigen::MatrixXd::Zero(source_count, 6)));
}

TEST(LightInterpolation, ImpossibleValuesAreRefused) {
  const LightInterpolation sound = *stage_field(lambert).basis.interpolation;
  EXPECT_EQ(sound.fault(domain), "");
  LightInterpolation of = sound;
  of.length = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(LightInterpolator(of, domain), InputError);
  of = sound;
  of.fine_share = 1.5;
  EXPECT_THROW(LightInterpolator(of, domain), InputError);
  of = sound;
  of.sources[0].x1 = domain.width + 1;
  EXPECT_THROW(LightInterpolator(of, domain), InputError);
  EXPECT_THROW(LightInterpolator(sound, {256, 128, Parameterisation::monitor}), InputError);
}

}  // namespace
}  // namespace refield
