// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/fill_unseen.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "core/errors.h"
#include "core/light_map.h"

namespace refield {

namespace {

struct BorderTexel {
  Eigen::Vector3f direction;
  Eigen::Vector3f radiance;
  float solid_angle = 0.0f;
};

double row_solid_angle(int y, int height) {
  return std::sin(std::numbers::pi * (y + 0.5) / height);
}

/// Whether a seen texel touches one that was not; maps wrap around, and go over the poles.
bool touches_unseen(const Image& weight, int x, int y) {
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      int nx = x + dx, ny = y + dy;
      if (ny < 0 || ny >= weight.height) {
        ny = y;
        nx += weight.width / 2;
      }
      if (weight.at((nx + weight.width) % weight.width, ny, 0) == 0.0f) return true;
    }
  return false;
}

std::vector<BorderTexel> border_of(const SeenLight& light) {
  std::vector<BorderTexel> border;
  const Image& weight = light.weight;
  for (int y = 0; y < weight.height; ++y)
    for (int x = 0; x < weight.width; ++x) {
      if (weight.at(x, y, 0) == 0.0f || !touches_unseen(weight, x, y)) continue;
      border.push_back({lat_long_direction(x + 0.5, y + 0.5, weight.width, weight.height).cast<float>(),
                        {light.radiance.at(x, y, 0), light.radiance.at(x, y, 1), light.radiance.at(x, y, 2)},
                        static_cast<float>(row_solid_angle(y, weight.height))});
    }
  return border;
}

Eigen::Vector3d mean_of_border(const std::vector<BorderTexel>& border, const Eigen::Vector3f& direction) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double total = 0.0;
  for (const BorderTexel& texel : border) {
    const float squared = (texel.direction - direction).squaredNorm();
    const float weight = texel.solid_angle / (squared * std::sqrt(squared));
    sum += (weight * texel.radiance).cast<double>();
    total += weight;
  }
  return sum / total;
}

}  // namespace

void fill_unseen(SeenLight& light) {
  const auto border = border_of(light);
  const int width = light.weight.width, height = light.weight.height;
  if (border.empty()) {
    if (unseen_fraction(light.weight) > 0.0)
      throw InputError(
          "the photograph shows no part of the environment; check the position of the ball and the masks");
    return;
  }
  tbb::parallel_for(tbb::blocked_range<int>(0, height), [&](const tbb::blocked_range<int>& rows) {
    for (int y = rows.begin(); y < rows.end(); ++y)
      for (int x = 0; x < width; ++x) {
        if (light.weight.at(x, y, 0) != 0.0f) continue;
        const Eigen::Vector3d mean =
            mean_of_border(border, lat_long_direction(x + 0.5, y + 0.5, width, height).cast<float>());
        for (int c = 0; c < 3; ++c) light.radiance.at(x, y, c) = static_cast<float>(mean[c]);
      }
  });
}

double unseen_fraction(const Image& weight) {
  double unseen = 0.0, all = 0.0;
  for (int y = 0; y < weight.height; ++y)
    for (int x = 0; x < weight.width; ++x) {
      const double solid_angle = row_solid_angle(y, weight.height);
      all += solid_angle;
      if (weight.at(x, y, 0) == 0.0f) unseen += solid_angle;
    }
  return unseen / all;
}

}  // namespace refield
