// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <optional>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/field_sampler.h"
#include "relight/relighter.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/gui/window_state.h"

namespace refield {

/// A field, or some pixels of a large one, laid out to be relit.
struct FieldPixels {
  TileRelighter relighter;
  FieldOutline field;  ///< without boxes, which stand in the relighter alone
  PixelGrid grid;      ///< of the whole image

  /// Of the whole image, or `part` of it. Throw InputError for an empty field.
  explicit FieldPixels(ReflectanceField pixels, const std::optional<PixelGrid>& part = std::nullopt);
  explicit FieldPixels(PackedField pixels);
};

/// What is to be shown under which light: all that is set up, or for a probe one part of the light map alone,
/// with a radiance of one.
struct ViewLight {
  LightSetup setup;
  std::optional<Box> probe;
  std::shared_ptr<FieldPixels> pixels;
  bool operator==(const ViewLight&) const = default;
};

/// A relit field as the user sees it.
struct RelitField {
  Image outputs;           ///< the field's image, or its mesh's outputs
  Image light;             ///< the light map, as LightPanorama shows it
  EnvironmentShare share;  ///< what of the environment reaches the light map
};

/// Relights a field by one light after another, each at the cost of what differs from the one before. For a
/// job in the background: while relight() runs, only panorama() may be called, and of its pixels' relighter
/// only transfer().
class ViewRelighter {
 public:
  ViewRelighter(std::shared_ptr<FieldPixels> pixels, const RunContext& run);

  const LightPanorama& panorama() const { return panorama_; }

  /// The times of the light map and of relighting. What can be cancelled is projecting alone, which takes
  /// long and leaves all as it was; then throws Interrupted.
  FrameTime relight(const ViewLight& wanted);

  /// Brings `shown`, always the same, up to date with the last relight(). Whether its light map changed.
  bool show(RelitField& shown);
  /// The light map of the last relight(), without its probe. Throws Interrupted.
  LightMap light() const;

 private:
  bool is_summed(const LightSetup& setup) const;
  double sum_environment(const LightSetup& setup);
  void relight_painted(const std::optional<Box>& probe, const std::optional<Box>& changed);
  const Image& relight_probe(const Box& probe);
  bool show_light(Image& shown);

  RunContext run_;
  LightPanorama panorama_;
  std::shared_ptr<FieldPixels> pixels_;
  LightPainter painter_;
  ViewLight relit_by_;            // by the last relight()
  const Image* relit_ = nullptr;  // by it, in the pixels' relighter; null before, and where nothing but a
                                  // summed environment shines
  bool is_dark_ = false;          // nothing was painted for it, as nothing but a summed environment shines
  std::optional<Box> changed_;    // of what is painted, since the last show()
  bool showed_summed_ = false;    // by the last show()

  LightMap probe_light_;
  std::optional<Box> lit_;  // of probe_light_, which the relighter shows; nothing: what is painted

  /// Clustered lights: an environment's integrals over the clusters, without a light map. What it lights is
  /// added to what light sources light.
  struct SummedEnvironment {
    TileRelighter relighter;
    BoxProjector boxes;
    EnvironmentProjector shown;  ///< onto the panorama
    std::optional<LightSetup> of;
    LightMap straight;  ///< on the panorama, not turned
    Image outputs, panorama;
  };
  std::optional<SummedEnvironment> summed_;
};

}  // namespace refield
