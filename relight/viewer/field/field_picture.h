// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"
#include "core/image/tone_map.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/field/view_relighter.h"
#include "relight/viewer/gui/canvas.h"

namespace refield {

/// What the viewer shows of a field.
///  - picture: the relit scene, tone-mapped.
///  - false_colour: its luminance in stops.
///  - the others: maps of relative error that the field holds, where it does.
enum class Shown { picture, false_colour, predicted_error, photograph_noise, training_error };

/// False colours reach from that many stops below white to that many above.
inline constexpr double stops_below_white = 8.0;
inline constexpr double stops_above_white = 2.0;

/// A field's image in the levels of the screen.
class FieldPicture {
 public:
  /// `field` must outlive this, or be replaced.
  explicit FieldPicture(const FieldOutline& field) : field_(&field) {}
  /// Other pixels of the same field.
  void replace(const FieldOutline& field);

  Shown shown() const { return shown_; }
  /// Throws InputError for a map that the field does not hold.
  void show(Shown shown);
  bool has(Shown shown) const;
  /// The relative error that has the last colour: the 98th percentile of the map that is shown; 0 for others.
  double error_range() const { return error_range_; }

  const ToneMapping& tone() const { return tone_; }
  void set_tone(const ToneMapping& tone);

  /// The relit image is another.
  void set_relit();
  /// It is shown by another exposure, or was never shown.
  void outdate() { is_old_ = true; }
  /// Makes the levels, where they are outdated; whether they were.
  /// `light`: that gave `radiance`, for the predicted error; null where it is no map of the field's domain.
  bool draw(const Image& radiance, double exposure, const Image* light = nullptr);
  /// Pixels of red, green, blue, alpha, row-major.
  std::span<const std::uint8_t> levels() const { return levels_; }

 private:
  void set_range(std::vector<float> errors);
  bool depends_on_light() const;

  const FieldOutline* field_;
  Shown shown_ = Shown::picture;
  double error_range_ = 0.0;
  ToneMapping tone_;
  ToneTableCache tone_table_;
  std::vector<std::uint8_t> levels_;
  bool is_old_ = true;
};

/// The kernels of one pixel or vertex, and their density over the light map.
class KernelPicture {
 public:
  /// `panorama` must outlive this.
  explicit KernelPicture(const LightPanorama& panorama);

  /// Nothing, and positions where no pixel is: no pixel's. On a mesh the vertex is picked that the pixel of
  /// `view` shows most of.
  void pick(std::optional<PixelPosition> pixel, const PixelGrid& shown, const FreeView* view);
  /// Where it is seen.
  const std::optional<PixelPosition>& picked() const { return picked_; }
  /// Finds where the picked vertex of a mesh is seen now, also through what hides it.
  void follow(const PinholeCamera& camera, const OutputMesh& mesh);

  /// Finds the kernels, where others were picked, and makes the levels; whether there are new ones. They stay
  /// where later pixels are not those of the picked one.
  bool draw(const FieldPixels& pixels);
  const std::vector<PixelKernel>& kernels() const { return kernels_; }
  /// To be laid over the light map.
  std::span<const std::uint8_t> levels() const { return levels_; }

 private:
  std::optional<std::size_t> picked_output(const FieldPixels& pixels) const;

  const LightPanorama& panorama_;
  std::optional<PixelPosition> picked_;
  std::optional<std::uint32_t> picked_vertex_;
  std::vector<PixelKernel> kernels_;
  std::vector<std::uint8_t> levels_;
  bool is_old_ = true;
};

}  // namespace refield
