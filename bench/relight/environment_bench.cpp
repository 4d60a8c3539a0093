// SPDX-License-Identifier: Apache-2.0
// From an environment map in memory to the picture on the screen: projection, relighting, shading and tone
// mapping. The field is made here: clustered environment lights over a mesh of 73 000 vertices, shown at
// 1024×768, with as many clusters and weights as docs/method/prt-clusters.md states for a scanned figure.
// Beside the time stand the error of the linear picture against the exact projection (relative RMSE) and
// `limit_ms`, the time that reading the field and writing the picture take on this machine. The captured
// field's benchmarks are in relight_bench.cpp.
//
// REFIELD_FIELD=f.rfield measures a precomputed field instead, REFIELD_ENV=map.exr with a map of your own.
#include <benchmark/benchmark.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "bench/relight/environment_bench.h"
#include "core/base/rng.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "core/image/tone_map.h"
#include "core/light/cube_map.h"
#include "relight/environment/environment.h"
#include "relight/mesh/mesh_view.h"
#include "relight/relighter.h"

namespace {

using refield::Image;
using refield::LightMap;
using refield::PreparedEnvironment;

/// Squares of a quadtree on each face: those of 1/32 of a face's width and larger ones, 16 000 in all, of
/// which each group of 64 vertices takes 300.
refield::ReflectanceField cluster_field(int resolution) {
  constexpr int side = 270, kernels = 300, levels = 6;
  refield::ReflectanceField field;
  field.basis = {refield::cube_domain(resolution), {}, {}, refield::Measure::solid_angle};
  for (int level = 0; level < levels; ++level) {
    const int squares = 1 << level, size = resolution / squares;
    for (int face = 0; face < refield::cube_faces; ++face)
      for (int y = 0; y < squares; ++y)
        for (int x = 0; x < squares; ++x)
          field.basis.boxes.push_back(
              {x * size, face * resolution + y * size, (x + 1) * size, face * resolution + (y + 1) * size});
  }
  refield::Rng rng(3);
  // Small ones as well: a half and a quarter of the finest.
  const int fine = resolution >> (levels - 1);
  for (int i = 0; i < 8000; ++i) {
    const int size = std::max(fine >> (1 + i % 2), 1);
    const auto x = static_cast<int>(rng.below(static_cast<std::uint64_t>(resolution / size))) * size;
    const auto y = static_cast<int>(rng.below(static_cast<std::uint64_t>(6 * resolution / size))) * size;
    field.basis.boxes.push_back({x, y, x + size, y + size});
  }
  refield::OutputMesh mesh;
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x) {
      const float u = static_cast<float>(x) / (side - 1) - 0.5f,
                  v = static_cast<float>(y) / (side - 1) - 0.5f;
      mesh.positions.emplace_back(u, 0.1f * std::sin(9.0f * u) * std::sin(9.0f * v), v);
      mesh.normals.emplace_back(0.0f, 1.0f, 0.0f);
      mesh.colours.emplace_back(0.7f, 0.6f, 0.5f);
      if (x + 1 < side && y + 1 < side) {
        const auto corner = static_cast<std::uint32_t>(y * side + x);
        mesh.triangles.push_back({corner, corner + side, corner + 1});
        mesh.triangles.push_back({corner + 1, corner + side, corner + side + 1});
      }
    }
  mesh.camera = refield::framing_camera(mesh, 1024, 768);
  field.width = refield::output_image_width;
  field.height = refield::output_image_height(mesh.outputs());
  field.mesh = std::move(mesh);
  constexpr std::size_t vertices = std::size_t{side} * side;
  std::vector<std::size_t> output(static_cast<std::size_t>(field.width) * field.height, vertices);
  for (std::size_t i = 0; i < vertices; ++i) output[refield::pixel_of_output(i)] = i;
  std::vector<std::uint32_t> columns(kernels);
  std::vector<float> weights(std::size_t{3} * kernels);
  const auto boxes = static_cast<std::uint32_t>(field.basis.boxes.size());
  for (const std::size_t vertex : output) {
    if (vertex >= vertices) {
      field.transfer.append_row({}, {});
      continue;
    }
    const auto first = static_cast<std::uint32_t>(vertex / 64 * 37 % (boxes / kernels));
    for (std::uint32_t k = 0; k < kernels; ++k) {
      columns[k] = first + k * (boxes / kernels);
      const auto weight = static_cast<float>(rng.uniform());
      for (std::uint32_t c = 0; c < 3; ++c) weights[3 * k + c] = weight;
    }
    field.transfer.append_row(columns, weights);
  }
  return field;
}

/// Shows a field under environments.
class Screen {
 public:
  explicit Screen(const refield::ReflectanceField& field)
      : relighter_(field),
        boxes_(relighter_.box_projector().value()),
        view_(field, *field.mesh->camera),
        rgba_(view_.camera().width * static_cast<std::size_t>(view_.camera().height) * 4) {}

  void show(const PreparedEnvironment& environment, const refield::EulerAngles& turn) {
    picture_ = view_.show(relighter_.relight(boxes_.project(environment, turn)));
    tone_map_rgba(picture_, tones_, rgba_);
  }
  Image exact(const PreparedEnvironment& environment, const refield::EulerAngles& turn) {
    const refield::EnvironmentProjector projector(relighter_.domain(), {});
    return view_.show(relighter_.relight(projector.project_exactly(environment, turn).light));
  }
  const Image& picture() const { return picture_; }
  std::size_t bytes() const {
    return std::visit([](const auto& transfer) { return transfer.bytes(); }, relighter_.transfer()) +
           picture_.values.size() * sizeof(float) + rgba_.size();
  }

 private:
  refield::TileRelighter relighter_;
  refield::BoxProjector boxes_;
  refield::MeshRenderer view_;
  refield::LevelTable tones_{refield::ToneMapping{}};
  Image picture_;
  std::vector<std::uint8_t> rgba_;
};

refield::ReflectanceField field_of(int resolution) {
  const char* path = std::getenv("REFIELD_FIELD");
  return path != nullptr ? refield::read_reflectance_field(path) : cluster_field(resolution);
}

void report(benchmark::State& state, Screen& screen, const PreparedEnvironment& environment,
            const refield::EulerAngles& turn) {
  state.counters["limit_ms"] = static_cast<double>(screen.bytes()) / refield::bench::read_rate() * 1e3;
  state.counters["relative_rmse"] = relative_rmse(screen.picture(), screen.exact(environment, turn));
}

/// Maps that were never seen, R texels per face.
void ClusterNewMap(benchmark::State& state) {
  const refield::ReflectanceField field = field_of(static_cast<int>(state.range(0)));
  Screen screen(field);
  const auto map =
      std::make_shared<const LightMap>(refield::bench::environment(static_cast<int>(state.range(1))));
  const refield::EulerAngles turn{20, 30, 40};
  for (auto _ : state) screen.show(PreparedEnvironment(map), turn);
  report(state, screen, PreparedEnvironment(map), turn);
}
BENCHMARK(ClusterNewMap)
    ->ArgNames({"size", "map"})
    ->Args({128, 512})
    ->Args({1024, 512})
    ->Args({1024, 4096})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// One map, turned from frame to frame.
void ClusterRotated(benchmark::State& state) {
  const refield::ReflectanceField field = field_of(static_cast<int>(state.range(0)));
  Screen screen(field);
  const PreparedEnvironment environment(refield::bench::environment(static_cast<int>(state.range(1))));
  refield::EulerAngles turn{20, 30, 40};
  for (auto _ : state) {
    turn.yaw += 1.5;
    screen.show(environment, turn);
  }
  report(state, screen, environment, turn);
}
BENCHMARK(ClusterRotated)
    ->ArgNames({"size", "map"})
    ->Args({128, 512})
    ->Args({1024, 512})
    ->Args({1024, 4096})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// The projection alone, onto a whole cube map, as the viewer shows it.
void CubeMap(benchmark::State& state) {
  const refield::EnvironmentProjector projector(refield::cube_domain(static_cast<int>(state.range(0))), {});
  const PreparedEnvironment environment(refield::bench::environment(static_cast<int>(state.range(1))));
  for (auto _ : state)
    benchmark::DoNotOptimize(projector.project(environment, {20, 30, 40}).light.radiance.values.data());
}
BENCHMARK(CubeMap)
    ->ArgNames({"size", "map"})
    ->Args({128, 512})
    ->Args({1024, 512})
    ->Args({1024, 4096})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

}  // namespace

namespace refield::bench {

LightMap environment(int width) {
  const char* path = std::getenv("REFIELD_ENV");
  if (path != nullptr) return read_environment(path);
  Rng rng(9);
  LightMap map{Image(width, width / 2, 3), Parameterisation::lat_long};
  for (float& value : map.radiance.values) value = static_cast<float>(rng.uniform());
  for (int c = 0; c < 3; ++c) map.radiance.at(width / 3, width / 7, c) = 1e5f;  // a sun of one texel
  return map;
}

double read_rate() {
  static const double rate = [] {
    const std::vector<float> memory(std::size_t{1} << 26, 1.0f);
    double best = 0.0;
    for (int i = 0; i < 3; ++i) {
      const auto start = std::chrono::steady_clock::now();
      benchmark::DoNotOptimize(tbb::parallel_reduce(
          tbb::blocked_range<std::size_t>(0, memory.size() / 16, 1 << 12), 0.0f,
          [&](const auto& range, float sum) {
            for (std::size_t k = range.begin(); k != range.end(); ++k) sum += memory[16 * k];
            return sum;
          },
          std::plus<>()));
      const std::chrono::duration<double> time = std::chrono::steady_clock::now() - start;
      best = std::max(best, static_cast<double>(memory.size() * sizeof(float)) / time.count());
    }
    return best;
  }();
  return rate;
}

}  // namespace refield::bench
