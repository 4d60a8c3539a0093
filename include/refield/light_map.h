// SPDX-License-Identifier: Apache-2.0
#pragma once

/// Incident light: a map of linear RGB radiance [height × width × 3] with what its columns and rows stand
/// for: texels of a monitor, directions of a latitude-longitude map, or the six faces of a cube map.
///
/// Public: LightMap, LightMapView (another owner's values), LightDomain (size and parameterisation alone),
/// lat_long_direction(), cube_face_axes(), Box, MonitorPlacement (lengths in millimetres, angles in degrees),
/// EulerAngles and read_light_map(). docs/reference/conventions.md shows the axes.
#include "core/image/image_io.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
