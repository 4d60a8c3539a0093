// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"
#include "estimate/rig/rig_model.h"
#include "refield/estimate.h"
