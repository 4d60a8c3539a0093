// SPDX-License-Identifier: Apache-2.0
#include "core/field/mesh.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

#include "core/field/transfer_tiles.h"

namespace refield {

namespace {

/// Half the image's height at distance one.
float half_height_of(const PinholeCamera& camera) {
  return std::tan(0.5f * camera.vertical_field_of_view_degrees * std::numbers::pi_v<float> / 180.0f);
}

}  // namespace

Eigen::Matrix3f PinholeCamera::axes() const {
  const Eigen::Vector3f ahead = (target - position).normalized();
  const Eigen::Vector3f right = up.cross(ahead).normalized();
  Eigen::Matrix3f rows;
  rows << right.transpose(), ahead.cross(right).transpose(), ahead.transpose();
  return rows;
}

Eigen::Vector3f PinholeCamera::direction(float x, float y) const {
  const float half_height = half_height_of(*this);
  const auto h = static_cast<float>(height), w = static_cast<float>(width);
  const Eigen::Vector3f seen(half_height * (2.0f * x - w) / h, half_height * (1.0f - 2.0f * y / h), 1.0f);
  return (axes().transpose() * seen).normalized();
}

std::optional<Eigen::Vector2f> PinholeCamera::image_point(const Eigen::Vector3f& point) const {
  const Eigen::Vector3f seen = axes() * (point - position);
  if (!(seen.z() > 0.0f)) return std::nullopt;
  const float scale = 0.5f * static_cast<float>(height) / (half_height_of(*this) * seen.z());
  return Eigen::Vector2f(0.5f * static_cast<float>(width) + scale * seen.x(),
                         0.5f * static_cast<float>(height) - scale * seen.y());
}

void PinholeCamera::check() const {
  if (width <= 0 || height <= 0)
    throw InputError("the camera's image is ", width, "×", height, " pixels; give a size above zero");
  if (!(vertical_field_of_view_degrees > 0.0f && vertical_field_of_view_degrees < 180.0f))
    throw InputError("the camera's field of view is ", vertical_field_of_view_degrees,
                     " degrees; give one between 0 and 180");
  const Eigen::Vector3f ahead = target - position;
  const float sine = up.cross(ahead).norm();
  if (!ahead.allFinite() || !up.allFinite() || !(sine > 1e-6f * up.norm() * ahead.norm()))
    throw InputError(
        "the viewing direction of the camera is zero or parallel to its up direction; give another target or "
        "up vector");
}

namespace {
constexpr std::size_t tiles_across = output_image_width / tile_side_px;
}

int output_image_height(std::size_t outputs) {
  constexpr std::size_t outputs_of_a_row_of_tiles = tiles_across * tile_pixels;
  return static_cast<int>((outputs + outputs_of_a_row_of_tiles - 1) / outputs_of_a_row_of_tiles) *
         tile_side_px;
}

std::size_t pixel_of_output(std::size_t output) {
  const std::size_t tile = output / tile_pixels, within = output % tile_pixels;
  const std::size_t x = tile % tiles_across * tile_side_px + static_cast<std::size_t>(column_of_tile(within));
  const std::size_t y = tile / tiles_across * tile_side_px + static_cast<std::size_t>(row_of_tile(within));
  return y * output_image_width + x;
}

}  // namespace refield
