// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/unwrap.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdlib>

#include "core/base/units.h"
#include "core/light/light_map.h"

namespace refield {

namespace {

constexpr int table_size = 1025;

/// Mean of the two polarisations, M. Born and E. Wolf, Principles of Optics, section 14.2, in real numbers.
double conductor_reflectance(double n, double k, double c) {
  const double s2 = 1.0 - c * c;
  const double t = n * n - k * k - s2;
  const double sum = std::sqrt(t * t + 4.0 * n * n * k * k);  // a² + b²
  const double a = std::sqrt(std::max(0.0, 0.5 * (sum + t)));
  const double across = (sum + c * c - 2.0 * a * c) / (sum + c * c + 2.0 * a * c);
  const double along =
      across * (c * c * sum + s2 * s2 - 2.0 * a * c * s2) / (c * c * sum + s2 * s2 + 2.0 * a * c * s2);
  return 0.5 * (across + along);
}

constexpr double samples_per_pixel = 3.0;  // along each side of a texel
constexpr int max_samples_per_side = 64;   // along each side of a texel
/// Nothing is taken from within this angle of the camera itself, nor from this near to the ball's outline.
constexpr double camera_region_degrees = 5.0, rim_px = 2.0;

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
  Unwrapper(const Photograph& photograph, const MirrorBall& ball, const EulerAngles& turn, const Mask& hidden,
            const UnwrapOptions& options)
      : photograph_(photograph),
        ball_(ball),
        camera_from_world_(rotation_of(turn).transpose()),
        hidden_(hidden),
        options_(options),
        cos_region_(std::cos(radians_from_degrees(camera_region_degrees))),
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
    if (!found || found->depth_px < rim_px) return std::nullopt;
    return found;
  }

  int samples_along_side(int x, int y) const {
    std::array<Eigen::Vector2d, 4> corner;
    for (int i = 0; i < 4; ++i) {
      const auto found =
          ball_.find(camera_from_world_ *
                     lat_long_direction(x + (i & 1), y + (i >> 1), options_.width, options_.width / 2));
      if (!found) return max_samples_per_side;
      corner[i] = found->point;
    }
    const double extent = std::max({(corner[0] - corner[1]).norm(), (corner[0] - corner[2]).norm(),
                                    (corner[3] - corner[1]).norm(), (corner[3] - corner[2]).norm()});
    return std::clamp(static_cast<int>(std::ceil(samples_per_pixel * extent)), 2, max_samples_per_side);
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

template <class Reflectance>
MirrorReflectance MirrorReflectance::tabulated(const Reflectance& reflectance) {
  MirrorReflectance result;
  result.table_.resize(table_size);
  for (int i = 0; i < table_size; ++i)
    for (int c = 0; c < 3; ++c)
      result.table_[i][c] = static_cast<float>(reflectance(c, i / (table_size - 1.0)));
  return result;
}

MirrorReflectance MirrorReflectance::conductor(const std::array<double, 3>& n,
                                               const std::array<double, 3>& k) {
  return tabulated([&](int c, double cosine) { return conductor_reflectance(n[c], k[c], cosine); });
}

MirrorReflectance MirrorReflectance::chrome() {
  return conductor({3.09, 3.18, 2.33}, {3.34, 3.33, 3.14});
}

MirrorReflectance MirrorReflectance::silver() {
  return conductor({0.05, 0.06, 0.04}, {4.483, 3.586, 2.657});
}

MirrorReflectance MirrorReflectance::measured(const std::array<double, 3>& at_normal_incidence) {
  for (double value : at_normal_incidence)
    if (!(value > 0.0 && value <= 1.0))
      throw InputError("the mirror's reflectance is " + std::to_string(value) +
                       "; give numbers above 0 and at most 1");
  return tabulated([&](int c, double cosine) {
    const double r = at_normal_incidence[c];
    return r + (1.0 - r) * std::pow(1.0 - cosine, 5.0);
  });
}

MirrorReflectance MirrorReflectance::from_text(const std::string& text) {
  if (text == "chrome") return chrome();
  if (text == "silver") return silver();
  if (text == "perfect") return measured({1.0, 1.0, 1.0});
  return measured(channel_numbers(text, "--reflectance (chrome, silver, perfect or measured)"));
}

std::array<float, 3> MirrorReflectance::at(double cos_incidence) const {
  const double place = std::clamp(cos_incidence, 0.0, 1.0) * (table_size - 1);
  const int below = std::min(static_cast<int>(place), table_size - 2);
  const auto t = static_cast<float>(place - below);
  std::array<float, 3> result;
  for (int c = 0; c < 3; ++c) result[c] = (1.0f - t) * table_[below][c] + t * table_[below + 1][c];
  return result;
}

std::array<double, 3> channel_numbers(const std::string& text, const std::string& option) {
  std::array<double, 3> numbers{};
  const char* at = text.c_str();
  int count = 0;
  bool more = true;
  while (more && count < 3) {
    char* end = nullptr;
    numbers[count] = std::strtod(at, &end);
    if (end == at) break;
    ++count;
    more = *end == ',';
    at = more ? end + 1 : end;
  }
  if ((count != 1 && count != 3) || more || *at != '\0' ||
      !std::ranges::all_of(numbers, [](double number) { return std::isfinite(number); }))
    throw InputError(option + ": '" + text +
                     "' is neither one number nor three separated by commas, red,green,blue");
  if (count == 1) numbers = {numbers[0], numbers[0], numbers[0]};
  return numbers;
}

std::optional<ImageCircle> circle_from_text(const std::string& text) {
  if (text == "find") return std::nullopt;
  const auto [x, y, radius] = channel_numbers(text, "--ball");
  return ImageCircle{{x, y}, radius};
}

void UnwrapOptions::check() const {
  if (width < 8 || width > 16384 || width % 2 != 0)
    throw InputError("the light map's width is " + std::to_string(width) +
                     "; give an even number, 8 to 16384");
  for (double factor : gain)
    if (!(factor > 0.0 && std::isfinite(factor)))
      throw InputError("the filters' factor is " + std::to_string(factor) +
                       "; it must be above zero and finite");
}

SeenLight unwrap(const Photograph& photograph, const MirrorBall& ball, const EulerAngles& turn,
                 const Mask& hidden, const UnwrapOptions& options) {
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
