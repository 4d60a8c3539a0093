// SPDX-License-Identifier: Apache-2.0
#include "simulate/prt/cube_quadtree.h"

#include "core/cube_map.h"

namespace refield::prt {

namespace {
constexpr std::uint32_t first_name = 8;  // faces are 8 to 13: four bits that are never zero in front
}

CubeSquare face_square(int face, int resolution) {
  return {{0, face * resolution, resolution, (face + 1) * resolution},
          first_name + static_cast<std::uint32_t>(face)};
}

std::array<CubeSquare, 4> quadrisect(const CubeSquare& square) {
  const Box& box = square.box;
  const int x = box.x0 + (box.width() + 1) / 2, y = box.y0 + (box.height() + 1) / 2;
  const std::uint32_t name = 4 * square.name;
  return {{{{box.x0, box.y0, x, y}, name},
           {{x, box.y0, box.x1, y}, name + 1},
           {{box.x0, y, x, box.y1}, name + 2},
           {{x, y, box.x1, box.y1}, name + 3}}};
}

Box box_of_name(std::uint32_t name, int resolution) {
  int splits = 0;
  while (name >> (2 * splits) >= first_name + cube_faces) ++splits;
  CubeSquare square = face_square(static_cast<int>((name >> (2 * splits)) - first_name), resolution);
  while (splits-- > 0) square = quadrisect(square)[name >> (2 * splits) & 3];
  return square.box;
}

}  // namespace refield::prt
