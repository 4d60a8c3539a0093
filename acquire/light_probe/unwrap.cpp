// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/unwrap.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/errors.h"
#include "core/light_map.h"
#include "core/units.h"

namespace refield {

namespace {

constexpr double samples_per_pixel = 3.0;  // along each side of a texel
constexpr int most_samples = 64;           // along each side of a texel

void require_number(double value, double low, double high, const char* what) {
  if (!(value >= low && value <= high))
    throw InputError(std::string(what) + " is " + std::to_string(value) + "; give " + std::to_string(low) +
                     " to " + std::to_string(high));
}

double positive(float value) {
  return std::max(static_cast<double>(value), 0.0);
}

/// Slope of radiance within a pixel whose mean is `here`, from its neighbours' means: the central difference
/// where the three are monotone, limited so that nothing overshoots them; zero at an extremum. The pixel
/// keeps its mean, hence its energy. (The monotonised central limiter of B. van Leer, J. Comput. Phys. 23,
/// 1977.)
double slope(double before, double here, double after) {
  const double left = here - before, right = after - here;
  if (left * right <= 0.0) return 0.0;
  const double magnitude =
      std::min({2.0 * std::abs(left), 2.0 * std::abs(right), 0.5 * std::abs(left + right)});
  return left > 0.0 ? magnitude : -magnitude;
}

/// Samples one photograph; holds what all texels have in common.
class Unwrapper {
 public:
  Unwrapper(const Photograph& photograph, const MirrorBall& ball, const Turn& turn, const Mask& hidden,
            const UnwrapOptions& options)
      : photograph_(photograph),
        ball_(ball),
        camera_from_world_(turn.matrix().transpose()),
        hidden_(hidden),
        options_(options),
        cos_region_(std::cos(radians_from_degrees(options.camera_region_degrees))),
        sharpest_(ball.find(-ball.towards())->pixels_per_radian) {}

  void texel(int x, int y, SeenLight& seen) const {
    const int n = samples_along_side(x, y);
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double area = 0.0, area_seen = 0.0, quality = 0.0;
    bool clipped = false;
    for (int j = 0; j < n; ++j) {
      const double row = y + (j + 0.5) / n;
      const double solid_angle = std::sin(std::numbers::pi * row / (0.5 * options_.width));
      for (int i = 0; i < n; ++i) {
        area += solid_angle;
        const auto found = look(x + (i + 0.5) / n, row);
        if (!found) continue;
        Eigen::Vector3d radiance;
        bool sample_clipped = false;
        if (!light_at(*found, radiance, sample_clipped)) continue;
        sum += solid_angle * radiance;
        area_seen += solid_angle;
        const double resolution = found->pixels_per_radian / sharpest_;
        quality += solid_angle * resolution * resolution * resolution * resolution;
        clipped |= sample_clipped;
      }
    }
    if (area_seen < 0.5 * area) return;
    for (int c = 0; c < 3; ++c)
      seen.radiance.at(x, y, c) = static_cast<float>(sum[c] / area_seen * options_.gain[c]);
    seen.weight.at(x, y, 0) = static_cast<float>(std::max(quality / area, 1e-12));
    seen.clipped[static_cast<std::size_t>(y) * options_.width + x] = clipped;
  }

 private:
  /// The image of a point of the map, where it may be used.
  std::optional<MirrorImage> look(double column, double row) const {
    const Eigen::Vector3d direction =
        camera_from_world_ * lat_long_direction(column, row, options_.width, options_.width / 2);
    if (-direction.dot(ball_.towards()) > cos_region_) return std::nullopt;
    auto found = ball_.find(direction);
    if (!found || found->depth_px < options_.rim_px) return std::nullopt;
    return found;
  }

  int samples_along_side(int x, int y) const {
    std::array<Eigen::Vector2d, 4> corner;
    for (int i = 0; i < 4; ++i) {
      const auto found =
          ball_.find(camera_from_world_ *
                     lat_long_direction(x + (i & 1), y + (i >> 1), options_.width, options_.width / 2));
      if (!found) return most_samples;
      corner[i] = found->point;
    }
    const double extent = std::max({(corner[0] - corner[1]).norm(), (corner[0] - corner[2]).norm(),
                                    (corner[3] - corner[1]).norm(), (corner[3] - corner[2]).norm()});
    return std::clamp(static_cast<int>(std::ceil(samples_per_pixel * extent)), 2, most_samples);
  }

  bool is_usable(int x, int y) const {
    const Image& image = photograph_.radiance;
    return x >= 0 && y >= 0 && x < image.width && y < image.height &&
           (hidden_.empty() || !hidden_[static_cast<std::size_t>(y) * image.width + x]);
  }

  /// False where the pixel is hidden or outside the photograph.
  bool light_at(const MirrorImage& found, Eigen::Vector3d& radiance, bool& clipped) const {
    const Image& image = photograph_.radiance;
    const int x = static_cast<int>(std::floor(found.point.x())),
              y = static_cast<int>(std::floor(found.point.y()));
    if (!is_usable(x, y)) return false;
    // Neighbours that may not be used count as equal to the pixel: no slope towards them.
    const auto neighbour = [&](int nx, int ny, int c) {
      return positive(is_usable(nx, ny) ? image.at(nx, ny, c) : image.at(x, y, c));
    };
    const std::array<float, 3> reflectance = options_.reflectance.at(found.cos_incidence);
    for (int c = 0; c < 3; ++c) {
      const double here = positive(image.at(x, y, c));
      double across = slope(neighbour(x - 1, y, c), here, neighbour(x + 1, y, c));
      double down = slope(neighbour(x, y - 1, c), here, neighbour(x, y + 1, c));
      // Light is not negative, in the pixel's corners neither.
      if (const double drop = 0.5 * (std::abs(across) + std::abs(down)); drop > here) {
        across *= here / drop;
        down *= here / drop;
      }
      radiance[c] =
          (here + across * (found.point.x() - x - 0.5) + down * (found.point.y() - y - 0.5)) / reflectance[c];
      if (!photograph_.sigma.empty()) clipped |= std::isinf(photograph_.sigma.at(x, y, c));
    }
    return true;
  }

  const Photograph& photograph_;
  const MirrorBall& ball_;
  const Eigen::Matrix3d camera_from_world_;
  const Mask& hidden_;
  const UnwrapOptions& options_;
  const double cos_region_;
  const double sharpest_;
};

SeenLight nothing_seen(int width) {
  return {Image(width, width / 2, 3), Image(width, width / 2, 1),
          Mask(static_cast<std::size_t>(width) * (width / 2), 0)};
}

}  // namespace

void UnwrapOptions::check() const {
  if (width < 8 || width > 16384 || width % 2 != 0)
    throw InputError("the light map's width is " + std::to_string(width) +
                     "; give an even number, 8 to 16384");
  require_number(camera_region_degrees, 0.0, 60.0, "the camera's region, degrees,");
  require_number(rim_px, 0.0, 100.0, "the rim, pixels,");
  for (double factor : gain)
    if (!(factor > 0.0 && std::isfinite(factor)))
      throw InputError("the filters' factor is " + std::to_string(factor) +
                       "; it must be above zero and finite");
}

SeenLight unwrap(const Photograph& photograph, const MirrorBall& ball, const Turn& turn, const Mask& hidden,
                 const UnwrapOptions& options) {
  options.check();
  if (photograph.radiance.channels != 3) throw InputError("a light probe needs a photograph of 3 channels");
  if (!hidden.empty() && hidden.size() != photograph.radiance.pixel_count())
    throw InputError("the mask of hidden objects differs in size from the photograph");
  SeenLight seen = nothing_seen(options.width);
  const Unwrapper unwrapper(photograph, ball, turn, hidden, options);
  tbb::parallel_for(tbb::blocked_range<int>(0, options.width / 2, 4),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int y = rows.begin(); y < rows.end(); ++y)
                        for (int x = 0; x < options.width; ++x) unwrapper.texel(x, y, seen);
                    });
  return seen;
}

SeenLight join(const std::vector<SeenLight>& views) {
  if (views.empty()) throw InputError("there is no view of the ball to join");
  SeenLight joined = nothing_seen(views[0].radiance.width);
  for (const SeenLight& view : views) {
    if (!view.radiance.same_shape(joined.radiance))
      throw InputError("views of different sizes cannot be joined");
    for (std::size_t t = 0; t < joined.weight.values.size(); ++t) {
      const float weight = view.weight.values[t];
      joined.weight.values[t] += weight;
      for (int c = 0; c < 3; ++c)
        joined.radiance.values[3 * t + c] += weight * view.radiance.values[3 * t + c];
      joined.clipped[t] |= view.clipped[t];
    }
  }
  for (std::size_t t = 0; t < joined.weight.values.size(); ++t)
    if (const float weight = joined.weight.values[t]; weight > 0.0f)
      for (int c = 0; c < 3; ++c) joined.radiance.values[3 * t + c] /= weight;
  return joined;
}

int natural_width(const MirrorBall& ball) {
  const double width = 2.0 * std::numbers::pi * ball.find(-ball.towards())->pixels_per_radian;
  return std::clamp(static_cast<int>(width / 16.0) * 16, 32, 4096);
}

}  // namespace refield
