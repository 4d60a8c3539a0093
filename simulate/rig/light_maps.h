// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "core/base/run_context.h"
#include "core/light/light_map.h"
#include "core/session/capture_session.h"
#include "simulate/tabletop/recipe.h"

namespace refield {

/// One light map of a data set.
struct LightSpec {
  std::string name;  ///< "train_007", "test_012"
  FrameRole role = FrameRole::train;
  std::string kind;  ///< "natural", "designed", "coloured", "bar", "square", "white", "black"
  int number = 0;    ///< within its role and kind
};

/// All light maps that a plan asks for, in the order of a session's frames.
std::vector<LightSpec> list_lights(const LightPlan& plan);

/// Makes the listed maps: linear radiance from 0 to 1, as a monitor shows it, and hands each with its place
/// in the list to `sink`, from several threads at the same time.
///  - natural: perspective views of made-up panoramas, rotated, exposed and clipped as a camera would.
///  Training and test
///    views never share a panorama.
///  - designed: saturated leaves (LeafPatterns). The first patterns of a longer list are those of a shorter
///  one.
///  - coloured: natural views of further panoramas in red, green, blue, cyan, magenta and yellow in turn.
///  - bar: white, an eighth of the width, sliding from the left edge to the right.
///  - square: white, a sixteenth of the width, at places spread over the map.
void make_lights(const std::vector<LightSpec>& list, const LightDomain& domain, std::uint64_t seed,
                 const std::function<void(std::size_t place, LightMap&& light)>& sink,
                 const RunContext& run = {});

}  // namespace refield
