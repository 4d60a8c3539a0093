// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace refield::test {

/// A ball on a table, small enough to be traced and captured within a second.
inline constexpr const char* tiny_recipe = R"(
seed = 5
[camera]
width = 24
height = 18
position = [0.0, 0.3, -1.0]
target = [0.0, 0.05, 0.0]
vertical_fov_degrees = 30.0
[monitor]
width = 16
height = 12
position = [0.6, 0.3, -0.1]
towards = [-0.4, 0.2, -0.2]
width_m = 0.8
height_m = 0.6
[ambient]
radiance = [0.01, 0.009, 0.008]
[lights]
train = 10
natural = 1
bars = 1
squares = 1
[exposures]
count = 4
ratio = 4.0
[[material]]
name = "clay"
kind = "diffuse"
diffuse = [0.6, 0.4, 0.3]
[[object]]
name = "table"
shape = "plane"
material = "clay"
stretch = [1.2, 1.0, 1.2]
[[object]]
name = "ball"
shape = "sphere"
material = "clay"
position = [0.0, 0.1, 0.0]
size = 0.2
)";

}  // namespace refield::test
