// SPDX-License-Identifier: Apache-2.0
// refield-studies: compares methods and settings of refield with one another and with other methods.
#include <cstdio>
#include <exception>

#include "bench/studies/studies.h"
#include "cli/common/options.h"
#include "cli/run_context.h"
#include "core/base/errors.h"

namespace {

constexpr int status_bad_input = 2;
constexpr int status_interrupted = 130;

int run(int argc, char** argv) {
  CLI::App app(
      "refield-studies compares the methods and settings of refield with one another and with published "
      "methods.\n\nEach study writes its figures as CSV files to a folder. 'bench/studies/draw.py FOLDER' "
      "draws them.\n"
      "docs/method/studies.md lists the command for each chart and table of the documentation.");
  app.name("refield-studies");
  app.formatter(refield::cli::help_formatter());
  app.require_subcommand(1);
  app.fallthrough();
  refield::cli::Common common;
  app.add_flag("--json", common.json, "Print figures as JSON on standard output");
  app.add_flag("--quiet", common.quiet, "Do not show progress on standard error");
  refield::cli::Action action;
  refield::studies::add_chart(app, common, action);
  refield::studies::add_pack_chart(app, common, action);
  refield::studies::add_prt_chart(app, action);
  refield::studies::add_dynamic_chart(app, action);
  refield::studies::add_dynamic_bases(app, action);
  refield::cli::require_finite_numbers(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : status_bad_input;
  }
  if (common.quiet) refield::silence_progress();
  refield::install_interrupt_handler();
  action();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const refield::Interrupted&) {
    std::fprintf(stderr, "refield-studies: stopped; 'chart' continues with --resume\n");
    return status_interrupted;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "refield-studies: %s\n", error.what());
    return status_bad_input;
  }
}
