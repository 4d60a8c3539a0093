// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Images: row-major, top row first, float, scene-linear RGB; pixel centres lie at +0.5. Radiance is relative
/// unless a calibration gives absolute units.
///
/// Public: Image (owns its values), ImageView (another owner's values, with strides in floats; nothing is
/// copied), Photograph (radiance and each sample's standard deviation), Mask, resample_area(), the files
/// (read_image(), read_photograph(), write_exr(), write_photograph()) and the measures (relative_rmse(),
/// tone_mapped_psnr_db()). Files that cannot be read throw DeviceError or FormatError, shapes that do not fit
/// InputError.
#include "core/image/image.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
