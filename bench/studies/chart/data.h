// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "bench/studies/chart/noise_curve.h"
#include "bench/studies/chart/pixel_kinds.h"
#include "core/field/reflectance_field.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"

namespace refield::chart {

/// What the caller named on the command line.
struct Sources {
  CaptureSession session;                      ///< training frames, and test frames where they come with it
  std::optional<CaptureSession> test;          ///< held-out frames of a capture that is given by patterns
  std::filesystem::path truth;                 ///< folder of 'refield simulate', or exact transport; or empty
  std::optional<std::filesystem::path> kinds;  ///< map of pixel kinds, or a recipe
  float clip_level;
};

/// A held-out light and what the scene looks like under it.
struct TestFrame {
  std::string kind;  ///< of light
  LightMap light;
  Photograph reference;  ///< exact image or, without truth, photograph
};

/// All that rows of the chart are measured on.
struct ChartData {
  CaptureSession session;  ///< training frames alone, sizes checked
  Mask mask;
  std::vector<TestFrame> tests;
  std::vector<std::string> light_kinds;  ///< that are charted, natural first
  std::optional<PixelKinds> pixel_kinds;
  std::string kinds_note;                     ///< where they come from
  std::optional<ReflectanceField> transport;  ///< exact
  NoiseCurve noise{
      std::span<const CaptureFrame>()};  ///< of the camera and exposures that made the photographs
  std::string reference_note;            ///< what errors are measured against
};

/// Reads everything but the training photographs. Throws InputError where nothing is held out or sizes
/// differ.
ChartData load_chart_data(const Sources& sources);

/// What a light map is, where no manifest says so: black, white (one value everywhere), bar (one value in a
/// rectangle of full height or width), square (in a smaller one), else natural.
std::string light_kind_of(const LightMap& light);

}  // namespace refield::chart
