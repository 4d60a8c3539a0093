// SPDX-License-Identifier: Apache-2.0
#include "cli/common/options.h"

#include <sstream>

#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "relight/field_pictures.h"
#include "relight/held_out.h"

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

/// Columns that `text` takes in a terminal: its bytes without the continuation bytes of UTF-8.
std::size_t columns_of(std::string_view text) {
  return static_cast<std::size_t>(
      std::ranges::count_if(text, [](char c) { return (static_cast<unsigned char>(c) & 0xc0u) != 0x80u; }));
}

/// Consecutive lines of `text` form a paragraph, which is broken at spaces into lines of at most `width`
/// columns. Lines that begin with a space (examples, tables) and empty lines stay as they are.
std::string wrapped(const std::string& text, std::size_t width) {
  std::string result;
  std::size_t columns = 0;  // of the last line, while it can take more words
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.front() == ' ') {
      if (columns > 0) result += '\n';
      result += line + '\n';
      columns = 0;
      continue;
    }
    std::istringstream words(line);
    for (std::string word; words >> word;) {
      const std::size_t word_columns = columns_of(word);
      const bool fits = columns + 1 + word_columns <= width;
      if (columns > 0) result += fits ? ' ' : '\n';
      columns = columns > 0 && fits ? columns + 1 + word_columns : word_columns;
      result += word;
    }
  }
  while (result.ends_with('\n')) result.pop_back();
  return result;
}

/// What stands before an option's value: FLOAT, or a|b where the value is one of few.
std::string value_name(const CLI::Option& option) {
  if (option.get_type_size() == 0) return "";
  const std::string type = option.get_type_name();
  const auto bounds = type.find(':');
  std::string name = type.substr(0, bounds);
  if (bounds != std::string::npos && type[bounds + 1] == '{') {
    name = type.substr(bounds + 2, type.find('}') - bounds - 2);
    std::ranges::replace(name, ',', '|');
  }
  return " " + name + (option.get_expected_max() == CLI::detail::expected_max_vector_size ? " ..." : "");
}

/// Help of at most 100 columns: the output first, without the bounds of values, which messages state.
class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    std::string help = wrapped(app->get_description(), width) + "\n\n" + make_usage(app, std::move(name));
    help += list("Arguments", app->get_options([](const CLI::Option* option) {
      return option->get_positional() && !option->get_group().empty();
    }));
    std::size_t hidden = 0;
    for (const std::string& group : app->get_groups()) {
      auto options = app->get_options([&](const CLI::Option* option) {
        return option->get_group() == group && option->nonpositional() && option != app->get_help_ptr() &&
               option != app->get_help_all_ptr();
      });
      std::ranges::stable_partition(options, [](const CLI::Option* o) { return o->check_name("-o"); });
      if (group == "Options" || (!group.empty() && mode == CLI::AppFormatMode::All))
        help += list(group, options);
      else if (!group.empty())
        hidden += options.size();
    }
    help += verbs_of(*app);
    const std::string more = hidden > 0 ? "; --help-all lists " + std::to_string(hidden) +
                                              (hidden == 1 ? " further option" : " further options")
                                        : "";
    const CLI::App* program = app;
    while (program->get_parent() != nullptr) program = program->get_parent();
    if (program != app && program->get_option_no_throw("--force") != nullptr)  // not in refield-studies
      help += "\n" +
              wrapped(
                  "Every command takes --json (results and errors as JSON on standard output), --quiet (no "
                  "progress) and --force (replace the output of an earlier run)" +
                      more + ".",
                  width) +
              "\n";
    const std::string footer = wrapped(app->get_footer(), width);
    return help + (footer.empty() ? "" : "\n" + footer + "\n");
  }

 private:
  static constexpr std::size_t width = 100, indent = 30, verb_indent = 14;

  /// "head", from column `at` the text.
  static std::string row(std::string head, const std::string& text, std::size_t at) {
    head = "  " + head;
    if (head.size() + 2 > at)
      head += '\n' + std::string(at, ' ');
    else
      head.resize(at, ' ');
    std::istringstream lines(wrapped(text, width - at));
    std::string result;
    for (std::string line; std::getline(lines, line);)
      result += (result.empty() ? head : std::string(at, ' ')) + line + '\n';
    return result;
  }

  static std::string list(const std::string& heading, const std::vector<const CLI::Option*>& options) {
    std::string text;
    for (const CLI::Option* option : options) {
      std::string description = option->get_description();
      const std::string value = option->get_default_str();
      if (!value.empty() && description.find("(default:") == std::string::npos)
        description += " (default: " + value + ")";
      if (option->get_required() && !option->get_positional()) description += " (required)";
      std::string name = option->get_name(option->get_positional(), true);
      if (option->get_positional()) name = option->get_name();
      text += row(name + value_name(*option), description, indent);
    }
    return text.empty() ? "" : "\n" + heading + ":\n" + text;
  }

  /// By their groups, with the first line of each description.
  static std::string verbs_of(const CLI::App& app) {
    std::string text, group;
    for (const CLI::App* verb : app.get_subcommands([](const CLI::App*) { return true; })) {
      if (verb->get_group() != group) text += "\n" + (group = verb->get_group()) + ":\n";
      const std::string description = verb->get_description();
      text += row(verb->get_name(), description.substr(0, description.find('\n')), verb_indent);
    }
    return text;
  }
};

std::optional<Json> printed;  ///< what print_json() was given

/// Whether `value` is an object or a list that holds one.
bool holds_objects(const Json& value) {
  return value.is_object() || (value.is_array() && std::any_of(value.begin(), value.end(), holds_objects));
}

std::string label_of(const std::string& key) {
  std::string label = printable(key);
  std::ranges::replace(label, '_', ' ');
  return label;
}

/// A value, or a list of values: "30, 25".
std::string line_of(const Json& value) {
  constexpr std::size_t one_line = 40;
  if (value.is_array() && value.size() > one_line)
    return std::to_string(value.size()) + " values, see --json";
  if (value.is_null() || (value.is_structured() && value.empty())) return "none";
  if (value.is_string()) return printable(value.get<std::string>());
  if (value.is_number_float()) return formatted("%.5g", value.get<double>());
  if (!value.is_array()) return printable(json_text(value));
  return listed(value, value.size(), line_of);
}

/// Objects of few values as lines of a table.
void print_table(const Json& rows, int indent) {
  std::vector<std::string> keys;
  for (const Json& row : rows)
    for (const auto& [key, item] : row.items())
      if (std::ranges::find(keys, key) == keys.end()) keys.push_back(key);
  std::vector<std::string> lines(1 + rows.size(), std::string(static_cast<std::size_t>(indent), ' '));
  for (const std::string& key : keys) {
    std::vector<std::string> cells{label_of(key)};
    for (const Json& row : rows) cells.push_back(row.contains(key) ? line_of(row[key]) : "");
    std::size_t width = 0;
    for (const std::string& cell : cells) width = std::max(width, columns_of(cell));
    for (std::size_t i = 0; i < lines.size(); ++i)
      lines[i] += cells[i] + std::string(width - columns_of(cells[i]) + 2, ' ');
  }
  for (const std::string& line : lines)
    std::printf("%s\n", line.substr(0, line.find_last_not_of(' ') + 1).c_str());
}

Json finite_or_null(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

}  // namespace

std::shared_ptr<CLI::FormatterBase> help_formatter() {
  return std::make_shared<HelpFormatter>();
}

std::string printable(const std::string& text) {
  std::string shown;
  int following = 0;  // bytes of a UTF-8 sequence still to come
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const bool follows = byte >= 0x80 && byte < 0xc0 && following > 0;
    const bool begins = byte >= 0xc2 && byte < 0xf5;
    // U+0080 to U+009F are control characters, too.
    const bool control =
        byte < 0x20 || byte == 0x7f ||
        (byte == 0xc2 && i + 1 < text.size() && static_cast<unsigned char>(text[i + 1]) < 0xa0);
    following = follows                    ? following - 1
                : byte >= 0xf0             ? 3
                : byte >= 0xe0             ? 2
                : byte >= 0xc2 && !control ? 1
                                           : 0;
    if (!control && (byte < 0x80 || follows || begins)) {
      shown += text[i];
    } else {
      shown += formatted("\\x%02x", byte);
    }
  }
  return shown;
}

void print_figures(const Json& figures, int indent) {
  for (const auto& [key, item] : figures.items()) {
    const std::string label = label_of(key);
    if (!holds_objects(item) || item.empty()) {
      std::printf("%*s%s: %s\n", indent, "", label.c_str(), line_of(item).c_str());
      continue;
    }
    std::printf("%*s%s\n", indent, "", label.c_str());
    if (item.is_object()) print_figures(item, indent + 2);
    if (item.is_object()) continue;
    const auto is_block = [](const Json& entry) {
      return !entry.is_object() || std::any_of(entry.begin(), entry.end(), holds_objects);
    };
    if (std::none_of(item.begin(), item.end(), is_block)) {
      print_table(item, indent + 2);
      continue;
    }
    for (const Json& entry : item) print_figures(entry, indent + 2);
  }
}

void print_json(const Json& figures) {
  printed = figures;
}

void write_json(const fs::path& path, const Json& figures) {
  write_text_atomically(path, json_text(figures, 2) + "\n");
}

void finish_json(const std::string& kind, const std::string& message) {
  if (!printed && kind.empty()) return;
  Json document = {{"schema", 1}};
  if (printed) document.update(*printed);
  if (!kind.empty()) document["error"] = {{"kind", kind}, {"message", message}};
  std::printf("%s\n", json_text(document, 2).c_str());
}

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

void warn_of_unobserved_light(double interpolated, double unobserved) {
  if (interpolated > 0.01)
    std::fprintf(stderr,
                 "refield: note: %.0f %% of the light comes from directions between the light sources of the "
                 "capture; its effect is interpolated\n",
                 100.0 * interpolated);
  if (const std::string warning = unobserved_light_warning({interpolated, unobserved}); !warning.empty())
    std::fprintf(stderr, "refield: warning: %s\n", warning.c_str());
}

void warn_of_clipping(double clipped_share) {
  if (clipped_share > 0.5)
    std::fprintf(stderr,
                 "refield: warning: with this --exposure, %.0f %% of the illuminated pixels are clipped; "
                 "remove --exposure to select it automatically\n",
                 100.0 * clipped_share);
}

PictureSize read_picture_size(const std::string& text, PictureSize least, const std::string& option) {
  constexpr int largest = 16384;
  PictureSize size;
  char rest = '\0';
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest) != 2 ||
      size.width < least.width || size.height < least.height || size.width > largest || size.height > largest)
    throw InputError(option, " ", text, ": give width x height in pixels, ", least.width, "x", least.height,
                     " to 16384x16384");
  return size;
}

CLI::Option* add_placement_option(CLI::App& verb, std::vector<std::string>& placements,
                                  const std::string& more) {
  return verb.add_option("--placement", placements,
                         "Placement of the monitor: WIDTHxHEIGHT@DISTANCE in mm, then yaw, pitch, roll in "
                         "degrees and x, y in mm where not zero, such as 520x320@600,yaw=90. " +
                             more + " Repeat the option for each window of stacked light maps");
}

CLI::Option* add_fps_option(CLI::App& verb, double& frames_per_second) {
  return verb.add_option("--fps", frames_per_second, "Frame rate of a video in frames per second")
      ->capture_default_str();
}

CLI::Option* add_monitor_option(CLI::App& verb, std::string& monitor) {
  return verb.add_option(
      "--monitor", monitor,
      "Monitor that lights the scene, as 'refield acquire devices' names it: a connector such as HDMI-A-1, "
      "or window:0 for a full-screen window on the first display of the desktop");
}

CLI::Option* add_horizontal_fov_option(CLI::App& verb, std::optional<double>& degrees) {
  return verb.add_option("--horizontal-fov", degrees, "Horizontal field of view of the camera in degrees")
      ->check(CLI::Range(0.1, 170.0));
}

CLI::Option* add_diameter_option(CLI::App& verb, std::optional<double>& diameter_mm) {
  return verb.add_option("--diameter", diameter_mm, "Diameter of the ball in mm")->check(positive_number());
}

CLI::Option* add_saturation_option(CLI::App& verb, std::optional<double>& saturation) {
  return verb
      .add_option("--saturation", saturation,
                  "Lowest sample value that may be clipped (default: the level at which samples pile up, "
                  "else from RAW files, else the largest value; none for float images)")
      ->group(further);
}

CLI::Option* add_max_noise_option(CLI::App& verb, std::string& share) {
  return verb.add_option("--max-noise", share,
                         "Take the minimum number of exposures that keep the noise of each sample below this "
                         "fraction of its radiance, such as 2%");
}

CLI::Option* add_until_error_option(CLI::App& verb, std::string& share) {
  return verb.add_option("--until-error", share,
                         "Stop taking training photographs when the predicted median error on new "
                         "photographs falls to this value, such as 2%");
}

CLI::Option* add_ball_option(CLI::App& verb, std::string& ball, const std::string& more) {
  return verb
      .add_option(
          "--ball", ball,
          "Centre and radius of the mirror ball, X,Y,R in pixels from the top left corner, or 'find'" + more)
      ->default_str("find");
}

void add_parameterisation_option(CLI::App& verb, std::string& parameterisation) {
  verb.add_option("--parameterisation", parameterisation,
                  "Parameterisation of the light maps of --light: monitor, lat_long or cube (default: "
                  "lat_long for maps of 'refield acquire probe', else monitor)")
      ->group(further);
}

void add_mask_option(CLI::App& verb, std::string& mask) {
  verb.add_option("--mask", mask,
                  "Mask image, bright where the scene is; other pixels are ignored (default: the mask of the "
                  "session, else all pixels)");
}

void add_hold_out_option(CLI::App& verb, int& hold_out) {
  verb.add_option("--hold-out", hold_out,
                  "Hold out every N-th photograph: the estimate does not use it, and it is compared with its "
                  "prediction (default: those that the session or the field holds out)")
      ->type_name("N");
}

void add_capture_options(CLI::App& verb, CaptureOptions& options) {
  verb.add_option("--light", options.light, "Light maps: folder or quoted pattern, instead of a session");
  verb.add_option("--observed", options.observed,
                  "Photographs, instead of a session: quoted pattern or folder; paired with the light maps "
                  "by the text that the wildcards match, else by name");
  add_parameterisation_option(verb, options.parameterisation);
  add_mask_option(verb, options.mask);
  add_hold_out_option(verb, options.hold_out);
}

Parameterisation parameterisation_of(const std::string& name, const std::string& lights) {
  if (!name.empty()) return parameterisation_from_name(name);
  const fs::path path = lights;
  const bool is_probe = fs::exists((fs::is_directory(path) ? path : path.parent_path()) / "probe.toml");
  return is_probe ? Parameterisation::lat_long : Parameterisation::monitor;
}

Session open_capture(const CaptureOptions& options) {
  if (options.by_pairs() == !options.session.empty())
    throw InputError("no input, or two inputs; give either a SESSION folder, or both --light and --observed");
  if (options.by_pairs() && (options.light.empty() || options.observed.empty()))
    throw InputError(
        "--light and --observed require each other; give a pattern for the light maps and one for the "
        "photographs");
  Session session = options.by_pairs() ? Session(options.light, options.observed,
                                                 parameterisation_of(options.parameterisation, options.light))
                                       : Session(options.session);
  if (!options.mask.empty()) session.set_mask(options.mask);
  if (options.hold_out != 0) session.hold_out(options.hold_out);
  return session;
}

std::shared_ptr<const void> reserve_output(const fs::path& output, const std::vector<fs::path>& inputs,
                                           const std::string& extension) {
  return std::make_shared<const OutputLock>(output, inputs, extension);
}

Json held_out_figures(const HeldOutError& error) {
  Json figures = {{"images", error.images},
                  {"trained_on", error.trained_on ? Json(*error.trained_on) : Json(nullptr)},
                  {"relative_rmse", finite_or_null(error.relative_rmse)},
                  {"median", finite_or_null(error.median)},
                  {"percentile_90", finite_or_null(error.percentile_90)},
                  {"tone_mapped_psnr_db", finite_or_null(error.tone_mapped_psnr_db)}};
  if (error.prediction)
    figures["predicted_error"] = {{"rank_correlation", finite_or_null(error.prediction->rank_correlation)},
                                  {"median_ratio", finite_or_null(error.prediction->median_ratio)},
                                  {"median", finite_or_null(error.prediction->predicted_median)}};
  figures["per_image"] = Json::array();
  for (const HeldOutImage& image : error.per_image)
    figures["per_image"].push_back(
        {{"name", image.name},
         {"observed", image.observed.string()},
         {"relative_rmse", finite_or_null(image.error.relative_rmse)},
         {"tone_mapped_psnr_db", finite_or_null(image.error.tone_mapped_psnr_db)}});
  return figures;
}

Json held_out_figures(const std::vector<HeldOutError>& errors) {
  Json kinds = Json::object();
  for (const HeldOutError& error : errors)
    kinds[error.kind.empty() ? "all" : error.kind] = held_out_figures(error);
  return kinds;
}

void print_errors(const std::vector<HeldOutError>& errors) {
  const auto label = [](const HeldOutError& error) {
    return error.kind.empty() ? "all" : error.kind.c_str();
  };
  std::printf("%-16s %6s %14s %12s %12s %18s\n", "", "images", "relative RMSE", "median pixel", "90th pct.",
              "tone-mapped PSNR");
  for (const HeldOutError& error : errors)
    std::printf("%-16s %6zu %14.4f %12.4f %12.4f %15.2f dB\n", label(error), error.images,
                error.relative_rmse, error.median, error.percentile_90, error.tone_mapped_psnr_db);
  if (std::ranges::none_of(errors, [](const HeldOutError& error) { return error.per_image.size() > 1; }))
    return;
  std::printf("\n%-16s %6s %14s %12s %12s\n", "per image", "", "median image", "mean", "largest");
  for (const HeldOutError& error : errors) {
    if (error.per_image.size() < 2) continue;
    const ErrorSpread spread = spread_of(error.per_image);
    std::printf("%-16s %6s %14.4f %12.4f %12.4f  %s\n", label(error), "", spread.median, spread.mean,
                spread.largest, error.per_image[spread.worst].name.c_str());
  }
}

}  // namespace refield::cli
