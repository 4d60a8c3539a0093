// SPDX-License-Identifier: Apache-2.0
// Relighting at full size: 1024×768 pixels, 25 kernels per pixel, a light map of 800×600. Memory bandwidth
// limits it: ReadMemory measures that on this machine in the same run, and beside each method stand the bytes
// it moves a second and its error against sums in double.
//
// The field is made here: trees of rectangles that blocks of 4×4 pixels share, as where a scene is coherent.
// `scene` has the statistics of a field estimated from photographs. REFIELD_FIELD=f.rfield measures a
// captured or simulated field instead.
#include <benchmark/benchmark.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <utility>

#ifdef REFIELD_CBLAS
#include <cblas.h>
#endif

#include "bench/relight/environment_bench.h"
#include "core/base/rng.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "core/image/tone_map.h"
#include "core/light/summed_area_table.h"
#include "relight/environment/environment.h"
#include "relight/relighter.h"

namespace {

using refield::Box;
using refield::Image;

constexpr int width = 1024;
constexpr int height = 768;
constexpr int light_width = 800;
constexpr int light_height = 600;
constexpr int kernels = 25;
constexpr int block_px = 4;
constexpr std::size_t trees = 3520;  // of 25 rectangles: as many distinct ones as prototypes of that size had

/// The leaves of a random tree of rectangles over the light map.
std::vector<Box> random_leaves(refield::Rng& rng) {
  std::vector<Box> leaves = {{0, 0, light_width, light_height}};
  while (leaves.size() < kernels) {
    Box& box = leaves[rng.below(leaves.size())];
    const bool across = box.width() > box.height();
    const std::int32_t extent = across ? box.width() : box.height();
    if (extent < 2) continue;
    Box rest = box;
    const auto cut = 1 + static_cast<std::int32_t>(rng.below(static_cast<std::uint64_t>(extent - 1)));
    if (across)
      box.x1 = rest.x0 = box.x0 + cut;
    else
      box.y1 = rest.y0 = box.y0 + cut;
    leaves.push_back(rest);
  }
  return leaves;
}

refield::ReflectanceField made_field() {
  refield::Rng rng(1);
  refield::ReflectanceField made;
  made.width = width;
  made.height = height;
  made.basis.domain = {light_width, light_height, refield::Parameterisation::monitor};
  for (std::size_t tree = 0; tree < trees; ++tree)
    for (const Box& leaf : random_leaves(rng)) made.basis.boxes.push_back(leaf);
  std::vector<std::uint32_t> columns(kernels);
  std::vector<float> weights(std::size_t{3} * kernels);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      refield::Rng block(2, static_cast<std::uint64_t>(x / block_px),
                         static_cast<std::uint64_t>(y / block_px));
      const auto first = block.below(trees) * kernels;
      for (std::size_t k = 0; k < kernels; ++k) {
        columns[k] = static_cast<std::uint32_t>(first + k);
        const auto area = static_cast<double>(made.basis.boxes[columns[k]].area());
        for (std::size_t c = 0; c < 3; ++c)
          weights[3 * k + c] = static_cast<float>(rng.uniform() / (kernels * area));
      }
      made.transfer.append_row(columns, weights);
    }
  return made;
}

/// Pixels that see a part of the light each, as in a mirror or where light is local: their kernels lie within
/// a twelfth of the map's width and height, around where the pixel is in the image.
refield::ReflectanceField reflecting_field() {
  refield::Rng rng(7);
  refield::ReflectanceField made;
  made.width = width;
  made.height = height;
  made.basis.domain = {light_width, light_height, refield::Parameterisation::monitor};
  const auto interval = [&rng](int middle, int length) {
    const int reach = length / 24;
    const int size = 1 + static_cast<int>(rng.below(static_cast<std::uint64_t>(reach)));
    const int start = middle - reach + static_cast<int>(rng.below(2 * static_cast<std::uint64_t>(reach)));
    const int first = std::clamp(start, 0, length - size);
    return std::pair(first, first + size);
  };
  constexpr int across = width / block_px;
  for (int block = 0; block < across * (height / block_px); ++block)
    for (int k = 0; k < kernels; ++k) {
      const auto [x0, x1] = interval(block % across * light_width / across, light_width);
      const auto [y0, y1] = interval(block / across * light_height / (height / block_px), light_height);
      made.basis.boxes.push_back({x0, y0, x1, y1});
    }
  std::vector<std::uint32_t> columns(kernels);
  std::vector<float> weights(std::size_t{3} * kernels);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      for (std::size_t k = 0; k < kernels; ++k)
        columns[k] = static_cast<std::uint32_t>(
            (static_cast<std::size_t>(y / block_px) * across + x / block_px) * kernels + k);
      for (float& weight : weights) weight = static_cast<float>(rng.uniform());
      made.transfer.append_row(columns, weights);
    }
  return made;
}

/// Statistics of a field estimated from the table-top scene of datasets_synthetic at this size: half of all
/// pixels see rectangles that no other pixel has, anywhere on the light map.
///  - Each pixel has most hats of a grid of 5×4.
///  - Each tile of 16×16 pixels has rectangles of its own, 563 on average, spread like an exponential; each
///  is
///    used by one pixel.
///  - Regions of 2×3 tiles share 387 rectangles: each block of 4×4 pixels has two of them, each pixel 2.4
///  more.
///  - Widths and heights are log-normal around 54 and 61 texels; a quarter of all edges lie on a grid.
refield::ReflectanceField scene_like_field() {
  constexpr int tile_px = 16, region_tiles_x = 2, region_tiles_y = 3, of_region = 387;
  constexpr double own_of_tile = 563.0, shared_of_pixel = 2.4, share_of_hats = 0.84;
  refield::Rng rng(9);
  refield::ReflectanceField made;
  made.width = width;
  made.height = height;
  made.basis.domain = {light_width, light_height, refield::Parameterisation::monitor};
  made.basis.hats = {5, 4};
  const auto hats = static_cast<std::uint32_t>(made.basis.hats.count());
  const auto interval = [&rng](double log2_size, double deviation, int length) {
    constexpr int grid = 48;
    const auto size =
        std::clamp(static_cast<int>(std::exp2(log2_size + deviation * rng.normal())), 1, length);
    const int places = length - size + 1;
    const int first = static_cast<int>(rng.below(static_cast<std::uint64_t>(places)));
    const auto edge = [&](int at) {
      return rng.uniform() < 0.25 ? (at * grid + length / 2) / length * length / grid : at;
    };
    const int begin = edge(first), end = edge(first + size);
    return begin < end ? std::pair(begin, end) : std::pair(first, first + size);
  };
  const auto new_box = [&] {
    const auto [x0, x1] = interval(5.76, 1.56, light_width);
    const auto [y0, y1] = interval(5.92, 1.59, light_height);
    made.basis.boxes.push_back({x0, y0, x1, y1});
    return static_cast<std::uint32_t>(made.basis.size() - 1);
  };
  constexpr int tiles_across = width / tile_px, regions_across = tiles_across / region_tiles_x;
  constexpr int regions = regions_across * (height / tile_px / region_tiles_y);
  for (int i = 0; i < regions * of_region; ++i) new_box();
  std::vector<double> own(static_cast<std::size_t>(tiles_across) * (height / tile_px));
  for (double& mean : own) mean = own_of_tile / (tile_px * tile_px) * -std::log(1.0 - rng.uniform());
  std::vector<std::uint32_t> columns;
  std::vector<float> weights;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int tile_x = x / tile_px, tile_y = y / tile_px;
      const int region = tile_y / region_tiles_y * regions_across + tile_x / region_tiles_x;
      const auto shared = [&](refield::Rng& chooser) {
        return static_cast<std::uint32_t>(hats + region * of_region + chooser.below(of_region));
      };
      columns.clear();
      for (std::uint32_t hat = 0; hat < hats; ++hat)
        if (rng.uniform() < share_of_hats) columns.push_back(hat);
      refield::Rng block(2, static_cast<std::uint64_t>(x / block_px),
                         static_cast<std::uint64_t>(y / block_px));
      for (int k = 0; k < 2; ++k) columns.push_back(shared(block));
      for (auto k = static_cast<int>(rng.poisson(shared_of_pixel)); k > 0; --k)
        columns.push_back(shared(rng));
      for (auto k =
               static_cast<int>(rng.poisson(own[static_cast<std::size_t>(tile_y) * tiles_across + tile_x]));
           k > 0; --k)
        columns.push_back(new_box());
      std::ranges::sort(columns);
      columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
      weights.clear();
      for (const std::uint32_t column : columns) {
        const double area = column < hats ? light_width * light_height / hats
                                          : static_cast<double>(made.basis.box(column).area());
        for (int c = 0; c < 3; ++c) weights.push_back(static_cast<float>(rng.uniform() / (kernels * area)));
      }
      made.transfer.append_row(columns, weights);
    }
  return made;
}

using GiveField = const refield::ReflectanceField&();

const refield::ReflectanceField& the_scene() {
  static const refield::ReflectanceField field = scene_like_field();
  return field;
}

const refield::ReflectanceField& the_mirror() {
  static const refield::ReflectanceField field = reflecting_field();
  return field;
}

const refield::ReflectanceField& the_field() {
  static const refield::ReflectanceField field = [] {
    const char* path = std::getenv("REFIELD_FIELD");
    return path != nullptr ? refield::read_reflectance_field(path) : made_field();
  }();
  return field;
}

refield::LightMap random_light(std::uint64_t seed) {
  refield::Rng rng(seed);
  const refield::LightDomain& domain = the_field().basis.domain;
  refield::LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  for (float& value : light.radiance.values) value = static_cast<float>(rng.uniform());
  return light;
}

/// The scene under a light, all sums in double, box by box: the reference.
Image in_double(const refield::LightMap& light, const refield::ReflectanceField& field = the_field()) {
  const refield::SummedAreaTable table(light.radiance);
  const std::vector<double> hats = field.basis.hats.project(light);
  Image image(field.width, field.height, 3);
  tbb::parallel_for(std::size_t{0}, field.transfer.rows(), [&](std::size_t row) {
    double sum[3] = {0.0, 0.0, 0.0};
    for (auto e = field.transfer.row_start[row]; e < field.transfer.row_start[row + 1]; ++e) {
      const std::uint32_t k = field.transfer.column[e];
      const auto box = field.basis.is_smooth(k) ? std::array{hats[3 * k], hats[3 * k + 1], hats[3 * k + 2]}
                                                : table.sum(field.basis.box(k));
      for (std::size_t c = 0; c < 3; ++c) sum[c] += double{field.transfer.weight[3 * e + c]} * box[c];
    }
    for (std::size_t c = 0; c < 3; ++c) image.values[3 * row + c] = static_cast<float>(sum[c]);
  });
  return image;
}

void report(benchmark::State& state, std::size_t bytes_per_frame, const Image& image,
            const Image& reference) {
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes_per_frame));
  state.counters["MB_per_frame"] = static_cast<double>(bytes_per_frame) / 1e6;
  state.counters["frames_per_second"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["relative_rmse"] = relative_rmse(image, reference);
}

/// The limit: all cores read memory that no cache holds.
void ReadMemory(benchmark::State& state) {
  const std::vector<std::uint64_t> memory(40'000'000, 1);
  for (auto _ : state)
    benchmark::DoNotOptimize(tbb::parallel_reduce(
        tbb::blocked_range<std::size_t>(0, memory.size(), 1 << 16), std::uint64_t{0},
        [&](const auto& range, std::uint64_t sum) {
          for (std::size_t i = range.begin(); i != range.end(); ++i) sum += memory[i];
          return sum;
        },
        std::plus<>()));
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(memory.size() * sizeof(memory[0])));
}
BENCHMARK(ReadMemory)->Unit(benchmark::kMillisecond)->UseRealTime();

/// The whole light changes from frame to frame.
void Whole(benchmark::State& state, GiveField field, refield::RelightPrecision precision) {
  refield::TileRelighter relighter(field(), precision);
  const refield::LightMap lights[] = {random_light(3), random_light(4)};
  std::size_t frame = 0;
  const Image* image = nullptr;
  for (auto _ : state) image = &relighter.relight(lights[frame++ % 2]);
  report(state, refield::bench::bytes_per_frame(relighter, *image), *image,
         in_double(lights[(frame - 1) % 2], field()));
}
BENCHMARK_CAPTURE(Whole, fast, the_field, refield::RelightPrecision::fast)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Whole, fine, the_field, refield::RelightPrecision::fine)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Whole, scene, the_scene, refield::RelightPrecision::fast)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Whole, mirror, the_mirror, refield::RelightPrecision::fast)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// From an environment map in memory, turned from frame to frame, to the picture on the screen: what a
/// monitor's window of 52×32 cm at 60 cm shows of it.
void RotatedEnvironment(benchmark::State& state) {
  const refield::ReflectanceField& field = the_field();
  const std::vector<refield::MonitorPlacement> monitor =
      field.monitors.empty() ? std::vector{refield::MonitorPlacement{520, 320, 600}} : field.monitors;
  const refield::EnvironmentProjector projector(field.basis.domain, monitor);
  const refield::PreparedEnvironment environment(
      refield::bench::environment(static_cast<int>(state.range(0))));
  refield::TileRelighter relighter(field);
  const refield::LevelTable tones{refield::ToneMapping{}};
  std::vector<std::uint8_t> rgba(std::size_t{4} * static_cast<std::size_t>(field.width) * field.height);
  refield::EulerAngles turn{20, 30, 40};
  const Image* image = nullptr;
  for (auto _ : state) {
    turn.yaw += 1.5;
    image = &relighter.relight(projector.project(environment, turn).light);
    tone_map_rgba(*image, tones, rgba);
  }
  state.counters["limit_ms"] =
      static_cast<double>(refield::bench::bytes_per_frame(relighter, *image) + rgba.size()) /
      refield::bench::read_rate() * 1e3;
  const Image shown = *image;
  state.counters["relative_rmse"] =
      relative_rmse(shown, relighter.relight(projector.project_exactly(environment, turn).light));
}
BENCHMARK(RotatedEnvironment)
    ->ArgName("map")
    ->Arg(512)
    ->Arg(1024)
    ->Arg(4096)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// The light map alone.
void Window(benchmark::State& state) {
  const refield::MonitorPlacement monitor{520, 320, 600};
  const refield::EnvironmentProjector projector(
      {light_width, light_height, refield::Parameterisation::monitor}, std::span(&monitor, 1));
  const refield::PreparedEnvironment environment(
      refield::bench::environment(static_cast<int>(state.range(0))));
  for (auto _ : state)
    benchmark::DoNotOptimize(projector.project(environment, {20, 30, 40}).light.radiance.values.data());
}
BENCHMARK(Window)
    ->ArgName("map")
    ->Arg(512)
    ->Arg(1024)
    ->Arg(4096)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->UseRealTime();

/// A twentieth of the map's width changes: over its whole height, or a region as high as wide.
void Part(benchmark::State& state, GiveField field, refield::RelightPrecision precision, bool whole_height) {
  refield::TileRelighter relighter(field(), precision);
  refield::LightMap light = random_light(3);
  const int w = light.radiance.width, h = light.radiance.height;
  const int side = std::max(w / 20, 1);
  const Box part = whole_height ? Box{w / 2, 0, w / 2 + side, h}
                                : Box{w / 2, h / 2, w / 2 + side, std::min(h / 2 + side, h)};
  relighter.relight(light);
  float brightness = 1.0f;
  const Image* image = nullptr;
  for (auto _ : state) {
    state.PauseTiming();
    brightness = brightness == 1.0f ? 2.0f : 1.0f;
    for (int y = part.y0; y < part.y1; ++y)
      for (int x = part.x0; x < part.x1; ++x)
        for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = brightness;
    state.ResumeTiming();
    image = &relighter.update(light, part);
  }
  report(state, 0, *image, in_double(light, field()));
}
BENCHMARK_CAPTURE(Part, fast_strip, the_field, refield::RelightPrecision::fast, true)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Part, fast_square, the_field, refield::RelightPrecision::fast, false)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Part, mirror_strip, the_mirror, refield::RelightPrecision::fast, true)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Part, mirror_square, the_mirror, refield::RelightPrecision::fast, false)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK_CAPTURE(Part, fine_square, the_field, refield::RelightPrecision::fine, false)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

/// Entries as the file has them, each distinct kernel summed once: ReflectanceField::relight().
void Rows(benchmark::State& state) {
  const auto& field = the_field();
  const auto light = random_light(3);
  Image image;
  for (auto _ : state) image = field.relight(light);
  report(state,
         field.transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float)) +
             field.transfer.rows() * (sizeof(std::uint64_t) + 3 * sizeof(float)),
         image, in_double(light));
}
BENCHMARK(Rows)->Unit(benchmark::kMillisecond)->UseRealTime();

/// As Matusik et al. 2004 relight: for each kernel of each pixel four lookups in the summed-area table.
void DirectLookups(benchmark::State& state) {
  const auto& field = the_field();
  const auto light = random_light(3);
  Image image;
  for (auto _ : state) image = in_double(light);
  report(state, field.transfer.entries() * (sizeof(Box) + 3 * sizeof(float)), image, image);
}
BENCHMARK(DirectLookups)->Unit(benchmark::kMillisecond)->UseRealTime();

/// Eigen's product of a sparse matrix by rows, each channel a matrix.
void EigenSparse(benchmark::State& state) {
  using Matrix = Eigen::SparseMatrix<float, Eigen::RowMajor, std::int64_t>;
  const auto& field = the_field();
  const auto light = random_light(3);
  std::vector<Matrix> channels;
  for (int c = 0; c < 3; ++c) {
    Matrix& matrix = channels.emplace_back(static_cast<Eigen::Index>(field.transfer.rows()),
                                           static_cast<Eigen::Index>(field.basis.size()));
    matrix.reserve(static_cast<Eigen::Index>(field.transfer.entries()));
    for (std::size_t row = 0; row < field.transfer.rows(); ++row) {
      matrix.startVec(static_cast<Eigen::Index>(row));
      for (auto e = field.transfer.row_start[row]; e < field.transfer.row_start[row + 1]; ++e)
        matrix.insertBackByOuterInnerUnordered(static_cast<Eigen::Index>(row),
                                               static_cast<Eigen::Index>(field.transfer.column[e])) =
            field.transfer.weight[3 * e + static_cast<std::size_t>(c)];
    }
    matrix.finalize();
  }
  Image image(field.width, field.height, 3);
  const auto pixels = static_cast<Eigen::Index>(field.transfer.rows());
  Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> out(image.values.data(), pixels, 3);
  for (auto _ : state) {
    const std::vector<float> sums = field.basis.project(light);
    const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> coefficients(
        sums.data(), static_cast<Eigen::Index>(field.basis.size()), 3);
    tbb::parallel_for(0, 3, [&](int c) {
      out.col(c) = channels[static_cast<std::size_t>(c)] * Eigen::VectorXf(coefficients.col(c));
    });
  }
  report(state, 3 * field.transfer.entries() * (sizeof(float) + sizeof(std::int64_t)), image,
         in_double(light));
}
BENCHMARK(EigenSparse)->Unit(benchmark::kMillisecond)->UseRealTime();

#ifdef REFIELD_CBLAS
/// The light transport matrix in full, by OpenBLAS, at a size that fits: 128×96 pixels, 100×75 texels. At
/// full size it would be 4096 times as large.
void DenseBlas(benchmark::State& state) {
  constexpr int rows = 128 * 96, columns = 100 * 75;
  refield::Rng rng(5);
  std::vector<float> matrix(std::size_t{rows} * columns), light(std::size_t{columns} * 3),
      image(std::size_t{rows} * 3);
  for (float& value : matrix) value = static_cast<float>(rng.uniform());
  for (float& value : light) value = static_cast<float>(rng.uniform());
  for (auto _ : state) {
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, rows, 3, columns, 1.0f, matrix.data(), columns,
                light.data(), 3, 0.0f, image.data(), 3);
    benchmark::ClobberMemory();
  }
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(matrix.size() * sizeof(float)));
}
BENCHMARK(DenseBlas)->Unit(benchmark::kMillisecond)->UseRealTime();
#endif

/// What comes before the first frame.
void LayOut(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(refield::TileRelighter(the_field()).transfer().index());
}
BENCHMARK(LayOut)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
