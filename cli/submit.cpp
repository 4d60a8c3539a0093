// SPDX-License-Identifier: Apache-2.0
#include <sys/wait.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <future>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <thread>

#include "cli/cluster/cluster_job.h"
#include "cli/common/options.h"
#include "cli/estimate_options.h"
#include "cli/report/input.h"
#include "cli/run_context.h"
#include "cli/verbs.h"
#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"
#include "core/base/output_lock.h"
#include "core/field_io/field_shard.h"
#include "core/image/image_io.h"
#include "estimate/estimate.h"

namespace refield::cli {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

struct SubmitArguments : EstimationArguments {
  std::vector<std::string> estimate;  ///< its options as they were given
  std::string output;
  int shards = 0;
  int nodes = 0;
  std::string time;
  double task_memory_gib = 0.0;
  std::string partition;
  std::vector<std::string> sbatch;
  std::string hosts;  ///< of GNU parallel; empty: Slurm
  bool detach = false;
  bool dry_run = false;
  bool resume = false, cancel = false, finish = false;  ///< of a submission
};

struct CommandOutput {
  int status = 0;
  std::string text;  ///< of both streams
};

CommandOutput run_command(const std::vector<std::string>& words) {
  std::FILE* pipe = ::popen((shell_words(words) + " 2>&1").c_str(), "r");
  if (!pipe) throw DeviceError(words.front(), errno, "cannot be started");
  CommandOutput output;
  char buffer[4096];
  for (std::size_t got; (got = std::fread(buffer, 1, sizeof buffer, pipe)) > 0;)
    output.text.append(buffer, got);
  const int status = ::pclose(pipe);
  output.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return output;
}

void pause_for(Clock::duration duration) {
  for (const auto until = Clock::now() + duration; Clock::now() < until;) {
    run_context().throw_if_stopped();
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

[[noreturn]] void refuse_command(const std::vector<std::string>& words, const CommandOutput& output) {
  if (output.status == 127)
    throw InputError(words.front() +
                     ": is not installed here; submit from a machine of the Slurm cluster, or give --hosts");
  std::string text = output.text;
  while (!text.empty() && text.back() == '\n') text.pop_back();
  throw InputError(words.front() + " refused: " + text);
}

/// Runs a command of Slurm, waiting while the controller does not answer. Throws InputError where it refuses.
std::string call_slurm(const std::vector<std::string>& words) {
  constexpr auto patience = std::chrono::minutes(10);
  const auto until = Clock::now() + patience;
  for (bool is_told = false;; is_told = true) {
    const CommandOutput output = run_command(words);
    if (output.status == 0) return output.text;
    const auto says = [&](const char* text) { return output.text.find(text) != std::string::npos; };
    const bool is_away = says("Unable to contact") || says("Connection refused") || says("timed out") ||
                         says("Zero Bytes were transmitted");
    if (!is_away || Clock::now() > until) refuse_command(words, output);
    if (!is_told) run_context().note("Slurm's controller does not answer; waiting for it");
    pause_for(std::chrono::seconds(3));
  }
}

/// "123" or "123;cluster" in a line of its own; warnings may come before it. Numbers of a federation's
/// clusters have ten digits.
std::int64_t submitted_job(const std::vector<std::string>& words) {
  const std::string text = call_slurm(words);
  std::istringstream lines(text);
  std::int64_t job = 0;
  for (std::string line; std::getline(lines, line);)
    if (const std::string number = line.substr(0, line.find(';'));
        !number.empty() && number.size() < 19 && number.find_first_not_of("0123456789") == std::string::npos)
      job = std::stoll(number);
  if (job == 0) throw InputError("sbatch printed no number of a job: " + text);
  return job;
}

/// What the shards are planned for.
struct Nodes {
  int count = 0;
  int cpus = 0;                 ///< fewest of a node
  std::int64_t memory_mib = 0;  ///< largest of a node
};

Nodes nodes_of_cluster(const std::string& partition) {
  std::vector<std::string> words = {"sinfo", "--noheader", "--Node", "--format=%N|%c|%m"};
  if (!partition.empty()) words.push_back("--partition=" + partition);
  const std::string text = call_slurm(words);
  std::istringstream lines(text);
  Nodes nodes;
  std::set<std::string> names;
  for (std::string line; std::getline(lines, line);) {
    char name[256];
    int cpus = 0;
    long long memory = 0;
    if (std::sscanf(line.c_str(), "%255[^|]|%d|%lld", name, &cpus, &memory) != 3 || cpus < 1) continue;
    names.insert(name);
    nodes.cpus = nodes.cpus == 0 ? cpus : std::min(nodes.cpus, cpus);
    nodes.memory_mib = std::max<std::int64_t>(nodes.memory_mib, memory);
  }
  nodes.count = static_cast<int>(names.size());
  if (nodes.count == 0)
    throw InputError("--partition " + partition + ": Slurm lists no nodes; 'sinfo' lists its partitions");
  return nodes;
}

/// Submits what of the last round has not been submitted. A process may have been killed between sbatch and
/// writing the number down; so jobs of the round's names are looked for first.
void submit_round(ClusterJob& job) {
  const std::size_t last = job.rounds.size() - 1;
  Round& round = job.rounds[last];
  if (round.array_job != 0 && round.merge_job != 0) return;
  for (const QueuedTask& entry : queue_from_text(call_slurm(queue_command(job)))) {
    if (entry.name == array_name(job, last)) round.array_job = entry.job;
    if (entry.name == merge_name(job, last)) round.merge_job = entry.job;
  }
  if (round.array_job == 0) round.array_job = submitted_job(array_command(job, last));
  write_cluster_job(job);
  if (round.merge_job == 0) round.merge_job = submitted_job(merge_command(job, last));
  write_cluster_job(job);
}

void merge_shards(ClusterJob& job) {
  const auto start = Clock::now();
  std::vector<fs::path> parts;
  for (int shard = 1; shard <= job.shards; ++shard) parts.push_back(shard_file(job, shard));
  {
    const OutputLock lock(job.output, parts, ".rfield");
    merge_field_parts(parts, job.output, run_context());
    report::write_run_log(job.output, "merge", std::chrono::duration<double>(Clock::now() - start).count(),
                          {{"parts", parts.size()}, {"rounds", job.rounds.size()}});
  }
  job.outcome = Outcome::complete;
  write_cluster_job(job);
  std::error_code ignored;
  fs::remove_all(job.folder / "shards", ignored);
}

void fail(ClusterJob& job, const std::string& message) {
  job.outcome = Outcome::failed;
  job.message = message;
  write_cluster_job(job);
}

/// Merges the shards. One that is damaged is put aside, and is missing then; false where that happened.
bool merged_shards(ClusterJob& job) {
  try {
    merge_shards(job);
    return true;
  } catch (const FormatError& damage) {
    if (damage.path().parent_path() != job.folder / "shards") throw;
    run_context().note(std::string(damage.what()) + "; put aside as " + damage.path().filename().string() +
                       ".damaged");
    fs::rename(damage.path(), damage.path().string() + ".damaged");
    return false;
  }
}

/// Shards that were refused start from the first row: what refused them may be their finished rows.
void discard_refused_rows(const ClusterJob& job, const std::vector<int>& shards) {
  std::error_code ignored;
  for (const int shard : shards)
    if (task_end(job, shard, {}).status == 2)
      fs::remove_all(shard_file(job, shard).string() + ".partial", ignored);
}

/// Brings a Slurm job one step on when none of its tasks is active: merges the shards, or submits those that
/// are missing again. Called by the merge job, and by a follower that finds no job left.
void advance(const fs::path& folder) {
  const OutputLock lock(folder / "job.json", {});
  ClusterJob job = read_cluster_job(folder);
  if (job.outcome != Outcome::running) return;
  if (job.rounds.back().array_job == 0 || job.rounds.back().merge_job == 0) return submit_round(job);
  const auto queue = queue_from_text(call_slurm(queue_command(job)));
  for (const QueuedTask& entry : queue)
    if (entry.task && entry.is_active()) return;
  try {
    if (missing_shards(job).empty() && merged_shards(job)) return;
    const std::vector<int> missing = missing_shards(job);
    std::map<int, TaskEnd> ends;
    for (const int shard : missing) ends[shard] = task_end(job, shard, queue);
    const NextRound next = next_round(job, ends);
    for (const std::string& note : next.notes) run_context().note(note);
    if (!next.round) return fail(job, next.failure);
    job.rounds.push_back(*next.round);
    discard_refused_rows(job, missing);
    write_cluster_job(job);
    submit_round(job);
  } catch (const Error& error) {
    fail(job, std::string(error.what()) + "; see " + (job.folder / "log" / "merge.log").string());
  }
}

std::string how_to_go_on(const ClusterJob& job) {
  return "follow with:  refield submit " + job.folder.string() + "\nstop with:    refield submit " +
         job.folder.string() + " --cancel";
}

/// Writes the outcome of a job that has ended.
void print_end(const ClusterJob& job, const Common& common) {
  if (job.outcome == Outcome::failed)
    throw InputError(job.message + "\nThe other shards are kept; 'refield submit " + job.folder.string() +
                     " --resume' submits those that are missing");
  if (job.outcome == Outcome::cancelled)
    throw InputError(job.folder.string() + ": the job was cancelled; its " +
                     std::to_string(job.shards - missing_shards(job).size()) +
                     " completed shards are kept; --resume continues with the others");
  if (common.json) {
    const nlohmann::ordered_json figures = {
        {"field", job.output.string()}, {"shards", job.shards}, {"submissions", job.rounds.size()}};
    print_json(figures);
  } else {
    std::printf("%s: merged from %d shards, %zu submission%s\n", job.output.c_str(), job.shards,
                job.rounds.size(), job.rounds.size() == 1 ? "" : "s");
  }
}

/// Where a job stands, as the progress bar shows it.
struct Standing {
  int running = 0;
  int waiting = 0;
  int requeued = 0;
  bool is_active = false;
};

Standing standing_of(const std::vector<QueuedTask>& queue) {
  Standing standing;
  for (const QueuedTask& entry : queue) {
    standing.is_active |= entry.is_active();
    if (!entry.task) continue;
    standing.requeued += entry.restarts;
    if (!entry.is_active()) continue;
    ++(entry.state == "RUNNING" || entry.state == "COMPLETING" ? standing.running : standing.waiting);
  }
  return standing;
}

/// Shows the shards on the progress bar. A shard of which only the time left is of interest counts from now.
class ShardProgress {
 public:
  explicit ShardProgress(const ClusterJob& job)
      : shards_(job.shards),
        at_start_(static_cast<int>(missing_shards(job).size())),
        missing_(at_start_),
        progress_(run_context(), "estimate on cluster", std::max<std::uint64_t>(1, at_start_)) {}
  ~ShardProgress() { set_progress_detail(""); }

  void update(const ClusterJob& job, const std::string& detail) {
    const int missing = static_cast<int>(missing_shards(job).size());
    set_progress_detail(std::to_string(shards_ - missing) + " of " + std::to_string(shards_) + " shards" +
                        detail);
    progress_.advance(static_cast<std::uint64_t>(std::max(0, missing_ - missing)));
    missing_ = std::min(missing_, missing);
  }

 private:
  int shards_, at_start_, missing_;
  Progress progress_;
};

/// Releases tasks that Slurm holds since their node could not start them; each a few times.
void release_held(const std::vector<QueuedTask>& queue, std::map<int, int>& released) {
  constexpr int max_releases = 5;
  for (const QueuedTask& entry : queue) {
    if (!entry.is_held || !entry.task || ++released[*entry.task] > max_releases) continue;
    run_context().note("a node could not start shard " + std::to_string(*entry.task) +
                       "; released to run again");
    run_command({"scontrol", "release", std::to_string(entry.job) + "_" + std::to_string(*entry.task)});
  }
}

/// Follows a job of Slurm until it has ended, and helps where no job of it is left.
ClusterJob follow(const fs::path& folder) {
  ClusterJob job = read_cluster_job(folder);
  std::size_t rounds_told = job.rounds.size();
  ShardProgress progress(job);
  bool was_idle = false, is_told = false;
  std::map<int, int> released;  // number of times, by shard
  for (const auto start = Clock::now();;) {
    job = read_cluster_job(folder);
    if (job.outcome != Outcome::running) return job;
    for (; rounds_told < job.rounds.size(); ++rounds_told)
      run_context().note("submitted again, see " + (folder / "log" / "merge.log").string() + ": shards " +
                         array_text(job.rounds[rounds_told].shards));
    const CommandOutput listed = run_command(queue_command(job));
    if (listed.status == 127) refuse_command({"squeue"}, listed);
    if (listed.status == 0) {
      const auto queue = queue_from_text(listed.text);
      release_held(queue, released);
      const Standing standing = standing_of(queue);
      progress.update(job, ", " + std::to_string(standing.running) + " running, " +
                               std::to_string(standing.waiting) + " waiting, " +
                               std::to_string(standing.requeued) + " requeued");
      // The merge job may just have ended; what it wrote is read first.
      if (!standing.is_active && was_idle) advance(folder);
      was_idle = !standing.is_active && !was_idle;
      is_told = false;
    } else {
      if (!is_told) run_context().note("squeue does not answer; the jobs go on");
      is_told = true;
    }
    pause_for(std::clamp<Clock::duration>((Clock::now() - start) / 20, std::chrono::seconds(1),
                                          std::chrono::seconds(20)));
  }
}

/// Estimates the missing shards with GNU parallel, in this process' lifetime, and merges them.
void run_parallel(ClusterJob& job) {
  const OutputLock lock(job.folder / "job.json", {});
  std::vector<std::string> words = {"parallel", "--will-cite", "--retries", "3", "--jobs", "1"};
  words.insert(words.end(), job.sbatch.begin(), job.sbatch.end());
  words.insert(words.end(), {"sh", (job.folder / "shard.sh").string(), "{}", ":::"});
  for (const int shard : missing_shards(job)) words.push_back(std::to_string(shard));
  if (words.back() != ":::") {
    ShardProgress progress(job);
    auto ended = std::async(std::launch::async, [&] { return run_command(words); });
    while (ended.wait_for(std::chrono::seconds(1)) != std::future_status::ready) progress.update(job, "");
    run_context().throw_if_stopped();
    const CommandOutput output = ended.get();
    if (output.status == 127 && output.text.find("parallel") != std::string::npos)
      throw InputError("parallel: is not installed; install GNU parallel, or remove --hosts to use Slurm");
    std::string failed;
    for (const int shard : missing_shards(job)) failed += "\n  " + shard_log(job, shard).string();
    if (!failed.empty())
      return fail(job, "shards are missing after three runs each; see" + failed + "\n" + output.text);
  }
  if (!merged_shards(job)) fail(job, "a shard is damaged");
}

void go_on(const fs::path& folder, const Common& common) {
  ClusterJob job = read_cluster_job(folder);
  if (job.engine == "parallel") {
    if (job.outcome == Outcome::running) run_parallel(job);
    return print_end(job, common);
  }
  try {
    print_end(follow(folder), common);
  } catch (const Interrupted&) {
    std::fprintf(stderr, "\nrefield: detached; the jobs go on\n%s\n", how_to_go_on(job).c_str());
    throw Detached();
  }
}

void resume(const fs::path& folder, const Common& common) {
  {
    const OutputLock lock(folder / "job.json", {});
    ClusterJob job = read_cluster_job(folder);
    if (job.outcome == Outcome::complete) return print_end(job, common);
    if (job.engine == "slurm") {
      for (const QueuedTask& entry : queue_from_text(call_slurm(queue_command(job))))
        if (entry.task && entry.is_active())
          throw InputError(folder.string() +
                           ": its tasks are still queued or running; remove --resume to follow them");
      Round round{missing_shards(job), job.rounds.back().limits};
      job.first_round = static_cast<int>(job.rounds.size());
      // Without shards to estimate only the merge is left, which advance() does.
      if (!round.shards.empty()) job.rounds.push_back(round);
    }
    job.outcome = Outcome::running;
    job.message.clear();
    discard_refused_rows(job, missing_shards(job));
    write_scripts(job);
    write_cluster_job(job);
    if (job.engine == "slurm") submit_round(job);
  }
  go_on(folder, common);
}

void cancel(const fs::path& folder) {
  ClusterJob job = read_cluster_job(folder);
  if (job.outcome == Outcome::complete)
    throw InputError(folder.string() + ": the job is complete; there is nothing to cancel");
  job.outcome = Outcome::cancelled;
  write_cluster_job(job);
  std::set<std::string> jobs;
  if (job.engine == "slurm")
    for (const QueuedTask& entry : queue_from_text(call_slurm(queue_command(job))))
      if (entry.is_active()) jobs.insert(std::to_string(entry.job));
  if (!jobs.empty()) {
    std::vector<std::string> words = {"scancel"};
    words.insert(words.end(), jobs.begin(), jobs.end());
    call_slurm(words);
  }
  std::printf(
      "cancelled; %zu of %d shards are complete and kept\ncontinue with: refield submit %s --resume\n",
      job.shards - missing_shards(job).size(), job.shards, folder.c_str());
}

std::string job_name(const fs::path& output) {
  std::string name = "refield-";
  for (const char c : output.stem().string())
    name += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return name + formatted("-%06x", std::random_device{}() & 0xffffffu);
}

std::string threads_text(const ClusterJob& job) {
  return job.threads > 0 ? std::to_string(job.threads) : "all";
}

/// Shards, processors, memory and time from the cost of the estimation, as measured on this machine.
std::pair<ClusterJob, CostEstimate> plan(SubmitArguments& arguments) {
  CaptureSession session = open_estimation(arguments);
  ClusterJob job;
  const bool uses_slurm = arguments.hosts.empty();
  job.engine = uses_slurm ? "slurm" : "parallel";
  const Nodes nodes = uses_slurm
                          ? nodes_of_cluster(arguments.partition)
                          : Nodes{1 + static_cast<int>(std::ranges::count(arguments.hosts, ',')), 0, 0};
  EstimateOptions& options = arguments.options;
  const bool has_threads = options.threads > 0;
  job.threads = has_threads ? options.threads : nodes.cpus;
  if (uses_slurm && job.threads > nodes.cpus)
    throw InputError("--threads " + std::to_string(job.threads) + ": a node of the cluster has " +
                     std::to_string(nodes.cpus) + " processors; give at most that");
  const int used_nodes = arguments.nodes > 0 ? arguments.nodes : nodes.count;
  if (uses_slurm && arguments.nodes > 0) job.tasks_at_once = used_nodes * (nodes.cpus / job.threads);
  job.node_memory_mib = nodes.memory_mib;

  options.threads = job.threads;
  const CostEstimate cost = estimate_cost(session, options, run_context());
  const int height = cost.plan.rows.count();
  constexpr int shards_per_node = 4, min_rows = 16;
  job.shards = arguments.shards > 0
                   ? arguments.shards
                   : std::clamp(used_nodes * shards_per_node, 1, std::max(1, height / min_rows));
  if (job.shards > height)
    throw InputError("--shards " + std::to_string(job.shards) + ": the images have only " +
                     std::to_string(height) + " rows; give at most that");
  options.rows = RowRange{0, (height + job.shards - 1) / job.shards};
  const EstimatePlan shard_plan = plan_estimate(session, options, run_context());
  constexpr double mib = 1024.0 * 1024.0;
  // A node may use more for the same work, and be slower than this machine; rows differ in cost.
  constexpr double memory_margin = 1.25, time_margin = 3.0;
  constexpr std::int64_t more_mib = 256, min_minutes = 10;
  TaskLimits limits;
  limits.memory_mib =
      arguments.task_memory_gib > 0.0
          ? static_cast<std::int64_t>(std::ceil(arguments.task_memory_gib * 1024.0))
          : static_cast<std::int64_t>(memory_margin * static_cast<double>(shard_plan.memory_bytes) / mib) +
                more_mib;
  const double seconds =
      cost.check_seconds + cost.lights_seconds + (cost.photographs_seconds + cost.fit_seconds) / job.shards;
  limits.minutes = !arguments.time.empty()
                       ? minutes_from_text(arguments.time)
                       : min_minutes + static_cast<std::int64_t>(time_margin * seconds / 60.0);
  const double megapixels = 1e-6 * height * read_image_header(session.frames.front().observed).width;
  // Up to 25 kernels per pixel of one shard at a time; of all where light sources are interpolated between.
  const bool holds_all = session.light.parameterisation == Parameterisation::lat_long;
  const double bytes_per_pixel = holds_all ? 800.0 : 140.0 + 800.0 / job.shards;
  job.merge_limits = {1024 + static_cast<std::int64_t>(megapixels * bytes_per_pixel),
                      min_minutes + static_cast<std::int64_t>(megapixels)};
  if (nodes.memory_mib > 0) {
    job.merge_limits.memory_mib = std::min(job.merge_limits.memory_mib, nodes.memory_mib);
    if (arguments.task_memory_gib <= 0.0) limits.memory_mib = std::min(limits.memory_mib, nodes.memory_mib);
  }
  job.estimate = arguments.estimate;
  job.estimate.push_back("--threads=" + std::to_string(job.threads));
  job.sbatch = arguments.sbatch;
  if (!arguments.partition.empty()) job.sbatch.push_back("--partition=" + arguments.partition);
  if (!uses_slurm) {
    const bool is_file = fs::is_regular_file(arguments.hosts);
    job.sbatch.insert(job.sbatch.begin(), {is_file ? "--sshloginfile" : "--sshlogin", arguments.hosts});
  }
  job.rounds.resize(1);
  for (int shard = 1; shard <= job.shards; ++shard) job.rounds[0].shards.push_back(shard);
  job.rounds[0].limits = limits;
  run_context().note("submit: " + std::to_string(job.shards) + " shards of about " +
                     std::to_string(std::lround(seconds)) + " s, each with " + threads_text(job) +
                     " threads, " + std::to_string(limits.memory_mib) + " MiB and at most " +
                     std::to_string(limits.minutes) + " min");
  return {job, cost};
}

void submit(SubmitArguments arguments, const Common& common) {
  if (arguments.output.empty()) throw InputError("--output is missing; add -o NAME.rfield");
  const CaptureOptions& capture = arguments.capture;
  fs::path folder = fs::absolute(arguments.output + ".shards").lexically_normal();
  ClusterJob job;
  CostEstimate cost;
  {
    // Of the output only while nothing is submitted; the job that merges takes it then.
    const OutputLock lock(arguments.output, {capture.session, capture.light, capture.observed, capture.mask},
                          ".rfield");
    if (fs::exists(folder / "job.json") && read_cluster_job(folder).outcome != Outcome::complete)
      throw InputError(
          folder.string() + ": holds shards of an earlier submission; follow it with 'refield submit " +
          folder.string() + "', continue it with --resume, or --cancel it and remove the folder");
    std::tie(job, cost) = plan(arguments);
    job.folder = folder;
    job.output = fs::absolute(arguments.output).lexically_normal();
    job.name = job_name(job.output);
    job.directory = fs::current_path();
    job.program = fs::read_symlink("/proc/self/exe");
    if (arguments.dry_run) {
      std::printf("%d shards, %s threads and %lld MiB each, at most %lld min; nothing was submitted\n",
                  job.shards, threads_text(job).c_str(),
                  static_cast<long long>(job.rounds[0].limits.memory_mib),
                  static_cast<long long>(job.rounds[0].limits.minutes));
      return;
    }
    fs::remove_all(folder);
    for (const char* name : {"shards", "end", "log"}) create_folders(folder / name);
    write_text_atomically(folder / "shards" / frame_check_name, cost.frame_check);
    write_scripts(job);
    write_cluster_job(job);
  }
  if (job.engine == "slurm") {
    const OutputLock lock(folder / "job.json", {});
    submit_round(job);
  }
  if (arguments.detach && job.engine == "slurm") {
    std::printf("submitted %d shards as Slurm job %lld\n%s\n", job.shards,
                static_cast<long long>(job.rounds[0].array_job), how_to_go_on(job).c_str());
    return;
  }
  go_on(folder, common);
}

void run_submit(const SubmitArguments& arguments, const Common& common) {
  const bool is_submission = fs::exists(fs::path(arguments.capture.session) / "job.json");
  if (!is_submission && (arguments.resume || arguments.cancel || arguments.finish))
    throw InputError("'" + arguments.capture.session +
                     "': is not the folder of a submission; give OUTPUT.shards for --resume and --cancel");
  if (!is_submission) return submit(arguments, common);
  const fs::path folder = read_cluster_job(arguments.capture.session).folder;  // absolute; checked
  if (arguments.finish) return advance(folder);
  if (arguments.resume) return resume(folder, common);
  if (arguments.cancel) return cancel(folder);
  go_on(folder, common);
}

/// The options that were given, as words.
std::vector<std::string> words_of(const std::vector<CLI::Option*>& options) {
  std::vector<std::string> words;
  for (const CLI::Option* option : options) {
    if (option->count() == 0) continue;
    const bool is_flag = option->get_expected_max() == 0;
    if (is_flag) words.push_back(option->get_name());
    for (const std::string& value : is_flag ? std::vector<std::string>{} : option->results())
      words.push_back(option->get_positional() ? value : option->get_name() + "=" + value);
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
      "per shard come from the cost estimate of 'refield estimate --dry-run'. Shards that lose their node, "
      "exceed a limit or are killed are submitted again, with more memory or time, up to three times. "
      "Session, program and output must have the same path on all nodes.\n"
      "\n"
      "The command follows the jobs; Ctrl-C detaches from them, and they continue. Scripts, logs and shards "
      "are in the folder OUTPUT.shards.\n"
      "\n"
      "Beside the options listed here, those of 'refield estimate' are accepted.\n"
      "\n"
      "Examples:\n"
      "  refield submit session -o scene.rfield --nodes 8 --partition compute\n"
      "  refield submit scene.rfield.shards                # follow\n"
      "  refield submit scene.rfield.shards --cancel\n"
      "  refield submit scene.rfield.shards --resume\n"
      "  refield submit session -o scene.rfield --hosts alice,bob");
  const std::size_t before = verb->get_options().size();
  add_estimation_options(*verb, *arguments);
  auto estimation = verb->get_options();
  estimation.erase(estimation.begin(), estimation.begin() + static_cast<std::ptrdiff_t>(before));
  for (CLI::Option* option : estimation) option->group("");
  verb->get_option("session")
      ->description("Capture session (folder), or OUTPUT.shards of a submission")
      ->group("Options");
  std::erase_if(estimation, [](const CLI::Option* option) { return option->get_name() == "--threads"; });
  verb->add_option("-o,--output", arguments->output, "Reflectance field to write (.rfield)");
  verb->add_option("--shards", arguments->shards,
                   "Number of shards (default: four per node, of at least 16 rows each)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--nodes", arguments->nodes,
                   "Number of nodes whose processors the tasks use at the same time (default: no limit)")
      ->check(CLI::Range(1, 100000));
  verb->add_option("--time-limit", arguments->time,
                   "Time limit of a task: minutes, HOURS:MM:SS or DAYS-HH:MM:SS (default: three times the "
                   "estimated time plus 10 minutes)");
  verb->add_option(
          "--task-memory", arguments->task_memory_gib,
          "Memory limit of a task in GiB (default: the estimated memory plus a quarter and 0.25 GiB)")
      ->check(non_negative_number());
  verb->add_option("--partition", arguments->partition, "Slurm partition (default: that of the cluster)");
  verb->add_option("--sbatch", arguments->sbatch,
                   "Further option of sbatch, such as --sbatch=--account=optics; repeat it for each");
  verb->add_option("--hosts", arguments->hosts,
                   "Run the shards by GNU parallel over ssh instead of Slurm, until this command ends: "
                   "hosts, separated by commas, or a file with one per line; ':' is this machine");
  verb->add_flag("--detach", arguments->detach, "Submit the jobs and do not follow them");
  add_dry_run_flag(*verb, arguments->dry_run)->group("");
  verb->add_flag("--resume", arguments->resume,
                 "Continue an interrupted run: submit the missing shards of OUTPUT.shards again, and follow");
  verb->add_flag("--cancel", arguments->cancel,
                 "Cancel the jobs of OUTPUT.shards; completed shards are kept for --resume");
  verb->add_flag("--finish", arguments->finish,
                 "Merge the shards of OUTPUT.shards, or submit the missing ones again; the last job of a "
                 "submission runs this")
      ->group("");
  verb->callback([arguments, estimation, &common, &action] {
    arguments->estimate = words_of(estimation);
    action = [arguments, &common] { run_submit(*arguments, common); };
  });
}

}  // namespace refield::cli
