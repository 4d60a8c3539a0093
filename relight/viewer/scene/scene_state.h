// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/mesh.h"
#include "core/image/image.h"
#include "core/image/tone_map.h"
#include "relight/viewer/gui/canvas.h"
#include "relight/viewer/gui/free_view.h"
#include "relight/viewer/viewer.h"

namespace refield {

/// The plane that a thing is dragged in: along the floor, or straight up and down.
enum class DragPlane { level, upright };

/// By how much a point moves so that it follows the pointer from one pixel to another. Level with a camera
/// that looks along the floor or from below it, and upright with one that looks straight down, pixels tell
/// no place there: it then moves in the plane of the picture. Never further than ten times its distance from
/// the camera.
Eigen::Vector3f dragged_shift(const PinholeCamera& camera, const Eigen::Vector3f& point,
                              const Eigen::Vector2f& from_px, const Eigen::Vector2f& to_px, DragPlane plane);

/// What the viewer of moving scenes is about, without its window: when it is, what a hand moved, who looks,
/// and how the picture is shown. Setters only note what is outdated; refresh() does the work.
class SceneState {
 public:
  static constexpr int max_bounces = 8;

  /// At time 0, exposed for it. Throws InputError for a scene without things.
  explicit SceneState(MovingScene scene);
  SceneState(const SceneState&) = delete;  // the view looks at the frame in it
  SceneState& operator=(const SceneState&) = delete;

  const MovingScene& scene() const { return scene_; }
  FreeView& view() { return *view_; }
  const FreeView& view() const { return *view_; }

  double time() const { return time_; }
  /// Within the scene's duration.
  void set_time(double seconds);
  /// Lets time pass; after its end the motion begins anew.
  void advance(double seconds);
  int bounces() const { return bounces_; }
  void set_bounces(int bounces);

  const Handling& handling(std::size_t thing) const { return handling_[thing]; }
  void handle(std::size_t thing, const Handling& handling);
  /// Where the middle of a thing is.
  Eigen::Vector3f middle(std::size_t thing) const;
  /// Moves it there, by hand.
  void put(std::size_t thing, const Eigen::Vector3f& middle);
  /// Takes back all that a hand did, and begins anew.
  void start_over();

  /// What a pixel shows: a thing, and a point of it near there. As of the last refresh().
  struct Seen {
    std::size_t thing;
    Eigen::Vector3f point;
  };
  std::optional<Seen> seen_at(int x, int y) const;

  const ToneMapping& tone() const { return tone_; }
  void set_tone(const ToneMapping& tone);
  /// So that 1 % of the picture without area lights is white or more.
  void expose();

  /// Whether there is a new picture, and what it took.
  Refreshed refresh();

  /// The picture, as of the last refresh(). Pixels of red, green, blue, alpha, row-major.
  const Image& radiance() const { return seen_; }
  std::span<const std::uint8_t> picture() const { return picture_; }

 private:
  void light(const PinholeCamera& camera);

  MovingScene scene_;
  std::vector<Handling> handling_;
  double time_ = 0.0;
  int bounces_ = 3;
  ToneMapping tone_;
  ToneTableCache tone_table_;
  SceneFrame frame_;
  std::unique_ptr<FreeView> view_;
  Image seen_;
  std::vector<std::uint8_t> picture_;
  bool is_light_old_ = false, is_tone_old_ = true;
};

}  // namespace refield
