// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"

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

/// The field that a page shows: weights as `exponent` rounds them, which packed() gives back, and no kernel
/// that no pixel uses.
struct PageField {
  ReflectanceField field;
  SharedExponent exponent;
};

/// Throws InputError for a precomputed field, over a cube map, for negative weights, a light map wider or
/// higher than 65535 texels, or a pixel of more kernels.
PageField page_field(const ReflectanceField& field, const RunContext& run = {});

/// What an exported page costs.
struct ExportReport {
  std::size_t files = 0;
  std::uint64_t bytes = 0;     ///< of all files
  double relative_rmse = 0.0;  ///< of the page's field against the full one, over the lights below
  int largest_difference = 0;  ///< of tone-mapped 8-bit values there, at the exposure of the page
  double exposure = 1.0;       ///< that the page starts with
};

/// A light map that a page brings along: of the field's own domain, or a panorama (lat-long) that it shows
/// through the monitor's window.
struct PageMap {
  std::string name;
  Image radiance;  ///< [height × width × 3]
};

/// Writes a page that relights `field` in a browser (WebGL 2) into `folder`: HTML, style, scripts and data,
/// for any static server or straight from disk. The page's rounding is measured under white light and four
/// bars. `title` heads the page. `maps` are stored as half floats. Data of an earlier export to
/// `folder` are removed. Throws InputError for a field that does not fit a page, DeviceError where the disk
/// refuses.
ExportReport export_page(const ReflectanceField& field, const std::string& title, const fs::path& folder,
                         const std::vector<PageMap>& maps = {}, const RunContext& run = {});

/// One of the page's files, as it stood in cli/web when the program was built.
struct PageFile {
  const char* name;
  std::string_view content;
};

std::span<const PageFile> page_files();

}  // namespace refield::web
