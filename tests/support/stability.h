// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"

namespace refield::test {

/// One row of the table of what happens under hard conditions. Errors are relative RMSE on held-out lights
/// against exact images, median over pixels.
struct StabilityFigure {
  std::string condition;  ///< "drift", "outlier frames", …
  std::string setting;    ///< "5 % over the capture"
  double error = 0.0;
  double undisturbed = 0.0;  ///< the error of the same capture without the disturbance
  double constant = 0.0;     ///< of predicting each pixel's mean over the training photographs
  double ridge = 0.0;        ///< of ridge regression on all texels (dual form, GCV for each pixel)
};

/// Prints a figure and, where the environment variable REFIELD_FIGURES names a folder, appends it to
/// stability.csv there (with a header line when the file is new).
void record_figure(const StabilityFigure& figure);

/// A small scene whose pixels are of four kinds (diffuse, glossy, mirror, hard shadow), photographed under
/// random lights: exact transport, training lights, and lights held out.
struct StabilityScene {
  explicit StabilityScene(int images = 80, std::uint64_t seed = 11);

  ReflectanceField truth;
  std::vector<LightMap> lights, held_out;

  /// Relative RMSE on the held-out lights over the channels that count: the quantile `of_pixels`.
  double error(const std::function<Image(const LightMap&)>& predict) const;
  double error(const ReflectanceField& field) const;
  /// Errors of the two baselines, trained on the session's training frames as they lie on disk.
  double error_of_constant(const CaptureSession& session) const;
  double error_of_ridge(const CaptureSession& session) const;

  double of_pixels = 0.5;
  std::vector<int> channels = {0, 1, 2};  ///< that count
};

/// Replaces a photograph of a session by what `change` makes of it.
void change_photograph(const CaptureFrame& frame, const std::function<void(Image&)>& change);

}  // namespace refield::test
