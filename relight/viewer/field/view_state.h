// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/base/run_context.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"
#include "relight/viewer/field/detail_loader.h"
#include "relight/viewer/field/field_picture.h"
#include "relight/viewer/field/free_view.h"
#include "relight/viewer/field/view_relighter.h"
#include "relight/viewer/gui/background_job.h"

namespace refield {

/// All that the viewer is about, without its window: a field, the light that it is under, what is selected,
/// how it is shown. Setters only note what is outdated. Light maps are made and images relit by a job in the
/// background, one at a time, which refresh() starts and whose result it takes; until then the last image
/// stays. A job begins with what is wanted at that time, so that changes never queue up.
class ViewState {
 public:
  /// Starts under a dim ambient light and two light sources, exposed for them. Throws InputError for an empty
  /// field.
  explicit ViewState(ReflectanceField field, const RunContext& run = {})
      : ViewState(std::make_shared<FieldPixels>(std::move(field)), nullptr, run) {}
  explicit ViewState(PackedField packed, const RunContext& run = {})
      : ViewState(std::make_shared<FieldPixels>(std::move(packed)), nullptr, run) {}
  /// Of a large field, some pixels: see look_at(). Throws what DetailLoader throws.
  explicit ViewState(std::unique_ptr<const FieldSampler> file, const RunContext& run = {})
      : ViewState(std::make_unique<DetailLoader>(std::move(file), run), run) {}
  ViewState(const ViewState&) = delete;  // its parts and the job refer to it
  ViewState& operator=(const ViewState&) = delete;

  /// That of the pixels shown, without rectangles, which stand in the relighter alone.
  const FieldOutline& field() const { return shown_->field; }
  /// The pixels of the whole image that radiance() holds, and the size of that image.
  PixelGrid grid() const;
  int image_width() const { return loader_ ? loader_->outline().width : radiance().width; }
  int image_height() const { return loader_ ? loader_->outline().height : radiance().height; }
  /// Of a large field, wants the pixels that the window shows; nothing: no part of it. Called once a frame.
  /// Until they are read, coarser ones stay. Throws what reading them threw.
  void look_at(const std::optional<VisibleRegion>& visible);
  /// Whether finer pixels are being read.
  bool is_reading() const { return loader_ && loader_->is_reading(); }
  /// Of fields over a mesh the user's camera; null for photographs.
  FreeView* view() { return view_.get(); }
  const FreeView* view() const { return view_.get(); }
  /// How the light map is laid before the user.
  const LightPanorama& panorama() const { return relighter_.panorama(); }
  /// What light is wanted.
  LightSetup& setup() { return wanted_.setup; }
  const LightSetup& setup() const { return wanted_.setup; }
  /// Back to the light sources of the start.
  void reset_light_sources();
  /// The light map that the image shows. Only while is_current(). Throws Interrupted.
  LightMap light() const { return relighter_.light(); }
  /// FieldOutline::light_shares() of the light map, as of the last refresh(). 0 for cube maps.
  const LightShares& light_shares() const { return light_shares_; }
  /// What of the environment reaches the light map, as of the last refresh().
  const EnvironmentShare& share() const { return relit_.share; }

  const ToneMapping& tone() const { return picture_.tone(); }
  void set_tone(const ToneMapping& tone) { picture_.set_tone(tone); }
  /// Of the relit image: tone mapping, or the probe's.
  ToneMapping tone_in_use() const { return {done_.probe ? probe_exposure_ : tone().exposure, tone().curve}; }
  /// The exposure of the light map's own picture.
  double light_exposure() const { return light_exposure_; }
  void set_light_exposure(double exposure);
  /// Exposes the picture, or the light, so that 1 % of it is white or more: at once, or once the image is
  /// relit.
  void expose_picture();
  void expose_light();

  Shown shown() const { return picture_.shown(); }
  /// Throws InputError for a map that the field does not hold.
  void show(Shown shown) { picture_.show(shown); }
  bool has(Shown shown) const { return picture_.has(shown); }
  double error_range() const { return picture_.error_range(); }

  /// Whose kernels are shown; nothing: no one's. Positions outside the picture are taken as nothing; of a
  /// large field the pixel before it is picked that is shown. On a mesh the vertex is picked that the pixel
  /// shows most of, and stays so when the camera moves; picked() is where it is seen then, through what hides
  /// it.
  void pick(std::optional<PixelPosition> pixel) { kernels_.pick(pixel, grid(), view()); }
  const std::optional<PixelPosition>& picked() const { return kernels_.picked(); }
  const std::vector<PixelKernel>& kernels() const { return kernels_.kernels(); }

  /// A part of the light map that alone gives light, one a texel: the sum of the transfer's columns there.
  /// Nothing: the painted light. The first part is exposed for; those that follow keep its exposure.
  void probe(std::optional<Box> part);
  const std::optional<Box>& probed() const { return wanted_.probe; }

  /// Whether the image shows the light that is wanted; else another refresh() is due.
  bool is_current() const { return !job_ && done_ == wanted_; }
  /// Relightings so far.
  std::size_t relit() const { return relit_count_; }

  /// What was outdated and is anew.
  struct Refreshed {
    bool picture = false;
    bool light = false;
    bool kernels = false;
    FrameTime time;  ///< all but total_ms and draw_ms
  };
  /// Brings up to date what can be within `patience`, by default all of it. Throws what projecting the map
  /// throws.
  Refreshed refresh(std::optional<std::chrono::milliseconds> patience = std::nullopt);

  /// The picture, as of the last refresh(). Pixels of red, green, blue, alpha, row-major.
  const Image& radiance() const { return view_ ? seen_ : relit_.outputs; }
  /// The light map as it is shown.
  const Image& shown_light() const { return relit_.light; }
  std::span<const std::uint8_t> picture() const { return picture_.levels(); }
  std::span<const std::uint8_t> light_picture() const { return light_levels_; }
  /// The density of the picked pixel's kernels over the light map, to be laid over its picture.
  std::span<const std::uint8_t> kernel_picture() const { return kernels_.levels(); }

 private:
  ViewState(std::unique_ptr<DetailLoader>&& loader, const RunContext& run)
      : ViewState(loader->coarse(), std::move(loader), run) {}
  ViewState(std::shared_ptr<FieldPixels> pixels, std::unique_ptr<DetailLoader>&& loader,
            const RunContext& run);

  bool await_relit(std::optional<std::chrono::milliseconds> patience, Refreshed& done);
  void take_result(Refreshed& done);
  bool look(bool relit);
  void expose_if_current();
  bool draw_light();

  std::unique_ptr<DetailLoader> loader_;  // of large fields
  std::shared_ptr<FieldPixels> shown_;
  ViewRelighter relighter_;  // the job's alone while it runs
  FieldPicture picture_;
  KernelPicture kernels_;
  std::unique_ptr<FreeView> view_;

  ViewLight wanted_, done_, running_;
  RelitField relit_;
  Image seen_;  // of it, by the camera
  std::size_t relit_count_ = 0;

  double probe_exposure_ = 1.0, light_exposure_ = 1.0;
  bool wants_picture_exposure_ = false, wants_light_exposure_ = false;
  ToneTableCache light_tone_;
  std::vector<std::uint8_t> light_levels_;
  bool is_light_old_ = true;
  LightShares light_shares_;

  std::unique_ptr<BackgroundJob<FrameTime>> job_;  // ends before what it works on
};

}  // namespace refield
