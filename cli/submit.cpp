// SPDX-License-Identifier: Apache-2.0
#include <sys/wait.h>

#include "cli/common/options.h"
#include "cli/estimate_options.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/image/image_io.h"
#include "estimate/estimate.h"

namespace refield::cli {

namespace {

struct SubmitArguments : EstimationArguments {
  std::vector<std::string> estimate;  ///< its options as they were given
  fs::path output;
  int shards = 0;  ///< 0: by the size of the picture
  std::vector<std::string> sbatch;
  bool dry_run = false;
};

/// What a job may use of its node. Slurm ends a job that uses more.
struct Limits {
  std::int64_t memory_mib = 0;
  std::int64_t minutes = 0;
};

struct Plan {
  int shards = 0;
  int threads = 0;  ///< processors per shard
  Limits shard, merge;
  std::string frame_check;
};

/// Words of a command, quoted for sh.
std::string shell_words(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) {
    text += text.empty() ? "'" : " '";
    for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
    text += "'";
  }
  return text;
}

/// What a command of Slurm prints, without the last newline. Throws InputError where it refuses.
std::string call_slurm(const std::vector<std::string>& words) {
  std::FILE* pipe = ::popen((shell_words(words) + " 2>&1").c_str(), "r");
  if (!pipe) throw DeviceError(words.front(), errno, "cannot be started");
  std::string text;
  char buffer[4096];
  for (std::size_t got; (got = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;) text.append(buffer, got);
  const int status = ::pclose(pipe);
  constexpr int not_found = 127;
  if (WIFEXITED(status) && WEXITSTATUS(status) == not_found)
    throw InputError(words.front(),
                     ": is not installed here; submit from a machine of the Slurm cluster, or run 'refield "
                     "estimate --rows' and 'refield merge' by another system");
  while (text.ends_with('\n')) text.pop_back();
  if (status != 0) throw InputError(words.front(), " refused: ", text);
  return text;
}

/// Shards, processors, memory and time from the cost of the estimation, as measured on this machine.
Plan plan_shards(const SubmitArguments& arguments, const CaptureSession& session) {
  constexpr int default_threads = 8, default_shards = 32, min_rows = 16;
  EstimateOptions options = arguments.options;
  if (options.threads == 0) options.threads = default_threads;
  Plan plan;
  plan.threads = options.threads;
  const CostEstimate cost = estimate_cost(session, options, run_context());
  plan.frame_check = cost.frame_check;
  const int height = cost.plan.rows.count();
  plan.shards = arguments.shards > 0 ? arguments.shards : std::clamp(height / min_rows, 1, default_shards);
  if (plan.shards > height)
    throw InputError(
        formatted("--shards %d: the images have only %d rows; give at most that", plan.shards, height));
  options.rows = RowRange{0, (height + plan.shards - 1) / plan.shards};
  constexpr double mib = 1024.0 * 1024.0;
  // A node may use more for the same work, and be slower than this machine; rows differ in cost.
  constexpr double memory_margin = 1.25, time_margin = 3.0;
  constexpr std::int64_t more_mib = 256, min_minutes = 10;
  const auto shard_bytes = static_cast<double>(plan_estimate(session, options, run_context()).memory_bytes);
  const double seconds =
      cost.check_seconds + cost.lights_seconds + (cost.photographs_seconds + cost.fit_seconds) / plan.shards;
  plan.shard = {static_cast<std::int64_t>(memory_margin * shard_bytes / mib) + more_mib,
                min_minutes + static_cast<std::int64_t>(time_margin * seconds / 60.0)};
  const double megapixels = 1e-6 * height * read_image_header(session.frames.front().observed).width;
  // Up to 25 kernels per pixel of one shard at a time; of all where light sources are interpolated between.
  const bool holds_all = session.light.parameterisation == Parameterisation::lat_long;
  const double bytes_per_pixel = holds_all ? 800.0 : 140.0 + 800.0 / plan.shards;
  plan.merge = {1024 + static_cast<std::int64_t>(megapixels * bytes_per_pixel),
                min_minutes + static_cast<std::int64_t>(megapixels)};
  run_context().note(
      formatted("submit: %d shards of about %.0f s, each with %d threads, %lld MiB and at most %lld min",
                plan.shards, seconds, plan.threads, static_cast<long long>(plan.shard.memory_mib),
                static_cast<long long>(plan.shard.minutes)));
  return plan;
}

/// The estimation of one field as shards. All lies in one folder: shard.sh and merge.sh (what the jobs run),
/// shards/ (shards and their finished rows) and log/.
struct Submission {
  fs::path folder;
  std::string name;  ///< of both jobs
  std::string shard_script, merge_script;
};

Submission prepare(const SubmitArguments& arguments, const Plan& plan) {
  const fs::path output = fs::absolute(arguments.output).lexically_normal();
  Submission submission;
  submission.folder = output.string() + ".shards";
  submission.name = formatted("refield-%s-%08zx", output.stem().c_str(),
                              std::hash<std::string>()(output.string()) & 0xffffffffu);
  const std::string start = "#!/bin/sh\n# Written by refield submit.\ncd " +
                            shell_words({fs::current_path().string()}) + " || exit 2\n";
  const std::string program = fs::read_symlink("/proc/self/exe").string();
  const std::string shards = shell_words({(submission.folder / "shards").string()});
  std::vector<std::string> estimate = {program, "estimate"};
  estimate.insert(estimate.end(), arguments.estimate.begin(), arguments.estimate.end());
  // exec: what Slurm signals before the time limit is the estimation itself.
  submission.shard_script = start + "shard=${1:-$SLURM_ARRAY_TASK_ID}\nexec " + shell_words(estimate) +
                            " --threads \"${SLURM_CPUS_PER_TASK:-0}\" --rows \"$shard/" +
                            std::to_string(plan.shards) + "\" --resume -o " + shards + "/\"$shard.rfield\"\n";
  submission.merge_script = start + shell_words({program, "merge"}) + " " + shards + "/*.rfield -o " +
                            shell_words({output.string()}) + " && rm -r " + shards + "\n";
  return submission;
}

/// Refuses where another submission has left shards, or jobs of an earlier one have not ended.
void check_earlier(const Submission& submission) {
  const std::string folder = submission.folder.string();
  if (fs::exists(submission.folder / "shards") &&
      read_text(submission.folder / "shard.sh") != submission.shard_script)
    throw InputError(folder,
                     ": holds shards of a submission with other options; repeat that command, which "
                     "continues, or remove the folder");
  const std::string jobs =
      call_slurm({"squeue", "--noheader", "--name=" + submission.name, "--format=%i %T"});
  if (!jobs.empty())
    throw InputError(folder, ": its jobs are queued or running; wait for them, or end them with 'scancel ",
                     "--name=", submission.name, "':\n", jobs);
}

/// Submits `script` of the folder and returns the number of the job. Options of the user come last: they
/// replace those that are planned.
std::string submit_job(const Submission& submission, const std::string& script, const std::string& log,
                       int threads, const Limits& limits, const std::vector<std::string>& more,
                       const std::vector<std::string>& of_user) {
  std::vector<std::string> words = {"sbatch",
                                    "--parsable",
                                    "--requeue",
                                    "--nodes=1",
                                    "--ntasks=1",
                                    "--open-mode=append",
                                    "--job-name=" + submission.name,
                                    "--cpus-per-task=" + std::to_string(threads),
                                    "--mem=" + std::to_string(limits.memory_mib) + "M",
                                    "--time=" + std::to_string(limits.minutes),
                                    "--output=" + (submission.folder / "log" / log).string()};
  words.insert(words.end(), more.begin(), more.end());
  words.insert(words.end(), of_user.begin(), of_user.end());
  words.push_back((submission.folder / script).string());
  // "123", or "123;cluster", in the last line: warnings may come before it.
  const std::string text = call_slurm(words);
  const std::string last = text.substr(text.rfind('\n') + 1);
  const std::string number = last.substr(0, last.find(';'));
  if (!number_from_text<std::int64_t>(number)) throw InputError("sbatch printed no number of a job: ", text);
  return number;
}

/// Submits an array of the shards that are missing and, after it, their merge.
void submit_jobs(const Submission& submission, const Plan& plan, const std::vector<std::string>& of_user,
                 const Common& common) {
  const fs::path shards = submission.folder / "shards";
  for (const fs::path& folder : {shards, submission.folder / "log"}) create_folders(folder);
  write_text_atomically(shards / frame_check_name, plan.frame_check);
  write_text_atomically(submission.folder / "shard.sh", submission.shard_script);
  write_text_atomically(submission.folder / "merge.sh", submission.merge_script);
  std::vector<std::string> missing, after;
  for (int shard = 1; shard <= plan.shards; ++shard)
    if (!fs::exists(shards / (std::to_string(shard) + ".rfield"))) missing.push_back(std::to_string(shard));
  Json figures = {{"shards", plan.shards}, {"name", submission.name}};
  if (!missing.empty()) {
    std::string array = "--array=";
    for (const std::string& shard : missing) array += (shard == missing.front() ? "" : ",") + shard;
    // Before the time limit a task is asked to stop, and keeps its finished rows.
    figures["array_job"] = submit_job(submission, "shard.sh", "shard-%a.log", plan.threads, plan.shard,
                                      {array, "--signal=B:TERM@30"}, of_user);
    after = {"--dependency=afterok:" + figures["array_job"].get<std::string>(), "--kill-on-invalid-dep=yes"};
  }
  figures["merge_job"] = submit_job(submission, "merge.sh", "merge.log", 1, plan.merge, after, of_user);
  if (common.json) return print_json(figures);
  std::printf(
      "submitted %zu of %d shards, and their merge as Slurm job %s\n"
      "list them with:  squeue --name=%s\n"
      "end them with:   scancel --name=%s\n"
      "After a failure the same command submits the shards that are missing.\n",
      missing.size(), plan.shards, figures["merge_job"].get<std::string>().c_str(), submission.name.c_str(),
      submission.name.c_str());
}

void run_submit(SubmitArguments arguments, const Common& common) {
  const CaptureOptions& capture = arguments.capture;
  // Only until the jobs are submitted; the one that merges takes the output then.
  const OutputLock lock(arguments.output, {capture.session, capture.light, capture.observed, capture.mask},
                        ".rfield");
  const CaptureSession session = open_estimation(arguments).internal();
  const Plan plan = plan_shards(arguments, session);
  if (arguments.dry_run) {
    std::printf("nothing was submitted\n");
    return;
  }
  const Submission submission = prepare(arguments, plan);
  check_earlier(submission);
  submit_jobs(submission, plan, arguments.sbatch, common);
}

/// The options that were given, as words. Not by get_name(), which is empty for hidden options.
std::vector<std::string> words_of(const std::vector<CLI::Option*>& options) {
  std::vector<std::string> words;
  for (const CLI::Option* option : options) {
    if (option->count() == 0) continue;
    const std::string name = option->get_positional() ? "" : "--" + option->get_lnames().front();
    const bool is_flag = option->get_expected_max() == 0;
    if (is_flag) words.push_back(name);
    for (const std::string& value : is_flag ? std::vector<std::string>{} : option->results())
      words.push_back(name.empty() ? value : name + "=" + value);
  }
  return words;
}

}  // namespace

void add_submit(CLI::App& app, const Common& common, Action& action) {
  const auto arguments = std::make_shared<SubmitArguments>();
  CLI::App* verb = app.add_subcommand(
      "submit",
      "Estimate a reflectance field on a Slurm cluster.\n"
      "\n"
      "The image is divided into shards of rows, which are estimated as a Slurm job array and merged by a "
      "last job. The field equals that of 'refield estimate' on one machine, byte for byte. Memory and time "
      "per shard come from the cost estimate of 'refield estimate --dry-run'. If a node fails, Slurm "
      "restarts its tasks; after any other failure the same command submits the shards that are missing. "
      "Session, program and output must have the same path on all nodes. Scripts, logs and shards are in the "
      "folder OUTPUT.shards.\n"
      "\n"
      "Beside the options listed here, those of 'refield estimate' are accepted; --threads is the number of "
      "processors of a task (default: 8).\n"
      "\n"
      "Examples:\n"
      "  refield submit session -o scene.rfield --sbatch=--partition=compute\n"
      "  refield submit session -o scene.rfield --sbatch=--mem=16G --sbatch=--time=4:00:00");
  const std::size_t before = verb->get_options().size();
  add_estimation_options(*verb, *arguments);
  auto estimation = verb->get_options();
  estimation.erase(estimation.begin(), estimation.begin() + static_cast<std::ptrdiff_t>(before));
  for (CLI::Option* option : estimation) option->group("");
  verb->get_option("session")->group("Options");
  std::erase(estimation, verb->get_option("--threads"));
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)")->required();
  verb->add_option("--shards", arguments->shards, "Number of shards (default: 32, of at least 16 rows each)")
      ->check(CLI::Range(1, 1000));
  verb->add_option("--sbatch", arguments->sbatch,
                   "Further option of sbatch, such as --sbatch=--partition=compute, or one that replaces "
                   "what is planned, such as --sbatch=--mem=16G; repeat it for each");
  add_dry_run_flag(*verb, arguments->dry_run)->group("");
  verb->callback([arguments, estimation, &common, &action] {
    arguments->estimate = words_of(estimation);
    action = [arguments, &common] { run_submit(*arguments, common); };
  });
}

}  // namespace refield::cli
