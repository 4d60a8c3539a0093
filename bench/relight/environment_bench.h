// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/light/light_map.h"

namespace refield::bench {

/// A lat-long map of noise and a sun of one texel, 1e5 times as bright; or the one that REFIELD_ENV names.
LightMap environment(int width);

/// Bytes a second that all cores read from memory together.
double read_rate();

}  // namespace refield::bench
