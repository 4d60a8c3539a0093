// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>

#include "core/image/image.h"
#include "refield/light_map.h"

namespace refield {

struct BoxHash {
  std::size_t operator()(const Box& box) const {
    const auto word = [](std::int32_t a, std::int32_t b) {
      return static_cast<std::uint64_t>(static_cast<std::uint32_t>(a)) << 32 | static_cast<std::uint32_t>(b);
    };
    std::uint64_t h = word(box.x0, box.y0) * 0x9e3779b97f4a7c15ull;
    h ^= h >> 29;
    h = (h + word(box.x1, box.y1)) * 0xbf58476d1ce4e5b9ull;
    return static_cast<std::size_t>(h ^ (h >> 32));
  }
};

/// What a monitor shows, from its texels: "black", "white" and "primary" (one channel) fill the screen, a
/// "bar" and a "square" are rectangles of one colour on black, of the full height or width and smaller; all
/// else is "natural". Values within a thousandth of the largest are equal.
std::string_view kind_of_light(const Image& radiance);

/// Throws InputError unless the light is of a field's domain.
void require_domain(const LightMapView& light, const LightDomain& domain);

/// Direction that a point of a lat-long map stands for. `column` in [0, width], `row` in [0, height].
/// With φ = 2π·column/width and θ = π·row/height: direction = (−sin θ sin φ, cos θ, −sin θ cos φ). Someone
/// inside who looks along +Z (centre column) has +X to the right, +Y above (row 0): not mirrored, thus
/// left-handed axes; in a right-handed scene negate X or Z. The left edge is −Z, width/4 right of it is −X.
Eigen::Vector3d lat_long_direction(double column, double row, int width, int height);

/// Inverse of lat_long_direction: (column, row) of a unit direction, column in [0, width).
Eigen::Vector2d lat_long_position(const Eigen::Vector3d& direction, int width, int height);

/// Radiance [RGB] of a lat-long or cube map in a unit direction, linear between the middles of texels; at the
/// edges of a cube's faces as at the nearest middle. Throws InputError for a monitor map.
Eigen::Array3f radiance_towards(const LightMap& map, const Eigen::Vector3d& direction);

/// Solid angle of each texel in `row` of a lat-long map, in steradians.
double lat_long_solid_angle(int row, int width, int height);

/// Axes of a cube map's face (0 to 5), as rows: where its columns grow to, opposite to where its rows grow
/// to, and what its middle looks at. Someone inside sees faces +X −X +Z −Z upright; he who looks up from +Z
/// sees +Y with −Z at its top edge, he who looks down sees −Y with +Z at its top edge. With u, v from −1 to 1
/// to the right and upwards on the face, its texels lie in directions u·right + v·up + ahead: the layout of
/// OpenGL's and Direct3D's cube maps.
Eigen::Matrix3d cube_face_axes(int face);

/// 69 letters by which is_same_pattern() recognises a light map in another encoding (half or 8 bits, JPEG)
/// and at another brightness: to a field, which is linear, multiples of one light are the same. They hold a
/// count sketch (Charikar, Chen and Farach-Colton 2002) of what differs from the mean, which also tells
/// single texels apart, the mean's colour, the contrast, a sketch of the encoded luma, and `is_jpeg`.
std::string pattern_of(const Image& radiance, bool is_jpeg = false);
/// Whether two lights differ by less than about 5 % of what differs from their mean. If one is of a JPEG
/// file, which may store one colour for four texels: or their luma by less than about 30 %.
bool is_same_pattern(std::string_view a, std::string_view b);

}  // namespace refield
