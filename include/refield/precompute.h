// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Precomputed transport of a scene of meshes, as a reflectance field over a cube map whose outputs are the
/// vertices, or the pixels of one view.
///
/// Public, in namespace refield::prt: Scene and read_scene(), sort_vertices(), cluster_transfer() with
/// ClusterOptions (Johan and Nishita: light clusters) and harmonic_transfer() with harmonic_field() and
/// HarmonicOptions (Fujita and Kanai 2004: spherical harmonics). They give FieldRows, which pack_rows()
/// (refield/relight.h) turns into a PackedField. Scenes that do not suit and options out of range throw
/// InputError.
#include "refield/relight.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/harmonic_transfer.h"
#include "simulate/prt/prt_scene.h"
