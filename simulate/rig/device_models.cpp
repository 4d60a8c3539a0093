// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/device_models.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "core/base/rng.h"
#include "simulate/tabletop/surface.h"

namespace refield {

MonitorModel MonitorModel::as_stated() const {
  MonitorModel stated = *this;
  stated.gamma = stated_gamma.value_or(gamma);
  return stated;
}

double MonitorModel::gain(int channel, double done) const {
  const double share =
      drift_settling > 0.0 ? std::expm1(-done / drift_settling) / std::expm1(-1.0 / drift_settling) : done;
  return 1.0 + drift[channel] * share;
}

double MonitorModel::backlight(TimePoint start, TimePoint end) const {
  if (pwm_hz == 0.0 || pwm_depth == 0.0 || end <= start) return 1.0;
  // The integral of ±1 over whole periods is zero; within one it is a triangle.
  const auto integral = [&](TimePoint t) {
    const double periods = Seconds(t.time_since_epoch()).count() * pwm_hz;
    const double phase = periods - std::floor(periods);
    return (phase < 0.5 ? phase : 1.0 - phase) / pwm_hz;
  };
  return 1.0 + pwm_depth * (integral(end) - integral(start)) / Seconds(end - start).count();
}

std::array<std::vector<double>, 3> MonitorModel::tone_curve() const {
  std::array<std::vector<double>, 3> curve;
  for (int c = 0; c < 3; ++c)
    for (int level = 0; level < 256; ++level)
      curve[c].push_back(white_radiance *
                         (black_level + (1.0 - black_level) * std::pow(level / 255.0, gamma[c])));
  return curve;
}

LightMap MonitorModel::emitted(const DriveImage& image) const {
  const auto curve = tone_curve();
  LightMap light{Image(image.width, image.height, 3), Parameterisation::monitor};
  if (image.levels.size() != light.radiance.values.size())
    throw InputError("monitor: a drive image of ", image.width, "×", image.height, " texels has ",
                     image.levels.size(), " levels; three a texel are needed");
  const Falloff screen{image.width, image.height, falloff};
  double sum = 0.0;
  std::size_t i = 0;
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) {
      const double share = screen.at(x, y);
      for (int c = 0; c < 3; ++c, ++i) {
        const double radiance = curve[c][image.levels[i]];
        sum += radiance;
        light.radiance.values[i] = static_cast<float>(radiance * share);
      }
    }
  if (dimming > 0.0) {
    const double mean = sum / (white_radiance * static_cast<double>(image.levels.size()));
    for (float& value : light.radiance.values) value *= static_cast<float>(1.0 - dimming * mean);
  }
  return light;
}

namespace {

template <class Row>
Row row_at(const std::vector<Row>& rows, double done) {
  const auto next = std::ranges::find_if(rows, [&](const Row& row) { return row.from > done; });
  return next == rows.begin() ? Row{} : *(next - 1);
}

}  // namespace

Disturbances::Move Disturbances::position(double done) const {
  return row_at(moves, done);
}

double Disturbances::room(double done) const {
  // One and a half swings, of which none is a straight line.
  constexpr double swings = 1.5;
  return row_at(room_light, done).factor *
         (1.0 + room_variation * std::sin(2.0 * std::numbers::pi * swings * done));
}

namespace {

// From this mean on Poisson and read noise together are one normal variable to within the rounding of the
// converter.
constexpr double normal_from_electrons = 64.0;

int channels_of(PixelLayout layout) {
  return layout == PixelLayout::rgb ? 3 : 1;
}

}  // namespace

Seconds SensorModel::true_exposure(Seconds stated) const {
  return rounds_exposures ? Seconds(std::exp2(std::round(3.0 * std::log2(stated.count())) / 3.0)) : stated;
}

std::array<double, 3> SensorModel::jitter(std::uint64_t key) const {
  Rng random(key);
  const double all = 1.0 + gain_jitter * random.normal();
  std::array<double, 3> factors{};
  for (double& factor : factors) factor = std::max(0.0, all * (1.0 + balance_jitter * random.normal()));
  return factors;
}

Image SensorModel::mixed(Image radiance) const {
  if (mixing == SensorModel{}.mixing) return radiance;
  for (std::size_t i = 0; i < radiance.values.size(); i += 3) {
    const std::array<float, 3> light{radiance.values[i], radiance.values[i + 1], radiance.values[i + 2]};
    for (std::size_t c = 0; c < 3; ++c)
      radiance.values[i + c] =
          static_cast<float>(mixing[c][0] * light[0] + mixing[c][1] * light[1] + mixing[c][2] * light[2]);
  }
  return radiance;
}

Eigen::Matrix3f SensorModel::mixing_matrix() const {
  Eigen::Matrix3f matrix;
  for (int c = 0; c < 3; ++c)
    for (int p = 0; p < 3; ++p) matrix(c, p) = static_cast<float>(mixing[c][p]);
  return matrix;
}

std::vector<std::uint16_t> SensorModel::expose(const Image& radiance, Seconds exposure, double gain,
                                               std::uint64_t noise_key) const {
  if (radiance.channels != 3)
    throw InputError("sensor: needs a radiance image of 3 channels, got ", shape_text(radiance));
  const int channels = channels_of(layout);
  const double full = full_scale();
  const double electrons_per_radiance = sensitivity * exposure.count();
  const double dn_per_electron = gain / electrons_per_dn;
  const double read_variance = read_noise_electrons * read_noise_electrons;
  std::vector<std::uint16_t> samples(radiance.pixel_count() * channels);

  const Falloff lens{radiance.width, radiance.height, vignetting};

  const auto sample = [&](double value, double arriving, Rng& noise) {
    const double mean = std::max(0.0, value) * arriving * electrons_per_radiance;
    const double electrons = mean >= normal_from_electrons
                                 ? mean + std::sqrt(mean + read_variance) * noise.normal()
                                 : noise.poisson(mean) + read_noise_electrons * noise.normal();
    double dn = black_level_dn + dn_per_electron * std::min(electrons, full_well_electrons);
    dn = std::clamp(dn, 0.0, full);
    if (response_gamma != 1.0) dn = full * std::pow(dn / full, 1.0 / response_gamma);
    return static_cast<std::uint16_t>(std::lround(dn));
  };
  tbb::parallel_for(0, radiance.height, [&](int y) {
    Rng noise(noise_key, y);
    std::uint16_t* out = samples.data() + static_cast<std::size_t>(y) * radiance.width * channels;
    for (int x = 0; x < radiance.width; ++x) {
      const double arriving = lens.at(x, y);
      switch (layout) {
        case PixelLayout::rgb:
          for (int c = 0; c < 3; ++c) *out++ = sample(radiance.at(x, y, c), arriving, noise);
          break;
        case PixelLayout::grey:
          *out++ = sample((radiance.at(x, y, 0) + radiance.at(x, y, 1) + radiance.at(x, y, 2)) / 3.0,
                          arriving, noise);
          break;
        default:
          *out++ = sample(radiance.at(x, y, bayer_channel(layout, x, y)), arriving, noise);
      }
    }
  });
  return samples;
}

}  // namespace refield
