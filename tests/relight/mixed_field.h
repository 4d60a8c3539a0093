// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"

namespace refield::test {

/// Pixels that share lists of kernels, pixels with their own, hats, kernels of far-apart pixels, empty rows.
ReflectanceField mixed_field(int width, int height, LightDomain domain, HatGrid hats = {3, 2});

/// The same field with a third of its weights negative, each channel for itself.
ReflectanceField with_both_signs(ReflectanceField field);

}  // namespace refield::test
