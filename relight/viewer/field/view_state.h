// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"
#include "core/image/tone_map.h"
#include "relight/relighter.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/field/light_panorama.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/tone_table_cache.h"

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

/// False colours reach from that many stops below white to that many above.
inline constexpr double stops_below_white = 8.0;
inline constexpr double stops_above_white = 2.0;

/// All that the viewer is about, without its window: a field, the light that it is under, what is selected,
/// how it is shown. Setters only note what is outdated. Light maps are made and images relit by a job in the
/// background, one at a time, which refresh() starts and whose result it takes; until then the last image
/// stays. A job begins with what is wanted at that time, so that changes never queue up.
class ViewState {
 public:
  /// Starts under a dim ambient light and two light sources, exposed for them. Throws InputError for an empty
  /// field.
  explicit ViewState(ReflectanceField field, const RunContext& run = {})
      : ViewState(load(std::move(field)), run) {}
  explicit ViewState(PackedField packed, const RunContext& run = {})
      : ViewState(load(std::move(packed)), run) {}
  ViewState(const ViewState&) = delete;  // the job works on it
  ViewState& operator=(const ViewState&) = delete;

  /// Without transfer and rectangles, which stand in the relighter alone.
  const ReflectanceField& field() const { return field_; }
  /// Of fields over a mesh the user's camera; null for photographs.
  FreeView* view() { return view_.get(); }
  const FreeView* view() const { return view_.get(); }
  /// How the light map is laid before the user.
  const LightPanorama& panorama() const { return panorama_; }
  /// What light is wanted.
  LightSetup& setup() { return setup_; }
  const LightSetup& setup() const { return setup_; }
  /// The light map that the image shows. Only while is_current(). Throws Interrupted.
  LightMap light() const;
  /// What of the environment reaches the light map, as of the last refresh().
  const EnvironmentShare& share() const { return share_; }
  /// Back to the light sources of the start.
  void reset_light_sources();

  const ToneMapping& tone() const { return tone_; }
  void set_tone(const ToneMapping& tone);
  /// The exposure of the light map's own picture.
  double light_exposure() const { return light_exposure_; }
  void set_light_exposure(double exposure);
  /// Exposes the picture, or the light, so that 1 % of it is white or more: at once, or once the image is
  /// relit.
  void expose_picture();
  void expose_light();

  Shown shown() const { return shown_; }
  /// Throws InputError for a map that the field does not hold.
  void show(Shown shown);
  bool has(Shown shown) const;
  /// The relative error that has the last colour: the 98th percentile of the map that is shown; 0 for others.
  double error_range() const { return error_range_; }

  /// Whose kernels are shown; nothing: no one's. Positions outside the picture are taken as nothing. On a
  /// mesh the vertex is picked that the pixel shows most of, and stays so when the camera moves; picked() is
  /// where it is seen then, through what hides it.
  void pick(std::optional<PixelPosition> pixel);
  const std::optional<PixelPosition>& picked() const { return picked_; }
  const std::vector<PixelKernel>& kernels() const { return kernels_; }

  /// A part of the light map that alone gives light, one a texel: the sum of the transfer's columns there.
  /// Nothing: the painted light. The first part is exposed for; those that follow keep its exposure.
  void probe(std::optional<Box> part);
  const std::optional<Box>& probed() const { return probed_; }

  /// Whether the image shows the light that is wanted; else another refresh() is due.
  bool is_current() const { return !job_ && done_ == wanted(); }
  /// Relightings so far.
  std::size_t relit() const { return relit_count_; }

  /// What was outdated and is anew.
  struct Refreshed {
    bool picture = false;
    bool light = false;
    bool kernels = false;
    double light_ms = 0.0;    ///< in the background: turning or projecting the map, painting light sources
    double relight_ms = 0.0;  ///< in the background
    double view_ms = 0.0;     ///< of what the camera sees, and the picture of it
    double tone_ms = 0.0;
    double wait_ms = 0.0;  ///< for the background
  };
  /// Brings up to date what can be within `patience`, by default all of it. Throws what projecting the map
  /// throws.
  Refreshed refresh(std::optional<std::chrono::milliseconds> patience = std::nullopt);

  /// The picture, as of the last refresh(). Pixels of red, green, blue, alpha, row-major.
  const Image& radiance() const { return view_ ? seen_ : outputs_; }
  /// The light map as it is shown.
  const Image& shown_light() const { return shown_light_; }
  std::span<const std::uint8_t> picture() const { return picture_; }
  std::span<const std::uint8_t> light_picture() const { return light_picture_; }
  /// The density of the picked pixel's kernels over the light map, to be laid over its picture.
  std::span<const std::uint8_t> kernel_picture() const { return kernel_picture_; }
  /// Of the relit image: tone mapping, or the probe's.
  ToneMapping tone_in_use() const { return {done_.probe ? probe_exposure_ : tone_.exposure, tone_.curve}; }

 private:
  /// What an image is relit by.
  struct Request {
    LightSetup light;
    std::optional<Box> probe;
    bool operator==(const Request&) const = default;
  };
  struct JobTimes {
    double light_ms = 0.0, relight_ms = 0.0;
  };
  Request wanted() const { return {setup_, probed_}; }
  void start_job();
  JobTimes relight(const Request& request);
  const Image& relight_probe(const Box& probe);
  bool is_summed(const LightSetup& light) const;
  double sum_environment(const LightSetup& light);
  void take_result(Refreshed& done);
  void show_light(const std::optional<Box>& changed);
  void expose_if_current();
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
  ViewState(Loaded loaded, const RunContext& run);
  static Loaded load(ReflectanceField field);
  static Loaded load(PackedField packed);

  RunContext run_;
  ReflectanceField field_;
  LightSetup setup_;
  ToneMapping tone_;
  double light_exposure_ = 1.0;
  Shown shown_ = Shown::picture;
  double error_range_ = 0.0;
  std::optional<PixelPosition> picked_;
  std::optional<std::uint32_t> picked_vertex_;
  std::vector<PixelKernel> kernels_;
  std::optional<Box> probed_;
  double probe_exposure_ = 1.0;
  bool wants_picture_exposure_ = false, wants_light_exposure_ = false;

  ToneTableCache picture_tone_, light_tone_;
  LightPanorama panorama_;
  std::unique_ptr<FreeView> view_;
  Image seen_;  // by it
  Image outputs_, shown_light_;
  std::vector<std::uint8_t> picture_, light_picture_, kernel_picture_;
  bool is_picture_old_ = true, is_light_old_ = true, are_kernels_old_ = true;

  Request done_, running_;
  EnvironmentShare share_;
  std::size_t relit_count_ = 0;
  bool was_summed_ = false;  // the environment in shown_light_

  // The job's alone while it runs, but for the relighter's transfer, which never changes.
  Relighter relighter_;
  LightPainter painter_;
  LightMap probe_light_;
  std::optional<Box> lit_;        // of probe_light_, which the relighter shows; nothing: what is painted
  const Image* relit_ = nullptr;  // in the relighter
  std::optional<Box> changed_;    // of what is painted, since a result was taken
  /// Clustered lights: an environment's integrals over the clusters, without a light map. What it lights is
  /// added to what light sources light.
  struct SummedEnvironment {
    Relighter relighter;
    BoxProjector boxes;
    EnvironmentProjector shown;  ///< onto the panorama
    std::optional<LightSetup> of;
    LightMap straight;  ///< on the panorama, not turned
    Image outputs, panorama;
  };
  std::optional<SummedEnvironment> summed_;
  bool adds_summed_ = false;  // to what relit_ shows
  bool is_dark_ = false;      // beside a summed environment nothing shines; relit_ is missing then
  std::unique_ptr<BackgroundJob<JobTimes>> job_;  // ends before what it works on
};

}  // namespace refield
