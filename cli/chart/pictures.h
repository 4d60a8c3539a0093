// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "cli/chart/row.h"

namespace refield::chart {

/// Writes time.svg, size.svg, images.svg and relighting.svg to `folder`: error against estimation time, bytes
/// a pixel, number of images and relighting time. Each has a panel for every kind of light, over the whole
/// picture and of the median pixel. All but images.svg show the rows of the largest number of images.
void write_pictures(const std::filesystem::path& folder, const std::vector<ChartRow>& rows,
                    const std::vector<std::string>& names, const std::vector<std::string>& light_kinds);

}  // namespace refield::chart
