// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/run_context.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/group_weights.h"

namespace refield::prt {

/// For each group of 16 outputs its own cut through the quadtrees of light (Similarity::group). Every face
/// is looked at in squares of an eighth of its side at least, and in squares as narrow as the lobe where
/// outputs mirror; a square whose samples differ is quadrisected; then squares are joined again from the
/// bottom up as long as the loss allows, judged by all samples under them. Weights are means over all of
/// these, each counting by its solid angle.
std::vector<GroupWeights> cut_groups(const TransferSamples& transfer, const ClusterOptions& options,
                                     ClusterStatistics& statistics, const RunContext& run);

}  // namespace refield::prt
