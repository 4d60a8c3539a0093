// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <set>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/session/capture_session.h"

namespace refield {

/// A field that takes in images which it was not made from: pixels choose anew, with all images, among the
/// rectangles that their block has in the field, which saves most of the search (BlockFitter::fit()).
class Refinement {
 public:
  /// Reads the field. `frames` are all training frames, its own and new ones. Throws InputError when sizes or
  /// light domain differ, when the field does not say what it was made from, when one of its frames is not
  /// among `frames`, or when none of these is new.
  Refinement(const fs::path& field, const CaptureSession& session, std::span<const CaptureFrame> frames,
             const RunContext& run = {});

  /// Says which frames the images of a fit are, once some have been left out.
  void use_frames(std::span<const CaptureFrame> frames);
  /// Whether the field has not seen an image of use_frames() yet.
  bool is_new(int image) const { return is_new_[image] != 0; }
  int known_images() const { return static_cast<int>(known_names_.size()); }
  const fs::path& path() const { return path_; }
  /// The rectangles that a pixel has in the field.
  std::vector<Box> boxes(std::size_t pixel) const;

 private:
  fs::path path_;
  ReflectanceField field_;
  std::set<std::string> known_names_;
  std::vector<char> is_new_;
};

}  // namespace refield
