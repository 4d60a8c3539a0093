// SPDX-License-Identifier: Apache-2.0
// Reading and writing the two kinds of file, at the size of a full capture.
#include <benchmark/benchmark.h>
#include <unistd.h>

#include <filesystem>

#include "core/base/rng.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"

namespace {

namespace fs = std::filesystem;

/// A file name of this process, removed at the end.
class ScratchFile {
 public:
  explicit ScratchFile(const char* extension)
      : path_(fs::temp_directory_path() / ("refield-bench-" + std::to_string(::getpid()) + extension)) {}
  ~ScratchFile() {
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

refield::Image photograph() {
  refield::Rng rng(1);
  refield::Image image(1024, 768, 3);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < 3; ++c)  // smooth with one percent of noise, as photographs are
        image.at(x, y, c) = static_cast<float>((0.2 + 1e-3 * x + 1e-3 * y) * (1.0 + 0.01 * rng.normal()));
  return image;
}

refield::ReflectanceField field(int width, int height, int kernels) {
  refield::Rng rng(2);
  refield::ReflectanceField made;
  made.width = width;
  made.height = height;
  made.basis = {{128, 96}, {}, {}};
  for (int x = 0; x < 128; ++x)
    for (int y = 0; y < 96; ++y) made.basis.boxes.push_back({x, y, x + 1, y + 1});
  std::vector<std::uint32_t> columns(kernels);
  std::vector<float> weights(3 * columns.size());
  for (int pixel = 0; pixel < width * height; ++pixel) {
    for (auto& column : columns) column = static_cast<std::uint32_t>(rng.below(made.basis.boxes.size()));
    for (auto& weight : weights) weight = static_cast<float>(rng.uniform());
    made.transfer.append_row(columns, weights);
  }
  return made;
}

void WriteExr(benchmark::State& state) {
  const ScratchFile file(".exr");
  const refield::Image image = photograph();
  const auto precision = state.range(0) ? refield::Precision::half : refield::Precision::single;
  for (auto _ : state) refield::write_exr(file.path(), image, precision);
  state.SetBytesProcessed(state.iterations() *
                          static_cast<std::int64_t>(image.values.size() * sizeof(float)));
  state.counters["file_MB"] = static_cast<double>(fs::file_size(file.path())) / 1e6;
}
BENCHMARK(WriteExr)->ArgName("half")->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

void ReadExr(benchmark::State& state) {
  const ScratchFile file(".exr");
  const refield::Image image = photograph();
  refield::write_exr(file.path(), image);
  for (auto _ : state) benchmark::DoNotOptimize(refield::read_image(file.path()).values.data());
  state.SetBytesProcessed(state.iterations() *
                          static_cast<std::int64_t>(image.values.size() * sizeof(float)));
}
BENCHMARK(ReadExr)->Unit(benchmark::kMillisecond);

void WriteReflectanceField(benchmark::State& state) {
  const ScratchFile file(".rfield");
  const refield::ReflectanceField made = field(320, 240, 25);
  for (auto _ : state) refield::write_reflectance_field(file.path(), made);
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(fs::file_size(file.path())));
}
BENCHMARK(WriteReflectanceField)->Unit(benchmark::kMillisecond);

void ReadReflectanceField(benchmark::State& state) {
  const ScratchFile file(".rfield");
  refield::write_reflectance_field(file.path(), field(320, 240, 25));
  for (auto _ : state) benchmark::DoNotOptimize(refield::read_reflectance_field(file.path()).width);
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(fs::file_size(file.path())));
}
BENCHMARK(ReadReflectanceField)->Unit(benchmark::kMillisecond);

}  // namespace
