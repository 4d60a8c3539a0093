// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <vector>

#include "core/run_context.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/group_weights.h"

namespace refield::prt {

/// One clustering for all outputs (Johan and Nishita, section 4): squares are quadrisected until the samples'
/// transfer vectors are similar. A light that is sampled again within a part of its square is not traced
/// again; its vector is dropped once its square is a cluster. Memory holds the vectors of one path through
/// the quadtree, never all lights. Returns the weights of each group.
std::vector<GroupWeights> cluster_lights(const TransferSamples& transfer, std::size_t outputs,
                                         const ClusterOptions& options, ClusterStatistics& statistics,
                                         const RunContext& run);

}  // namespace refield::prt
