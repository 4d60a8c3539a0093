// SPDX-License-Identifier: Apache-2.0
#include "core/field/reflectance_field.h"

#include <tbb/parallel_for.h>

#include "core/field/light_error.h"

namespace refield {

LightShares FieldOutline::light_shares(const Image& radiance) const {
  if (observed_light.empty()) return {};
  if (basis.interpolation) return LightInterpolator(*basis.interpolation, basis.domain).shares(radiance);
  double all = 0.0, observed = 0.0;
  for (const float value : radiance.values) all += value;
  for (const Box& box : observed_light)
    for (int y = box.y0; y < box.y1; ++y)
      for (int x = box.x0; x < box.x1; ++x)
        for (int c = 0; c < radiance.channels; ++c) observed += radiance.at(x, y, c);
  return {0.0, all > 0.0 ? std::clamp(1.0 - observed / all, 0.0, 1.0) : 0.0};
}

void ReflectanceField::fit_interpolation() {
  if (!can_interpolate(observed_light, basis.domain)) return;
  constexpr std::size_t max_pixels = 300;
  std::vector<std::size_t> lit;
  for (std::size_t p = 0; p < transfer.rows(); ++p)
    if (transfer.row_start[p] < transfer.row_start[p + 1]) lit.push_back(p);
  const std::size_t count = std::min(lit.size(), max_pixels);
  const SourceResponses of_sources(*this, observed_light);
  Eigen::MatrixXd responses(of_sources.sources(), static_cast<Eigen::Index>(3 * count));
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    responses.middleCols(static_cast<Eigen::Index>(3 * k), 3) =
        of_sources.of_pixel(lit[k * lit.size() / count]);
  });
  basis.interpolation = fit_light_interpolation(observed_light, basis.domain, responses);
  // Photographs of one light source at a time.
  if (basis.interpolation && !quality.light_error.known() && knows_light_error(*this))
    predict_errors_between(*basis.interpolation, basis.domain, of_sources, quality);
}

Image ReflectanceField::relight(const LightMap& light) const {
  Image image(width, height, 3);
  apply(basis.project(light), image.values);
  return image;
}

void ReflectanceField::apply(std::span<const float> coefficients, std::span<float> outputs) const {
  transfer.apply(coefficients, outputs);
  if (mixes_colours()) convert_colours(outputs, output_from_primaries);
}

void SparseTransfer::append_row(std::span<const std::uint32_t> columns, std::span<const float> weights) {
  if (weights.size() != columns.size() * 3) throw InputError("a transfer row needs three weights an entry");
  column.insert(column.end(), columns.begin(), columns.end());
  weight.insert(weight.end(), weights.begin(), weights.end());
  row_start.push_back(column.size());
}

SparseTransfer SparseTransfer::slice(std::size_t first, std::size_t last) const {
  const auto from = static_cast<std::ptrdiff_t>(row_start[first]),
             to = static_cast<std::ptrdiff_t>(row_start[last]);
  SparseTransfer some;
  some.row_start.clear();
  for (std::size_t row = first; row <= last; ++row)
    some.row_start.push_back(row_start[row] - row_start[first]);
  some.column.assign(column.begin() + from, column.begin() + to);
  some.weight.assign(weight.begin() + 3 * from, weight.begin() + 3 * to);
  return some;
}

void SparseTransfer::pass_by_rows(std::size_t first, std::size_t last) const {
  pass_by(column, row_start[first], row_start[last]);
  pass_by(weight, 3 * row_start[first], 3 * row_start[last]);
}

void SparseTransfer::apply(std::span<const float> coefficients, std::span<float> outputs) const {
  if (outputs.size() != rows() * 3) throw InputError("transfer: three outputs a row are needed");
  // Memory bandwidth is the limit, so arithmetic must stay below it: the three channels are one vector of
  // four, and each weight is read together with its neighbour's first float, which meets a zero. Only the
  // last entry has none.
  std::vector<Eigen::Array4f> light(coefficients.size() / 3);
  for (std::size_t k = 0; k < light.size(); ++k)
    light[k] = {coefficients[3 * k], coefficients[3 * k + 1], coefficients[3 * k + 2], 0.0f};
  const std::uint64_t last = std::max<std::uint64_t>(entries(), 1) - 1;
  // Stretches of many pages for values in a file.
  const std::size_t stretch = weight.get_allocator().is_mapped() ? 32768 : 1024;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows(), stretch), [&](const auto& range) {
    for (std::size_t row = range.begin(); row != range.end(); ++row) {
      Eigen::Array4f sum = Eigen::Array4f::Zero();
      const std::uint64_t end = row_start[row + 1];
      for (std::uint64_t e = row_start[row]; e < std::min(end, last); ++e)
        sum += Eigen::Map<const Eigen::Array4f>(weight.data() + 3 * e) * light[column[e]];
      if (row_start[row] <= last && last < end)
        sum += Eigen::Array4f(weight[3 * last], weight[3 * last + 1], weight[3 * last + 2], 0.0f) *
               light[column[last]];
      Eigen::Map<Eigen::Array3f>(outputs.data() + 3 * row) = sum.head<3>();
    }
    pass_by_rows(range.begin(), range.end());
  });
}

}  // namespace refield
