// SPDX-License-Identifier: Apache-2.0
// Relighting by spherical harmonics, growth with order and vertices: a cube map of 32 texels per face becomes
// coefficients, and those every vertex' light; glossy ones give order² harmonics of it. The figure made by
// formula has 10 · n² + 2 vertices and 20 · n² triangles. Beside the time stands the error against the same
// in double; 256 directions are enough here, since their number does not change the work of a frame.
#include <benchmark/benchmark.h>

#include "bench/relight/environment_bench.h"
#include "core/base/rng.h"
#include "core/image/metrics.h"
#include "core/light/cube_map.h"
#include "relight/mesh/mesh_view.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
#include "simulate/geometry/mesh_shapes.h"
#include "simulate/prt/harmonic_transfer.h"

namespace {

using refield::FieldRows;
using refield::Image;
using refield::LightMap;
namespace prt = refield::prt;

constexpr int face = 32;

FieldRows rabbit_field(int order, int size, bool glossy) {
  prt::Scene scene;
  scene.mesh = prt::rabbit_mesh(size);
  scene.materials = {glossy ? prt::Material{{0.0f, 0.0f, 0.0f}, {0.5f, 0.5f, 0.5f}, 20.0f} : prt::Material{}};
  scene.material_of_vertex.assign(scene.mesh.positions.size(), 0);
  prt::sort_vertices(scene);
  prt::HarmonicStatistics statistics;
  const prt::HarmonicOptions options{.order = order, .directions = 256, .until = 1.0};
  return prt::harmonic_field(scene, prt::harmonic_transfer(scene, options, statistics), face);
}

LightMap random_cube(std::uint64_t seed) {
  refield::Rng rng(seed);
  LightMap light{Image(face, 6 * face, 3), refield::Parameterisation::cube};
  for (float& value : light.radiance.values) value = static_cast<float>(rng.uniform());
  return light;
}

void Harmonics(benchmark::State& state, bool glossy) {
  const FieldRows rows =
      rabbit_field(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)), glossy);
  refield::TileRelighter relighter(refield::pack_rows(rows, 8));
  const LightMap lights[] = {random_cube(3), random_cube(4)};
  std::size_t frame = 0;
  const Image* image = nullptr;
  for (auto _ : state) image = &relighter.relight(lights[frame++ % 2]);
  const refield::ReflectanceField whole{rows.outline, rows.rows({0, rows.outline.height})};
  state.counters["relative_rmse"] = relative_rmse(*image, whole.relight(lights[(frame - 1) % 2]));
  state.counters["MB_per_frame"] =
      static_cast<double>(refield::bench::bytes_per_frame(relighter, *image)) / 1e6;
  state.counters["frames_per_second"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.SetLabel(std::to_string(rows.outline.mesh->positions.size()) + " vertices");
}
BENCHMARK_CAPTURE(Harmonics, diffuse, false)
    ->ArgNames({"order", "size"})
    ->ArgsProduct({{2, 3, 4, 5, 6, 8}, {50}})
    ->ArgsProduct({{5}, {25, 100}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Harmonics, glossy, true)
    ->ArgNames({"order", "size"})
    ->ArgsProduct({{3, 4, 5, 6}, {50}})
    ->ArgsProduct({{5}, {25}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// The coefficients alone.
void HarmonicsOfLight(benchmark::State& state) {
  const refield::LightBasis basis{
      refield::cube_domain(face), {}, {}, refield::Measure::solid_angle, {static_cast<int>(state.range(0))}};
  const refield::SmoothProjector projector(basis);
  LightMap light = random_cube(3);
  Image weighed;
  for (auto _ : state) {
    weighed = light.radiance;
    projector.weigh(weighed, {0, 0, face, 6 * face});
    benchmark::DoNotOptimize(projector.project(weighed, {0, 0, face, 6 * face}));
  }
}
BENCHMARK(HarmonicsOfLight)->Arg(3)->Arg(5)->Arg(8)->Unit(benchmark::kMillisecond)->UseRealTime();

/// What comes before: the cube map of an area light of 642 corners.
void MapOfAreaLight(benchmark::State& state) {
  refield::Mesh area_light = prt::sphere_mesh(8);
  for (auto& position : area_light.positions) position += Eigen::Vector3f(1.0f, 2.0f, 0.5f);
  for (auto _ : state) benchmark::DoNotOptimize(refield::emitter_map(area_light, {0.0f, 0.0f, 0.0f}, face));
}
BENCHMARK(MapOfAreaLight)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
