// SPDX-License-Identifier: Apache-2.0
#include "simulate/sensor.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "core/errors.h"
#include "core/rng.h"
#include "simulate/falloff.h"

namespace refield {

namespace {

// From this mean on Poisson and read noise together are one normal variable to within the rounding of the
// converter.
constexpr double normal_from_electrons = 64.0;

int channels_of(PixelLayout layout) {
  return layout == PixelLayout::rgb ? 3 : 1;
}

}  // namespace

void SensorModel::check() const {
  const auto require = [](bool good, const char* what) {
    if (!good) throw InputError(std::string("sensor: ") + what);
  };
  require(bits == 8 || bits == 10 || bits == 12, "bits must be 8, 10 or 12");
  require(sensitivity > 0.0 && std::isfinite(sensitivity), "sensitivity must be positive");
  require(electrons_per_dn > 0.0 && std::isfinite(electrons_per_dn), "electrons_per_dn must be positive");
  require(full_well_electrons > 0.0, "full_well_electrons must be positive");
  require(read_noise_electrons >= 0.0 && std::isfinite(read_noise_electrons),
          "read_noise_electrons must be at least 0");
  require(black_level_dn >= 0.0 && black_level_dn < full_scale() / 2.0,
          "black_level_dn must lie between 0 and half of the full scale");
  require(vignetting >= 0.0 && vignetting < 1.0, "vignetting must lie in 0 to 1");
  require(response_gamma >= 0.5 && response_gamma <= 5.0, "response_gamma must lie in 0.5 to 5");
  require(largest_gain >= 1.0, "largest_gain must be at least 1");
  require(shortest_exposure.count() > 0.0 && shortest_exposure <= longest_exposure,
          "exposures must be positive, the shortest no longer than the longest");
  require(frame_interval.count() > 0.0, "frame_interval must be positive");
  require(control_latency_frames >= 0 && control_latency_frames <= 64,
          "control_latency_frames must lie in 0 to 64");
  require(latency_frames >= 0 && latency_frames <= 64, "latency_frames must lie in 0 to 64");
}

double SensorModel::mean_dn(double radiance, Seconds exposure, double gain) const {
  const double electrons = std::min(full_well_electrons, sensitivity * radiance * exposure.count());
  return black_level_dn + gain * electrons / electrons_per_dn;
}

double SensorModel::variance_dn(double radiance, Seconds exposure, double gain) const {
  const double dn_per_electron = gain / electrons_per_dn;
  return dn_per_electron * dn_per_electron *
         (sensitivity * radiance * exposure.count() + read_noise_electrons * read_noise_electrons);
}

std::vector<std::uint16_t> SensorModel::expose(const Image& radiance, Seconds exposure, double gain,
                                               std::uint64_t noise_key) const {
  if (radiance.channels != 3)
    throw InputError("sensor: needs a radiance image of 3 channels, got " + shape_text(radiance));
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
    return static_cast<std::uint16_t>(dn + 0.5);
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
