// SPDX-License-Identifier: Apache-2.0
#include "cli/web/export.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/base/errors.h"
#include "core/field/mesh.h"
#include "core/field/transfer_tiles.h"

namespace refield::web {

namespace {

constexpr std::size_t group = group_pixels;
constexpr float largest_weight = std::numeric_limits<std::uint8_t>::max();

/// The entries of one group of outputs: kernels ascending, weights [kernels × 3 × 16].
class GroupEntries {
 public:
  /// Kernels of the page are `number`[kernel of the field].
  GroupEntries(const ReflectanceField& field, const std::vector<std::uint32_t>& number, std::size_t first) {
    const SparseTransfer& transfer = field.transfer;
    const std::size_t last = std::min(first + group, field.mesh->outputs());
    const auto visit = [&](const auto& entry_of) {
      for (std::size_t output = first; output < last; ++output) {
        const std::size_t pixel = pixel_of_output(output);
        for (std::size_t i = transfer.row_start[pixel]; i < transfer.row_start[pixel + 1]; ++i)
          entry_of(number[transfer.column[i]], output - first, i);
      }
    };
    visit([&](std::uint32_t kernel, std::size_t, std::size_t) { kernels_.push_back(kernel); });
    std::ranges::sort(kernels_);
    kernels_.erase(std::unique(kernels_.begin(), kernels_.end()), kernels_.end());
    weights_.assign(kernels_.size() * 3 * group, 0.0f);
    visit([&](std::uint32_t kernel, std::size_t within, std::size_t i) {
      const auto k = static_cast<std::size_t>(std::ranges::lower_bound(kernels_, kernel) - kernels_.begin());
      for (std::size_t c = 0; c < 3; ++c)
        weights_[(3 * k + c) * group + within] += transfer.weight[3 * i + c];
    });
  }

  void append_to(PackedMesh& packed) const {
    std::uint32_t count = 0;
    const std::size_t values = packed.channels * group;
    for (std::size_t k = 0; k < kernels_.size(); ++k) {
      const auto weights = std::span(weights_).subspan(3 * group * k, values);
      const float most = *std::ranges::max_element(weights);
      if (!(most > 0.0f)) continue;
      ++count;
      packed.kernels.push_back(kernels_[k]);
      packed.scales.push_back(most / largest_weight);
      for (const float weight : weights)
        packed.weights.push_back(static_cast<std::uint8_t>(std::lround(weight / most * largest_weight)));
    }
    packed.counts.push_back(count);
  }

 private:
  std::vector<std::uint32_t> kernels_;
  std::vector<float> weights_;
};

bool is_grey(const SparseTransfer& transfer) {
  for (std::size_t i = 0; i < transfer.entries(); ++i)
    if (transfer.weight[3 * i] != transfer.weight[3 * i + 1] ||
        transfer.weight[3 * i] != transfer.weight[3 * i + 2])
      return false;
  return true;
}

}  // namespace

PackedMesh pack_mesh(const ReflectanceField& field, const RunContext& run) {
  if (!field.mesh) throw InputError("the field has no mesh");
  require_no_negative_weights(field.transfer);
  PackedMesh packed;
  std::vector<std::uint32_t> number;
  packed.basis = used_basis(field, number);
  packed.channels = is_grey(field.transfer) ? 1 : 3;
  for (std::size_t first = 0; first < field.mesh->outputs(); first += group) {
    if (first % 1024 == 0) run.throw_if_stopped();
    GroupEntries(field, number, first).append_to(packed);
  }
  return packed;
}

Image relight(const PackedMesh& packed, const ReflectanceField& field, const LightMap& light) {
  const std::vector<float> coefficients = packed.basis.project(light);
  Image outputs(field.width, field.height, 3);
  std::vector<std::size_t> first(packed.counts.size() + 1, 0);
  std::partial_sum(packed.counts.begin(), packed.counts.end(), first.begin() + 1, std::plus<std::size_t>());
  tbb::parallel_for(std::size_t{0}, packed.counts.size(), [&](std::size_t g) {
    std::array<double, 3 * group> sums{};
    for (std::size_t i = first[g]; i < first[g + 1]; ++i)
      for (std::size_t c = 0; c < 3; ++c) {
        const double brings = static_cast<double>(packed.scales[i]) * coefficients[3 * packed.kernels[i] + c];
        const std::size_t channels = packed.channels, channel = channels == 1 ? 0 : c;
        const std::uint8_t* weights = packed.weights.data() + (channels * i + channel) * group;
        for (std::size_t within = 0; within < group; ++within)
          sums[c * group + within] += brings * weights[within];
      }
    for (std::size_t within = 0; within < group && g * group + within < field.mesh->outputs(); ++within)
      for (std::size_t c = 0; c < 3; ++c)
        outputs.values[3 * pixel_of_output(g * group + within) + c] =
            static_cast<float>(sums[c * group + within]);
  });
  return outputs;
}

}  // namespace refield::web
