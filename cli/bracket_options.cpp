// SPDX-License-Identifier: Apache-2.0
#include "cli/bracket_options.h"

#include "cli/option_checks.h"

namespace refield::cli {

void add_bracket_camera(CLI::App& verb, BracketCamera& camera) {
  verb.add_option(
      "--response", camera.response,
      "Response of the camera: linear, srgb, gamma:X (sample = light^(1/X)) or a calibration.toml (default: "
      "srgb for 8-bit files, else linear; estimated if the exposures contradict it)");
  verb.add_option("--layout", camera.layout,
                  "Layout of one-channel files: grey, bayer_rggb (or bayer), bayer_grbg, bayer_gbrg or "
                  "bayer_bggr (default: grey; for camera RAW files, from the file)")
      ->check(CLI::IsMember({"grey", "bayer", "bayer_rggb", "bayer_grbg", "bayer_gbrg", "bayer_bggr"}));
  verb.add_option("--black", camera.black,
                  "Black level of the camera in linearised sample units (default: from RAW files, else 0)");
  verb.add_option("--saturation", camera.saturation,
                  "Lowest sample value that may be clipped (default: from RAW files, else the largest value; "
                  "1.0 for float images)");
  verb.add_option("--full-scale-electrons", camera.full_scale_electrons,
                  "Number of photo-electrons at full scale, which determines the shot noise used for weights "
                  "and sigma")
      ->check(positive_number())
      ->capture_default_str();
  verb.add_option("--read-noise", camera.read_noise_electrons,
                  "Standard deviation of the read noise in electrons")
      ->check(non_negative_number())
      ->capture_default_str();
}

}  // namespace refield::cli
