// SPDX-License-Identifier: Apache-2.0
#include "core/harmonics.h"

#include <cmath>
#include <numbers>

namespace refield {

void evaluate_harmonics(int order, const Eigen::Vector3d& direction, std::span<double> values) {
  const double x = direction.x(), y = direction.y(), z = direction.z();
  double diagonal = std::sqrt(0.25 / std::numbers::pi);  // P_mm without its factor (sin θ)^m
  double cosine = 1.0, sine = 0.0;                       // (sin θ)^m cos mφ and sin mφ
  for (int m = 0; m < order; ++m) {
    const double scale = m == 0 ? 1.0 : std::numbers::sqrt2;
    double before = 0.0, now = diagonal;
    for (int l = m; l < order; ++l) {
      const int middle = l * (l + 1);
      values[static_cast<std::size_t>(middle + m)] = scale * cosine * now;
      if (m > 0) values[static_cast<std::size_t>(middle - m)] = scale * sine * now;
      const double next = l + 1.0, mm = static_cast<double>(m) * m;
      const double grow = std::sqrt((4.0 * next * next - 1.0) / (next * next - mm));
      const double back = l == m ? 0.0 : std::sqrt((l * static_cast<double>(l) - mm) / (4.0 * l * l - 1.0));
      const double after = grow * (z * now - back * before);
      before = now;
      now = after;
    }
    const double turned = x * cosine - y * sine;
    sine = x * sine + y * cosine;
    cosine = turned;
    diagonal *= std::sqrt((2.0 * m + 3.0) / (2.0 * m + 2.0));
  }
}

}  // namespace refield
