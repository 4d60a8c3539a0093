// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "bench/studies/dynamic/basis_study.h"
#include "core/image/image.h"

namespace refield::dynamic_chart {

/// Figures 4 to 7 of the paper: light [vertices × terms], its first term, on a surface: exact, and in 4, 8
/// and 16 functions, a row for each basis.
Image basis_picture(const StudySurface& surface, const std::vector<StudyBasis>& bases,
                    const Eigen::MatrixXf& light);

}  // namespace refield::dynamic_chart
