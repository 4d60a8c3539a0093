// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/pixel_kernels.h"
#include "core/reflectance_field.h"
#include "core/tone_map.h"
#include "relight/relighter.h"
#include "relight/viewer/free_view.h"
#include "relight/viewer/light_painter.h"
#include "relight/viewer/light_panorama.h"
#include "relight/viewer/tone_table_cache.h"

namespace refield {

/// What the viewer shows of a field.
///  - picture: the relit scene, tone-mapped.
///  - false_colour: its luminance in stops.
///  - the others: maps of relative error that the field holds, where it does.
enum class Shown { picture, false_colour, predicted_error, photograph_noise, training_error };

inline constexpr std::array<Shown, 5> all_shown = {Shown::picture, Shown::false_colour,
                                                   Shown::predicted_error, Shown::photograph_noise,
                                                   Shown::training_error};
std::string_view name_of(Shown shown);
/// Throws InputError for an unknown name.
Shown shown_from_name(std::string_view name);

struct PixelPosition {
  int x = 0;
  int y = 0;
  bool operator==(const PixelPosition&) const = default;
};

/// False colours reach from so many stops below white to so many above.
inline constexpr double stops_below_white = 8.0;
inline constexpr double stops_above_white = 2.0;

/// All that the viewer is about, without its window: a field, the light that it is under, what is selected,
/// how it is shown. Setters only note what is outdated; refresh() does the work.
class ViewState {
 public:
  /// Starts under a dim ambient light and two lamps, exposed for them. Throws InputError for an empty field.
  explicit ViewState(ReflectanceField field) : ViewState(load(std::move(field))) {}
  explicit ViewState(PackedField packed) : ViewState(load(std::move(packed))) {}
  ViewState(const ViewState&) = delete;  // the picture may lie in the relighter
  ViewState& operator=(const ViewState&) = delete;

  /// Without transfer and rectangles, which stand in the relighter alone.
  const ReflectanceField& field() const { return field_; }
  /// Of fields over a mesh the user's camera; null for photographs.
  FreeView* view() { return view_.get(); }
  const FreeView* view() const { return view_.get(); }
  /// How the light map is laid before the user.
  const LightPanorama& panorama() const { return panorama_; }
  LightPainter& painter() { return painter_; }
  const LightPainter& painter() const { return painter_; }
  /// Back to the lamps of the start.
  void reset_lamps();

  const ToneMapping& tone() const { return tone_; }
  void set_tone(const ToneMapping& tone);
  /// The exposure of the light map's own picture.
  double light_exposure() const { return light_exposure_; }
  void set_light_exposure(double exposure);
  /// Exposes the picture, or the light, so that 1 % of it is white or more.
  void expose_picture();
  void expose_light();

  Shown shown() const { return shown_; }
  /// Throws InputError for a map that the field does not hold.
  void show(Shown shown);
  bool has(Shown shown) const;
  /// The relative error that has the last colour: the 98th percentile of the map that is shown; 0 for others.
  double error_range() const { return error_range_; }

  /// Whose kernels are shown; nothing: nobody's. Positions outside the picture are taken as nothing. On a
  /// mesh the vertex is picked that the pixel shows most of, and stays so when the camera moves; picked() is
  /// where it is seen then, through what hides it.
  void pick(std::optional<PixelPosition> pixel);
  const std::optional<PixelPosition>& picked() const { return picked_; }
  const std::vector<PixelKernel>& kernels() const { return kernels_; }

  /// A part of the light map that alone gives light, one a texel: the sum of the transfer's columns there.
  /// Nothing: the painted light. The first part is exposed for; those that follow keep its exposure.
  void probe(std::optional<Box> part);
  const std::optional<Box>& probed() const { return probed_; }

  /// What was outdated and is anew.
  struct Refreshed {
    bool picture = false;
    bool light = false;
    bool kernels = false;
    double relight_ms = 0.0;
    double view_ms = 0.0;  ///< of what the camera sees, and the picture of it
    double tone_ms = 0.0;
  };
  Refreshed refresh();

  /// The picture, as of the last refresh(). Pixels of red, green, blue, alpha, row-major.
  const Image& radiance() const { return view_ ? seen_ : *outputs_; }
  /// The light map as it is shown.
  const Image& shown_light() const { return panorama_.is_cube() ? shown_light_ : painter_.light().radiance; }
  std::span<const std::uint8_t> picture() const { return picture_; }
  std::span<const std::uint8_t> light_picture() const { return light_picture_; }
  /// The density of the picked pixel's kernels over the light map, to be laid over its picture.
  std::span<const std::uint8_t> kernel_picture() const { return kernel_picture_; }
  /// Of the relit image: tone mapping, or the probe's.
  ToneMapping tone_in_use() const { return {probed_ ? probe_exposure_ : tone_.exposure, tone_.curve}; }

 private:
  bool relight();
  void relight_probe();
  bool look(bool relit);
  void place_mark();
  std::size_t picked_output() const;
  void draw_picture();
  void draw_kernels();
  const std::vector<float>& error_map(Shown shown) const;

  struct Loaded {
    ReflectanceField field;
    Relighter relighter;
  };
  explicit ViewState(Loaded loaded);
  static Loaded load(ReflectanceField field);
  static Loaded load(PackedField packed);

  ReflectanceField field_;
  Relighter relighter_;
  LightPainter painter_;
  ToneMapping tone_;
  double light_exposure_ = 1.0;
  Shown shown_ = Shown::picture;
  double error_range_ = 0.0;
  std::optional<PixelPosition> picked_;
  std::optional<std::uint32_t> picked_vertex_;
  std::vector<PixelKernel> kernels_;
  std::optional<Box> probed_;
  std::optional<Box> lit_;  // the probe that the image stands for; nothing: the painted light
  LightMap probe_light_;
  double probe_exposure_ = 1.0;

  ToneTableCache picture_tone_, light_tone_;
  LightPanorama panorama_;
  const Image* outputs_ = nullptr;  // in the relighter
  std::unique_ptr<FreeView> view_;
  Image seen_;         // by it
  Image shown_light_;  // of a cube
  std::vector<std::uint8_t> picture_, light_picture_, kernel_picture_;
  bool is_picture_old_ = true, is_light_old_ = true, are_kernels_old_ = true;
};

}  // namespace refield
