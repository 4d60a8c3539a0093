// SPDX-License-Identifier: Apache-2.0
#include "acquire/colour/colour_chart.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <cmath>
#include <deque>
#include <limits>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "core/base/linear_algebra.h"
#include "core/image/colour.h"
#include "core/image/tone_map.h"

namespace refield {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr std::array<std::string_view, chart_patches> patch_names = {
    "dark skin", "light skin",    "blue sky",     "foliage",   "blue flower",  "bluish green",
    "orange",    "purplish blue", "moderate red", "purple",    "yellow green", "orange yellow",
    "blue",      "green",         "red",          "yellow",    "magenta",      "cyan",
    "white",     "neutral 8",     "neutral 6.5",  "neutral 5", "neutral 3.5",  "black"};

const std::array<Vector3d, chart_patches>& reference_rec709() {
  static const auto colours = [] {
    std::array<Vector3d, chart_patches> linear;
    std::ranges::transform(chart_lab(), linear.begin(), rec709_from_lab);
    return linear;
  }();
  return colours;
}

// ---- the fit ----

/// Position of a patch on the chart, −1 to 1 from edge to edge of the centres.
Vector2d chart_place(int patch) {
  return {2.0 * (patch % chart_columns) / (chart_columns - 1) - 1.0,
          2.0 * (patch / chart_columns) / (chart_rows - 1) - 1.0};
}

using Parameters = Eigen::Matrix<double, 11, 1>;  // the matrix row by row, then the fall-off along x and y
using Colours = std::array<Vector3d, chart_patches>;

Matrix3d matrix_of(const Parameters& p) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.data());
}

/// What the fit makes of a patch's colour, the fall-off divided out.
Vector3d fitted_patch(const Parameters& p, const Vector3d& camera, int patch) {
  const double light = 1.0 + p.tail<2>().dot(chart_place(patch));
  return matrix_of(p) * camera / std::max(light, 0.1);
}

/// M c = s r with the brightness s = 1 + a x + b y is linear in M, a and b. Weighted by about the slope of
/// lightness, else the dark patches, which the eye resolves as well, would hardly count.
Parameters linear_fit(const Colours& camera) {
  Eigen::Matrix<double, 3 * chart_patches, 11> system = Eigen::Matrix<double, 3 * chart_patches, 11>::Zero();
  Eigen::Matrix<double, 3 * chart_patches, 1> target;
  for (int k = 0; k < chart_patches; ++k) {
    const Vector3d& reference = reference_rec709()[k];
    const double weight = std::pow(std::max(reference.mean(), 0.0) + 0.03, -2.0 / 3.0);
    for (int c = 0; c < 3; ++c) {
      system.block<1, 3>(3 * k + c, 3 * c) = weight * camera[k].transpose();
      system.block<1, 2>(3 * k + c, 9) = -weight * reference[c] * chart_place(k).transpose();
      target[3 * k + c] = weight * reference[c];
    }
  }
  return solve_least_squares(system, target);
}

/// Differences in L*a*b*, those of chroma divided as in CIE94 by 1 + 0.045 C.
Eigen::VectorXd residuals_of(const Parameters& p, const Colours& camera) {
  Eigen::VectorXd residuals(3 * chart_patches);
  for (int k = 0; k < chart_patches; ++k) {
    const Vector3d& reference = chart_lab()[k];
    const double chroma = 1.0 + 0.045 * std::hypot(reference[1], reference[2]);
    residuals.segment<3>(3 * k) = (lab_from_rec709(fitted_patch(p, camera[k], k)) - reference)
                                      .cwiseQuotient(Vector3d(1.0, chroma, chroma));
  }
  return residuals;
}

/// From the linear fit, which is near.
Parameters refined(const Parameters& linear, const Colours& camera) {
  return least_squares([&](const Eigen::VectorXd& p) { return residuals_of(p, camera); }, linear, 1e-6, 1e-10)
      .parameters;
}

std::array<double, chart_patches> delta_e_of(const Parameters& p, const Colours& camera) {
  std::array<double, chart_patches> delta_e{};
  for (int k = 0; k < chart_patches; ++k)
    delta_e[k] = delta_e_2000(lab_from_rec709(fitted_patch(p, camera[k], k)), chart_lab()[k]);
  return delta_e;
}

double median(std::array<double, chart_patches> values) {
  std::ranges::sort(values);
  return 0.5 * (values[chart_patches / 2 - 1] + values[chart_patches / 2]);
}

// ---- the search ----

/// A flat quadrilateral: centre and two edges, pixels of the picture that is searched.
struct Quad {
  Vector2d centre, right, down;
  double area() const { return std::abs(right.x() * down.y() - right.y() * down.x()); }
};

/// The photograph at most `max_side_px` wide and high, encoded for display, 8 bits.
cv::Mat picture_of(const Image& radiance, double& scale) {
  constexpr int max_side_px = 1600;
  scale = std::min(1.0, static_cast<double>(max_side_px) / std::max(radiance.width, radiance.height));
  Image image = radiance;
  for (float& value : image.values) value = std::isfinite(value) ? std::max(value, 0.0f) : 0.0f;
  if (scale < 1.0)
    image = resample_area(image, std::max(1, static_cast<int>(std::lround(scale * radiance.width))),
                          std::max(1, static_cast<int>(std::lround(scale * radiance.height))));
  // White highlights must not darken the chart: the 99th percentile is white.
  const auto levels = tone_mapped(image, {exposure_to_white(image)});
  cv::Mat picture(image.height, image.width, CV_8UC3);
  std::copy(levels.begin(), levels.end(), picture.data);
  return picture;
}

/// Quadrilaterals among the connected regions of `flat`.
void add_quads(const cv::Mat& flat, std::vector<Quad>& quads) {
  constexpr double min_side_px = 5.0;
  std::vector<std::vector<cv::Point>> contours;
  std::vector<cv::Vec4i> hierarchy;
  cv::findContours(flat, contours, hierarchy, cv::RETR_CCOMP, cv::CHAIN_APPROX_NONE);
  const double max_area = flat.total() / 24.0;
  for (std::size_t k = 0; k < contours.size(); ++k) {
    if (hierarchy[k][3] >= 0) continue;  // of a hole
    const auto& contour = contours[k];
    std::vector<cv::Point> hull, corners;
    cv::convexHull(contour, hull);
    const double area = cv::contourArea(hull);
    if (area < min_side_px * min_side_px || area > max_area || cv::contourArea(contour) < 0.75 * area)
      continue;
    // A covered or rounded corner must not make five.
    for (const double tolerance : {0.03, 0.06, 0.1}) {
      cv::approxPolyDP(hull, corners, tolerance * cv::arcLength(hull, true), true);
      if (corners.size() <= 4) break;
    }
    if (corners.size() != 4 || !cv::isContourConvex(corners)) continue;
    if (const double ratio = cv::contourArea(corners) / area; ratio < 0.75 || ratio > 1.25) continue;
    std::array<Vector2d, 4> p;
    for (std::size_t i = 0; i < 4; ++i) p[i] = {corners[i].x + 0.5, corners[i].y + 0.5};
    const cv::Moments moments = cv::moments(hull);
    const Quad quad{{moments.m10 / moments.m00 + 0.5, moments.m01 / moments.m00 + 0.5},
                    0.5 * (p[1] - p[0] + p[2] - p[3]),
                    0.5 * (p[3] - p[0] + p[2] - p[1])};
    const double longer = std::max(quad.right.norm(), quad.down.norm());
    const double shorter = std::min(quad.right.norm(), quad.down.norm());
    if (shorter < min_side_px || longer > 3.5 * shorter || quad.area() < 0.3 * longer * shorter) continue;
    quads.push_back(quad);
  }
}

std::vector<Quad> find_quads(const cv::Mat& picture) {
  cv::Mat smooth;
  std::vector<Quad> quads;
  // Smoothed against noise; small charts cannot afford much.
  for (const int blur : {3, 7}) {
    cv::GaussianBlur(picture, smooth, {blur, blur}, 0.0);
    cv::Mat highest, lowest, range;
    cv::dilate(smooth, highest, {});
    cv::erode(smooth, lowest, {});
    cv::subtract(highest, lowest, range);
    std::vector<cv::Mat> channels;
    cv::split(range, channels);
    cv::Mat steepest = cv::max(cv::max(channels[0], channels[1]), channels[2]);
    for (const int threshold : {4, 7, 12, 20, 32}) {
      cv::Mat flat;
      cv::threshold(steepest, flat, threshold, 255, cv::THRESH_BINARY_INV);
      add_quads(flat, quads);
    }
  }
  // One patch shows at several thresholds: the largest shape counts.
  std::ranges::stable_sort(quads, std::greater(), &Quad::area);
  std::vector<Quad> distinct;
  for (const Quad& quad : quads)
    if (std::ranges::none_of(distinct, [&](const Quad& other) {
          return (other.centre - quad.centre).squaredNorm() < 0.1 * other.area() &&
                 quad.area() > 0.3 * other.area();
        }))
      distinct.push_back(quad);
  return distinct;
}

struct GridPoint {
  int column = 0, row = 0;
  Vector2d centre;
};

/// A quadrilateral with its edges named as those of `like` are.
Quad turned_like(const Quad& quad, const Quad& like) {
  Quad best = quad;
  double most = -1.0;
  for (const auto& [right, down] : {std::pair{quad.right, quad.down}, std::pair{quad.down, quad.right}})
    for (const double r : {1.0, -1.0})
      for (const double d : {1.0, -1.0}) {
        const double match = r * right.normalized().dot(like.right.normalized()) +
                             d * down.normalized().dot(like.down.normalized());
        if (match <= most) continue;
        most = match;
        best = {quad.centre, r * right, d * down};
      }
  return best;
}

/// The quadrilaterals that continue the grid of one of them, neighbour by neighbour. Centres of neighbours
/// are 1 to 1.9 edges apart: the gaps are 0.1 to 0.3 of a patch, and the shapes end some pixels early.
std::vector<GridPoint> grid_around(std::size_t seed, const std::vector<Quad>& quads) {
  std::vector<char> is_used(quads.size(), 0);
  std::vector<GridPoint> grid;
  std::deque<std::pair<Quad, GridPoint>> open;
  const auto take = [&](std::size_t i, const Quad& quad, int column, int row) {
    is_used[i] = 1;
    grid.push_back({column, row, quad.centre});
    open.emplace_back(quad, grid.back());
  };
  take(seed, quads[seed], 0, 0);
  while (!open.empty()) {
    const auto [quad, at] = open.front();
    open.pop_front();
    Eigen::Matrix2d edges;
    edges << quad.right, quad.down;
    const Eigen::Matrix2d in_edges = edges.inverse();
    for (std::size_t i = 0; i < quads.size(); ++i) {
      if (is_used[i]) continue;
      const Vector2d away = in_edges * (quads[i].centre - quad.centre);
      const bool along_row = std::abs(away.x()) > std::abs(away.y());
      const double along = along_row ? away.x() : away.y(), across = along_row ? away.y() : away.x();
      if (std::abs(along) < 0.95 || std::abs(along) > 1.9 || std::abs(across) > 0.3) continue;
      const Quad next = turned_like(quads[i], quad);
      const double wide = next.right.norm() / quad.right.norm(), high = next.down.norm() / quad.down.norm();
      if (std::min(wide, high) < 0.6 || std::max(wide, high) > 1.6) continue;
      const int step = along > 0.0 ? 1 : -1;
      const int column = at.column + (along_row ? step : 0), row = at.row + (along_row ? 0 : step);
      if (std::ranges::any_of(grid, [&](const GridPoint& p) { return p.column == column && p.row == row; }))
        continue;
      take(i, next, column, row);
    }
  }
  return grid;
}

/// Least squares of the algebraic error on centred coordinates (direct linear transform); Hartley and
/// Zisserman, "Multiple View Geometry", 2004, algorithm 4.2. nullopt where the points do not determine it.
std::optional<Matrix3d> homography_of(const std::vector<GridPoint>& points) {
  Vector2d mean = Vector2d::Zero();
  for (const GridPoint& p : points) mean += p.centre / static_cast<double>(points.size());
  double spread = 0.0;
  for (const GridPoint& p : points) spread += (p.centre - mean).norm() / static_cast<double>(points.size());
  if (!(spread > 0.0)) return std::nullopt;
  Eigen::MatrixXd system(2 * points.size(), 9);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector2d at = (points[i].centre - mean) / spread;
    const Eigen::RowVector3d from(points[i].column / 3.0, points[i].row / 3.0, 1.0);
    system.row(2 * i) << from, Eigen::RowVector3d::Zero(), -at.x() * from;
    system.row(2 * i + 1) << Eigen::RowVector3d::Zero(), from, -at.y() * from;
  }
  const SingularValues svd = singular_values(system);
  if (svd.values[7] < 1e-6 * svd.values[0]) return std::nullopt;
  const Eigen::VectorXd h = svd.v.col(8);
  Matrix3d scaled, back;
  scaled << h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8];
  back << spread, 0.0, mean.x(), 0.0, spread, mean.y(), 0.0, 0.0, 1.0;
  return back * scaled * Vector3d(1.0 / 3.0, 1.0 / 3.0, 1.0).asDiagonal();
}

Vector2d mapped(const Matrix3d& homography, double column, double row) {
  return (homography * Vector3d(column, row, 1.0)).hnormalized();
}

/// A grid whose points all fit one homography, at least `min_points` of them on two rows and two columns.
constexpr std::size_t min_points = 9;
constexpr double tolerated_offset = 0.12;  // of the distance to the next patch

std::optional<Matrix3d> sound_homography(std::vector<GridPoint>& grid) {
  while (grid.size() >= min_points) {
    auto homography = homography_of(grid);
    if (!homography) return std::nullopt;
    const auto offset = [&](const GridPoint& p) {
      const Vector2d there = mapped(*homography, p.column, p.row);
      return (there - p.centre).norm() / (mapped(*homography, p.column + 1.0, p.row) - there).norm();
    };
    const auto worst = std::ranges::max_element(grid, {}, offset);
    if (offset(*worst) < tolerated_offset) return homography;
    grid.erase(worst);
  }
  return std::nullopt;
}

// ---- reading the patches ----

/// The middle of a patch, by pixel.
struct PatchSamples {
  std::array<std::vector<float>, 3> values;
  std::array<Vector3d, 4> quarters;  // means of its quarters
  std::size_t unmeasured = 0;
  bool is_inside = true;
};

constexpr double half_side = 0.25;  // of the distance between patches: patches are 0.75 to 0.95 wide

Vector2d in_image(const Matrix3d& homography, int patch, double x, double y) {
  return mapped(homography, patch % chart_columns + x, patch / chart_columns + y);
}

PatchSamples patch_samples(const Photograph& photograph, const Matrix3d& homography, int patch) {
  const Image& image = photograph.radiance;
  PatchSamples samples;
  const double side =
      (in_image(homography, patch, half_side, 0.0) - in_image(homography, patch, -half_side, 0.0)).norm();
  const int steps = std::clamp(static_cast<int>(2.0 * side), 6, 200);
  std::array<Vector3d, 4> sums;
  sums.fill(Vector3d::Zero());
  std::array<double, 4> counts{};
  // Every pixel of the middle at least once; a second time does no harm.
  std::vector<std::pair<int, int>> pixels;
  for (int j = 0; j < steps; ++j)
    for (int i = 0; i < steps; ++i) {
      const double x = half_side * (2.0 * (i + 0.5) / steps - 1.0),
                   y = half_side * (2.0 * (j + 0.5) / steps - 1.0);
      const Vector2d at = in_image(homography, patch, x, y);
      if (!(at.x() >= 0.0 && at.y() >= 0.0 && at.x() < image.width && at.y() < image.height)) {
        samples.is_inside = false;
        return samples;
      }
      const int px = static_cast<int>(at.x()), py = static_cast<int>(at.y());
      const Vector3d value(image.at(px, py, 0), image.at(px, py, 1), image.at(px, py, 2));
      const bool is_measured = photograph.sigma.empty() || (std::isfinite(photograph.sigma.at(px, py, 0)) &&
                                                            std::isfinite(photograph.sigma.at(px, py, 1)) &&
                                                            std::isfinite(photograph.sigma.at(px, py, 2)));
      samples.unmeasured += !is_measured;
      for (int c = 0; c < 3; ++c) samples.values[c].push_back(static_cast<float>(value[c]));
      const std::size_t quarter = (x > 0.0 ? 1 : 0) + (y > 0.0 ? 2 : 0);
      sums[quarter] += value;
      counts[quarter] += 1.0;
    }
  for (std::size_t q = 0; q < 4; ++q) samples.quarters[q] = sums[q] / counts[q];
  return samples;
}

/// Without the darkest and brightest fifth: dust, dead pixels.
double patch_mean(std::vector<float> values) {
  std::ranges::sort(values);
  const std::size_t cut = values.size() / 5;
  return std::accumulate(values.begin() + cut, values.end() - cut, 0.0) /
         static_cast<double>(values.size() - 2 * cut);
}

Vector3d colour_of(const PatchSamples& samples) {
  return {patch_mean(samples.values[0]), patch_mean(samples.values[1]), patch_mean(samples.values[2])};
}

/// Nullopt where a patch lies outside of the picture.
std::optional<Colours> colours_at(const Photograph& photograph, const Matrix3d& homography) {
  Colours colours;
  for (int k = 0; k < chart_patches; ++k) {
    const PatchSamples samples = patch_samples(photograph, homography, k);
    if (!samples.is_inside) return std::nullopt;
    colours[k] = colour_of(samples);
  }
  return colours;
}

/// One way that a grid may lie on the chart.
struct ChartPlacement {
  Matrix3d homography;
  double median_delta_e = std::numeric_limits<double>::infinity();
  bool is_mirrored = false;
  bool is_cut = false;  // a patch is outside of the picture
};

/// All ways that lay every point of the grid on a patch, the best first.
std::vector<ChartPlacement> placements_of(const std::vector<GridPoint>& grid, const Matrix3d& image_from_grid,
                                          const Photograph& photograph) {
  std::vector<ChartPlacement> candidates;
  for (int turn = 0; turn < 8; ++turn) {
    Eigen::Matrix2i grid_from_chart = Eigen::Matrix2i::Identity();
    const Eigen::Matrix2i quarter = (Eigen::Matrix2i() << 0, -1, 1, 0).finished();
    for (int i = 0; i < turn % 4; ++i) grid_from_chart = quarter * grid_from_chart;
    if (turn >= 4) grid_from_chart.col(0) *= -1;
    Eigen::Vector2i low(1000, 1000), high(-1000, -1000);
    for (const GridPoint& p : grid) {
      const Eigen::Vector2i at = grid_from_chart.transpose() * Eigen::Vector2i(p.column, p.row);
      low = low.cwiseMin(at);
      high = high.cwiseMax(at);
    }
    for (int x = high.x() - chart_columns + 1; x <= low.x(); ++x)
      for (int y = high.y() - chart_rows + 1; y <= low.y(); ++y) {
        Matrix3d move = Matrix3d::Identity();
        move.topLeftCorner<2, 2>() = grid_from_chart.cast<double>();
        move.topRightCorner<2, 1>() = (grid_from_chart * Eigen::Vector2i(x, y)).cast<double>();
        ChartPlacement candidate{image_from_grid * move};
        // y is down in the image and on the chart, so a chart seen from its front keeps the sense of turning.
        const Vector2d origin = mapped(candidate.homography, 2.0, 1.0);
        const Vector2d right = mapped(candidate.homography, 3.0, 1.0) - origin;
        const Vector2d down = mapped(candidate.homography, 2.0, 2.0) - origin;
        candidate.is_mirrored = right.x() * down.y() - right.y() * down.x() < 0.0;
        if (const auto colours = colours_at(photograph, candidate.homography))
          candidate.median_delta_e = median(delta_e_of(linear_fit(*colours), *colours));
        else
          candidate.is_cut = true;
        candidates.push_back(candidate);
      }
  }
  std::ranges::stable_sort(candidates, {}, &ChartPlacement::median_delta_e);
  return candidates;
}

/// Above this a grid is another thing than a chart: a keyboard or a window.
constexpr double foreign_delta_e = 8.0;

std::string patch_list(const std::vector<int>& patches) {
  std::string text;
  for (const int patch : patches) text += (text.empty() ? "" : ", ") + std::string(patch_names[patch]);
  return text;
}

/// Reads the patches and checks them.
Colours checked_colours(const Photograph& photograph, const Matrix3d& homography, const std::string& name) {
  constexpr double tolerated_share = 0.01;  // of unmeasured pixels: dead ones
  constexpr double tolerated_change = 0.2;  // between quarters of a patch; a shadow's edge is above
  const Image& image = photograph.radiance;
  std::array<float, 3> peak{};
  for (std::size_t i = 0; i < image.values.size(); ++i) peak[i % 3] = std::max(peak[i % 3], image.values[i]);
  std::vector<int> clipped, covered;
  Colours colours;
  double white = 0.0;
  for (int k = 0; k < chart_patches; ++k) {
    const PatchSamples samples = patch_samples(photograph, homography, k);
    colours[k] = colour_of(samples);
    white = std::max(white, colours[k].maxCoeff());
    const auto count = static_cast<double>(samples.values[0].size());
    bool is_clipped = static_cast<double>(samples.unmeasured) > tolerated_share * count;
    // Without sigma: a camera that clips gives one and the same value, which nothing exceeds.
    for (int c = 0; c < 3; ++c)
      is_clipped =
          is_clipped || static_cast<double>(std::ranges::count(samples.values[c], peak[c])) > 0.25 * count;
    if (is_clipped) clipped.push_back(k);
  }
  for (int k = 0; k < chart_patches; ++k) {
    const PatchSamples samples = patch_samples(photograph, homography, k);
    for (const Vector3d& quarter : samples.quarters)
      if ((quarter - colours[k]).cwiseAbs().maxCoeff() >
          tolerated_change * colours[k].maxCoeff() + 0.01 * white) {
        covered.push_back(k);
        break;
      }
  }
  if (!clipped.empty())
    throw InputError(name, ": the chart's patches ", patch_list(clipped),
                     " are clipped; photograph the chart with a shorter exposure, or merge a bracket");
  if (!covered.empty())
    throw InputError(name, ": the chart's patches ", patch_list(covered),
                     " are not even: something covers or shades them, or reflects in them; free the chart "
                     "and photograph it again");
  return colours;
}

}  // namespace

std::string_view chart_patch_name(int patch) {
  return patch_names[static_cast<std::size_t>(patch)];
}

const std::array<Vector3d, chart_patches>& chart_lab() {
  static const std::array<Vector3d, chart_patches> lab = {{
      {37.54, 14.37, 14.92},  {64.66, 19.27, 17.50},   {49.32, -3.82, -22.54}, {43.46, -12.74, 22.72},
      {54.94, 9.61, -24.79},  {70.48, -32.26, -0.37},  {62.73, 35.83, 56.50},  {39.43, 10.75, -45.17},
      {50.57, 48.64, 16.67},  {30.10, 22.54, -20.87},  {71.77, -24.13, 58.19}, {71.51, 18.24, 67.37},
      {28.37, 15.42, -49.80}, {54.38, -39.72, 32.27},  {42.43, 51.05, 28.62},  {81.80, 2.67, 80.41},
      {50.63, 51.28, -14.12}, {49.57, -29.71, -28.32}, {95.19, -1.03, 2.93},   {81.29, -0.57, 0.44},
      {66.89, -0.75, -0.06},  {50.76, -0.13, 0.14},    {35.63, -0.46, -0.48},  {20.64, 0.07, -0.46},
  }};
  return lab;
}

Vector2d ColourChart::point(double column, double row) const {
  return mapped(image_from_chart, column, row);
}

ColourChart find_colour_chart(const Photograph& photograph, const std::string& name) {
  double scale = 1.0;
  const cv::Mat picture = picture_of(photograph.radiance, scale);
  const std::vector<Quad> quads = find_quads(picture);
  std::optional<ChartPlacement> best;
  std::size_t max_points = 0;
  bool is_cut = false;  // a grid may lie on a chart of which patches are outside of the picture
  std::vector<char> is_tried(quads.size(), 0);
  for (std::size_t seed = 0; seed < quads.size(); ++seed) {
    if (is_tried[seed]) continue;
    std::vector<GridPoint> grid = grid_around(seed, quads);
    for (std::size_t i = 0; i < quads.size(); ++i)
      if (std::ranges::any_of(grid, [&](const GridPoint& p) { return p.centre == quads[i].centre; }))
        is_tried[i] = 1;
    const auto homography = sound_homography(grid);
    if (!homography) continue;
    max_points = std::max(max_points, grid.size());
    const Matrix3d image_from_grid = Vector3d(1.0 / scale, 1.0 / scale, 1.0).asDiagonal() * *homography;
    const auto candidates = placements_of(grid, image_from_grid, photograph);
    is_cut = is_cut || std::ranges::any_of(candidates, &ChartPlacement::is_cut);
    if (!candidates.empty() && (!best || candidates.front().median_delta_e < best->median_delta_e))
      best = candidates.front();
  }
  const std::string remedy =
      "; photograph the whole chart, sharp, evenly lit, tilted by less than 40°, and at least 60 pixels wide";
  if (!best) throw InputError(name, ": no chart of 24 patches was found", remedy);
  if (!(best->median_delta_e < foreign_delta_e))
    throw InputError(name, ": a grid of ", max_points, " squares was found, but ",
                     is_cut ? "the chart reaches outside of the picture or "
                            : "its colours are not those of the chart of 24 patches: ",
                     "it is another thing", remedy);
  if (best->is_mirrored)
    throw InputError(
        name, ": the chart of 24 patches is mirrored; flip the picture, or photograph it without a mirror");
  return {best->homography, checked_colours(photograph, best->homography, name)};
}

double ColourFit::median_delta_e() const {
  return median(delta_e);
}

double ColourFit::largest_delta_e() const {
  return std::ranges::max(delta_e);
}

int ColourFit::worst_patch() const {
  return static_cast<int>(std::ranges::max_element(delta_e) - delta_e.begin());
}

ColourFit fit_colour(const ColourChart& chart, const std::string& name) {
  constexpr double tolerated_delta_e = 12.0;
  const Parameters p = refined(linear_fit(chart.camera), chart.camera);
  ColourFit fit;
  fit.delta_e = delta_e_of(p, chart.camera);
  fit.rec709_from_camera = matrix_of(p);
  const double reach = std::abs(p[9]) + std::abs(p[10]);
  fit.light_change = (1.0 + reach) / std::max(1.0 - reach, 0.01) - 1.0;
  // p(camera) is a reflectance. The camera's grey of green 1 shall become 1.
  const Vector3d grey = fit.rec709_from_camera.inverse() * Vector3d::Ones();
  if (!(grey.minCoeff() > 0.0) || !grey.allFinite())
    throw InputError(name, ": no colour matrix fits the chart; check that the photograph is scene-linear");
  fit.rec709_from_camera *= grey[1];
  if (fit.largest_delta_e() > tolerated_delta_e) {
    std::vector<int> patches;
    for (int k = 0; k < chart_patches; ++k)
      if (fit.delta_e[k] > tolerated_delta_e) patches.push_back(k);
    throw InputError(name, ": the chart's patches ", patch_list(patches),
                     " do not have the expected colours: something covers them or reflects in them, the "
                     "chart has faded, or the photograph is not scene-linear");
  }
  return fit;
}

}  // namespace refield
