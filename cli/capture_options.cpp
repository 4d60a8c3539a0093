// SPDX-License-Identifier: Apache-2.0
#include "cli/capture_options.h"

#include "cli/run_context.h"
#include "core/errors.h"
#include "relight/held_out.h"

namespace refield::cli {

void add_capture_options(CLI::App& verb, CaptureOptions& options, const std::string& held_out) {
  verb.add_option("--light", options.light, "Light maps, instead of a session: quoted pattern or folder");
  verb.add_option("--observed", options.observed,
                  "Photographs, instead of a session: quoted pattern or folder; paired with the light maps "
                  "by the text that the wildcards match, else by name");
  verb.add_option("--parameterisation", options.parameterisation,
                  "Parameterisation of the light maps of --light: monitor, lat_long or cube")
      ->capture_default_str();
  verb.add_option("--mask", options.mask,
                  "Mask image, bright where the scene is; other pixels are ignored (default: the mask of the "
                  "session, else all pixels)");
  verb.add_option("--hold-out", options.hold_out, held_out)->type_name("N");
}

CaptureSession open_capture(const CaptureOptions& options) {
  if (options.by_pairs() == !options.session.empty())
    throw InputError("no input, or two inputs; give either a SESSION folder, or both --light and --observed");
  if (options.by_pairs() && (options.light.empty() || options.observed.empty()))
    throw InputError(
        "--light and --observed require each other; give a pattern for the light maps and one for the "
        "photographs");
  CaptureSession session = options.by_pairs()
                               ? pair_by_globs(options.light, options.observed,
                                               parameterisation_from_name(options.parameterisation))
                               : read_capture_session(options.session);
  if (!options.mask.empty()) session.mask = options.mask;
  if (options.hold_out != 0) hold_out_every(session, options.hold_out);
  return session;
}

void find_held_out(const CaptureOptions& options, const ReflectanceField& field, CaptureSession& session) {
  if (options.hold_out != 0) return;
  if (const std::string warning = mark_held_out(session, field); !warning.empty())
    run_context().note(warning);
}

}  // namespace refield::cli
