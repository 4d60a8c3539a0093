// SPDX-License-Identifier: Apache-2.0
#pragma once

/// High dynamic range photographs from exposure series.
///
/// Public: merge_exposures() for a sensor's raw frames (samples as stored, RawFrame) with a
/// CameraCalibration, merge_linear_exposures() for linear float images, subtract_ambient() and
/// read_bracket_file(). Exposures are in seconds. The result is radiance and its standard deviation [height ×
/// width × 3]; samples that are clipped in every exposure have infinite sigma. Frames that differ in size or
/// layout throw InputError.
#include "acquire/hdr/bracket_files.h"
#include "acquire/hdr/hdr_merge.h"
