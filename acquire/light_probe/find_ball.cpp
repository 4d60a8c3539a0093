// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/find_ball.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "core/errors.h"
#include "core/rng.h"

namespace refield {

namespace {

constexpr int search_side_px = 640;  // circles are proposed at this size
constexpr int rays = 720;
constexpr double least_support = 0.75;
constexpr double least_size =
    0.1;  // radius beside the image's shorter side: smaller round things are not probes

cv::Mat1f luminance_of(const Image& image) {
  cv::Mat1f result(image.height, image.width);
  auto out = result.begin();
  for (std::size_t p = 0; p < image.pixel_count(); ++p, ++out) {
    const float* v = image.values.data() + p * image.channels;
    const float luminance = image.channels >= 3 ? 0.2126f * v[0] + 0.7152f * v[1] + 0.0722f * v[2] : v[0];
    *out = std::isfinite(luminance) ? std::max(luminance, 0.0f) : 0.0f;
  }
  return result;
}

/// Black is raised to a thousandth of the bright parts so that noise does not count.
cv::Mat1f log_of(const cv::Mat1f& luminance) {
  const float bright = quantile({luminance.begin(), luminance.end()}, 0.99);
  cv::Mat1f result;
  cv::log(luminance + (bright > 0.0f ? 1e-3 * bright : 1.0), result);
  return result;
}

cv::Mat1b eight_bits(const cv::Mat1f& image) {
  const std::vector<float> values(image.begin(), image.end());
  const float low = quantile(values, 0.01);
  const float high = quantile(values, 0.99);
  cv::Mat1b result;
  image.convertTo(result, CV_8U, 255.0 / std::max(high - low, 1e-6f),
                  -255.0 * low / std::max(high - low, 1e-6f));
  return result;
}

/// Edge pixels that are the first from one of the four sides: before a plain background, the silhouette.
std::vector<Eigen::Vector2d> silhouette(const cv::Mat1b& bytes) {
  cv::Mat1b edges;
  cv::Canny(bytes, edges, 20.0, 50.0);
  std::vector<Eigen::Vector2d> points;
  const auto first = [&](int length, const auto& at, const auto& point) {
    for (int i = 2; i + 2 < length; ++i)
      if (at(i)) {
        points.push_back(point(i));
        return;
      }
  };
  const int w = edges.cols, h = edges.rows;
  for (int y = 0; y < h; ++y) {
    first(
        w, [&](int i) { return edges(y, i); }, [&](int i) { return Eigen::Vector2d(i + 0.5, y + 0.5); });
    first(
        w, [&](int i) { return edges(y, w - 1 - i); },
        [&](int i) { return Eigen::Vector2d(w - i - 0.5, y + 0.5); });
  }
  for (int x = 0; x < w; ++x) {
    first(
        h, [&](int i) { return edges(i, x); }, [&](int i) { return Eigen::Vector2d(x + 0.5, i + 0.5); });
    first(
        h, [&](int i) { return edges(h - 1 - i, x); },
        [&](int i) { return Eigen::Vector2d(x + 0.5, h - i - 0.5); });
  }
  return points;
}

/// The circle through three points; a radius of 0 when they lie on a line.
ImageCircle circle_through(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  const Eigen::Vector2d u = b - a, v = c - a;
  const double determinant = 2.0 * (u.x() * v.y() - u.y() * v.x());
  if (std::abs(determinant) < 1e-6) return {};
  const Eigen::Vector2d centre((v.y() * u.squaredNorm() - u.y() * v.squaredNorm()) / determinant,
                               (u.x() * v.squaredNorm() - v.x() * u.squaredNorm()) / determinant);
  return {a + centre, centre.norm()};
}

/// The circle on which most of the silhouette lies, by random triples (RANSAC).
std::optional<ImageCircle> silhouette_circle(const cv::Mat1b& bytes) {
  const auto points = silhouette(bytes);
  if (points.size() < 30) return std::nullopt;
  Rng random(1);
  ImageCircle best;
  std::ptrdiff_t most = 0;
  for (int trial = 0; trial < 600; ++trial) {
    const auto pick = [&] { return points[random.below(static_cast<std::uint32_t>(points.size()))]; };
    const ImageCircle circle = circle_through(pick(), pick(), pick());
    if (circle.radius < 8.0 || circle.radius > std::max(bytes.cols, bytes.rows)) continue;
    const auto inliers = std::ranges::count_if(points, [&](const auto& p) {
      return std::abs((p - circle.centre).norm() - circle.radius) < std::max(1.5, 0.01 * circle.radius);
    });
    if (inliers > most) {
      most = inliers;
      best = circle;
    }
  }
  if (most < 30) return std::nullopt;
  return best;
}

/// Circles at the photograph's scale.
std::vector<ImageCircle> propose_circles(const cv::Mat1f& log_image) {
  const double scale =
      std::min(1.0, static_cast<double>(search_side_px) / std::max(log_image.cols, log_image.rows));
  cv::Mat1f small;
  cv::resize(log_image, small, {}, scale, scale, cv::INTER_AREA);
  cv::Mat1b bytes = eight_bits(small);
  cv::GaussianBlur(bytes, bytes, {}, 1.5);
  const int side = std::max(bytes.cols, bytes.rows);
  std::vector<ImageCircle> circles;
  if (const auto circle = silhouette_circle(bytes))
    circles.push_back({circle->centre / scale, circle->radius / scale});
  // From strict to lenient: what a strict search finds is refined first.
  for (const double roundness : {0.8, 0.5, 0.2}) {
    std::vector<cv::Vec3f> found;
    cv::HoughCircles(bytes, found, cv::HOUGH_GRADIENT_ALT, 1.5, side / 40.0, 100.0, roundness, side / 60,
                     static_cast<int>(0.75 * side));
    for (std::size_t i = 0; i < std::min<std::size_t>(found.size(), 12); ++i)
      circles.push_back({Eigen::Vector2d(found[i][0] + 0.5, found[i][1] + 0.5) / scale, found[i][2] / scale});
  }
  return circles;
}

float sample(const cv::Mat1f& image, double x, double y) {
  const double fx = std::clamp(x - 0.5, 0.0, image.cols - 1.001);
  const double fy = std::clamp(y - 0.5, 0.0, image.rows - 1.001);
  const int ix = static_cast<int>(fx), iy = static_cast<int>(fy);
  const auto tx = static_cast<float>(fx - ix), ty = static_cast<float>(fy - iy);
  return (1 - ty) * ((1 - tx) * image(iy, ix) + tx * image(iy, ix + 1)) +
         ty * ((1 - tx) * image(iy + 1, ix) + tx * image(iy + 1, ix + 1));
}

/// The outermost clear step of a profile that leads outwards, between samples by a parabola; nullopt where
/// nothing stands out. Outermost, since the rim squeezes all surroundings into a few pixels within the
/// outline.
std::optional<double> outermost_step(const std::vector<float>& profile) {
  constexpr float clear = 0.35f;       // of the sharpest step
  constexpr float least_step = 0.02f;  // of the light
  std::vector<float> slope(profile.size(), 0.0f);
  for (std::size_t i = 1; i + 1 < profile.size(); ++i) slope[i] = std::abs(profile[i + 1] - profile[i - 1]);
  const float sharpest = *std::ranges::max_element(slope);
  const auto [darkest, brightest] = std::ranges::minmax(profile);
  if (sharpest < least_step * std::max(std::abs(darkest), std::abs(brightest))) return std::nullopt;
  for (std::size_t i = profile.size() - 3; i >= 2; --i) {
    if (slope[i] < clear * sharpest || slope[i] < slope[i - 1] || slope[i] < slope[i + 1]) continue;
    const double curvature = slope[i - 1] - 2.0 * slope[i] + slope[i + 1];
    const double offset = curvature < 0.0 ? 0.5 * (slope[i - 1] - slope[i + 1]) / curvature : 0.0;
    return static_cast<double>(i) + std::clamp(offset, -0.5, 0.5);
  }
  return std::nullopt;
}

/// Steps within `reach` pixels of a circle, along its radii, half a pixel apart.
std::vector<Eigen::Vector2d> outline_points(const cv::Mat1f& image, const ImageCircle& circle, double reach) {
  constexpr double step = 0.5;
  std::vector<Eigen::Vector2d> points;
  const int count = 2 * static_cast<int>(std::ceil(reach / step)) + 1;
  for (int i = 0; i < rays; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / rays;
    const Eigen::Vector2d out(std::cos(turn), std::sin(turn));
    const auto at = [&](double place) -> Eigen::Vector2d {
      return circle.centre + (circle.radius + step * (place - (count - 1) / 2.0)) * out;
    };
    const Eigen::Vector2d first = at(0), last = at(count - 1);
    const auto inside = [&](const Eigen::Vector2d& p) {
      return p.x() >= 0 && p.y() >= 0 && p.x() <= image.cols && p.y() <= image.rows;
    };
    if (!inside(first) || !inside(last)) continue;
    std::vector<float> profile(count);
    for (int s = 0; s < count; ++s) profile[s] = sample(image, at(s).x(), at(s).y());
    if (const auto place = outermost_step(profile)) points.push_back(at(*place));
  }
  return points;
}

/// Coarse to fine; the support counts all rays, also those that met no edge or left the image.
std::optional<OutlineFit> refine(const cv::Mat1f& log_image, const cv::Mat1f& luminance, ImageCircle circle,
                                 const ProbeOptics& optics) {
  std::optional<OutlineFit> fit;
  const double far = std::max(6.0, 0.05 * circle.radius);
  // The logarithm sees edges in the dark, too, but moves them towards the dark side: the last word is
  // luminance's.
  for (const auto& [image, reach] :
       {std::pair{log_image, far}, {log_image, 6.0}, {luminance, 4.0}, {luminance, 3.0}}) {
    const auto points = outline_points(image, circle, reach);
    if (points.size() < rays / 4) return std::nullopt;
    try {
      fit = fit_outline(points, optics, circle);
    } catch (const InputError&) {
      return std::nullopt;  // this proposal was no ball; others may be
    }
    fit->support *= static_cast<double>(points.size()) / rays;
    circle = {fit->ball.centre_px(), fit->ball.radius_px()};
    const int side = std::min(image.cols, image.rows);
    if (!(circle.radius > least_size * side && circle.radius < 2.0 * side)) return std::nullopt;
  }
  return fit;
}

}  // namespace

OutlineFit find_ball(const Image& photograph, const ProbeOptics& optics) {
  optics.check();
  const cv::Mat1f luminance = luminance_of(photograph);
  const cv::Mat1f log_luminance = log_of(luminance);
  std::optional<OutlineFit> best;
  for (const ImageCircle& circle : propose_circles(log_luminance)) {
    const auto fit = refine(log_luminance, luminance, circle, optics);
    // The clearest; among equally clear ones the larger, since the ball may show round things in itself.
    if (fit && (!best || fit->support > best->support + 0.02 ||
                (fit->support > best->support - 0.02 && fit->ball.radius_px() > best->ball.radius_px())))
      best = fit;
  }
  if (!best || best->support < least_support)
    throw InputError(
        "no ball was found with certainty; give its circle with --ball X,Y,R, or a mask image with "
        "--ball-mask");
  return *best;
}

}  // namespace refield
