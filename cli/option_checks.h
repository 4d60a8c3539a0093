// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>
#include <optional>
#include <span>
#include <string>

namespace refield::cli {

/// Checks of an option's number. Their messages state the bound, which those of CLI::PositiveNumber and
/// CLI::NonNegativeNumber hide behind the largest double in 309 digits.
CLI::Validator positive_number();
CLI::Validator non_negative_number();

/// Makes every option of `app` and of its subcommands whose values are floating-point numbers refuse NaN,
/// infinity and what is no number. Call it when all options have been added.
void require_finite_numbers(CLI::App& app);

/// Adds `--exposure`, a factor on the radiance above zero or `auto`; empty: automatic.
CLI::Option* add_exposure_option(CLI::App& verb, std::optional<double>& exposure);

/// Prints automatic exposures so that they can be repeated: one for all files, or one per file.
void print_exposures(std::span<const std::string> files, std::span<const double> exposures);

/// Warns on standard error where more than half of the pixels that show light are clipped.
void warn_of_clipping(double clipped_share);

}  // namespace refield::cli
