// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/monitor_by_ball.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>

#include "core/base/linear_algebra.h"

namespace refield {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::size_t min_spots = 6;  // 12 numbers for a pose of 6

/// The screen relative to the ball's centre, mm, camera axes.
struct ScreenPose {
  Matrix3d turn = Matrix3d::Identity();  // columns: right, up, away from the scene
  Vector3d middle = Vector3d::Zero();

  Vector3d point(const Vector2d& screen, double width_mm, double height_mm) const {
    return middle + turn * Vector3d((screen.x() - 0.5) * width_mm, (0.5 - screen.y()) * height_mm, 0.0);
  }
};

/// Image of the reflection of a point, mm from the ball's centre. The ray from the point meets the ball where
/// the camera sees that ray's direction; since the ball is small, taking turns converges.
Vector2d reflection_of(const Vector3d& point, const MirrorBall& ball, double radius_mm) {
  constexpr int rounds = 12;
  Vector3d direction = point.normalized();
  Vector2d image = ball.centre_px();
  for (int i = 0; i < rounds; ++i) {
    const auto seen = ball.find(direction);
    if (!seen) break;
    image = seen->point;
    const Vector3d ray = ball.camera().ray(image);
    const double along = ball.distance_radii() * ray.dot(ball.towards());
    const double miss = std::min(1.0, ball.distance_radii() * ray.cross(ball.towards()).norm());
    const Vector3d surface =
        (along - std::sqrt((1.0 - miss) * (1.0 + miss))) * ray - ball.distance_radii() * ball.towards();
    direction = (point - radius_mm * surface).normalized();
  }
  return image;
}

/// From directions alone, as if the ball were a point: direction ~ [right up middle] (U, V, 1).
ScreenPose first_pose(std::span<const SpotReflection> spots, const MirrorBall& ball, double width_mm,
                      double height_mm) {
  Eigen::MatrixXd system(3 * spots.size(), 9);
  std::vector<Vector3d> directions;
  for (std::size_t i = 0; i < spots.size(); ++i) {
    const auto seen = ball.reflect(spots[i].image_px);
    if (!seen) throw InputError("a spot's reflection lies beside the ball; check its centre and radius");
    const Vector3d& d = directions.emplace_back(seen->direction);
    const Eigen::RowVector3d q((spots[i].screen.x() - 0.5) * width_mm / height_mm, 0.5 - spots[i].screen.y(),
                               1.0);
    Matrix3d cross;
    cross << 0.0, -d.z(), d.y(), d.z(), 0.0, -d.x(), -d.y(), d.x(), 0.0;
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k < 3; ++k) system.block<1, 3>(3 * i + r, 3 * k) = cross(r, k) * q;
  }
  const VectorXd h = singular_values(system).v.col(8);
  Matrix3d plane = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.data());
  // The screen is where the light comes from, not opposite.
  double ahead = 0.0;
  for (std::size_t i = 0; i < spots.size(); ++i) ahead += directions[i].dot(plane.col(2));
  if (ahead < 0.0) plane = -plane;
  const double scale = 0.5 * (plane.col(0).norm() + plane.col(1).norm());
  Matrix3d axes;
  axes << plane.col(0), plane.col(1), plane.col(0).cross(plane.col(1)) / scale;
  const SingularValues nearest = singular_values(axes);
  return {nearest.u * nearest.v.transpose(), plane.col(2) / scale * height_mm};
}

/// Turn (axis × angle), middle of the screen in its heights, and the ball's centre and radius in standard
/// deviations of the outline.
constexpr int unknowns = 9;
using Unknowns = Eigen::Matrix<double, unknowns, 1>;

struct Problem {
  std::span<const SpotReflection> spots;
  const ReferenceBall& reference;
  double width_mm, height_mm;
  ScreenPose start;

  ScreenPose pose(const Unknowns& x) const {
    const Vector3d axis = x.head<3>();
    const double angle = axis.norm();
    const Matrix3d turn = angle > 0.0 ? Eigen::AngleAxisd(angle, axis / angle).toRotationMatrix()
                                      : Matrix3d(Matrix3d::Identity());
    return {turn * start.turn, start.middle + height_mm * x.segment<3>(3)};
  }
  MirrorBall ball(const Unknowns& x) const {
    const MirrorBall& seen = reference.ball;
    const double sigma = reference.outline_sigma_px;
    const Vector2d centre = seen.centre_px() + sigma * x.segment<2>(6);
    const double radius = seen.radius_px();
    return {seen.camera(), seen.camera().ray(centre),
            seen.distance_radii() * radius / (radius + sigma * x[8])};
  }
  /// Of spots in pixels, then of the ball in standard deviations.
  VectorXd residuals(const Unknowns& x, double spot_sigma_px) const {
    const ScreenPose at = pose(x);
    const MirrorBall moved = ball(x);
    VectorXd all(2 * spots.size() + 3);
    for (std::size_t i = 0; i < spots.size(); ++i)
      all.segment<2>(2 * i) =
          (reflection_of(at.point(spots[i].screen, width_mm, height_mm), moved, 0.5 * reference.diameter_mm) -
           spots[i].image_px) /
          spot_sigma_px;
    all.tail<3>() = x.tail<3>();
    return all;
  }
};

struct Solution {
  Unknowns x = Unknowns::Zero();
  Eigen::Matrix<double, unknowns, unknowns> covariance;
  double rms_px = 0.0;
};

constexpr double least_sigma_px = 0.05;  // of a spot's centroid

Solution solve_pose(const Problem& problem) {
  Solution solution;
  double sigma = 0.3;
  // The second pass knows how far spots scatter.
  for (int pass = 0; pass < 2; ++pass) {
    const LeastSquaresFit fit =
        least_squares([&](const VectorXd& x) { return problem.residuals(x, sigma); }, solution.x, 1e-5, 1e-9);
    solution.x = fit.parameters;
    solution.covariance = inverse(fit.jacobian.transpose() * fit.jacobian);
    const auto spots = static_cast<double>(problem.spots.size());
    const double sum = fit.residuals.head(fit.residuals.size() - 3).squaredNorm() * sigma * sigma;
    solution.rms_px = std::sqrt(sum / spots);
    sigma = std::max(least_sigma_px, std::sqrt(sum / (2.0 * spots - 6.0)));
  }
  return solution;
}

MonitorPlacement placement_of(const ScreenPose& pose, double width_mm, double height_mm) {
  constexpr double degrees = 180.0 / std::numbers::pi;
  const Vector3d local = pose.turn.transpose() * pose.middle;
  const Matrix3d& r = pose.turn;
  // Inverse of rotation_of().
  return {width_mm,
          height_mm,
          local.z(),
          {degrees * std::atan2(r(0, 2), r(2, 2)), degrees * std::asin(std::clamp(-r(1, 2), -1.0, 1.0)),
           degrees * std::atan2(r(1, 0), r(1, 1))},
          local.x(),
          local.y()};
}

constexpr std::array<std::array<double, 2>, 4> screen_corners = {
    {{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}}};

std::array<Vector3d, 4> corners_of(const ScreenPose& pose, double width_mm, double height_mm) {
  std::array<Vector3d, 4> corners;
  for (std::size_t i = 0; i < 4; ++i)
    corners[i] = pose.point({screen_corners[i][0], screen_corners[i][1]}, width_mm, height_mm);
  return corners;
}

double largest_corner_sigma(const Problem& problem, const Solution& solution) {
  const auto at = corners_of(problem.pose(solution.x), problem.width_mm, problem.height_mm);
  std::array<Eigen::Matrix<double, 3, unknowns>, 4> jacobians;
  for (int k = 0; k < unknowns; ++k) {
    constexpr double difference = 1e-5;
    Unknowns changed = solution.x;
    changed[k] += difference;
    const auto moved = corners_of(problem.pose(changed), problem.width_mm, problem.height_mm);
    for (std::size_t i = 0; i < 4; ++i) jacobians[i].col(k) = (moved[i] - at[i]) / difference;
  }
  double largest = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Matrix3d covariance = jacobians[i] * solution.covariance * jacobians[i].transpose();
    largest = std::max(largest, std::sqrt(covariance.trace()) / at[i].norm());
  }
  return largest;
}

}  // namespace

std::optional<Vector2d> spot_of(const Image& light) {
  constexpr double largest_share = 0.05;
  const auto level = [&](int x, int y) { return light.at(x, y, 0) + light.at(x, y, 1) + light.at(x, y, 2); };
  float peak = 0.0f;
  for (int y = 0; y < light.height; ++y)
    for (int x = 0; x < light.width; ++x) peak = std::max(peak, level(x, y));
  if (!(peak > 0.0f)) return std::nullopt;
  Vector2d sum = Vector2d::Zero();
  double weights = 0.0;
  int x0 = light.width, x1 = 0, y0 = light.height, y1 = 0;
  for (int y = 0; y < light.height; ++y)
    for (int x = 0; x < light.width; ++x) {
      const double weight = level(x, y);
      if (weight < 0.02 * peak) continue;
      x0 = std::min(x0, x);
      x1 = std::max(x1, x + 1);
      y0 = std::min(y0, y);
      y1 = std::max(y1, y + 1);
      sum += weight * Vector2d((x + 0.5) / light.width, (y + 0.5) / light.height);
      weights += weight;
    }
  const double share =
      static_cast<double>(x1 - x0) * (y1 - y0) / (static_cast<double>(light.width) * light.height);
  if (share > largest_share) return std::nullopt;
  return Vector2d(sum / weights);
}

std::optional<Vector2d> highlight_in(const Image& photograph, const MirrorBall& ball) {
  // The outermost pixels hold what is beside the ball.
  constexpr double usable_share = 0.97;
  const Vector2d centre = ball.centre_px();
  const double radius = usable_share * ball.radius_px();
  const int x0 = std::max(1, static_cast<int>(centre.x() - radius)),
            y0 = std::max(1, static_cast<int>(centre.y() - radius));
  const int x1 = std::min(photograph.width - 1, static_cast<int>(centre.x() + radius) + 1);
  const int y1 = std::min(photograph.height - 1, static_cast<int>(centre.y() + radius) + 1);
  const auto level = [&](int x, int y) {
    const double sum = photograph.at(x, y, 0) + photograph.at(x, y, 1) + photograph.at(x, y, 2);
    return std::isfinite(sum) ? sum : 0.0;
  };
  const auto is_on_ball = [&](int x, int y) { return (Vector2d(x + 0.5, y + 0.5) - centre).norm() < radius; };
  // The brightest 3 × 3 pixels: a single hot one is none.
  double peak = 0.0;
  int peak_x = 0, peak_y = 0;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) {
      if (!is_on_ball(x, y)) continue;
      double sum = 0.0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) sum += level(x + dx, y + dy) / 9.0;
      if (sum > peak) {
        peak = sum;
        peak_x = x;
        peak_y = y;
      }
    }
  if (!(peak > 0.0)) return std::nullopt;
  // Of what is connected with it: other reflections are apart. The window grows with the highlight.
  Vector2d at(peak_x + 0.5, peak_y + 0.5);
  for (int reach = 2; reach < static_cast<int>(radius); ++reach) {
    Vector2d sum = Vector2d::Zero();
    double weights = 0.0, border = 0.0;
    for (int dy = -reach; dy <= reach; ++dy)
      for (int dx = -reach; dx <= reach; ++dx) {
        const int x = peak_x + dx, y = peak_y + dy;
        if (x < x0 || y < y0 || x >= x1 || y >= y1 || !is_on_ball(x, y)) continue;
        const double weight = std::max(0.0, level(x, y) - 0.1 * peak);
        sum += weight * Vector2d(x + 0.5, y + 0.5);
        weights += weight;
        if (std::max(std::abs(dx), std::abs(dy)) == reach) border = std::max(border, weight);
      }
    at = sum / weights;
    if (border == 0.0) break;
  }
  return at;
}

MonitorSighting place_monitor(std::span<const SpotReflection> spots, const ReferenceBall& reference,
                              double width_mm, double height_mm) {
  constexpr double tolerated_px = 3.0;
  if (!(reference.diameter_mm > 0.0)) throw InputError("the diameter of the ball must be above zero");
  if (!(width_mm > 0.0 && height_mm > 0.0)) throw InputError("the size of the screen must be above zero");
  std::vector<SpotReflection> used(spots.begin(), spots.end());
  std::vector<std::size_t> places(spots.size());
  for (std::size_t i = 0; i < places.size(); ++i) places[i] = i;
  MonitorSighting sighting;
  while (true) {
    if (used.size() < min_spots)
      throw InputError(
          "only " + std::to_string(used.size()) +
          " spots of the screen are reflected where one screen can be, " + std::to_string(min_spots) +
          " are needed; check the ball's circle, that it shows the whole screen, and that the light "
          "maps belong to the photographs");
    const Problem problem{used, reference, width_mm, height_mm,
                          first_pose(used, reference.ball, width_mm, height_mm)};
    const Solution solution = solve_pose(problem);
    const VectorXd residuals = problem.residuals(solution.x, 1.0);
    std::size_t worst = 0;
    double worst_px = 0.0;
    for (std::size_t i = 0; i < used.size(); ++i)
      if (const double px = residuals.segment<2>(2 * i).norm(); px > worst_px) {
        worst_px = px;
        worst = i;
      }
    // Twice the RMS of all alone says little while a wrong one bends the fit: they go one by one.
    if (worst_px > tolerated_px) {
      sighting.left_out.push_back(places[worst]);
      used.erase(used.begin() + static_cast<std::ptrdiff_t>(worst));
      places.erase(places.begin() + static_cast<std::ptrdiff_t>(worst));
      continue;
    }
    const ScreenPose pose = problem.pose(solution.x);
    sighting.placement = placement_of(pose, width_mm, height_mm);
    if (!(sighting.placement.distance_mm > 0.0))
      throw InputError(
          "the screen seems to face away from the ball; check that the light maps are not mirrored");
    sighting.corners_mm = corners_of(pose, width_mm, height_mm);
    sighting.corner_sigma = largest_corner_sigma(problem, solution);
    sighting.rms_px = solution.rms_px;
    std::ranges::sort(sighting.left_out);
    return sighting;
  }
}

}  // namespace refield
