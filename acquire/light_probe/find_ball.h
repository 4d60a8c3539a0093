// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/light_probe/outline_fit.h"
#include "core/image.h"

namespace refield {

/// Finds a mirror ball in a photograph: circles are proposed by the Hough transform of the edges of its
/// logarithm, each is refined to a fraction of a pixel by the sharpest step along 720 radii, and the one
/// whose outline is clearest is taken. The background is best plain and unlike the ball's rim: a mirror ball
/// before distant surroundings has hardly an outline, since its rim shows what is just beside it. Throws
/// InputError when there is no clear ball; the message says what to do.
OutlineFit find_ball(const Image& photograph, const ProbeOptics& optics);

}  // namespace refield
