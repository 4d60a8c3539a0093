// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <memory>
#include <vector>

#include "core/reflectance_field.h"
#include "relight/mesh_view.h"

namespace refield {

/// The pictures of a field, one a frame: of a captured field its outputs as they stand, of one over a mesh
/// what cameras see. May be asked from several threads at a time.
class FieldPictures {
 public:
  /// `cameras`: none (the field's standard_camera(), where it has a mesh), one for all frames, or one a
  /// frame, all of the first one's size. The field must outlive this. Throws InputError for cameras without a
  /// mesh to look at and what PinholeCamera::check() throws.
  // NOLINTNEXTLINE(google-explicit-constructor): a field shows itself where no camera is asked for
  FieldPictures(const ReflectanceField& field, std::vector<PinholeCamera> cameras = {});

  int width() const;
  int height() const;

  /// Throws InputError when the light does not fit the field.
  Image picture(const LightMap& light, std::size_t frame) const;

 private:
  const ReflectanceField* field_;
  std::vector<PinholeCamera> cameras_;
  std::shared_ptr<const MeshView> view_;  // where one camera takes all frames
};

/// `frames` cameras on a full circle about the target, along the horizon (around +Y), from `start` on; seen
/// from above they go to the right of the first one's sight.
std::vector<PinholeCamera> turntable(const PinholeCamera& start, int frames);

}  // namespace refield
