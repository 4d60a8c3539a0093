// SPDX-License-Identifier: Apache-2.0
#include "core/pixel_kernels.h"

#include <algorithm>
#include <string>

#include "core/errors.h"

namespace refield {

std::vector<PixelKernel> kernels_of_pixel(const ReflectanceField& field, std::size_t pixel) {
  const SparseTransfer& transfer = field.transfer;
  if (pixel >= transfer.rows())
    throw InputError("the field has " + std::to_string(transfer.rows()) + " pixels; there is no pixel " +
                     std::to_string(pixel));
  std::vector<PixelKernel> kernels;
  double total = 0.0;
  for (std::uint64_t e = transfer.row_start[pixel]; e < transfer.row_start[pixel + 1]; ++e) {
    const std::uint32_t kernel = transfer.column[e];
    const float* w = transfer.weight.data() + 3 * e;
    const double energy = (static_cast<double>(w[0]) + w[1] + w[2]) * field.basis.area(kernel);
    kernels.push_back(
        {kernel, field.basis.is_hat(kernel), field.basis.support(kernel), {w[0], w[1], w[2]}, energy});
    total += energy;
  }
  if (total > 0.0)
    for (PixelKernel& kernel : kernels) kernel.energy_share /= total;
  std::ranges::stable_sort(kernels, std::ranges::greater(), &PixelKernel::energy_share);
  return kernels;
}

Image kernel_density(const ReflectanceField& field, std::size_t pixel) {
  const LightBasis& basis = field.basis;
  Image density(basis.domain.width, basis.domain.height, 1);
  for (const PixelKernel& entry : kernels_of_pixel(field, pixel)) {
    const float weight = (entry.weight[0] + entry.weight[1] + entry.weight[2]) / 3.0f;
    for (int y = entry.support.y0; y < entry.support.y1; ++y)
      for (int x = entry.support.x0; x < entry.support.x1; ++x)
        density.at(x, y, 0) += weight * basis.value(entry.kernel, x, y);
  }
  return density;
}

}  // namespace refield
