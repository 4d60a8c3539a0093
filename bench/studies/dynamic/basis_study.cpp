// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/dynamic/basis_study.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "bench/studies/dynamic/fixed_basis.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/image/metrics.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/object_transport.h"
#include "simulate/prt/transfer_samples.h"

namespace refield::dynamic_chart {

using dynamic::BasisKind;
using dynamic::SurfaceBasis;

namespace {

/// Around a solid at 1.4 to 4 radii, above a plane at 0.3 to 1.5.
Eigen::Vector3f random_place(const std::optional<Eigen::Vector3f>& front, const Eigen::Vector3d& way,
                             int area_light) {
  Rng rng(20, area_light);
  const auto uniform = [&rng](double low, double high) { return static_cast<float>(rng.uniform(low, high)); };
  if (!front) return way.cast<float>() * uniform(1.4, 4.0);
  const Eigen::Vector3f along = front->unitOrthogonal(), across = front->cross(along);
  const float right = uniform(-0.9, 0.9), ahead = uniform(-0.9, 0.9);
  return right * along + ahead * across + uniform(0.3, 1.5) * *front;
}

/// Evenly over a square area light.
std::vector<Eigen::Vector3f> points_of(const Eigen::Vector3f& middle, const Eigen::Vector3f& facing,
                                       float side) {
  constexpr int points_per_side = 8;
  const Eigen::Vector3f along = facing.unitOrthogonal(), across = facing.cross(along);
  const auto at = [side](int k) { return side * ((static_cast<float>(k) + 0.5f) / points_per_side - 0.5f); };
  std::vector<Eigen::Vector3f> points;
  for (int j = 0; j < points_per_side; ++j)
    for (int i = 0; i < points_per_side; ++i) points.push_back(middle + at(i) * along + at(j) * across);
  return points;
}

double median_error(const SurfaceBasis& basis, const Eigen::VectorXf& root,
                    const std::vector<Eigen::MatrixXf>& light) {
  std::vector<float> errors;
  for (const Eigen::MatrixXf& exact : light) {
    if ((exact.array() == 0.0f).all()) continue;  // an area light that meets backs alone
    const Eigen::MatrixXf left = exact - basis.functions * (basis.to_weights * exact);
    errors.push_back((root.asDiagonal() * left).norm() / (root.asDiagonal() * exact).norm());
  }
  return quantile(errors, 0.5);
}

/// Most float matrices that have no inverse still get one, of noise.
std::optional<double> error_by_inverse(const Eigen::MatrixXf& functions, const Eigen::VectorXf& areas,
                                       const std::vector<Eigen::MatrixXf>& light) {
  try {
    const double error = median_error(dynamic::basis_by_inverse(functions), areas.cwiseSqrt(), light);
    if (std::isfinite(error)) return error;
  } catch (const SolverError&) {
  }
  return std::nullopt;
}

}  // namespace

std::vector<StudyBasis> bases_of(const StudySurface& surface, const prt::MeshRays& rays, int functions) {
  constexpr int all_lights = 384;
  const auto places = dynamic::surface_places(surface.mesh);
  std::vector<StudyBasis> bases;
  for (const auto& [name, kind] :
       {std::pair("harmonics", BasisKind::spherical_harmonics),
        std::pair("wavelets", BasisKind::haar_wavelets), std::pair("cosines", BasisKind::cosines)})
    bases.push_back({name, dynamic::fixed_functions(kind, places, functions)});
  const auto add_principal = [&](const char* name, dynamic::PrincipalOptions options) {
    run_context().throw_if_stopped();
    options.lights = all_lights / static_cast<int>(options.distances.size());
    bases.push_back({name, dynamic::principal_basis(surface.mesh, rays, surface.factors, functions, options,
                                                    run_context())
                               .functions});
  };
  add_principal("principal", {});
  add_principal("principal, near", {.distances = {1.05f}});
  return bases;
}

Eigen::MatrixXf area_light_terms(const StudySurface& surface, const prt::MeshRays& rays,
                                 const Eigen::Vector3f& away) {
  const dynamic::BoundingBall ball = dynamic::bounding_ball(surface.mesh);
  const auto front = dynamic::facing_of(surface.mesh);
  const Eigen::Vector3f facing = front ? Eigen::Vector3f(-*front) : Eigen::Vector3f(-away.normalized());
  const auto points = points_of(ball.middle + ball.radius * away, facing, 0.5f * ball.radius);
  const Eigen::MatrixXf terms =
      dynamic::light_terms(surface.mesh, rays, surface.factors, points, run_context());
  const Eigen::Index count = surface.factors.terms();
  Eigen::MatrixXf light = Eigen::MatrixXf::Zero(terms.rows() / count, count);
  for (Eigen::Index v = 0; v < light.rows(); ++v)
    for (std::size_t p = 0; p < points.size(); ++p) {
      const Eigen::Vector3f way = surface.mesh.positions[static_cast<std::size_t>(v)] - points[p];
      const float cosine = std::max(0.0f, way.normalized().dot(facing));
      light.row(v) += cosine * terms.col(static_cast<Eigen::Index>(p)).segment(v * count, count).transpose();
    }
  return light;
}

std::vector<Eigen::MatrixXf> area_light_terms(const StudySurface& surface, const prt::MeshRays& rays,
                                              int area_lights) {
  const auto front = dynamic::facing_of(surface.mesh);
  const auto ways = prt::hammersley_sphere(area_lights);
  std::vector<Eigen::MatrixXf> light;
  Progress progress(run_context(), "area lights on " + surface.name, static_cast<std::uint64_t>(area_lights));
  for (int l = 0; l < area_lights; ++l) {
    light.push_back(
        area_light_terms(surface, rays, random_place(front, ways[static_cast<std::size_t>(l)], l)));
    progress.advance();
  }
  return light;
}

std::vector<BasisRow> study(const StudySurface& surface, const std::vector<StudyBasis>& bases,
                            const std::vector<Eigen::MatrixXf>& light, const std::vector<int>& functions) {
  const Eigen::VectorXf areas = dynamic::areas_of(surface.mesh);
  std::vector<BasisRow> rows;
  for (const StudyBasis& basis : bases)
    for (const int count : functions) {
      if (count > basis.functions.cols()) continue;
      run_context().throw_if_stopped();
      const Eigen::MatrixXf first = basis.functions.leftCols(count);
      const SurfaceBasis ours = dynamic::surface_basis(first, areas);
      rows.push_back({surface.name, basis.name, count, ours.functions.cols(), dynamic::condition_of(first),
                      median_error(ours, areas.cwiseSqrt(), light), error_by_inverse(first, areas, light)});
    }
  return rows;
}

}  // namespace refield::dynamic_chart
