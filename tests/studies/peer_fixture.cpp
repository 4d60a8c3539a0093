// SPDX-License-Identifier: Apache-2.0
#include "tests/studies/peer_fixture.h"

#include "core/base/rng.h"
#include "core/image/metrics.h"

namespace refield::test {

peers::PeerData photographed(const ReflectanceField& field, std::vector<LightMap> lights, double noise) {
  peers::PeerData data;
  data.domain = field.basis.domain;
  data.width = field.width;
  data.height = field.height;
  data.observed.resize(static_cast<Eigen::Index>(lights.size()), 3 * data.pixels());
  for (std::size_t j = 0; j < lights.size(); ++j) {
    Image photograph = field.relight(lights[j]);
    Rng rng(3, j);
    for (float& value : photograph.values) value *= static_cast<float>(1.0 + noise * rng.normal());
    data.observed.row(static_cast<Eigen::Index>(j)) =
        Eigen::Map<const Eigen::RowVectorXf>(photograph.values.data(), data.observed.cols());
  }
  data.lights = std::move(lights);
  return data;
}

double relative_difference(const Image& a, const Image& b) {
  return relative_rmse(a, b);
}

}  // namespace refield::test
