// SPDX-License-Identifier: Apache-2.0
#include "core/field/light_error.h"

#include <tbb/parallel_for.h>

#include "core/field/light_covariance.h"

namespace refield {

using namespace gaussian_process;

namespace {

/// Error under extended light is a double sum over directions; more of them are put together.
constexpr std::size_t max_error_points = 8192;

/// Each source predicted from all others.
struct LeftOutSources {
  Eigen::MatrixXd residuals;  // [sources × sources]: times the sources' responses, at equal irradiance
  double variance = 0.0;      // by the Gaussian process, mean over the sources

  LeftOutSources(const LightInterpolation& interpolation, const LightDomain& domain) {
    const Eigen::MatrixXd directions = directions_of(interpolation.sources, domain);
    const Eigen::Index count = directions.rows();
    const Eigen::MatrixXd inverse =
        factorised(interpolation, chords_of((directions * directions.transpose()).array()))
            .solve(Eigen::MatrixXd::Identity(count, count));
    const Eigen::VectorXd variances = inverse.diagonal().cwiseInverse();
    residuals = variances.asDiagonal() * inverse;
    variance = variances.mean();
  }
};

/// Light from directions between the sources.
struct LightBetween {
  std::vector<Eigen::Vector3d> directions;
  std::vector<Eigen::RowVector3d> irradiance;
};

/// Light between the sources is put together in blocks of `size`, a chord, or less. What has no effect, far
/// from all sources, is left out.
LightBetween light_between(const Image& radiance, const LightInterpolation& interpolation, double size) {
  const int width = radiance.width, height = radiance.height;
  const LightDomain domain{width, height, Parameterisation::lat_long};
  const Eigen::MatrixXd sources = directions_of(interpolation.sources, domain);
  LightBetween light;
  std::vector<char> is_source(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), 0);
  for (const Box& box : interpolation.sources)
    for (int y = box.y0; y < box.y1; ++y)
      std::fill_n(is_source.begin() + static_cast<std::ptrdiff_t>(y) * width + box.x0, box.width(), 1);
  const double texel = std::numbers::pi / height;
  const int rows = std::max(1, static_cast<int>(size / texel));
  for (int first = 0; first < height; first += rows) {
    const double sine = std::max(std::sin(texel * (first + 0.5 * rows)), 1e-3);
    const int columns = std::clamp(static_cast<int>(size / (texel * sine)), 1, width);
    const auto blocks = static_cast<std::size_t>((width + columns - 1) / columns);
    std::vector<Eigen::Vector3d> middles(blocks, Eigen::Vector3d::Zero());
    std::vector<Eigen::RowVector3d> sums(blocks, Eigen::RowVector3d::Zero());
    for (int y = first; y < std::min(first + rows, height); ++y) {
      const double solid_angle = lat_long_solid_angle(y, width, height);
      for (int x = 0; x < width; ++x) {
        const Eigen::RowVector3d irradiance =
            solid_angle *
            Eigen::RowVector3d(radiance.at(x, y, 0), radiance.at(x, y, 1), radiance.at(x, y, 2));
        if (is_source[static_cast<std::size_t>(y) * width + x] != 0 || irradiance.isZero(0.0)) continue;
        const Eigen::Vector3d direction = lat_long_direction(x + 0.5, y + 0.5, width, height);
        const Eigen::RowVector3d part = nearness_of(interpolation, sources * direction) * irradiance;
        sums[static_cast<std::size_t>(x / columns)] += part;
        middles[static_cast<std::size_t>(x / columns)] += part.cwiseAbs().sum() * direction;
      }
    }
    for (std::size_t i = 0; i < blocks; ++i)
      if (middles[i].norm() > 0.0) {
        light.directions.push_back(middles[i].normalized());
        light.irradiance.push_back(sums[i]);
      }
  }
  return light;
}

/// Variance of the error under a light map by the Gaussian process, relative to that of a source at
/// irradiance 1 which is predicted from all others, mean over the sources.
double variance_between(const LightInterpolation& interpolation, const LightDomain& domain,
                        const Image& radiance) {
  require_domain({radiance, Parameterisation::lat_long}, domain);
  double size = interpolation.fine_length;
  LightBetween light = light_between(radiance, interpolation, size);
  while (light.directions.size() > max_error_points)
    light = light_between(radiance, interpolation, size *= 1.5);
  const Eigen::MatrixXd sources = directions_of(interpolation.sources, domain);
  const auto factor = factorised(interpolation, chords_of((sources * sources.transpose()).array()));
  const auto count = static_cast<Eigen::Index>(light.directions.size());
  // Covariance with the sources, in which the products of two columns are what the sources explain.
  Eigen::MatrixXd explained(sources.rows(), count);
  for (Eigen::Index i = 0; i < count; ++i)
    explained.col(i) = covariance(
        interpolation, chords_of((sources * light.directions[static_cast<std::size_t>(i)]).array()));
  factor.matrixL().solveInPlace(explained);
  std::vector<double> of_points(light.directions.size(), 0.0);
  // What is unknown of two directions is independent with several sources between them.
  const double least_cosine = 1.0 - 0.5 * interpolation.reach * interpolation.reach;
  tbb::parallel_for(Eigen::Index{0}, count, [&](Eigen::Index i) {
    const auto at = static_cast<std::size_t>(i);
    for (Eigen::Index k = 0; k <= i; ++k) {
      const auto other = static_cast<std::size_t>(k);
      const double cosine = k < i ? light.directions[at].dot(light.directions[other]) : 1.0;
      if (cosine < least_cosine) continue;
      const double prior =
          covariance(interpolation, chords_of(Eigen::ArrayXXd::Constant(1, 1, cosine)))(0, 0);
      of_points[at] += (k < i ? 2.0 : 1.0) * (prior - explained.col(i).dot(explained.col(k))) *
                       light.irradiance[at].dot(light.irradiance[other]) / 3.0;
    }
  });
  double variance = 0.0;
  for (const double part : of_points) variance += part;
  return std::max(variance, 0.0) / LeftOutSources(interpolation, domain).variance;
}

}  // namespace

bool knows_light_error(const FieldOutline& field) {
  const FieldQuality& quality = field.quality;
  return !quality.predicted_error.empty() &&
         quality.training_signal.size() == quality.predicted_error.size() &&
         (quality.light_error.known() || field.basis.interpolation);
}

std::vector<double> own_squared_error_under(const FieldOutline& field, const Image& radiance) {
  if (!knows_light_error(field)) return {};
  const FieldQuality& quality = field.quality;
  const auto& interpolation = field.basis.interpolation;
  std::vector<double> of_classes;
  if (!quality.light_error.known()) {
    of_classes = {variance_between(*interpolation, field.basis.domain, radiance)};
  } else if (interpolation) {
    Image on_sources = radiance;
    LightInterpolator(*interpolation, field.basis.domain).gather(on_sources);
    of_classes = quality.light_error.variances_under(on_sources);
  } else {
    of_classes = quality.light_error.variances_under(radiance);
  }
  std::vector<double> squared(quality.predicted_error.size());
  for (std::size_t p = 0; p < squared.size(); ++p) {
    const double misfit =
        std::pow(quality.predicted_error[p], 2.0) - std::pow(quality.photograph_noise[p], 2.0);
    squared[p] = std::max(misfit, 0.0) * std::pow(quality.training_signal[p], 2.0) *
                 of_classes[quality.light_class.empty() ? 0 : quality.light_class[p]];
  }
  return squared;
}

std::vector<float> predicted_error_under(const FieldOutline& field, const Image& radiance,
                                         const Image& relit) {
  const FieldQuality& quality = field.quality;
  const std::vector<double> own = own_squared_error_under(field, radiance);
  if (own.empty()) return quality.predicted_error;
  std::vector<float> error(own.size(), 0.0f);
  for (std::size_t p = 0; p < error.size(); ++p) {
    double signal = 0.0;
    for (int c = 0; c < 3; ++c) signal += std::pow(static_cast<double>(relit.values[3 * p + c]), 2.0);
    if (!(signal > 0.0) || !(quality.predicted_error[p] > 0.0f)) continue;
    error[p] = static_cast<float>(std::sqrt(own[p] / signal + std::pow(quality.photograph_noise[p], 2.0)));
  }
  return error;
}

SourceResponses::SourceResponses(const ReflectanceField& field, const std::vector<Box>& sources)
    : transfer_(field.transfer),
      count_(static_cast<Eigen::Index>(sources.size())),
      of_kernels_(field.basis.size()) {
  const LightBasis& basis = field.basis;
  tbb::parallel_for(std::size_t{0}, basis.size(), [&](std::size_t kernel) {
    for (std::size_t s = 0; s < sources.size(); ++s) {
      double sum = 0.0, solid_angle = 0.0;
      for (int y = sources[s].y0; y < sources[s].y1; ++y)
        for (int x = sources[s].x0; x < sources[s].x1; ++x) {
          solid_angle += lat_long_solid_angle(y, basis.domain.width, basis.domain.height);
          sum += static_cast<double>(basis.value(kernel, x, y));
        }
      if (sum != 0.0) of_kernels_[kernel].emplace_back(static_cast<Eigen::Index>(s), sum / solid_angle);
    }
  });
}

Eigen::MatrixXd SourceResponses::of_pixel(std::size_t pixel) const {
  Eigen::MatrixXd responses = Eigen::MatrixXd::Zero(count_, 3);
  for (auto e = transfer_.row_start[pixel]; e < transfer_.row_start[pixel + 1]; ++e)
    for (const auto& [source, part] : of_kernels_[transfer_.column[e]])
      for (std::size_t c = 0; c < 3; ++c)
        responses(source, static_cast<Eigen::Index>(c)) +=
            static_cast<double>(transfer_.weight[3 * e + c]) * part;
  return responses;
}

void predict_errors_between(const LightInterpolation& interpolation, const LightDomain& domain,
                            const SourceResponses& responses, FieldQuality& quality) {
  const LeftOutSources left_out(interpolation, domain);
  const auto sources = static_cast<double>(responses.sources());
  tbb::parallel_for(std::size_t{0}, quality.predicted_error.size(), [&](std::size_t p) {
    const Eigen::MatrixXd of_sources = responses.of_pixel(p);
    const double signal = of_sources.squaredNorm();
    quality.training_signal[p] = static_cast<float>(std::sqrt(signal / sources));
    if (!(signal > 0.0)) return;
    quality.predicted_error[p] =
        static_cast<float>(std::sqrt((left_out.residuals * of_sources).squaredNorm() / signal));
  });
}

}  // namespace refield
