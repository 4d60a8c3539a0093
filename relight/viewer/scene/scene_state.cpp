// SPDX-License-Identifier: Apache-2.0
#include "relight/viewer/scene/scene_state.h"

#include <Eigen/Geometry>

#include <cmath>

#include "core/image/tone_map.h"

namespace refield {

namespace {

/// Below this sine between line of sight and plane (6°) a pixel stands for too long a piece of it.
constexpr float least_slope = 0.1f;
constexpr float farthest = 10.0f;

/// Normal of the plane: where it would be seen too flat, the picture's.
Eigen::Vector3f normal_of(const PinholeCamera& camera, const Eigen::Vector3f& point, DragPlane plane) {
  const Eigen::Vector3f ahead = camera.axes().row(2).transpose();
  const Eigen::Vector3f sight = (point - camera.position).normalized();
  if (plane == DragPlane::level) return std::abs(sight.y()) < least_slope ? ahead : Eigen::Vector3f::UnitY();
  const Eigen::Vector3f level(sight.x(), 0.0f, sight.z());
  return level.norm() < least_slope ? ahead : level.normalized();
}

}  // namespace

Eigen::Vector3f dragged_shift(const PinholeCamera& camera, const Eigen::Vector3f& point,
                              const Eigen::Vector2f& from_px, const Eigen::Vector2f& to_px, DragPlane plane) {
  const float distance = (point - camera.position).norm();
  if (!(distance > 0.0f)) return Eigen::Vector3f::Zero();
  const Eigen::Vector3f normal = normal_of(camera, point, plane);
  const float height = normal.dot(point - camera.position);
  const auto meets = [&](const Eigen::Vector2f& px) -> Eigen::Vector3f {
    const Eigen::Vector3f direction = camera.direction(px.x(), px.y());
    const float slope = normal.dot(direction);
    float along = height / slope;
    // Beyond the horizon of the plane, or behind the camera: as far as it goes.
    if (!(along > 0.0f) || along > farthest * distance) along = farthest * distance;
    return camera.position + along * direction;
  };
  Eigen::Vector3f shift = meets(to_px) - meets(from_px);
  shift -= shift.dot(normal) * normal;
  if (plane == DragPlane::upright && std::abs(normal.y()) < 0.5f)
    shift = Eigen::Vector3f(0.0f, shift.y(), 0.0f);
  const float length = shift.norm();
  return length > farthest * distance ? Eigen::Vector3f(shift * (farthest * distance / length)) : shift;
}

namespace {

double take_milliseconds(std::chrono::steady_clock::time_point& start) {
  const auto now = std::chrono::steady_clock::now();
  return std::chrono::duration<double, std::milli>(now - std::exchange(start, now)).count();
}

}  // namespace

SceneState::SceneState(MovingScene scene) : scene_(std::move(scene)), handling_(scene_.things.size()) {
  if (scene_.things.empty()) throw InputError(scene_.name, ": the scene is empty; there is nothing to show");
  light(scene_.camera);
  view_ = std::make_unique<FreeView>(scene_.camera, [this](const PinholeCamera& camera, int samples) {
    return std::make_unique<const MeshRenderer>(frame_.mesh, camera, samples);
  });
  seen_ = view_->seen().show(frame_.radiance);
  expose();
}

void SceneState::light(const PinholeCamera& camera) {
  scene_.light({time_, handling_, bounces_, camera.position}, frame_);
  is_light_old_ = false;
}

void SceneState::set_time(double seconds) {
  const double wanted = std::isfinite(seconds) ? std::clamp(seconds, 0.0, scene_.duration) : 0.0;
  if (wanted == time_) return;
  time_ = wanted;
  is_light_old_ = true;
}

void SceneState::advance(double seconds) {
  if (scene_.duration > 0.0) set_time(std::fmod(time_ + seconds, scene_.duration));
}

void SceneState::set_bounces(int bounces) {
  const int wanted = std::clamp(bounces, 0, max_bounces);
  if (wanted == bounces_) return;
  bounces_ = wanted;
  is_light_old_ = true;
}

void SceneState::handle(std::size_t thing, const Handling& handling) {
  if (handling == handling_[thing]) return;
  handling_[thing] = handling;
  is_light_old_ = true;
}

Eigen::Vector3f SceneState::middle(std::size_t thing) const {
  return scene_.middle(thing, time_) + handling_[thing].shift;
}

void SceneState::put(std::size_t thing, const Eigen::Vector3f& middle) {
  if (!middle.allFinite()) return;
  Handling changed = handling_[thing];
  changed.shift = middle - scene_.middle(thing, time_);
  handle(thing, changed);
}

void SceneState::start_over() {
  for (std::size_t thing = 0; thing < handling_.size(); ++thing) handle(thing, {});
  set_time(0.0);
}

std::optional<SceneState::Seen> SceneState::seen_at(int x, int y) const {
  if (x < 0 || y < 0 || x >= seen_.width || y >= seen_.height) return std::nullopt;
  const auto vertex = view_->seen().vertex_at(x, y);
  if (!vertex) return std::nullopt;
  const auto next = std::ranges::upper_bound(frame_.first_vertex, *vertex);
  return Seen{static_cast<std::size_t>(next - frame_.first_vertex.begin()) - 1,
              frame_.mesh.positions[*vertex]};
}

void SceneState::set_tone(const ToneMapping& tone) {
  if (tone == tone_) return;
  tone_ = tone;
  is_tone_old_ = true;
}

void SceneState::expose() {
  std::vector<Eigen::Array3f> reflected = frame_.radiance;
  for (std::size_t thing = 0; thing < scene_.things.size(); ++thing)
    if (scene_.things[thing].is_area_light)
      std::fill(reflected.begin() + frame_.first_vertex[thing],
                reflected.begin() + frame_.first_vertex[thing + 1], Eigen::Array3f::Zero());
  set_tone({exposure_to_white(view_->seen().show(reflected)), tone_.curve});
}

Refreshed SceneState::refresh() {
  Refreshed done;
  auto start = std::chrono::steady_clock::now();
  const bool is_lit = is_light_old_ || view_->is_moved();  // what is glossy looks otherwise from elsewhere
  if (is_lit) {
    light(view_->camera());
    view_->move();
    done.time.relight_ms = done.time.wait_ms = take_milliseconds(start);
  }
  if (view_->update()) {
    seen_ = view_->seen().show(frame_.radiance);
    is_tone_old_ = true;
    done.time.view_ms = take_milliseconds(start);
  }
  done.picture = std::exchange(is_tone_old_, false);
  if (!done.picture) return done;
  picture_.resize(std::size_t{4} * seen_.pixel_count());
  tone_map_rgba(seen_, tone_table_.table(tone_), picture_);
  done.time.tone_ms = take_milliseconds(start);
  return done;
}

}  // namespace refield
