// SPDX-License-Identifier: Apache-2.0
// The C++ side of test_speed.py: measures the same calls on the same data.
//   speed_reference field FILE               writes a field of 1024×768 pixels
//   speed_reference relight FILE FRAMES      milliseconds of processor time per frame
//   speed_reference estimate FOLDER          milliseconds of processor time of an estimate from memory
#include <ctime>

#include <cstdio>
#include <cstdlib>
#include <random>
#include <string_view>
#include <vector>

#include "core/field_io/reflectance_field_file.h"
#include "estimate/estimate.h"
#include "relight/relighter.h"

using namespace refield;

namespace {

double processor_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

/// 24 boxes per pixel, as estimated fields have, the same in blocks of 8×8 pixels as neighbours in a
/// photograph share theirs.
ReflectanceField made_field() {
  ReflectanceField field;
  field.width = 1024;
  field.height = 768;
  field.basis.domain = {64, 48, Parameterisation::monitor};
  std::mt19937 random(1);
  for (int k = 0; k < 2000; ++k) {
    const int x = static_cast<int>(random() % 56), y = static_cast<int>(random() % 40);
    field.basis.boxes.push_back(
        {x, y, x + 1 + static_cast<int>(random() % 8), y + 1 + static_cast<int>(random() % 8)});
  }
  constexpr std::size_t kernels = 24;
  std::vector<std::uint32_t> columns(kernels);
  std::vector<float> weights(3 * kernels);
  for (int y = 0; y < field.height; ++y)
    for (int x = 0; x < field.width; ++x) {
      for (std::size_t k = 0; k < kernels; ++k)
        columns[k] = static_cast<std::uint32_t>((x / 8 * 131u + y / 8 * 31u + k * 317u) % 2000u);
      for (float& weight : weights) weight = 1e-3f * static_cast<float>(random() % 1000 + 1);
      field.transfer.append_row(columns, weights);
    }
  return field;
}

double relight_ms(const char* file, int frames) {
  const ReflectanceField field = read_reflectance_field(file);
  TileRelighter relighter(field);
  const LightDomain domain = relighter.domain();
  const LightMap light{Image(domain.width, domain.height, 3, 0.5f), domain.parameterisation};
  for (int i = 0; i < 3; ++i) relighter.relight(light);
  const double start = processor_ms();
  for (int i = 0; i < frames; ++i) relighter.relight(light);
  return (processor_ms() - start) / frames;
}

double estimate_ms(const char* folder) {
  const CaptureSession session = read_capture_session(folder);
  std::vector<LightMap> lights;
  std::vector<Image> photographs;
  for (const CaptureFrame& frame : session.frames_of(FrameRole::train)) {
    lights.push_back(read_illumination(frame, session.light.parameterisation, {}));
    photographs.push_back(read_observed(frame).radiance);
  }
  const std::vector<LightMapView> light_views(lights.begin(), lights.end());
  const std::vector<ImageView> views(photographs.begin(), photographs.end());
  RunContext run;
  run.max_threads = 1;
  const double start = processor_ms();
  estimate(light_views, views, {}, {}, {}, run);
  return processor_ms() - start;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string_view what = argv[1];
  if (what == "field")
    write_reflectance_field(argv[2], made_field());
  else if (what == "relight")
    std::printf("%.4f\n", relight_ms(argv[2], std::atoi(argv[3])));
  else
    std::printf("%.4f\n", estimate_ms(argv[2]));
  return 0;
}
