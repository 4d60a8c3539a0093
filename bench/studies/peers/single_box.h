// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "bench/studies/peers/peer_data.h"
#include "core/field/reflectance_field.h"

namespace refield::peers {

/// One rectangle a pixel, anywhere and of any size, with a non-negative weight a channel: the one that leaves
/// the lowest residual. All rectangles of a coarse grid are tried; the best few are then refined edge by edge
/// in halving steps down to a texel. Source: Zongker, Werner, Curless and Salesin 1999, whose environment
/// mattes are one rectangle a pixel; there striped patterns found it, here natural ones must.
ReflectanceField fit_single_box(const PeerData& data);

}  // namespace refield::peers
