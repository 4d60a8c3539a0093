// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/session/capture_session.h"

namespace refield {

/// What a rig does besides B = T L, the same for all pixels. Photograph j shows
///   b_j(x + shift_j) = gain_j · mixing · (T tone(l_k) + room_j · mean photograph),  k = light_of[j].
/// Vectors are [photographs] in the order of the session's training frames, or empty where nothing is to be
/// corrected. `refield estimate --rig FILE` reads and OUTPUT.log.json contains a model as JSON with these
/// names.
struct RigModel {
  std::vector<std::string> photographs;  ///< names of the training frames
  /// Number of the frame whose light map belongs to photograph j; −1: none does, the photograph is left out.
  std::vector<int> light_of;
  /// Of the picture against the first photograph's, to the right and down, pixels.
  std::vector<std::array<double, 2>> shift_px;
  /// Camera channel (row) per primary of the light (column); its diagonal is 1.
  Eigen::Matrix3d mixing = Eigen::Matrix3d::Identity();
  /// Emitted light of each channel: white · (light map / white)^tone.
  std::array<double, 3> tone{1.0, 1.0, 1.0};
  double white = 1.0;                       ///< largest radiance of the light maps
  std::vector<std::array<double, 3>> gain;  ///< of each channel, mean 1
  std::vector<double> room;  ///< room light, as a share of the mean photograph (its mean over the channels)

  bool mixes_colours() const { return mixing != Eigen::Matrix3d::Identity(); }
  bool bends_tone() const { return tone != std::array<double, 3>{1.0, 1.0, 1.0}; }
  bool is_identity() const;
};

/// JSON text of a model, with all digits.
std::string rig_text(const RigModel& rig);
/// Throws InputError naming `name` for text that is not a model.
RigModel rig_from_text(const std::string& text, const std::string& name);
RigModel read_rig(const std::filesystem::path& path);

/// Gives each frame, of photographs `height_px` high, the light map and the correction of the model; frames
/// without a light map are removed. Throws InputError when the model does not have all frames, by name.
void apply_rig(const RigModel& rig, int height_px, std::vector<CaptureFrame>& frames);

/// Rows of a photograph beyond those wanted that undo_rig() needs, above and below.
int rig_margin(const FrameCorrection* correction);

/// Undoes shift, gain and colour mixing of `rows`, rows [first_row, first_row + rows.height) of a photograph,
/// and returns those from `first` to `last`. One interpolation (Keys' cubic convolution, a = −1/2); a sample
/// that needs one that was not measured (NaN) is not measured, and no channel of a pixel is where one is
/// not. Beyond the picture's edges the nearest pixel counts.
Image undo_rig(const Image& rows, int first_row, int first, int last, const FrameCorrection& correction);

/// Weights of the pixels −1, 0, 1, 2 for a value `t` in [0, 1) after pixel 0. Source: Keys 1981, eq. 15.
std::array<float, 4> cubic_weights(double t);

}  // namespace refield
