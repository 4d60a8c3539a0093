// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/light_map.h"
#include "core/reflectance_field.h"
#include "core/run_context.h"

namespace refield::web {

/// Three non-negative weights in 32 bits: mantissas of 9 bits for R, G and B from the lowest bit up, and
/// above them an exponent e of 5 bits that they share; a weight is mantissa · 2^(e − offset). As GL_RGB9_E5
/// of OpenGL ES 3.0, 3.8.3.2, but for the offset, which fits the largest weight of the field.
struct SharedExponent {
  int offset = 0;

  static SharedExponent for_largest(float weight);
  std::uint32_t packed(const float* rgb) const;
  void unpack(std::uint32_t bits, float* rgb) const;
};

/// A field as a page holds it. Kernels that no pixel uses are left out.
struct PackedField {
  int width = 0;
  int height = 0;
  LightBasis basis;
  SharedExponent exponent;
  std::vector<std::uint16_t> counts;   ///< [pixels], entries of each
  std::vector<std::uint32_t> kernels;  ///< [entries]
  std::vector<std::uint32_t> weights;  ///< [entries], packed
};

/// Throws InputError for a light map wider or higher than 65535 texels, or a pixel of more kernels.
PackedField pack(const ReflectanceField& field, const RunContext& run = {});

/// The field that the page shows: with the weights as they were rounded.
ReflectanceField unpacked(const PackedField& packed, const RunContext& run = {});

}  // namespace refield::web
