// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/image/metrics.h"
#include "simulate/tabletop/scene.h"

namespace refield::chart {

/// What sort of light transport each pixel shows, so that errors can be distinguished by it.
struct PixelKinds {
  int width = 0;
  int height = 0;
  std::vector<std::string> names;    ///< [kinds]
  std::vector<std::uint8_t> labels;  ///< [pixels], 1 + index into `names`; 0: of no kind

  /// The pixels of one kind that also lie in `mask`.
  Mask mask_of(std::size_t kind, const Mask& mask) const;
};

/// The kinds that refield itself distinguishes, in this order.
inline constexpr const char* kind_names[] = {"diffuse", "glossy", "refraction", "hard_shadow", "mixed"};
/// Their labels.
enum Label : std::uint8_t { no_kind, diffuse, glossy, refraction, hard_shadow, mixed };

/// Writes a grey PNG whose levels are 50 × label (8 bits), and beside it NAME.json, which says what the
/// levels stand for: {"50": "diffuse", …}. At most five kinds.
void write_pixel_kinds(const std::filesystem::path& png, const PixelKinds& kinds);

/// Reads what write_pixel_kinds() wrote, or a picture that was painted the same way: the file beside it names
/// the grey levels that count; all others are of no kind. Throws InputError and FormatError.
PixelKinds read_pixel_kinds(const std::filesystem::path& png, int width, int height);

/// Sorts the camera's pixels by what they show (kind_names), from the first
/// surfaces that 4 × 4 rays through a pixel meet:
///  - refraction: three quarters or more are mirror or glass, or the monitor itself;
///  - diffuse (with translucent), glossy (with metal): the same for these materials ...
///  - hard_shadow: ... but from 5 to 95 % of the monitor points that face the surface are hidden from it,
///    so that the edge of something lies across its light;
///  - mixed: no sort of material reaches three quarters, as on the outlines of things.
/// Pixels whose rays mostly meet nothing are of no kind.
PixelKinds scene_kinds(const TabletopScene& scene, const RunContext& run = {});

}  // namespace refield::chart
