// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "relight/viewer/field/view_state.h"
#include "relight/viewer/gui/background_job.h"
#include "relight/viewer/gui/viewer_window.h"

namespace refield {

/// A light map, read and ready to go behind the light sources.
struct OpenedLight {
  fs::path file;
  LightMap map;                                            ///< that fits the field; empty for environments
  std::shared_ptr<const PreparedEnvironment> environment;  ///< instead
  std::shared_ptr<const EnvironmentProjector> projector;   ///< of it
  std::string note;                                        ///< what was done to the map
};

/// What a file held: a field or, with `state` null, a light map.
struct OpenedFile {
  fs::path file;
  std::unique_ptr<ViewState> state = nullptr;
  std::optional<OpenedLight> light = std::nullopt;  ///< with a field, too: the one to begin with
};

/// The viewer of fields: what is shown (ViewState) and how the window stands.
class FieldViewer final : public ViewerWindow {
 public:
  FieldViewer(OpenedFile field, std::vector<MonitorPlacement> monitors, const RunContext& context);

 private:
  std::string title() const override { return field_file_.filename().string(); }
  std::string name() const override;
  const Image& radiance() const override { return state_->radiance(); }
  PixelGrid grid() const override { return state_->grid(); }
  PixelPosition image_size() const override { return {state_->image_width(), state_->image_height()}; }
  std::span<const std::uint8_t> levels() const override { return state_->picture(); }
  FreeView* camera() override { return state_->view(); }
  ToneMapping tone() const override { return state_->tone(); }
  void set_tone(const ToneMapping& tone) override { state_->set_tone(tone); }
  void expose() override { state_->expose_picture(); }
  bool is_busy() const override {
    return opening_ || tells_share_ || state_->is_reading() || !state_->is_current();
  }
  /// Moves what is in motion: light sources sweep, the map turns.
  void advance(double seconds) override;
  /// Begins to read a field (.rfield) or a light map in the background; what was being read is given up.
  void open(const fs::path& file) override;
  void draw_controls(const Area& area) override;
  Refreshed refresh() override;
  void draw_over_picture() override;
  std::string pointer() const override;
  const char* mouse_help() const override;
  std::vector<Shortcut> shortcuts() override;
  void pick(const PixelPosition& pixel) override { state_->pick(pixel); }
  void deselect() override;
  void save(const fs::path& file) override;

  void show_light(OpenedLight opened);
  void show_opened(OpenedFile opened);
  /// Takes over what has been read since; errors become notices.
  void take_opened();
  void tell_share();
  /// The part of the image that is in view. Nothing where it was moved out of it, and for meshes.
  std::optional<VisibleRegion> visible_region() const;

  void turn_light(double degrees);
  void add_and_select(PaintedLight::Shape shape);
  void change_selected(const std::function<void(PaintedLight&)>& change);
  void remove_selected();
  void toggle_probing();
  /// Lights by a square of probe_texels_ around a point of the light map alone.
  void probe_at(const Point& texel);

  void light_section();
  void light_source_section();
  void picture_section();
  void kernel_section();
  double kernel_section_height() const;
  void draw_light_panel(const Area& area);
  void handle_light_mouse();
  void handle_light_drag();
  void handle_light_wheel();
  void draw_light_source(const PaintedLight& light_source, bool is_selected) const;
  void draw_kernels() const;
  void draw_probe() const;
  /// A point of the window in fractions of the map's width and height, and back.
  Point fraction_at(const Point& window) const;
  Point window_at(double x, double y) const;

  fs::path field_file_;
  std::vector<MonitorPlacement> monitors_;  // in place of those of fields; empty: theirs
  std::string light_name_;                  // of the map behind the light sources; empty: none
  fs::path light_file_;
  std::unique_ptr<ViewState> state_;

  std::unique_ptr<BackgroundJob<OpenedFile>> opening_;  // the file that is being read
  /// Those before it, cancelled: kept until they end, so that no one has to wait for them.
  std::vector<std::unique_ptr<BackgroundJob<OpenedFile>>> abandoned_;
  bool tells_share_ = false;  // a new environment is being projected: say how much of it the monitor shows

  bool probes_ = false;        // the left button probes the light instead of moving light sources
  int probe_texels_ = 1;       // side of the probe
  bool shows_kernels_ = true;  // those of the picked pixel over the light map

  Canvas light_;
  Texture light_texture_, kernel_texture_;
};

}  // namespace refield
