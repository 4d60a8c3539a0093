// SPDX-License-Identifier: Apache-2.0
#include "cli/web/packed_field.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/errors.h"
#include "core/run_context.h"

namespace refield::web {

namespace {

constexpr int mantissa_bits = 9;
constexpr int largest_mantissa = (1 << mantissa_bits) - 1;
constexpr int largest_exponent = 31;

/// Numbers of the kernels that stay: hats all, boxes where a pixel uses them. [kernels of the field]
std::vector<std::uint32_t> renumbered(const ReflectanceField& field, std::vector<Box>& kept) {
  const auto hats = static_cast<std::size_t>(field.basis.hats.count());
  std::vector<std::uint32_t> number(field.basis.size(), 0);
  for (const std::uint32_t kernel : field.transfer.column) number[kernel] = 1;
  for (std::size_t k = 0; k < number.size(); ++k) {
    if (k < hats) {
      number[k] = static_cast<std::uint32_t>(k);
    } else if (number[k] != 0) {
      number[k] = static_cast<std::uint32_t>(hats + kept.size());
      kept.push_back(field.basis.box(k));
    }
  }
  return number;
}

}  // namespace

SharedExponent SharedExponent::for_largest(float weight) {
  int exponent = 0;
  std::frexp(std::max(weight, std::numeric_limits<float>::min()), &exponent);
  // One more, should the largest mantissa round up.
  return {largest_exponent + mantissa_bits - exponent - 1};
}

std::uint32_t SharedExponent::packed(const float* rgb) const {
  const float largest = std::max({rgb[0], rgb[1], rgb[2]});
  if (!(largest > 0.0f)) return 0;
  int power = 0;
  std::frexp(largest, &power);
  int e = std::clamp(power - mantissa_bits + offset, 0, largest_exponent);
  if (std::lround(std::ldexp(largest, offset - e)) > largest_mantissa) ++e;
  std::uint32_t bits = static_cast<std::uint32_t>(e) << (3 * mantissa_bits);
  for (int c = 0; c < 3; ++c)
    bits |= static_cast<std::uint32_t>(std::lround(std::ldexp(rgb[c], offset - e))) << (mantissa_bits * c);
  return bits;
}

void SharedExponent::unpack(std::uint32_t bits, float* rgb) const {
  const int e = static_cast<int>(bits >> (3 * mantissa_bits));
  for (int c = 0; c < 3; ++c)
    rgb[c] = std::ldexp(static_cast<float>(bits >> (mantissa_bits * c) & largest_mantissa), e - offset);
}

PackedField pack(const ReflectanceField& field, const RunContext& run) {
  constexpr int most = std::numeric_limits<std::uint16_t>::max();
  const LightDomain& domain = field.basis.domain;
  if (domain.width > most || domain.height > most)
    throw InputError("the light map of " + std::to_string(domain.width) + "×" +
                     std::to_string(domain.height) +
                     " is too large for a page; at most 65535 texels per side are supported");
  if (std::ranges::any_of(field.transfer.weight, [](float weight) { return weight < 0.0f; }))
    throw InputError(
        "the field has negative weights, which a page cannot hold; relight it by 'refield relight' or "
        "'refield view'");
  PackedField packed;
  packed.width = field.width;
  packed.height = field.height;
  packed.basis.domain = domain;
  packed.basis.hats = field.basis.hats;
  const auto number = renumbered(field, packed.basis.boxes);
  const SparseTransfer& transfer = field.transfer;
  packed.exponent = SharedExponent::for_largest(
      transfer.weight.empty() ? 0.0f : *std::ranges::max_element(transfer.weight));
  for (std::size_t p = 0; p < transfer.rows(); ++p) {
    const std::uint64_t count = transfer.row_start[p + 1] - transfer.row_start[p];
    if (count > most)
      throw InputError("a pixel has " + std::to_string(count) + " kernels; a page shows at most 65535");
    packed.counts.push_back(static_cast<std::uint16_t>(count));
  }
  for (std::size_t i = 0; i < transfer.entries(); ++i) {
    if (i % 65536 == 0) run.throw_if_stopped();
    packed.kernels.push_back(number[transfer.column[i]]);
    packed.weights.push_back(packed.exponent.packed(&transfer.weight[3 * i]));
  }
  return packed;
}

ReflectanceField unpacked(const PackedField& packed, const RunContext& run) {
  ReflectanceField field;
  field.width = packed.width;
  field.height = packed.height;
  field.basis = packed.basis;
  for (const std::uint16_t count : packed.counts)
    field.transfer.row_start.push_back(field.transfer.row_start.back() + count);
  field.transfer.column = packed.kernels;
  field.transfer.weight.resize(packed.weights.size() * 3);
  for (std::size_t i = 0; i < packed.weights.size(); ++i) {
    if (i % 65536 == 0) run.throw_if_stopped();
    packed.exponent.unpack(packed.weights[i], &field.transfer.weight[3 * i]);
  }
  return field;
}

}  // namespace refield::web
