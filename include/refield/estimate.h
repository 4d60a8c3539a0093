// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Estimation of a reflectance field from photographs under known lights (Matusik et al. 2004).
///
/// Public: estimate() from arrays in memory (lights and photographs [images], each [height × width × 3];
/// sigma [images] or empty; mask [height × width] or empty), estimate_field() and estimate_to_file() from a
/// session, the latter out of core and resumable, plan_estimate(), estimate_cost(), and EstimateOptions.
/// Errors of the result are relative RMSE. Input that does not fit together throws InputError, naming the
/// image.
#include "estimate/estimate.h"
#include "estimate/options.h"
#include "refield/field.h"
#include "refield/image.h"
#include "refield/light_map.h"
#include "refield/run_context.h"
#include "refield/session.h"
