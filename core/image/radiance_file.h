// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <filesystem>
#include <optional>

#include "core/image/colour.h"
#include "core/image/image.h"

namespace refield {

/// Header of a Radiance picture (.hdr, .pic).
struct RadianceHeader {
  int width = 0;                                    ///< of the upright picture
  int height = 0;                                   ///< rows
  int orientation = 1;                              ///< of the scan lines, as ImageFacts::orientation
  bool is_xyz = false;                              ///< CIE XYZ instead of RGB
  std::array<double, 3> divisor = {1.0, 1.0, 1.0};  ///< product of all EXPOSURE and COLORCORR lines
  std::optional<Chromaticities> primaries;          ///< of RGB, where stated
  std::size_t data = 0;                             ///< byte where the first scan line begins
};

/// Throws FormatError.
RadianceHeader read_radiance_header(const std::filesystem::path& path);

/// Reads a Radiance picture as linear RGB, upright and divided by its exposure: the radiance that was stored
/// before programs changed its brightness. CIE XYZ becomes linear Rec.709. Scan lines may be flat or
/// compressed in the new or the old way. Throws FormatError for a damaged or truncated file. Source: G. Ward,
/// "Real Pixels", Graphics Gems II, 1991; Radiance file formats (filefmts.pdf), "Picture file format".
Image read_radiance(const std::filesystem::path& path);

}  // namespace refield
