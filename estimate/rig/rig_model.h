// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/session/capture_session.h"

namespace refield {

/// What a rig does besides B = T L, the same for all pixels. Photograph j shows
///   b_j(x + shift_j + turn_j (x − middle)) = gain_j · mixing · (T tone(l_k) + room_j · room picture),
/// k = light_of[j].
/// Vectors are [photographs] in the order of the session's training frames, or empty where nothing is to be
/// corrected. `refield estimate --rig FILE` reads and OUTPUT.log.json contains a model as JSON with
/// these names.
struct RigModel {
  std::vector<std::string> photographs;  ///< names of the training frames
  /// Number of the frame whose light map belongs to photograph j; −1: none does, the photograph is left out.
  std::vector<int> light_of;
  /// Of the picture against the first photograph's, to the right and down, pixels.
  std::vector<std::array<double, 2>> shift_px;
  /// Rotation of the picture about its middle, clockwise, radians, and growth, against the first photograph.
  std::vector<std::array<double, 2>> turn;
  /// Camera channel (row) per primary of the light (column); its diagonal is 1.
  Eigen::Matrix3d mixing = Eigen::Matrix3d::Identity();
  /// Emitted light of each channel: white · (light map / white)^tone.
  std::array<double, 3> tone{1.0, 1.0, 1.0};
  double white = 1.0;                       ///< largest radiance of the light maps
  std::vector<std::array<double, 3>> gain;  ///< of each channel, mean 1
  std::vector<double> room;                 ///< room light that is left, as a multiple of the room picture
  /// Whether that is the session's ambient photograph, else the mean photograph (its mean over the channels).
  bool ambient_room = false;

  bool mixes_colours() const { return mixing != Eigen::Matrix3d::Identity(); }
  bool bends_tone() const { return tone != std::array<double, 3>{1.0, 1.0, 1.0}; }
  bool is_identity() const;
};

/// JSON text of a model, with all digits.
std::string rig_text(const RigModel& rig);
/// Throws InputError naming `name` for text that is not a model.
RigModel rig_from_text(const std::string& text, const std::string& name);
RigModel read_rig(const fs::path& path);

/// Gives each of the `frames` of a session the light map and the correction of the model; frames without a
/// light map are removed. Throws InputError when the model does not have all frames, by name, or the session
/// lacks the ambient photograph that the model needs.
void apply_rig(const RigModel& rig, const CaptureSession& session, std::vector<CaptureFrame>& frames);

/// Gives held-out frames of `session` (role test) what the rig model in a field's provenance says of their
/// neighbours in time, so that they can be compared with the field: the light map, shift and turn (linear
/// between neighbours) and the tone curve. Their gain and room light are not known. Frames whose light map is
/// not there are removed. Changes nothing where the session does not hold the photographs of the model.
void correct_held_out(const std::string& provenance, CaptureSession& session);

}  // namespace refield
