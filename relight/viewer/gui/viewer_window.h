// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/run_context.h"
#include "core/field_io/field_sampler.h"
#include "core/image/colour.h"
#include "core/image/image.h"
#include "core/image/tone_map.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/free_view.h"
#include "relight/viewer/gui/gl_window.h"
#include "relight/viewer/viewer.h"

namespace refield {

/// A word to the user, shown for a few seconds.
struct Notice {
  std::string text;
  bool is_error = false;
  std::chrono::steady_clock::time_point until;
};

/// Choosing a file to open or to save to, in one folder.
struct FileDialog {
  enum class Purpose { open, save };

  FileDialog(Purpose wanted, const fs::path& start);
  /// Lists a folder: its folders and what can be opened (fields, images), sorted, hidden ones left out. One
  /// that cannot be read is empty.
  void go_to(const fs::path& wanted);
  /// As if a user had typed it.
  void type(const std::string& text);

  Purpose purpose;
  fs::path folder;  ///< absolute
  std::vector<fs::path> folders, files;
  std::array<char, 4096> typed{};
  bool is_new = true;  ///< not yet drawn
};

/// A key and what it does. The help shows them all, grouped in their order.
struct Shortcut {
  std::string group, name;  ///< "Image", "Shift+E"
  int key = 0;              ///< GLFW's
  bool with_shift = false;
  std::string help;
  std::function<void()> action;
};

/// A window of the viewer: a picture, controls at its right and a status bar; help, notices and a dialog for
/// files over the picture. Derived classes say what is shown, and draw their controls.
class ViewerWindow {
 public:
  /// `stem`: of saved pictures' names.
  ViewerWindow(const RunContext& context, std::string stem) : run(context), stem_(std::move(stem)) {}
  virtual ~ViewerWindow() = default;
  ViewerWindow(const ViewerWindow&) = delete;
  ViewerWindow& operator=(const ViewerWindow&) = delete;

  /// Shows it until the window is closed, sleeping while nothing happens. Throws Interrupted.
  void show_in(GlWindow& window);

  void say(const std::string& text) { notify(text, false, std::chrono::seconds(4)); }
  void complain(const std::string& text) { notify(text, true, std::chrono::seconds(10)); }
  /// Errors of `work` become notices.
  void attempt(const std::function<void()>& work);

  RunContext run;  ///< for what the window starts; notices are notes, too
  std::optional<FileDialog> dialog;
  std::optional<std::size_t> selected;  ///< light source, or thing
  bool is_playing = false;              ///< what moves by itself
  bool is_smooth = true;                ///< pixels blend into each other when enlarged
  Canvas canvas;                        ///< of the picture

 protected:
  // What the window shows.

  virtual std::string title() const = 0;
  /// The status bar's text about what is shown.
  virtual std::string name() const { return title(); }
  /// The pixels of the picture that are there, [grid()] of `image_size`.
  virtual const Image& radiance() const = 0;
  virtual PixelGrid grid() const { return {{0, 0, radiance().width, radiance().height}, 1}; }
  virtual PixelPosition image_size() const { return {radiance().width, radiance().height}; }
  /// [grid() × 4], as of the last refresh().
  virtual std::span<const std::uint8_t> levels() const = 0;
  /// What moves the camera; null for photographs.
  virtual FreeView* camera() = 0;
  virtual ToneMapping tone() const = 0;
  virtual void set_tone(const ToneMapping& tone) = 0;
  virtual void expose() = 0;

  // What a frame does, in this order.

  /// Whether another frame is due though nothing happened.
  virtual bool is_busy() const { return false; }
  virtual void advance(double seconds) = 0;
  /// A file that was dropped or chosen.
  virtual void open(const fs::path& file) = 0;
  virtual void draw_controls(const Area& area) = 0;
  /// Brings what is shown up to date.
  virtual Refreshed refresh() = 0;
  virtual void draw_over_picture() = 0;
  /// What lies under the pointer.
  virtual std::string pointer() const;

  // What mouse and keys do.

  virtual const char* mouse_help() const = 0;
  virtual std::vector<Shortcut> shortcuts() = 0;
  /// The left button goes down on a pixel; whether it takes hold of what is there. It is then dragged from
  /// one place of the window to another.
  virtual bool take_hold(const PixelPosition&) { return false; }
  virtual void drag_held(const Point& /*from*/, const Point& /*to*/, bool /*with_shift*/) {}
  /// A place on or beside the picture is clicked.
  virtual void pick(const PixelPosition& pixel) = 0;
  /// Lets go of one thing.
  virtual void deselect() = 0;
  /// Writes what write_picture() does of the picture at rest.
  virtual void save(const fs::path& file) = 0;

  /// Writes a picture as it is (.exr) or tone-mapped (.png), and says so. Throws InputError for other files.
  void write_picture(const fs::path& file, const ToneMapping& mapping,
                     ColourSpace space = ColourSpace::camera);

  // Parts of the controls.

  /// Save, screenshot and help.
  void window_buttons();
  /// Exposure and tone curve, auto-exposure.
  void tone_section();

  /// From the least to the most pixels that the controls are wide.
  double min_side = 360.0, max_side = 560.0;

 private:
  void notify(const std::string& text, bool is_error, std::chrono::seconds duration);
  std::vector<Shortcut> all_shortcuts();
  void save_both();
  void leave();
  void handle(const FrameInput& input);
  FrameTime draw(Texture& texture);
  Refreshed draw_picture(const Area& area, Texture& texture);
  void handle_picture_mouse();
  void handle_camera_mouse(FreeView& view);
  bool is_frame_due(GlWindow& window);
  bool end_frame(GlWindow& window);
  void note_time(std::chrono::steady_clock::time_point start, FrameTime time);
  void draw_help(const Area& area);
  void draw_notice(const Area& area);
  void draw_status_bar(const Area& area) const;
  void draw_dialog(const Area& area);
  std::string time_text() const;

  std::string stem_;
  std::vector<Shortcut> keys_;
  double help_height_ = 0.0;  // window pixels, as drawn last
  std::optional<Notice> notice_;
  std::deque<FrameTime> recent_frames_;
  std::optional<std::chrono::steady_clock::time_point> last_end_, last_moved_;  // of frames without a pause
  int frames_left_ = 0;
  bool shows_help_ = false, wants_screenshot_ = false, wants_to_close_ = false;
  std::optional<Point> pressed_;                // where the left button is, since it went down on the picture
  bool is_held_ = false, is_dragging_ = false;  // it holds something; it went further than a click may shake
};

/// "pixel 3, 4:  0.1  0.2  0.3"; empty where the pointer is not over the image, of whose pixels `held` are in
/// `image`.
std::string pointer_text(const Canvas& canvas, const Image& image, const char* what, const PixelGrid& held);

/// Opens a window on what `read` makes, in a thread of its own, and returns when it is closed. Where reading
/// takes long, the window says "`reads` `name`" before. Throws DeviceError where there is no display or no
/// OpenGL 3.3, what `read` throws, and Interrupted.
void open_window(const std::string& name, const std::string& reads,
                 const std::function<std::unique_ptr<ViewerWindow>()>& read, const WindowOptions& options,
                 const RunContext& context);

}  // namespace refield
