// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <string>
#include <vector>

#include "core/light_map.h"

namespace refield {

/// Lights of one kind, to measure by them how far two fields' pictures lie apart.
struct ProbeLights {
  std::string kind;
  std::vector<LightMap> lights;
};

/// The kinds, the same for equal domains: `white`; `texels`, one of a hundred texels in a random colour;
/// `bar`, white bars an eighth of the map wide or high; `square`, white squares of a twentieth of the map's
/// shorter side, in five places; `smooth`, coloured noise whose detail falls with its frequency, as in
/// nature.
std::vector<ProbeLights> probe_lights(const LightDomain& domain);

}  // namespace refield
