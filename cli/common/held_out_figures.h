// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <nlohmann/json.hpp>
#include <vector>

#include "relight/held_out.h"

namespace refield::cli {

/// Errors on held-out images for machines: of the series and, under "per_image", of each image with its
/// file. What is not finite becomes null.
nlohmann::ordered_json held_out_figures(const HeldOutError& error);
/// The same by kind of light.
nlohmann::ordered_json held_out_figures(const std::vector<HeldOutError>& errors);

/// The same as a table, with the spread over images.
void print_errors(const std::vector<HeldOutError>& errors);

}  // namespace refield::cli
