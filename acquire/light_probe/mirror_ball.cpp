// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/mirror_ball.h"

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <cmath>

#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "core/base/units.h"

namespace refield {

namespace {

/// Solves 2β + δ(β) = γ. The left side grows steadily with β, so Newton's method converges.
double normal_angle(double gamma, double distance, double largest) {
  double beta = std::min(gamma / (2.0 + 1.0 / (distance - std::cos(gamma / 2.0))), largest);
  for (int i = 0; i < 30; ++i) {
    const double c = std::cos(beta), s = std::sqrt(std::max(0.0, 1.0 - c * c));  // 0 ≤ β < π/2
    const double value = 2.0 * beta + std::atan2(s, distance - c) - gamma;
    const double slope = 2.0 + (distance * c - 1.0) / (distance * distance - 2.0 * distance * c + 1.0);
    const double step = value / slope;
    beta = std::clamp(beta - step, 0.0, largest);
    if (std::abs(step) < 1e-10) break;  // it converges quadratically: the next step is below rounding
  }
  return beta;
}

constexpr double support_px = 1.5;
constexpr std::size_t least_points = 8;

double angle_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// A cone of rays: where its axis meets the image, and its half-angle times the focal length.
struct Cone {
  Eigen::Vector2d centre;
  double radius;

  Eigen::Vector3d axis(const ProbeCamera& camera) const { return camera.ray(centre); }
};

/// Distances of points from the cone, in pixels at the image's centre.
Eigen::VectorXd residuals(std::span<const Eigen::Vector2d> points, const ProbeCamera& camera,
                          const Cone& cone) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(points.size()));
  const Eigen::Vector3d axis = cone.axis(camera);
  for (std::size_t i = 0; i < points.size(); ++i)
    result[static_cast<Eigen::Index>(i)] =
        camera.focal_px * angle_between(camera.ray(points[i]), axis) - cone.radius;
  return result;
}

/// Tukey's biweight: 1 for no residual, 0 beyond `reach`.
double tukey(double residual, double reach) {
  const double u = residual / reach;
  return std::abs(u) >= 1.0 ? 0.0 : (1.0 - u * u) * (1.0 - u * u);
}

double robust_reach(const Eigen::VectorXd& r) {
  std::vector<double> magnitude(r.size());
  for (Eigen::Index i = 0; i < r.size(); ++i) magnitude[i] = std::abs(r[i]);
  const auto middle = magnitude.begin() + static_cast<std::ptrdiff_t>(magnitude.size() / 2);
  std::nth_element(magnitude.begin(), middle, magnitude.end());
  constexpr double sigmas = 4.685 * 1.4826;  // Tukey's constant, on the median absolute deviation
  return std::max(0.75, sigmas * *middle);
}

/// Gauss-Newton with numerical derivatives: three unknowns, smooth, and a start within a few pixels.
Cone fit_cone(std::span<const Eigen::Vector2d> points, const ProbeCamera& camera, Cone cone) {
  for (int iteration = 0; iteration < 40; ++iteration) {
    const Eigen::VectorXd r = residuals(points, camera, cone);
    const double reach = robust_reach(r);
    Eigen::Matrix<double, Eigen::Dynamic, 3> jacobian(r.size(), 3);
    constexpr double step = 1e-3;
    for (int axis = 0; axis < 2; ++axis) {
      Cone moved = cone;
      moved.centre[axis] += step;
      jacobian.col(axis) = (residuals(points, camera, moved) - r) / step;
    }
    jacobian.col(2).setConstant(-1.0);
    Eigen::VectorXd weight(r.size());
    for (Eigen::Index i = 0; i < r.size(); ++i) weight[i] = tukey(r[i], reach);
    const Eigen::Matrix3d normal = jacobian.transpose() * weight.asDiagonal() * jacobian;
    const Eigen::Vector3d change = solve_symmetric(normal, -jacobian.transpose() * weight.asDiagonal() * r);
    if (!change.allFinite()) break;
    cone.centre += change.head<2>();
    cone.radius += change[2];
    if (change.norm() < 1e-7) break;
  }
  return cone;
}

MirrorBall ball_of(const Cone& cone, const ProbeCamera& camera) {
  const double alpha = cone.radius / camera.focal_px;
  if (!(alpha > 0.0 && alpha < std::numbers::pi / 2.0) || !cone.centre.allFinite())
    throw InputError(
        "no ball has the outline that was found or given; check --ball and the focal length or distance");
  return {camera, cone.axis(camera), 1.0 / std::sin(alpha)};
}

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
/// nothing stands out. Outermost, since the rim squeezes the whole environment into a few pixels within the
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

Eigen::Vector3d ProbeCamera::ray(const Eigen::Vector2d& point) const {
  const Eigen::Vector2d offset = (point - principal_px) / focal_px;
  return Eigen::Vector3d(offset.x(), -offset.y(), 1.0).normalized();
}

Eigen::Vector2d ProbeCamera::project(const Eigen::Vector3d& point) const {
  return principal_px + focal_px / point.z() * Eigen::Vector2d(point.x(), -point.y());
}

std::pair<Eigen::Vector3d, Eigen::Vector3d> tangents(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d helper =
      std::abs(axis.y()) < 0.9 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX();
  const Eigen::Vector3d first = helper.cross(axis).normalized();
  return {first, axis.cross(first)};
}

MirrorBall::MirrorBall(const ProbeCamera& camera, const Eigen::Vector3d& towards, double distance_radii)
    : camera_(camera),
      towards_(towards.normalized()),
      distance_(distance_radii),
      half_angle_(std::asin(1.0 / distance_radii)) {
  if (!(distance_ > 1.0) || !std::isfinite(distance_))
    throw InputError("the camera is " + std::to_string(distance_) +
                     " ball radii from the ball's centre; it must be outside the ball, more than 1");
  // The whole outline must lie before the camera to have an image.
  if (!(towards_.z() > std::sin(half_angle_)))
    throw InputError("the ball is not in front of the camera; check the ball's place and the focal length");
}

std::optional<MirrorPoint> MirrorBall::reflect(const Eigen::Vector2d& point) const {
  const Eigen::Vector3d d = camera_.ray(point);
  // sin² of the angle to the axis by the cross product: the cosine would lose it for a ball far away.
  const double along = distance_ * d.dot(towards_);
  const double miss = distance_ * d.cross(towards_).norm();
  if (along <= 0.0 || miss >= 1.0) return std::nullopt;
  const double half_chord = std::sqrt((1.0 - miss) * (1.0 + miss));
  const Eigen::Vector3d normal = (along - half_chord) * d - distance_ * towards_;
  return MirrorPoint{(d + 2.0 * half_chord * normal).normalized(), half_chord};
}

std::optional<MirrorImage> MirrorBall::find(const Eigen::Vector3d& direction) const {
  const double gamma = std::atan2(direction.cross(towards_).norm(), -direction.dot(towards_));
  const double alpha = half_angle_;
  if (gamma >= std::numbers::pi - alpha) return std::nullopt;
  const double beta = normal_angle(gamma, distance_, std::numbers::pi / 2.0 - alpha);
  Eigen::Vector3d sideways = direction - direction.dot(towards_) * towards_;
  const double length = sideways.norm();
  sideways = length > 1e-12 ? Eigen::Vector3d(sideways / length) : tangents(towards_).first;
  const double c = std::cos(beta);
  const Eigen::Vector3d point = (distance_ - c) * towards_ + std::sin(beta) * sideways;
  const double range_squared = distance_ * distance_ - 2.0 * distance_ * c + 1.0;
  const double delta = std::atan2(std::sin(beta), distance_ - c);
  // dδ/dγ, the angle in the image for an angle outside, times pixels per radian in the image.
  const double delta_slope = (distance_ * c - 1.0) / range_squared;
  return MirrorImage{camera_.project(point), std::cos(beta + delta),
                     camera_.focal_px * delta_slope / (2.0 + delta_slope),
                     camera_.focal_px * (alpha - delta)};
}

double MirrorBall::radius_px() const {
  double sum = 0.0;
  constexpr int points = 64;
  const Eigen::Vector2d centre = centre_px();
  for (int i = 0; i < points; ++i)
    sum += (outline_point(2.0 * std::numbers::pi * i / points) - centre).norm();
  return sum / points;
}

Eigen::Vector2d MirrorBall::outline_point(double turn) const {
  const auto [first, second] = tangents(towards_);
  const double alpha = half_angle_;
  return camera_.project(std::cos(alpha) * towards_ +
                         std::sin(alpha) * (std::cos(turn) * first + std::sin(turn) * second));
}

ProbeOptics ProbeOptics::of_view(double degrees, int width, int height) {
  if (!(degrees > 0.0 && degrees < 180.0))
    throw InputError("the field of view is " + std::to_string(degrees) +
                     " degrees; give more than 0, less than 180");
  return {0.5 * width / std::tan(radians_from_degrees(degrees) / 2.0), {}, {0.5 * width, 0.5 * height}};
}

void ProbeOptics::check() const {
  if (focal_px.has_value() == distance_radii.has_value())
    throw InputError(
        "the distance of the camera is required: give either the focal length or the distance "
        "from the camera to the ball");
  if (focal_px && !(*focal_px > 0.0 && std::isfinite(*focal_px)))
    throw InputError("the focal length is " + std::to_string(*focal_px) +
                     " pixels; it must be above zero and finite");
  if (distance_radii && !(*distance_radii > 1.0 && *distance_radii <= 1e6))
    throw InputError("the camera's distance is " + std::to_string(*distance_radii) +
                     " radii of the ball; give a number above 1, to the ball's centre");
}

OutlineFit fit_outline(std::span<const Eigen::Vector2d> points, const ProbeOptics& optics,
                       const ImageCircle& start) {
  optics.check();
  if (points.size() < least_points)
    throw InputError("the ball's outline shows in " + std::to_string(points.size()) +
                     " places only; draw it yourself with --ball");
  ProbeCamera camera{optics.focal_px.value_or(0.0), optics.principal_px};
  Cone cone{start.centre, start.radius};
  if (optics.focal_px) {
    cone = fit_cone(points, camera, cone);
  } else {
    // The distance fixes the angle; the focal length follows from the size, and moves the fit a little.
    const double alpha = std::asin(1.0 / *optics.distance_radii);
    for (int i = 0; i < 20; ++i) {
      camera.focal_px = cone.radius / alpha;
      cone = fit_cone(points, camera, cone);
      if (std::abs(cone.radius / camera.focal_px - alpha) < 1e-9 * alpha) break;
    }
    camera.focal_px = cone.radius / alpha;
  }
  OutlineFit fit{ball_of(cone, camera), 0.0, 0.0};
  const Eigen::VectorXd r = residuals(points, camera, cone);
  const auto near = (r.array().abs() < support_px).cast<double>();
  const double count = near.sum();
  fit.support = count / static_cast<double>(r.size());
  fit.rms_px = count > 0.0 ? std::sqrt((r.array().square() * near).sum() / count) : 0.0;
  return fit;
}

MirrorBall ball_from_circle(const ImageCircle& circle, const ProbeOptics& optics) {
  if (!(circle.radius > 0.0) || !circle.centre.allFinite())
    throw InputError("--ball: the radius is " + std::to_string(circle.radius) +
                     " pixels; give centre and radius as X,Y,R with R above zero");
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 360; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / 360.0;
    points.push_back(circle.centre + circle.radius * Eigen::Vector2d(std::cos(turn), std::sin(turn)));
  }
  return fit_outline(points, optics, circle).ball;
}

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
        "no ball was found with certainty, since too little of its outline is visible; give its circle with "
        "--ball X,Y,R");
  return *best;
}

}  // namespace refield
