// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/light_texels.h"

#include <tbb/parallel_for.h>

#include <cmath>

namespace refield::peers {

namespace {

Eigen::MatrixXd gaussian(int size, double length) {
  Eigen::MatrixXd covariance(size, size);
  for (int i = 0; i < size; ++i)
    for (int j = 0; j < size; ++j) {
      const double d = (i - j) / length;
      covariance(i, j) = std::exp(-0.5 * d * d);
    }
  return covariance;
}

}  // namespace

Eigen::MatrixXd texel_matrix(std::span<const LightMap> lights, int channel) {
  const auto texels = static_cast<Eigen::Index>(lights.front().radiance.pixel_count());
  Eigen::MatrixXd matrix(texels, static_cast<Eigen::Index>(lights.size()));
  for (std::size_t j = 0; j < lights.size(); ++j) {
    const float* values = lights[j].radiance.values.data() + channel;
    for (Eigen::Index t = 0; t < texels; ++t) matrix(t, static_cast<Eigen::Index>(j)) = values[3 * t];
  }
  return matrix;
}

TexelCovariance::TexelCovariance(const LightDomain& domain, double length_texels) : length_(length_texels) {
  if (length_ <= 0.0) return;
  along_x_ = gaussian(domain.width, length_);
  along_y_ = gaussian(domain.height, length_);
}

Eigen::MatrixXd TexelCovariance::times(const Eigen::MatrixXd& texels) const {
  if (length_ <= 0.0) return texels;
  Eigen::MatrixXd result(texels.rows(), texels.cols());
  const auto width = along_x_.rows(), height = along_y_.rows();
  tbb::parallel_for(Eigen::Index{0}, texels.cols(), [&](Eigen::Index j) {
    // Column-major [width × height]: the map's rows lie one after another.
    const Eigen::Map<const Eigen::MatrixXd> map(texels.col(j).data(), width, height);
    Eigen::Map<Eigen::MatrixXd>(result.col(j).data(), width, height).noalias() =
        along_x_ * (map * along_y_).eval();
  });
  return result;
}

}  // namespace refield::peers
