// SPDX-License-Identifier: Apache-2.0
#include "simulate/tabletop/light_transport.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "simulate/tabletop/simulate.h"
#include "simulate/tabletop/surface.h"

namespace refield {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using Kind = MaterialDescription::Kind;
using Shape = ObjectDescription::Shape;

// One pixel that looks through a pinhole at `target`; so narrow that it sees a point.
SceneDescription one_pixel(const Vector3d& from, const Vector3d& target) {
  SceneDescription scene;
  scene.camera = {.width = 1, .height = 1, .position = from, .target = target, .vertical_fov_degrees = 0.01};
  scene.monitor.texels = {64, 48, Parameterisation::monitor};
  scene.monitor.width_m = 0.8;
  scene.monitor.height_m = 0.6;
  return scene;
}

MaterialDescription material(Kind kind, const Rgb& colour) {
  return {.name = "it", .kind = kind, .colour = colour};
}

// A vertical square about `centre` that faces +z, turned about y.
ObjectDescription upright_square(const Vector3d& centre, double side, double turn_degrees = 0.0) {
  const auto length = static_cast<float>(side);
  return {.shape = Shape::plane,
          .material = "it",
          .place = {.stretch = {length, 1.0f, length},
                    .turn = {.yaw = turn_degrees, .pitch = 90.0},
                    .position = centre.cast<float>()}};
}

PixelTransport trace(const SceneDescription& description, const TraceOptions& options) {
  const TabletopScene scene(description);
  const LightHierarchy hierarchy(description.monitor.texels);
  TraceScratch scratch(hierarchy);
  return trace_pixel(scene, hierarchy, options, 0, 0, scratch);
}

// The pixel under a light, T · L by its definition.
Rgb under(const PixelTransport& pixel, const LightHierarchy& hierarchy, const Image& light) {
  Rgb sum = Rgb::Zero();
  for (const TransportEntry& entry : pixel.entries) {
    const Box box = hierarchy.box(entry.node);
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < 3; ++c) sum[c] += entry.weight[c] * light.at(x, y, c);
  }
  return sum;
}

Rgb under_white(const PixelTransport& pixel, const LightDomain& domain) {
  return under(pixel, LightHierarchy(domain), Image(domain.width, domain.height, 3, 1.0f));
}

// Form factor from a point to a parallel rectangle with one corner straight above it (Howell, A Catalog of
// Radiation Heat Transfer Configuration Factors, B-3).
double corner_form_factor(double a, double b, double distance) {
  const double x = a / distance, y = b / distance, u = std::sqrt(1 + x * x), v = std::sqrt(1 + y * y);
  return (x / u * std::atan(y / u) + y / v * std::atan(x / v)) / (2.0 * std::numbers::pi);
}

TEST(LightTransport, DiffuseSurfaceFacingTheMonitorHasItsFormFactor) {
  for (double distance : {0.25, 0.6, 2.0}) {
    SceneDescription scene = one_pixel({1.0, 0.0, 0.15}, {0, 0, 0});
    scene.materials = {material(Kind::diffuse, {0.8f, 0.5f, 0.2f})};
    scene.objects = {upright_square({0, 0, 0}, 0.1)};
    scene.monitor.centre = {0, 0, distance};
    scene.monitor.facing = {0, 0, -1};
    const double form_factor = 4.0 * corner_form_factor(0.4, 0.3, distance);
    const Rgb found = under_white(trace(scene, {}), scene.monitor.texels);
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(found[c] / scene.materials[0].colour[c], form_factor, 0.01 * form_factor) << distance;
  }
}

TEST(LightTransport, EveryPartOfTheMonitorCountsWithItsOwnShare) {
  // The left half alone, seen from below its right edge: a quarter has a closed form again.
  SceneDescription scene = one_pixel({1.0, 0.0, 0.15}, {0, 0, 0});
  scene.materials = {material(Kind::diffuse, Rgb::Ones())};
  scene.objects = {upright_square({0, 0, 0}, 0.1)};
  scene.monitor.centre = {0, 0, 0.5};
  scene.monitor.facing = {0, 0, -1};
  const PixelTransport pixel = trace(scene, {});
  const LightHierarchy hierarchy(scene.monitor.texels);
  Image corner(64, 48, 3);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 32; ++x)
      for (int c = 0; c < 3; ++c) corner.at(x, y, c) = 1.0f;
  const double expected = corner_form_factor(0.4, 0.3, 0.5);
  EXPECT_NEAR(under(pixel, hierarchy, corner)[0], expected, 0.01 * expected);
}

TEST(LightTransport, MirrorShowsTheRightTexel) {
  SceneDescription scene = one_pixel({-1.0, 0.2, 1.0}, {0.02, 0.01, 0});
  scene.materials = {material(Kind::mirror, {0.9f, 0.8f, 0.7f})};
  scene.objects = {upright_square({0, 0, 0}, 0.5)};
  scene.monitor.centre = {1.0, -0.15, 1.0};
  scene.monitor.facing = {-1, 0, -1};
  const PixelTransport pixel = trace(scene, {});
  // By hand: mirrored in the plane z = 0, the ray meets the monitor's plane.
  const Vector3d start(0.02, 0.01, 0),
      direction = (start - Vector3d(-1.0, 0.2, 1.0)).cwiseProduct(Vector3d(1, 1, -1));
  const Vector3d normal = scene.monitor.facing.normalized();
  const double t = (scene.monitor.centre - start).dot(normal) / direction.dot(normal);
  const Vector3d offset = start + t * direction - scene.monitor.centre;
  const Vector3d right = Vector3d::UnitY().cross(normal);
  const int x = static_cast<int>(std::floor((offset.dot(right) / 0.8 + 0.5) * 64));
  const int y = static_cast<int>(std::floor((0.5 - offset.y() / 0.6) * 48));
  ASSERT_EQ(pixel.entries.size(), 1u);
  EXPECT_EQ(LightHierarchy(scene.monitor.texels).box(pixel.entries[0].node), (Box{x, y, x + 1, y + 1}));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(pixel.entries[0].weight[c], scene.materials[0].colour[c], 1e-5f);
}

TEST(LightTransport, GlassPaneTransmitsAndShiftsLightAsItShould) {
  // At normal incidence a pane transmits (1 − R)/(1 + R), R = 0.04, with all its inner reflections.
  SceneDescription scene = one_pixel({0, 0, 1}, {0, 0, 0});
  scene.materials = {material(Kind::glass, Rgb::Ones())};
  ObjectDescription pane{.shape = Shape::box, .material = "it", .place = {.stretch = {1.0f, 1.0f, 0.1f}}};
  scene.objects = {pane};
  scene.monitor.centre = {0.003, 0.003, -1.0};
  scene.monitor.facing = {0, 0, 1};
  constexpr int grid = 40;
  TraceOptions options;
  options.specular_grid = grid;
  const Rgb straight = under_white(trace(scene, options), scene.monitor.texels);
  // Of grid² paths, each is reflected within with probability R: binomial spread.
  EXPECT_NEAR(straight[0], 0.96 / 1.04, 4.0 * std::sqrt(0.04 * 0.96) / grid);

  // At 45° Snell's law shifts the ray by thickness · (tan 45° − tan θ') sideways.
  scene.camera.position = {1, 0, 1};
  scene.monitor.centre = {-1, 0, -1};
  const PixelTransport oblique = trace(scene, options);
  const double inner = std::asin(std::sin(std::numbers::pi / 4) / 1.5);
  const double x_on_monitor_plane = -1.0 + 0.05 - 0.05 + 0.1 * (1.0 - std::tan(inner));
  const int texel = static_cast<int>(std::floor(((x_on_monitor_plane + 1.0) / 0.8 + 0.5) * 64));
  double there = 0.0, all = 0.0;
  for (const TransportEntry& entry : oblique.entries) {
    const Box box = LightHierarchy(scene.monitor.texels).box(entry.node);
    all += entry.weight[0];
    if (box.x0 == texel) there += entry.weight[0];
  }
  EXPECT_GT(there, 0.9 * all);  // the rest was reflected within and leaves further along
  EXPECT_LE(all, 1.0 + 1e-5);
  EXPECT_GT(all, 0.85);
}

TEST(LightTransport, AmbientLightOfAnOpenFloorIsItsAlbedoTimesTheRoom) {
  SceneDescription scene = one_pixel({0, 0, 1}, {0, 0, 0});
  scene.materials = {material(Kind::diffuse, {0.6f, 0.4f, 0.2f})};
  scene.objects = {upright_square({0, 0, 0}, 0.5)};
  scene.monitor.centre = {0, 0, 100};  // out of the way
  scene.monitor.facing = {0, 0, -1};
  scene.ambient_radiance = {0.5f, 1.0f, 2.0f};
  const PixelTransport pixel = trace(scene, {});
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(pixel.ambient[c], scene.materials[0].colour[c] * scene.ambient_radiance[c], 1e-4);
}

// A floor, a wall and a block between floor and monitor: shadow and interreflection, all diffuse.
SceneDescription corner_scene() {
  SceneDescription scene = one_pixel({-0.6, 0.8, 1.2}, {0, 0, 0});
  scene.materials = {material(Kind::diffuse, {0.8f, 0.6f, 0.4f})};
  scene.objects = {
      {.shape = Shape::plane, .material = "it", .place = {.stretch = {3.0f, 1.0f, 3.0f}}},
      upright_square({0, 0.5, -0.3}, 2.0),
      {.shape = Shape::box,
       .material = "it",
       .place = {.stretch = {0.1f, 0.2f, 0.12f}, .position = Eigen::Vector3f(0.25f, 0.1f, 0.0f)}}};
  scene.monitor.centre = {0.8, 0.4, 0.1};
  scene.monitor.facing = {-1, -0.2, 0};
  return scene;
}

// Radiance along a ray by path tracing without any shortcut: directions by the cosine, light only where a
// path happens to meet the monitor. Independent of trace_pixel in everything but the scene.
Rgb brute_force_path(const TabletopScene& scene, const Image& light, Ray ray, int surfaces, Rng& rng) {
  Rgb throughput = Rgb::Ones();
  for (int k = 0; k <= surfaces; ++k) {
    const auto hit = scene.intersect(ray);
    if (!hit) return Rgb::Zero();
    if (hit->is_monitor()) {
      if (ray.direction.dot(scene.monitor().normal()) >= 0.0f) return Rgb::Zero();
      const Eigen::Vector2i t = scene.monitor().texel_at(hit->position);
      return throughput *
             Rgb(light.at(t.x(), t.y(), 0), light.at(t.x(), t.y(), 1), light.at(t.x(), t.y(), 2));
    }
    throughput *= scene.material_of(hit->object).colour;
    const Vector3f n = hit->geometric_normal.dot(ray.direction) < 0 ? hit->geometric_normal
                                                                    : (-hit->geometric_normal).eval();
    // Normal plus a point on the unit sphere: distributed by the cosine.
    const double z = rng.uniform(-1, 1), phi = rng.uniform(0, 2 * std::numbers::pi), r = std::sqrt(1 - z * z);
    const Vector3f direction =
        (n + Vector3d(r * std::cos(phi), r * std::sin(phi), z).cast<float>()).normalized();
    ray = {hit->position + 1e-4f * n, direction};
  }
  return Rgb::Zero();
}

TEST(LightTransport, AgreesWithBruteForceMonteCarlo) {
  SceneDescription description = corner_scene();
  const TabletopScene scene(description);
  const LightHierarchy hierarchy(description.monitor.texels);
  Image light(64, 48, 3);  // blocks of random colour, and a bright bar
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x)
      for (int c = 0; c < 3; ++c)
        light.at(x, y, c) =
            static_cast<float>(Rng(4, x / 5, y / 7, c).uniform()) + (x / 8 == 3 ? 1.0f : 0.0f);

  constexpr int paths = 150000, repeats = 12;
  Eigen::Array3d sum = Eigen::Array3d::Zero(), square = sum;
  Rng rng(17);
  TraceOptions options;
  for (int i = 0; i < paths; ++i) {
    const Eigen::Array3d b =
        brute_force_path(scene, light, scene.camera_ray(0.5f, 0.5f), options.depth + 1, rng).cast<double>();
    sum += b;
    square += b * b;
  }
  const Eigen::Array3d expected = sum / paths,
                       expected_variance = (square / paths - expected * expected) / paths;

  Eigen::Array3d mean = Eigen::Array3d::Zero(), mean_square = mean;
  TraceScratch scratch(hierarchy);
  for (int k = 0; k < repeats; ++k) {
    options.seed = 100 + k;
    const Eigen::Array3d b =
        under(trace_pixel(scene, hierarchy, options, 0, 0, scratch), hierarchy, light).cast<double>();
    mean += b / repeats;
    mean_square += b * b / repeats;
  }
  const Eigen::Array3d variance = (mean_square - mean * mean) / (repeats - 1);
  for (int c = 0; c < 3; ++c)  // four standard errors, and half a per cent for boxes along the shadow's edge
    EXPECT_NEAR(mean[c], expected[c],
                4.0 * std::sqrt(variance[c] + expected_variance[c]) + 0.005 * expected[c]);
}

TEST(LightTransport, BoxesAreFineNonNegativeAndEnergyIsBounded) {
  SceneDescription scene = corner_scene();
  scene.camera.width = scene.camera.height = 8;
  scene.camera.vertical_fov_degrees = 20;  // the monitor itself is out of view
  const TracedScene traced = trace_scene(scene, {});
  for (float w : traced.transport.transfer.weight) ASSERT_GE(w, 0.0f);
  for (const Box& box : traced.transport.basis.boxes) ASSERT_LE(box.width(), scene.monitor.texels.width / 16);
  const LightMap white{Image(64, 48, 3, 1.0f), Parameterisation::monitor};
  const Image image = traced.transport.relight(white);
  for (std::size_t i = 0; i < image.values.size(); ++i) {
    // No surface is brighter than its albedo lets it be under light of radiance 1 from everywhere.
    EXPECT_LE(image.values[i], scene.materials[0].colour[static_cast<int>(i % 3)]);
    EXPECT_GT(image.values[i], 0.0f);
  }
}

TEST(LightTransport, ShadowEdgesAreResolvedToSingleTexels) {
  const SceneDescription scene = corner_scene();
  TraceOptions options;
  options.energy = 0.0;
  const PixelTransport pixel = trace(scene, options);
  const LightHierarchy hierarchy(scene.monitor.texels);
  int single = 0;
  for (const TransportEntry& entry : pixel.entries) single += hierarchy.box(entry.node).area() == 1;
  EXPECT_GT(single, 40);
}

TEST(LightTransport, DoesNotDependOnTheNumberOfThreads) {
  SceneDescription scene = corner_scene();
  scene.camera.width = 12;
  scene.camera.height = 10;
  scene.camera.vertical_fov_degrees = 40;
  const TracedScene many = trace_scene(scene, {});
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const TracedScene single = trace_scene(scene, {});
  EXPECT_EQ(many.transport.basis.boxes, single.transport.basis.boxes);
  EXPECT_EQ(many.transport.transfer.column, single.transport.transfer.column);
  EXPECT_EQ(many.transport.transfer.weight, single.transport.transfer.weight);
  EXPECT_EQ(many.ambient.values, single.ambient.values);
}

TEST(LightTransport, QualityIsOneToThree) {
  EXPECT_NO_THROW(TraceOptions::of_quality(3, 1));
  EXPECT_THROW(TraceOptions::of_quality(0, 1), InputError);
  EXPECT_THROW(TraceOptions::of_quality(4, 1), InputError);
}

}  // namespace
}  // namespace refield
