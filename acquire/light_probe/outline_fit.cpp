// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/outline_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "core/errors.h"

namespace refield {

namespace {

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
    const Eigen::Vector3d change =
        normal.ldlt().solve(-jacobian.transpose() * weight.asDiagonal() * r).eval();
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

/// Algebraic circle fit (Kåsa): the start where nothing is known yet.
ImageCircle fit_circle(std::span<const Eigen::Vector2d> points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const auto& p : points) {
    const Eigen::Vector2d q = p - mean;
    const Eigen::Vector3d row(q.x(), q.y(), 1.0);
    normal += row * row.transpose();
    right += q.squaredNorm() * row;
  }
  const Eigen::Vector3d solution = normal.ldlt().solve(right);
  const Eigen::Vector2d centre = solution.head<2>() / 2.0;
  return {mean + centre, std::sqrt(std::max(0.0, solution[2] + centre.squaredNorm()))};
}

/// Half-way points between pixels on the ball and neighbours that are not.
std::vector<Eigen::Vector2d> border_points(const Mask& mask, int width, int height) {
  std::vector<Eigen::Vector2d> points;
  const auto on = [&](int x, int y) { return mask[static_cast<std::size_t>(y) * width + x] != 0; };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (x + 1 < width && on(x, y) != on(x + 1, y)) points.emplace_back(x + 1.0, y + 0.5);
      if (y + 1 < height && on(x, y) != on(x, y + 1)) points.emplace_back(x + 0.5, y + 1.0);
    }
  return points;
}

}  // namespace

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
                     " places only; draw it yourself with --ball or --ball-mask");
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

MirrorBall ball_from_mask(const Mask& mask, int width, int height, const ProbeOptics& optics) {
  const auto points = border_points(mask, width, height);
  if (points.size() < least_points)
    throw InputError("the mask of the ball has no border; paint the whole ball white on black");
  const OutlineFit fit = fit_outline(points, optics, fit_circle(points));
  constexpr double least_support = 0.6;
  if (fit.support < least_support)
    throw InputError("the ball's mask is not round: " +
                     std::to_string(static_cast<int>(std::lround(100.0 * fit.support))) +
                     " % of its border lie on the best outline; paint the ball alone, white on black");
  return fit.ball;
}

}  // namespace refield
