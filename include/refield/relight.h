// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Relighting of a reflectance field.
///
/// Public: Relighter, which shows one field under one light after another and updates where the light
/// changed; EnvironmentProjector, which gives the light that a monitor or a cube map receives from an
/// environment [latitude-longitude]; MeshView, which shows the outputs of a field over a mesh to a camera;
/// pack_field(), which rounds weights to 8 or 16 bits within a given relative RMSE.
/// ReflectanceField::relight() (refield/field.h) is the plain product for a single image. A light of another
/// size or parameterisation than the field's basis throws InputError. A Relighter is for one thread at a
/// time; copies share the transfer.
#include "refield/field.h"
#include "refield/run_context.h"
#include "relight/environment/environment.h"
#include "relight/mesh/mesh_view.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
