// SPDX-License-Identifier: Apache-2.0
// refield: reads the command line, runs one verb, turns errors into messages and exit statuses.
#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <system_error>

#include "cli/common/options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"

namespace {

constexpr int status_defect = 1;
constexpr int status_bad_input = 2;
constexpr int status_interrupted = 130;

/// What can help when memory runs out: the verb's --memory, where it has one. Set before memory can run out.
const char* memory_remedy = "work on smaller images or close other programs";

/// Makes the process fit to run: what goes wrong later is an error with a message then, not a signal, and no
/// file gets the number of a standard stream that was closed.
void prepare_process() {
  for (int stream = 0; stream <= 2; ++stream)
    if (::fcntl(stream, F_GETFD) < 0) ::open("/dev/null", stream == 0 ? O_RDONLY : O_WRONLY);
  std::signal(SIGXFSZ, SIG_IGN);  // writing beyond `ulimit -f` fails with EFBIG instead
  // Libraries call it damage when they cannot open a file; images, fields and their readers take up to a
  // dozen.
  constexpr rlim_t least_files = 64;
  rlimit files{};
  if (::getrlimit(RLIMIT_NOFILE, &files) != 0 || files.rlim_cur >= least_files) return;
  files.rlim_cur = std::min(files.rlim_max, least_files);
  ::setrlimit(RLIMIT_NOFILE, &files);
  if (files.rlim_cur < least_files)
    throw refield::InputError("the limit on open files is " + std::to_string(files.rlim_cur) +
                              ", but refield needs " + std::to_string(least_files) +
                              "; raise it (ulimit -n) and run again");
}

/// Exit status 2 when something that was printed did not arrive.
int finish_standard_output(int status) {
  errno = 0;
  const bool flushed = std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
  if (!flushed && errno == 0) {  // An earlier write failed; another one tells why.
    std::clearerr(stdout);
    std::fputc('\n', stdout);
    std::fflush(stdout);
  }
  int error_number = errno;
  const bool closed = ::close(STDOUT_FILENO) == 0;
  if (!closed && error_number == 0) error_number = errno;
  if ((flushed && closed) || status != 0) return status;
  const refield::DeviceError error("standard output", error_number != 0 ? error_number : EIO, "cannot write");
  std::fprintf(stderr, "refield: %s\n", error.what());
  return status_bad_input;
}

/// What the system refused, without the library's words.
refield::DeviceError refused_by_system(const std::system_error& error) {
  const auto* file = dynamic_cast<const std::filesystem::filesystem_error*>(&error);
  const bool is_errno =
      error.code().category() == std::system_category() || error.code().category() == std::generic_category();
  const int error_number = is_errno ? error.code().value() : EIO;
  return {file && !file->path1().empty() ? file->path1().string() : "the system", error_number,
          file ? "cannot access" : "refused an operation"};
}

constexpr const char* no_resources =
    "the system refused memory or a thread; raise the limits (ulimit -v, ulimit -u) or close other programs";

/// What oneTBB throws when the system gives it no thread.
bool lacks_threads(const std::exception& error) {
  return std::string_view(error.what()).find("pthread_create") != std::string_view::npos;
}

/// Ends without what libraries do at exit: some wait there for threads that they could not start.
[[noreturn]] void leave_at_once(int status) {
  std::fflush(nullptr);
  ::_exit(status);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose own start must come first
/// Without allocating memory.
[[noreturn]] void end_for_lack_of_resources() {
  for (const char* part : {"refield: ", no_resources, "\n"}) {
    const ssize_t written = ::write(STDERR_FILENO, part, std::strlen(part));
    static_cast<void>(written);
  }
  ::_exit(status_bad_input);
}

/// For exceptions that nothing can catch: those of libraries while they are loaded, and of their threads.
[[noreturn]] void end_uncaught() {
  try {
    if (const auto thrown = std::current_exception()) std::rethrow_exception(thrown);
  } catch (const std::bad_alloc&) {
    end_for_lack_of_resources();
  } catch (const std::system_error&) {
    end_for_lack_of_resources();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "refield: unexpected error: %s\n", error.what());
  } catch (...) {
  }
  std::abort();
}

/// Runs before the shared libraries' constructors. OpenBLAS, where it is the system's BLAS, would start one
/// thread for each core, and nothing here uses it.
void prepare_for_libraries() {
  ::setenv("OPENBLAS_NUM_THREADS", "1", 0);
  std::set_terminate(end_uncaught);
}
[[gnu::section(".preinit_array"), gnu::used]] void (*const before_libraries)() = prepare_for_libraries;
#endif

bool wants_json = false;  ///< also where the rest of the command line cannot be read

/// Says why the run ends, for people and, under --json, for programs.
int end_with(int status, const char* kind, const std::string& message) {
  std::fprintf(stderr, "refield: %s\n", message.c_str());
  if (wants_json) refield::cli::finish_json(kind, message);
  return status;
}

void add_verbs(CLI::App& app, const refield::cli::Common& common, refield::cli::Action& action) {
  using namespace refield::cli;
  using Add = void (*)(CLI::App&, const Common&, Action&);
  const std::pair<const char*, std::vector<Add>> groups[] = {
      {"Capture", {add_acquire}},
      {"Estimate", {add_estimate, add_submit, add_merge}},
      {"Relight", {add_relight, add_view, add_export_web, add_pack}},
      {"Examine", {add_info, add_compare}},
      {"Simulate", {add_simulate, add_precompute, add_render}}};
  for (const auto& [group, adds] : groups)
    for (const Add add : adds) {
      add(app, common, action);
      app.get_subcommands([](CLI::App*) { return true; }).back()->group(group);
    }
}

/// The command line of all verbs; parsing it sets `common` and `action`.
std::unique_ptr<CLI::App> command_line(refield::cli::Common& common, refield::cli::Action& action) {
  auto whole = std::make_unique<CLI::App>(
      "refield relights photographed scenes. From photographs under known light patterns it estimates a "
      "reflectance field, the response of each pixel to light, and renders the scene under new light.\n"
      "\n"
      "Typical sequence:\n"
      "  refield simulate RECIPE.toml -o truth                           create a synthetic scene\n"
      "  refield acquire run RECIPE.toml --truth truth -o session        photograph it under many lights\n"
      "  refield estimate session -o scene.rfield                        estimate the reflectance field\n"
      "  refield relight scene.rfield --light new.exr -o image.exr       render it under a new light\n"
      "  refield view scene.rfield                                       relight it interactively");
  CLI::App& app = *whole;
  app.name("refield");
  app.formatter(refield::cli::help_formatter());
  app.set_help_all_flag("--help-all", "List all options");
  app.require_subcommand(1);
  app.set_version_flag("--version", "refield " REFIELD_VERSION);
  app.fallthrough();
  app.add_flag("--json", common.json, "Print results and errors as JSON on standard output");
  app.add_flag("--quiet", common.quiet, "Do not print progress on standard error");
  app.add_flag("--force", common.force, "Replace the output of an earlier run, where a command refuses to");
  add_verbs(app, common, action);
  // After the verbs, which would inherit it.
  app.footer(
      "'refield COMMAND --help[-all]' explains a command; docs/guide/tutorial.md leads through a capture.\n"
      "\n"
      "Exit status: 0 success; 2 invalid input or option, or a system error (see the message); 130 "
      "interrupted by Ctrl-C or SIGTERM, finished work is kept; 1 internal error.");
  refield::cli::require_finite_numbers(app);
  return whole;
}

int run(int argc, char** argv) {
  refield::cli::Common common;
  refield::cli::Action action;
  const auto whole = command_line(common, action);
  CLI::App& app = *whole;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (app.exit(error) == 0) return 0;
    if (wants_json) refield::cli::finish_json("usage", error.what());
    return status_bad_input;
  }
  for (const CLI::App* verb : app.get_subcommands())
    if (verb->get_option_no_throw("--memory") != nullptr)
      memory_remedy = "give --memory a smaller limit or work on smaller images";
  if (common.quiet) refield::silence_progress();
  refield::install_interrupt_handler();
  action();
  refield::cli::finish_json("", "");
  return 0;
}

/// The kind of an error in JSON.
const char* kind_of(const refield::Error& error) {
  if (dynamic_cast<const refield::InputError*>(&error)) return "input";
  if (dynamic_cast<const refield::FormatError*>(&error)) return "format";
  return dynamic_cast<const refield::DeviceError*>(&error) ? "device" : "solver";
}

int run_and_report(int argc, char** argv) {
  wants_json = std::find(argv, argv + argc, std::string_view("--json")) != argv + argc;
  try {
    prepare_process();
    return run(argc, argv);
  } catch (const refield::Error& error) {
    return end_with(status_bad_input, kind_of(error), error.what());
  } catch (const refield::cli::Detached&) {
    return status_interrupted;
  } catch (const refield::Interrupted&) {
    return end_with(status_interrupted, "interrupted",
                    "interrupted; finished work is kept; acquire and estimate continue with --resume");
  } catch (const std::bad_alloc&) {
    end_with(status_bad_input, "memory", std::string("out of memory; ") + memory_remedy);
    leave_at_once(status_bad_input);
  } catch (const std::system_error& error) {
    return end_with(status_bad_input, "device", refused_by_system(error).what());
  } catch (const std::exception& error) {
    if (lacks_threads(error)) {
      end_with(status_bad_input, "memory", no_resources);
      leave_at_once(status_bad_input);
    }
    return end_with(status_defect, "defect",
                    std::string("unexpected error: ") + error.what() +
                        "\nPlease report this with the command that caused it.");
  }
}

}  // namespace

void refield::cli::run_words(std::vector<std::string> words) {
  Common common;
  Action action;
  const auto whole = command_line(common, action);
  std::ranges::reverse(words);  // as CLI11 takes them
  whole->parse(words);
  action();
}

int main(int argc, char** argv) {
  ::unsetenv("HDF5_USE_FILE_LOCKING");  // it would outweigh that fields are opened without HDF5's locks
  return finish_standard_output(run_and_report(argc, argv));
}
