// SPDX-License-Identifier: Apache-2.0
// acquire on the virtual rig: what a session says about a scene is what the scene's transport says.
#include <gtest/gtest.h>

#include <cmath>

#include "acquire/capture/capture.h"
#include "core/base/rng.h"
#include "simulate/rig/virtual_rig.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using test::TemporaryFolder;

constexpr LightDomain domain{12, 9, Parameterisation::monitor};
constexpr int width = 32;
constexpr int height = 24;

/// Every pixel sees two random boxes of the monitor.
ReflectanceField random_transport() {
  ReflectanceField field;
  field.width = width;
  field.height = height;
  field.basis.domain = domain;
  Rng random(31);
  for (int p = 0; p < width * height; ++p) {
    std::vector<std::uint32_t> columns;
    std::vector<float> weights;
    for (int k = 0; k < 2; ++k) {
      const int x = static_cast<int>(random.below(domain.width - 3));
      const int y = static_cast<int>(random.below(domain.height - 3));
      columns.push_back(static_cast<std::uint32_t>(field.basis.boxes.size()));
      field.basis.boxes.push_back({x, y, x + 3, y + 3});
      for (int c = 0; c < 3; ++c) weights.push_back(static_cast<float>(random.uniform(0.0, 0.05)));
    }
    field.transfer.append_row(columns, weights);
  }
  return field;
}

struct Case {
  const char* name;
  PixelLayout layout;
  int bits;
  double response_gamma;
};

class VirtualCapture : public ::testing::TestWithParam<Case> {};

TEST_P(VirtualCapture, AgreesWithTheTransportWithinItsOwnNoise) {
  const TemporaryFolder folder;
  const ReflectanceField transport = random_transport();
  SensorModel sensor;
  sensor.layout = GetParam().layout;
  sensor.bits = GetParam().bits;
  sensor.response_gamma = GetParam().response_gamma;
  sensor.electrons_per_dn = 15000.0 / (1 << sensor.bits);
  sensor.black_level_dn = (1 << sensor.bits) / 64.0;
  const MonitorModel monitor;
  VirtualRig rig(transport, Image(width, height, 3, 0.01f), monitor, sensor, 9);

  CaptureRequest request;
  request.folder = folder / "session";
  request.camera.bits = sensor.bits;
  request.camera.linear_from_dn = sensor.response_gamma == 1.0
                                      ? linear_response(sensor.bits)
                                      : gamma_response(sensor.bits, sensor.response_gamma);
  request.camera.black_level_dn = sensor.black_level_dn;
  request.camera.saturation_dn =
      std::floor(sensor.full_scale() *
                 std::pow((sensor.black_level_dn + sensor.full_well_electrons / sensor.electrons_per_dn) /
                              sensor.full_scale(),
                          1.0 / sensor.response_gamma));
  request.camera.saturation_dn = std::min<double>(request.camera.saturation_dn, sensor.full_scale());
  request.camera.electrons_per_dn = sensor.electrons_per_dn;
  request.camera.read_noise_electrons = sensor.read_noise_electrons;
  request.camera.electrons_per_radiance_second = sensor.sensitivity;
  const auto curve = monitor.tone_curve();
  for (int c = 0; c < 3; ++c) request.monitor.radiance_from_level[c].assign(curve[c].begin(), curve[c].end());
  request.exposures = {Seconds(0.02), Seconds(0.08), Seconds(0.32), Seconds(1.28)};
  Rng random(4);
  for (int i = 0; i < 3; ++i) {
    Image light(domain.width, domain.height, 3);
    for (float& value : light.values) value = static_cast<float>(std::pow(random.uniform(), 3.0));
    const std::string name = "light_" + std::to_string(i);
    write_exr(folder / (name + ".exr"), light);
    request.lights.push_back({name, FrameRole::train, "natural", folder / (name + ".exr")});
  }
  capture(request, rig.camera(), rig.illuminator(), nullptr);

  const CaptureSession session = read_capture_session(folder / "session");
  double mean = 0.0;
  double square = 0.0;
  double count = 0.0;
  for (const CaptureFrame& frame : session.frames) {
    const Image truth = transport.relight(read_light_map(frame.illumination, Parameterisation::monitor));
    const Photograph observed = read_photograph(frame.observed);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          float expected = truth.at(x, y, c);
          if (sensor.layout == PixelLayout::grey)
            expected = (truth.at(x, y, 0) + truth.at(x, y, 1) + truth.at(x, y, 2)) / 3.0f;
          // Interpolated Bayer samples are of other pixels: only the measured ones have an exact truth.
          if (sensor.layout == PixelLayout::bayer_rggb && (x & 1) + (y & 1) != c) continue;
          const double deviation = (observed.radiance.at(x, y, c) - expected) / observed.sigma.at(x, y, c);
          mean += deviation;
          square += deviation * deviation;
          count += 1.0;
        }
  }
  mean /= count;
  // Lights share one ambient photograph, so their deviations correlate: allow for half of the samples being
  // copies.
  EXPECT_NEAR(mean, 0.0, 5.0 * std::sqrt(2.0 / count));
  EXPECT_NEAR(std::sqrt(square / count), 1.0, 0.06);
}

INSTANTIATE_TEST_SUITE_P(Sensors, VirtualCapture,
                         ::testing::Values(Case{"rgb", PixelLayout::rgb, 12, 1.0},
                                           Case{"grey", PixelLayout::grey, 12, 1.0},
                                           Case{"bayer", PixelLayout::bayer_rggb, 12, 1.0},
                                           Case{"ten_bits", PixelLayout::rgb, 10, 1.0},
                                           Case{"eight_bits_with_gamma", PixelLayout::rgb, 8, 2.2}),
                         [](const auto& tested) { return std::string(tested.param.name); });

}  // namespace
}  // namespace refield
