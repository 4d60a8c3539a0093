// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "relight/environment/environment.h"
#include "relight/mesh/mesh_view.h"
#include "relight/relighter.h"

namespace refield {

/// An environment that lights a scene, turned, for fields that need no light map of it.
struct SceneEnvironment {
  std::shared_ptr<const PreparedEnvironment> environment;
  EulerAngles turn{};
};
using SceneLight = std::variant<LightMap, SceneEnvironment>;

/// The pictures of a field, one a frame: of a captured field its outputs as they stand, of one over a mesh
/// what cameras see. May be asked from several threads at a time.
class FieldPictures {
 public:
  /// `cameras`: none (the field's standard_camera(), where it has a mesh), one for all frames, or one a
  /// frame, all of the first one's size. The field must outlive this. Throws InputError for cameras without a
  /// mesh to look at and what PinholeCamera::check() throws.
  // NOLINTNEXTLINE(google-explicit-constructor): a field shows itself where no camera is asked for
  FieldPictures(const ReflectanceField& field, std::vector<PinholeCamera> cameras = {});

  /// Lays the field out for relighting many times, by TileRelighter, which takes the time of some pictures
  /// and memory. Pictures before are as ReflectanceField::relight() gives them. Not while pictures are made.
  void lay_out(RelightPrecision precision);

  /// From now on background() shows the light. Throws InputError for a captured field, whose photographs fill
  /// the picture.
  void show_background();

  ColourSpace colour_space() const { return field_->colour_space; }
  int width() const;
  int height() const;

  /// What the field's pixels, or the vertices of its mesh, send under a light: [height × width × 3] of the
  /// field. Throws InputError when the light does not fit the field, and for an environment where
  /// box_sums_suffice() does not hold.
  Image outputs(const SceneLight& light, const RunContext& run = {}) const;
  /// The picture of such outputs.
  Image picture(Image outputs, std::size_t frame) const;
  Image picture(const SceneLight& light, std::size_t frame, const RunContext& run = {}) const {
    return picture(outputs(light, run), frame);
  }
  /// What the vertices of the field's mesh reflect of such outputs, colours included, [1 × vertices × 3].
  /// Throws InputError for a captured field and for one whose light depends on the direction of sight.
  Image vertices(const Image& outputs) const;
  /// The mesh; null of a captured field.
  const Mesh* mesh() const { return field_->mesh ? &*field_->mesh : nullptr; }
  /// What is to be added to picture(): the light as it is seen beside the mesh, four lines of sight a pixel,
  /// times the part of the pixel that the mesh leaves; empty unless show_background() was called.
  Image background(const SceneLight& light, std::size_t frame) const;
  /// See FieldOutline::light_shares().
  LightShares light_shares(const LightMap& light) const { return field_->light_shares(light.radiance); }
  /// [pixels]: the part of each pixel that the mesh covers, whose radiance the picture holds; empty for a
  /// captured field, which covers all.
  std::vector<float> coverage(std::size_t frame) const;

 private:
  struct Relighters;

  const ReflectanceField* field_;
  std::vector<PinholeCamera> cameras_;
  bool shows_background_ = false;
  std::shared_ptr<const MeshRenderer> view_;  // where one camera takes all frames
  std::shared_ptr<const BoxProjector> box_projector_;
  std::shared_ptr<Relighters> relighters_;
};

/// A warning where more than 1 % of the light has an effect that the field does not know; empty otherwise.
std::string unobserved_light_warning(const LightShares& shares);

/// `frames` cameras on a full circle about the target, along the horizon (around +Y), from `start` on; seen
/// from above they go to the right of the first one's sight.
std::vector<PinholeCamera> turntable(const PinholeCamera& start, int frames);

}  // namespace refield
