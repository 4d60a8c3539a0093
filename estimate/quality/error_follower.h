// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/predicted_error.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"
#include "estimate/fit/box_table.h"
#include "estimate/fit/fit_pixel.h"
#include "estimate/fit/light_groups.h"
#include "estimate/options.h"

namespace refield {

/// What the images so far would give.
struct FollowedError {
  int images = 0;
  int lights = 0;  ///< that differ: images under multiples of one light count once
  /// Relative RMSE of the median pixel on new photographs, under light of interest; nothing below
  /// `min_lights_for_errors` lights.
  std::optional<double> predicted;
  double noise = 0.0;  ///< the part of it that is the photographs' own, where they carry it
};

/// Follows a capture: estimates a sample of pixels from the photographs taken so far and predicts the error
/// of a field made from them, as predict_errors() does (leave-one-out and five-fold cross-validation).
class ErrorFollower {
 public:
  /// At most about `max_pixels` pixels, evenly spread, are followed.
  explicit ErrorFollower(const EstimateOptions& options, int max_pixels = 640)
      : options_(options), max_pixels_(max_pixels) {}

  /// Light under which the error is asked for; without any it is that of the photographs' own kind of light.
  /// The maps have the size of the photographs' light maps, and none is black.
  void expect(std::vector<LightMap> lights) { expected_ = std::move(lights); }

  /// Reads a photograph and its light. Throws InputError when sizes differ from those before.
  void add(const CaptureFrame& frame, Parameterisation parameterisation, const RunContext& run = {});
  int images() const { return static_cast<int>(lights_.size()); }

  /// Needs two images. The result does not depend on the number of threads.
  FollowedError predict(const RunContext& run = {});

  /// How many images would reach `error`, extrapolated from the predictions so far; 0: cannot be told, or
  /// more than ten times as many as there are.
  int images_for(double error) const;

 private:
  double mean_square() const;  // of the samples measured
  /// Undoes what the camera's channels see of other primaries, as estimation does; nothing unless a
  /// photograph of each primary tells it.
  std::optional<Eigen::Matrix3d> unmixing() const;

  /// How the squared error of each pixel changes from the photographs' kind of light to the expected one,
  /// given its kernels [pixels].
  std::vector<double> change_of_light(const BoxTable& table, const std::vector<PixelKernels>& kernels,
                                      const RunContext& run) const;

  EstimateOptions options_;
  std::vector<LightMap> expected_;
  int max_pixels_;
  int width_ = 0, height_ = 0;
  std::vector<std::array<int, 2>> pixels_;
  std::vector<LightMap> lights_;
  std::vector<std::array<std::vector<float>, 3>> samples_;  // [pixels], over images
  std::vector<double> noise2_;                              // [pixels], Σσ²
  double noise_ = 0.0;                                      // of the last prediction
  std::vector<LearningPoint> history_;                      // shares are numbers of images
};

}  // namespace refield
