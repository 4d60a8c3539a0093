// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field/field_statistics.h"
#include "core/field/reflectance_field.h"
#include "core/field_io/field_sampler.h"
#include "core/field_io/packed_field.h"
#include "core/image/tone_map.h"
#include "relight/relighter.h"
#include "relight/viewer/field/light_painter.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/free_view.h"

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

/// What a window shows of a large image: a rectangle of it, at `scale` window pixels per image pixel.
struct VisibleRegion {
  Box region;
  double scale = 1.0;
  bool operator==(const VisibleRegion&) const = default;
};

/// Pixels of a large field for a window: every n-th of the whole image, which stay, and those of the visible
/// region at the resolution of the window. A window waits for a few of the first only; a job in the
/// background reads the others. Every n-th pixel, not the mean of n × n: means would need all entries of the
/// region, n² times as many bytes of the file.
class DetailLoader {
 public:
  /// Pixels of the whole image, which a window waits for, of it later, and of a region, at most.
  static constexpr std::int64_t max_first_pixels = std::int64_t{3} << 15;
  static constexpr std::int64_t max_coarse_pixels = std::int64_t{3} << 18;
  static constexpr std::int64_t max_detail_pixels = std::int64_t{9} << 18;

  /// Reads the first pixels. Throws what FieldSampler::read() throws.
  DetailLoader(std::unique_ptr<const FieldSampler> file, const RunContext& run);

  const FieldOutline& outline() const { return file_->outline(); }
  /// Of the whole image, as read so far.
  const std::shared_ptr<FieldPixels>& coarse() const { return coarse_; }
  /// The best pixels read so far that cover what is visible; starts to read better ones. Called once a frame.
  /// Throws what reading threw, once.
  std::shared_ptr<FieldPixels> show(const std::optional<VisibleRegion>& visible);
  bool is_reading() const { return job_ != nullptr; }
  /// Until reading ends, for a moment, if the last two calls of show() were for the same region: frames that
  /// show nothing new must not slow the reading.
  void wait_at_rest() const;

 private:
  PixelGrid grid_for(const VisibleRegion& visible) const;
  /// What is to be read for a window that shows a region, or none; nothing where that has been read or
  /// failed.
  std::optional<PixelGrid> wanted(const std::optional<VisibleRegion>& visible) const;
  /// Whether a grid shows a region with room for a move, at the resolution of the window.
  bool is_good(const PixelGrid& grid, const VisibleRegion& visible) const;
  void take_read();
  void read(const PixelGrid& grid);

  std::unique_ptr<const FieldSampler> file_;
  RunContext run_;
  PixelGrid whole_;  // of the coarse pixels, in the end
  std::shared_ptr<FieldPixels> coarse_, detail_;
  std::optional<VisibleRegion> visible_;  // in the last show()
  bool is_at_rest_ = false;
  PixelGrid reading_;  // of the job, or of the last one, which may have failed
  bool has_failed_ = false;
  std::unique_ptr<BackgroundJob<std::shared_ptr<FieldPixels>>> job_;
};

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
  struct Changed : Refreshed {
    bool light = false;
    bool kernels = false;
  };
  /// Brings up to date what can be within `patience`, by default all of it. Throws what projecting the map
  /// throws.
  Changed refresh(std::optional<std::chrono::milliseconds> patience = std::nullopt);

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

  bool await_relit(std::optional<std::chrono::milliseconds> patience, Changed& done);
  void take_result(Changed& done);
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
