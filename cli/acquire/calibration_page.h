// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "acquire/calibrate/calibrate.h"

namespace refield::cli {

// Plots of the calibration page, each an inline SVG with its legend.
std::string change_plot(const DisplayTiming& timing);
std::string step_plot(const ControlLatency& latency);
std::string banding_plot(const Banding& banding);
std::string response_plot(const CameraResponse& response);
std::string noise_plot(const PhotonTransfer& noise, const CameraResponse& response);
std::string tone_plot(const ToneCurve& curve);

/// One HTML page that shows what a calibration measured, with plots, and says in plain words what each figure
/// means and what to do where it is bad. Nothing is loaded from elsewhere.
std::string calibration_page(const RigMeasurements& rig);

}  // namespace refield::cli
