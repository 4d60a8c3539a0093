// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <algorithm>

#include "simulate/rig/device_models.h"

namespace refield::test {

/// Mean and variance of a sample's DN before clipping, response and rounding; `radiance` ≥ 0.
inline double mean_dn(const SensorModel& sensor, double radiance, Seconds exposure, double gain) {
  const double electrons =
      std::min(sensor.full_well_electrons, sensor.sensitivity * radiance * exposure.count());
  return sensor.black_level_dn + gain * electrons / sensor.electrons_per_dn;
}
inline double variance_dn(const SensorModel& sensor, double radiance, Seconds exposure, double gain) {
  const double dn_per_electron = gain / sensor.electrons_per_dn;
  return dn_per_electron * dn_per_electron *
         (sensor.sensitivity * radiance * exposure.count() +
          sensor.read_noise_electrons * sensor.read_noise_electrons);
}

}  // namespace refield::test
