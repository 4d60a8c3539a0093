// SPDX-License-Identifier: Apache-2.0
#include "cli/bracket_options.h"

#include "cli/option_checks.h"

namespace refield::cli {

void add_bracket_camera(CLI::App& verb, BracketCamera& camera) {
  verb.add_option(
      "--response", camera.response,
      "How samples encode light: linear, srgb, gamma:X (sample = light^(1/X)) or a calibration.toml.\n"
      "Default: srgb for 8 bits, else linear; estimated where the exposures contradict that");
  verb.add_option("--layout", camera.layout,
                  "Of one-channel files: grey, bayer_rggb (or bayer), bayer_grbg, bayer_gbrg, bayer_bggr\n"
                  "(default: grey; cameras' RAW files: as they say)")
      ->check(CLI::IsMember({"grey", "bayer", "bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"}));
  verb.add_option(
      "--black", camera.black,
      "What the camera gives without light, in linearised sample units (default: as RAW files state it, "
      "else 0)");
  verb.add_option(
      "--saturation", camera.saturation,
      "Lowest sample value that may be clipped (default: as RAW files state it, else the largest; 1.0 "
      "for float images)");
  verb.add_option("--full-scale-electrons", camera.full_scale_electrons,
                  "Photo-electrons at full scale: sets the shot noise that weights and sigma rest on")
      ->check(positive_number())
      ->capture_default_str();
  verb.add_option("--read-noise", camera.read_noise_electrons, "Read noise in electrons")
      ->check(non_negative_number())
      ->capture_default_str();
}

}  // namespace refield::cli
