// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/surface.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/base/rng.h"

namespace refield {
namespace {

using Eigen::Vector3f;
using Kind = MaterialDescription::Kind;

// A floor of one material under a small monitor.
SceneDescription floor_of(MaterialDescription material) {
  SceneDescription scene;
  scene.camera.width = scene.camera.height = 1;
  scene.camera.position = {0, 1, 1};
  scene.camera.target = {0, 0, 0};
  scene.monitor.texels = {16, 16, Parameterisation::monitor};
  scene.monitor.centre = {5, 1, 0};
  scene.monitor.facing = {-1, 0, 0};
  material.name = "it";
  scene.materials = {material};
  ObjectDescription floor;
  floor.shape = ObjectDescription::Shape::plane;
  floor.material = "it";
  floor.place.stretch = {4.0f, 1.0f, 4.0f};
  scene.objects = {floor};
  return scene;
}

Vector3f direction(double theta, double phi) {
  return Eigen::Vector3d(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi))
      .cast<float>();
}

struct Looked {
  TabletopScene scene;
  Surface surface;
  Looked(const SceneDescription& d, const Vector3f& to_viewer)
      : scene(d), surface(scene, *scene.intersect({to_viewer, -to_viewer}), to_viewer) {}
};

// Reflected share of light from everywhere, or by reciprocity of light from the viewer: midpoints over the
// sphere.
double albedo(const Surface& surface) {
  constexpr int steps = 800;
  double sum = 0.0;
  for (int i = 0; i < steps; ++i)
    for (int j = 0; j < steps; ++j) {
      const double cosine = -1.0 + 2.0 * (i + 0.5) / steps, phi = 2.0 * std::numbers::pi * (j + 0.5) / steps;
      sum += surface.scattering(direction(std::acos(cosine), phi))[0];
    }
  return sum * 4.0 * std::numbers::pi / (steps * steps);
}

class Materials : public testing::TestWithParam<std::tuple<Kind, double>> {
 protected:
  MaterialDescription material() const {
    MaterialDescription m;
    m.kind = std::get<0>(GetParam());
    m.colour = Rgb::Constant(1.0f);  // the hardest case for energy
    m.roughness = std::get<1>(GetParam());
    return m;
  }
};

TEST_P(Materials, NeverSendOutMoreLightThanArrives) {
  for (double degrees : {5.0, 45.0, 75.0}) {
    const Looked at(floor_of(material()), direction(degrees * std::numbers::pi / 180.0, 0.3));
    const double a = albedo(at.surface);
    EXPECT_LE(a, 1.01) << degrees;  // quadrature of a narrow lobe errs by less than a per cent
    EXPECT_GE(a, 0.6) << degrees;   // ... and the lobe was not missed
  }
}

TEST_P(Materials, SamplesIntegrateToTheAlbedo) {
  const Looked at(floor_of(material()), direction(0.9, 0.3));
  Rng rng(3);
  constexpr int count = 40000;
  double sum = 0.0, square = 0.0;
  for (int i = 0; i < count; ++i) {
    const auto sample =
        at.surface.sample(static_cast<float>(rng.uniform()), static_cast<float>(rng.uniform()),
                          static_cast<float>(rng.uniform()));
    const double w = sample ? sample->weight[0] : 0.0;
    sum += w;
    square += w * w;
  }
  const double mean = sum / count, error = std::sqrt((square / count - mean * mean) / count);
  EXPECT_NEAR(mean, albedo(at.surface), 5.0 * error + 0.01);
}

TEST_P(Materials, AreReciprocal) {
  const Vector3f a = direction(0.4, 0.2), b = direction(1.1, 2.5);
  const Looked from_a(floor_of(material()), a), from_b(floor_of(material()), b);
  const float forth = from_a.surface.scattering(b)[0] / b.y(), back = from_b.surface.scattering(a)[0] / a.y();
  EXPECT_NEAR(forth, back, 1e-4f * forth);
}

INSTANTIATE_TEST_SUITE_P(All, Materials,
                         testing::Values(std::tuple{Kind::diffuse, 0.5}, std::tuple{Kind::glossy, 0.3},
                                         std::tuple{Kind::glossy, 0.7}, std::tuple{Kind::metal, 0.35},
                                         std::tuple{Kind::metal, 0.7}, std::tuple{Kind::translucent, 0.5}));

TEST(Fresnel, KnownValues) {
  EXPECT_NEAR(dielectric_reflectance(1.0f, 1.0f / 1.5f), 0.04f, 1e-5f);   // ((n−1)/(n+1))²
  EXPECT_NEAR(dielectric_reflectance(0.01f, 1.0f / 1.5f), 0.95f, 0.02f);  // grazing
  const float critical = std::sqrt(1.0f - 1.0f / (1.5f * 1.5f));
  EXPECT_FLOAT_EQ(dielectric_reflectance(critical - 0.01f, 1.5f), 1.0f);  // total reflection
  EXPECT_FALSE(refracted(Vector3f(0.9f, -0.43589f, 0.0f).normalized(), Vector3f::UnitY(), 1.5f));
}

TEST(Fresnel, SnellsLawAndTheWayBack) {
  for (double degrees : {10.0, 35.0, 60.0, 85.0}) {
    const double theta = degrees * std::numbers::pi / 180.0;
    const Vector3f in(static_cast<float>(std::sin(theta)), static_cast<float>(-std::cos(theta)), 0.0f);
    const auto through = refracted(in, Vector3f::UnitY(), 1.0f / 1.5f);
    ASSERT_TRUE(through);
    EXPECT_NEAR(through->x(), std::sin(theta) / 1.5, 1e-6);
    EXPECT_LT(through->y(), 0.0f);
    const auto back = refracted(-*through, -Vector3f::UnitY(), 1.5f);  // the same path the other way round
    ASSERT_TRUE(back);
    EXPECT_LT((*back + in).norm(), 1e-5f);
    // The same share is reflected from both sides.
    EXPECT_NEAR(dielectric_reflectance(static_cast<float>(std::cos(theta)), 1.0f / 1.5f),
                dielectric_reflectance(-through->y(), 1.5f), 1e-5f);
  }
}

}  // namespace
}  // namespace refield
