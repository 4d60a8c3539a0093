// SPDX-License-Identifier: Apache-2.0
#include "cli/option_checks.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

namespace refield::cli {

namespace {

/// The finite number that all of `text` spells; none for anything else.
std::optional<double> finite_number(const std::string& text) {
  double value = 0.0;
  if (!CLI::detail::lexical_cast(text, value) || !std::isfinite(value)) return std::nullopt;
  return value;
}

CLI::Validator bounded_number(const char* name, const char* bound, bool zero_is_allowed) {
  return {[bound, zero_is_allowed](std::string& text) {
            const auto value = finite_number(text);
            const bool is_good = value && (zero_is_allowed ? *value >= 0.0 : *value > 0.0);
            return is_good ? std::string() : "is '" + text + "'; give a number " + bound;
          },
          name};
}

bool takes_floating_point(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  return type.starts_with("FLOAT") || type.starts_with("X,Y,Z");
}

}  // namespace

CLI::Validator positive_number() {
  return bounded_number("POSITIVE", "above zero", false);
}

CLI::Validator non_negative_number() {
  return bounded_number("NONNEGATIVE", "of zero or more", true);
}

void require_finite_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options())
    if (takes_floating_point(*option))
      // As a transformation it comes before the option's own checks, which NaN passes.
      option->transform(CLI::Validator(
          [](std::string& text) {
            return finite_number(text) ? std::string() : "is '" + text + "'; give a finite number";
          },
          ""));
  for (CLI::App* verb : app.get_subcommands([](CLI::App*) { return true; })) require_finite_numbers(*verb);
}

CLI::Option* add_exposure_option(CLI::App& verb, std::optional<double>& exposure) {
  return verb
      .add_option_function<std::string>(
          "--exposure",
          [&exposure](const std::string& text) {
            exposure = text == "auto" ? std::nullopt : finite_number(text);
          },
          "Exposure factor applied to the radiance in PNG and MP4 files (default: auto, so that the 99th "
          "percentile of the brightest channel over the illuminated pixels becomes white; one factor for all "
          "frames of a sequence)")
      ->check([](const std::string& text) {
        const auto value = finite_number(text);
        return text == "auto" || (value && *value > 0.0)
                   ? std::string()
                   : "is '" + text + "'; give a number above zero, or auto";
      })
      ->type_name("FACTOR");
}

void print_exposures(std::span<const std::string> files, std::span<const double> exposures) {
  constexpr std::size_t max_lines = 12;
  if (exposures.size() == 1) {
    std::printf("exposure %.3g (reproduce with --exposure %.3g)\n", exposures[0], exposures[0]);
  } else if (exposures.size() <= max_lines) {
    for (std::size_t i = 0; i < exposures.size(); ++i)
      std::printf("%s: exposure %.3g\n", files[i].c_str(), exposures[i]);
  } else {
    const auto [least, most] = std::ranges::minmax_element(exposures);
    std::printf("exposures %.3g (%s) to %.3g (%s); --json lists all\n", *least,
                files[static_cast<std::size_t>(least - exposures.begin())].c_str(), *most,
                files[static_cast<std::size_t>(most - exposures.begin())].c_str());
  }
}

void warn_of_clipping(double clipped_share) {
  if (clipped_share > 0.5)
    std::fprintf(stderr,
                 "refield: warning: with this --exposure, %.0f %% of the illuminated pixels are clipped; "
                 "remove --exposure to select it automatically\n",
                 100.0 * clipped_share);
}

}  // namespace refield::cli
