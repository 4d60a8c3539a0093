// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/wavelets.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/light/cube_map.h"

namespace refield::prt {

namespace {

/// One level: the corner of size × size becomes means and three kinds of details.
void transform_level(std::span<float> values, int side, int size, std::vector<float>& scratch, bool inverse) {
  const int half = size / 2;
  scratch.resize(static_cast<std::size_t>(size) * size);
  const auto value = [&](int x, int y) -> float& { return values[static_cast<std::size_t>(y) * side + x]; };
  const auto result = [&](int x, int y) -> float& { return scratch[static_cast<std::size_t>(y) * size + x]; };
  for (int y = 0; y < half; ++y)
    for (int x = 0; x < half; ++x) {
      // The same orthogonal matrix leads there and back.
      const float a = inverse ? value(x, y) : value(2 * x, 2 * y);
      const float b = inverse ? value(x + half, y) : value(2 * x + 1, 2 * y);
      const float c = inverse ? value(x, y + half) : value(2 * x, 2 * y + 1);
      const float d = inverse ? value(x + half, y + half) : value(2 * x + 1, 2 * y + 1);
      const float sum = 0.5f * (a + b + c + d), across = 0.5f * (a - b + c - d),
                  down = 0.5f * (a + b - c - d), both = 0.5f * (a - b - c + d);
      (inverse ? result(2 * x, 2 * y) : result(x, y)) = sum;
      (inverse ? result(2 * x + 1, 2 * y) : result(x + half, y)) = across;
      (inverse ? result(2 * x, 2 * y + 1) : result(x, y + half)) = down;
      (inverse ? result(2 * x + 1, 2 * y + 1) : result(x + half, y + half)) = both;
    }
  for (int y = 0; y < size; ++y)
    std::copy_n(scratch.data() + static_cast<std::size_t>(y) * size, size, &value(0, y));
}

/// Side of the square that a wavelet lives on.
int support_of(int x, int y, int side) {
  const auto level = std::bit_floor(static_cast<unsigned>(std::max({x, y, 1})));
  return side / static_cast<int>(level);
}

}  // namespace

void haar_transform(std::span<float> values, int side) {
  std::vector<float> scratch;
  for (int size = side; size > 1; size /= 2) transform_level(values, side, size, scratch, false);
}

void inverse_haar_transform(std::span<float> values, int side) {
  std::vector<float> scratch;
  for (int size = 2; size <= side; size *= 2) transform_level(values, side, size, scratch, true);
}

std::vector<WaveletTransfer::Entry> WaveletTransfer::entries_of(const TransferSamples& transfer,
                                                                std::size_t group, double threshold) {
  constexpr std::size_t outputs = TransferSamples::group_outputs;
  const auto face = static_cast<std::size_t>(resolution_) * static_cast<std::size_t>(resolution_);
  const std::size_t texels = cube_faces * face;
  std::vector<float> rows(outputs * texels);
  std::array<float, outputs> values;
  for (std::size_t texel = 0; texel < texels; ++texel) {
    const Eigen::Vector3d direction =
        cube_direction(static_cast<double>(texel % resolution_) + 0.5,
                       static_cast<double>(texel / resolution_) + 0.5, resolution_);
    transfer.evaluate(group, direction.cast<float>(), values);
    for (std::size_t i = 0; i < outputs; ++i) rows[i * texels + texel] = values[i];
  }
  std::vector<Entry> entries;
  for (std::size_t i = 0; i < outputs; ++i) {
    const std::span row(rows.data() + i * texels, texels);
    for (std::size_t f = 0; f < cube_faces; ++f) haar_transform(row.subspan(f * face, face), resolution_);
    float largest = 0.0f;
    for (const float value : row) largest = std::max(largest, std::abs(value));
    constexpr float steps = std::numeric_limits<std::int8_t>::max();
    const std::size_t output = group * outputs + i;
    scale_[output] = largest / steps;
    if (largest == 0.0f) continue;
    for (std::size_t wavelet = 0; wavelet < texels; ++wavelet) {
      if (std::abs(row[wavelet]) < static_cast<float>(threshold) * largest) continue;
      const auto weight = static_cast<std::int8_t>(std::lround(row[wavelet] / scale_[output]));
      if (weight != 0)
        entries.push_back({static_cast<std::uint32_t>(wavelet), static_cast<std::uint16_t>(output), weight});
    }
  }
  return entries;
}

WaveletTransfer::WaveletTransfer(const TransferSamples& transfer, int resolution, double threshold)
    : resolution_(resolution), scale_(transfer.groups() * TransferSamples::group_outputs) {
  if (!std::has_single_bit(static_cast<unsigned>(resolution)))
    throw InputError("wavelets need a resolution that is a power of two, not " + std::to_string(resolution));
  if (transfer.channels() != 1 || scale_.size() > 65536)
    throw InputError("wavelets are there for diffuse scenes of at most 65536 vertices; give a smaller one");
  std::vector<std::vector<Entry>> entries(transfer.groups());
  Progress progress(run_context(), "wavelets", entries.size());
  tbb::parallel_for(std::size_t{0}, entries.size(), [&](std::size_t group) {
    run_context().throw_if_stopped();
    entries[group] = entries_of(transfer, group, threshold);
    progress.advance();
  });
  start_.assign(static_cast<std::size_t>(cube_faces) * resolution * resolution + 1, 0);
  for (const auto& of_group : entries)
    for (const Entry& entry : of_group) ++start_[entry.wavelet + 1];
  std::partial_sum(start_.begin(), start_.end(), start_.begin());
  output_.resize(start_.back());
  weight_.resize(start_.back());
  std::vector<std::uint64_t> next(start_.begin(), start_.end() - 1);
  for (auto& of_group : entries) {
    for (const Entry& entry : of_group) {
      const std::uint64_t at = next[entry.wavelet]++;
      output_[at] = entry.output;
      weight_[at] = entry.weight;
    }
    of_group = {};
  }
}

std::vector<Eigen::Array3f> WaveletTransfer::relight(const LightMap& light, int terms) const {
  require_domain(light, cube_domain(resolution_));
  const auto face = static_cast<std::size_t>(resolution_) * static_cast<std::size_t>(resolution_);
  const std::size_t texels = cube_faces * face;
  std::array<std::vector<float>, 3> coefficients;
  const std::vector<float> angles = cube_solid_angles(resolution_);
  tbb::parallel_for(std::size_t{0}, std::size_t{3}, [&](std::size_t c) {
    auto& values = coefficients[c];
    values.resize(texels);
    for (std::size_t i = 0; i < texels; ++i) values[i] = light.radiance.values[3 * i + c] * angles[i % face];
    for (std::size_t f = 0; f < cube_faces; ++f)
      haar_transform(std::span(values).subspan(f * face, face), resolution_);
  });
  std::vector<float> score(texels);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, texels, 1 << 14), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const auto x = static_cast<int>(i % static_cast<std::size_t>(resolution_)),
                 y = static_cast<int>(i % face / static_cast<std::size_t>(resolution_));
      score[i] = static_cast<float>(support_of(x, y, resolution_)) *
                 (std::abs(coefficients[0][i]) + std::abs(coefficients[1][i]) + std::abs(coefficients[2][i]));
    }
  });
  std::vector<std::uint32_t> chosen(texels);
  std::iota(chosen.begin(), chosen.end(), 0u);
  const std::size_t count = std::min(texels, static_cast<std::size_t>(std::max(terms, 0)));
  if (count < texels)
    std::ranges::nth_element(
        chosen, chosen.begin() + static_cast<std::ptrdiff_t>(count),
        [&](std::uint32_t a, std::uint32_t b) { return score[a] != score[b] ? score[a] > score[b] : a < b; });
  using Sums = std::vector<Eigen::Array3f>;
  Sums sums = tbb::parallel_deterministic_reduce(
      tbb::blocked_range<std::size_t>(0, count, std::max<std::size_t>(64, count / 8)),
      Sums(scale_.size(), Eigen::Array3f::Zero()),
      [&](const auto& range, Sums partial) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          const std::uint32_t k = chosen[i];
          const Eigen::Array3f value(coefficients[0][k], coefficients[1][k], coefficients[2][k]);
          for (std::uint64_t at = start_[k]; at < start_[k + 1]; ++at)
            partial[output_[at]] += static_cast<float>(weight_[at]) * value;
        }
        return partial;
      },
      [](Sums a, const Sums& b) {
        for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
        return a;
      });
  for (std::size_t i = 0; i < sums.size(); ++i) sums[i] *= scale_[i];
  return sums;
}

std::size_t WaveletTransfer::bytes() const {
  return start_.size() * sizeof(start_[0]) + entry_bytes();
}

std::size_t WaveletTransfer::entry_bytes() const {
  return output_.size() * sizeof(output_[0]) + weight_.size() + scale_.size() * sizeof(scale_[0]);
}

}  // namespace refield::prt
