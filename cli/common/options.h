// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <CLI/CLI.hpp>

#include <nlohmann/json_fwd.hpp>

#include "refield/compare.h"
#include "refield/session.h"

namespace refield {

// Of core/base, where they are documented: paths that users give, JSON.
std::vector<std::filesystem::path> expand_globs(const std::vector<std::string>& patterns);
void require_not_an_input(const std::filesystem::path& output,
                          const std::vector<std::filesystem::path>& inputs);
using Json = nlohmann::ordered_json;
Json json_from_text(const std::string& text);

}  // namespace refield

namespace refield::cli {

/// Checks of an option's number. Their messages state the bound, which those of CLI::PositiveNumber and
/// CLI::NonNegativeNumber hide behind the largest double in 309 digits.
CLI::Validator positive_number();
CLI::Validator non_negative_number();

/// Makes every option of `app` and of its subcommands whose values are floating-point numbers refuse NaN,
/// infinity and what is no number. Call it when all options have been added.
void require_finite_numbers(CLI::App& app);

/// Prints the results of a verb under --json: once the verb has ended, see finish_json().
void print_json(const Json& figures);

/// Writes a file of JSON, atomically.
void write_json(const std::filesystem::path& path, const Json& figures);

/// A file's text as it may go to a terminal: control characters, which could move the cursor or worse, and
/// bytes that are not UTF-8 as their numbers.
std::string printable(const std::string& text);

/// Prints nested figures as "name: value" lines, with spaces for underscores. A list of objects is a table,
/// or a block for each where an object holds others.
void print_figures(const Json& figures, int indent = 0);

/// Writes the one JSON document of a run with --json, where there is one: "schema", the version of its keys
/// (docs/reference/verbs.md), what print_json() was given and, unless `kind` is empty, the error that ended
/// it.
void finish_json(const std::string& kind, const std::string& message);

/// The group of options for few users, which --help-all lists.
inline constexpr const char* further = "Further options";

/// Adds --placement; `more` says what the verb needs it for.
CLI::Option* add_placement_option(CLI::App& verb, std::vector<std::string>& placements,
                                  const std::string& more);
/// Adds --fps, of a video.
CLI::Option* add_fps_option(CLI::App& verb, double& frames_per_second);
/// Adds --monitor, the device that shows light patterns.
CLI::Option* add_monitor_option(CLI::App& verb, std::string& monitor);
/// Adds --horizontal-fov, in degrees, --diameter, of a ball in mm, and --saturation, a sample value.
CLI::Option* add_horizontal_fov_option(CLI::App& verb, std::optional<double>& degrees);
CLI::Option* add_diameter_option(CLI::App& verb, std::optional<double>& diameter_mm);
CLI::Option* add_saturation_option(CLI::App& verb, std::optional<double>& saturation);
/// Adds --max-noise and --until-error, shares such as "2%".
CLI::Option* add_max_noise_option(CLI::App& verb, std::string& share);
CLI::Option* add_until_error_option(CLI::App& verb, std::string& share);
/// Adds --ball, in pixels; `more` says where the ball is.
CLI::Option* add_ball_option(CLI::App& verb, std::string& ball, const std::string& more);

/// Formats help of at most 100 columns. --help lists the arguments and the options of the group "Options",
/// --help-all all.
std::shared_ptr<CLI::FormatterBase> help_formatter();

/// Adds `--exposure`, a factor on the radiance above zero or `auto`; empty: automatic.
CLI::Option* add_exposure_option(CLI::App& verb, std::optional<double>& exposure);

/// Prints automatic exposures so that they can be repeated: one for all files, or one per file.
void print_exposures(std::span<const std::string> files, std::span<const double> exposures);

/// Warns on standard error where more than 1 % of the light has an effect that the field does not know:
/// shares of its energy, PictureReport's.
void warn_of_unobserved_light(double interpolated, double unobserved);
/// Warns on standard error where more than half of the pixels that show light are clipped.
void warn_of_clipping(double clipped_share);

struct PictureSize {
  int width = 0;  ///< pixels
  int height = 0;
};

/// Reads "1440x900", the value of `option`. Throws InputError for what is none, smaller than `least` or
/// larger than 16384x16384.
PictureSize read_picture_size(const std::string& text, PictureSize least,
                              const std::string& option = "--size");

/// What estimate, compare and report work on: a capture session, or pairs of images of other tools.
struct CaptureOptions {
  std::string session;
  std::string light;
  std::string observed;
  std::string parameterisation;
  std::string mask;
  int hold_out = 0;  ///< 0: as the session says

  bool by_pairs() const { return !light.empty() || !observed.empty(); }
};

/// Adds --light, --observed, --parameterisation, --mask and --hold-out; the session is the verb's own
/// argument.
void add_capture_options(CLI::App& verb, CaptureOptions& options);
/// Those of them that import has, too.
void add_parameterisation_option(CLI::App& verb, std::string& parameterisation);
void add_mask_option(CLI::App& verb, std::string& mask);
void add_hold_out_option(CLI::App& verb, int& hold_out);

/// What --parameterisation names or, where it is empty, that of `lights`, a folder or pattern: lat_long for
/// the maps of 'refield acquire probe', else monitor.
Parameterisation parameterisation_of(const std::string& name, const std::string& lights);

/// Reads the session or pairs the files, with the mask and the images held out that the options name. Throws
/// InputError unless exactly one of both is given.
Session open_capture(const CaptureOptions& options);

/// Reserves an output while the result lives, before any long work; throws what OutputLock throws
/// (core/base/output_lock.h).
std::shared_ptr<const void> reserve_output(const std::filesystem::path& output,
                                           const std::vector<std::filesystem::path>& inputs,
                                           const std::string& extension = "");

/// Errors on held-out images for machines: of the series and, under "per_image", of each image with its
/// file. What is not finite becomes null.
Json held_out_figures(const HeldOutError& error);
/// The same by kind of light.
Json held_out_figures(const std::vector<HeldOutError>& errors);

/// The same as a table, with the spread over images.
void print_errors(const std::vector<HeldOutError>& errors);

}  // namespace refield::cli
