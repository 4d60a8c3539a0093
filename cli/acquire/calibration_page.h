// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "acquire/calibrate/calibrate.h"

namespace refield::cli {

/// One HTML page that shows what a calibration measured, with plots, and says in plain words what each figure
/// means and what to do where it is bad. Nothing is loaded from elsewhere.
std::string calibration_page(const RigMeasurements& rig);

}  // namespace refield::cli
