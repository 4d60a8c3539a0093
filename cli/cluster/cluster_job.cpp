// SPDX-License-Identifier: Apache-2.0
#include "cli/cluster/cluster_job.h"

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json_text.h"

namespace refield::cli {

namespace fs = std::filesystem;

NLOHMANN_JSON_SERIALIZE_ENUM(Outcome, {{Outcome::running, "running"},
                                       {Outcome::complete, "complete"},
                                       {Outcome::failed, "failed"},
                                       {Outcome::cancelled, "cancelled"}})
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TaskLimits, memory_mib, minutes)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Round, shards, limits, array_job, merge_job)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ClusterJob, name, engine, output, directory, program, estimate, sbatch,
                                   shards, tasks_at_once, threads, node_memory_mib, merge_limits, rounds,
                                   first_round, outcome, message)

namespace {

constexpr const char* state_name = "job.json";

/// Seconds before its time limit at which a task is asked to stop. It keeps its finished rows.
constexpr int stop_seconds = 30;

std::string quoted(const std::string& word) {
  std::string result = "'";
  for (const char c : word) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

fs::path end_file(const ClusterJob& job, int shard) {
  return job.folder / "end" / std::to_string(shard);
}

/// What the program and Slurm, which polls or has control groups, write of a task without memory. Slurm's
/// state is OUT_OF_MEMORY only with control groups.
bool lacked_memory(const fs::path& log) {
  constexpr std::streamoff tail = 4096;
  std::ifstream file(log, std::ios::binary | std::ios::ate);
  if (!file) return false;
  file.seekg(std::max<std::streamoff>(0, file.tellg() - tail));
  std::ostringstream read;
  read << file.rdbuf();
  return std::ranges::any_of(
      std::initializer_list<const char*>{"refield: out of memory", "Exceeded job memory limit",
                                         "exceeded memory limit (", "oom-kill", "oom_kill"},
      [&](const char* text) { return read.str().find(text) != std::string::npos; });
}

/// What both jobs of a round have in common.
std::vector<std::string> sbatch_command(const ClusterJob& job, const std::string& name,
                                        const TaskLimits& limits, int cpus, const fs::path& log) {
  std::vector<std::string> words = {"sbatch", "--parsable"};
  words.insert(words.end(), job.sbatch.begin(), job.sbatch.end());
  for (const std::string& word :
       {"--job-name=" + name, std::string("--nodes=1"), std::string("--ntasks=1"),
        "--cpus-per-task=" + std::to_string(cpus), "--mem=" + std::to_string(limits.memory_mib) + "M",
        "--time=" + std::to_string(limits.minutes), std::string("--requeue"),
        std::string("--open-mode=append"), "--output=" + log.string()})
    words.push_back(word);
  return words;
}

int runs_of(const ClusterJob& job, int shard) {
  return static_cast<int>(
      std::count_if(job.rounds.begin() + job.first_round, job.rounds.end(),
                    [&](const Round& round) { return std::ranges::count(round.shards, shard) > 0; }));
}

}  // namespace

ClusterJob read_cluster_job(const fs::path& folder) {
  const fs::path file = folder / state_name;
  std::error_code error;
  if (!fs::exists(file, error))
    throw InputError(folder.string() +
                     ": is not the folder of a submitted job; give OUTPUT.shards, which 'refield submit' "
                     "writes beside the field");
  try {
    auto job = nlohmann::json::parse(read_text(file)).get<ClusterJob>();
    job.folder = fs::absolute(folder).lexically_normal();
    if (!job.folder.has_filename()) job.folder = job.folder.parent_path();
    if (job.first_round < 0 || job.first_round > static_cast<int>(job.rounds.size()) || job.shards < 1)
      throw FormatError(file, "numbers of rounds or shards contradict each other");
    return job;
  } catch (const nlohmann::json::exception& damage) {
    throw FormatError(file,
                      std::string("is damaged (") + damage.what() + "); remove the folder and submit again");
  }
}

void write_cluster_job(const ClusterJob& job) {
  write_text_atomically(job.folder / state_name,
                        json_text(nlohmann::ordered_json(nlohmann::json(job)), 2) + "\n");
}

fs::path shard_file(const ClusterJob& job, int shard) {
  return job.folder / "shards" / (std::to_string(shard) + ".rfield");
}

fs::path shard_log(const ClusterJob& job, int shard) {
  return job.folder / "log" / ("shard-" + std::to_string(shard) + ".log");
}

std::vector<int> missing_shards(const ClusterJob& job) {
  std::vector<int> missing;
  std::error_code error;
  for (int shard = 1; shard <= job.shards; ++shard)
    if (!fs::exists(shard_file(job, shard), error)) missing.push_back(shard);
  return missing;
}

void write_scripts(const ClusterJob& job) {
  std::vector<std::string> estimate = {job.program.string(), "estimate"};
  estimate.insert(estimate.end(), job.estimate.begin(), job.estimate.end());
  const std::string n = std::to_string(job.shards);
  write_text_atomically(
      job.folder / "shard.sh",
      "#!/bin/sh\n"
      "# Written by refield submit. Estimates one of " +
          n +
          " shards: a task of a Slurm job array, or sh shard.sh N.\n"
          "shard=${1:-$SLURM_ARRAY_TASK_ID}\n"
          "cd " +
          quoted(job.directory.string()) +
          " || exit 2\n"
          "folder=" +
          quoted(job.folder.string()) +
          "\n"
          "[ -n \"$SLURM_ARRAY_TASK_ID\" ] || exec >>\"$folder/log/shard-$shard.log\" 2>&1\n"
          "rm -f \"$folder/end/$shard\"\n"
          "trap 'kill -TERM $estimate' TERM INT\n" +
          shell_words(estimate) + " --rows \"$shard/" + n +
          "\" --resume -o \"$folder/shards/$shard.rfield\" &\n"
          "estimate=$!\n"
          "wait $estimate\n"
          "status=$?\n"
          "while kill -0 $estimate 2>/dev/null; do  # a signal ended the waiting\n"
          "  wait $estimate\n"
          "  status=$?\n"
          "done\n"
          "echo \"$status $(uname -n) ${SLURMD_NODENAME:-}\" >\"$folder/end/$shard\"\n"
          "exit $status\n");
  write_text_atomically(
      job.folder / "merge.sh",
      "#!/bin/sh\n"
      "# Written by refield submit. Merges the shards, or submits those that are missing again.\n"
      "exec " +
          shell_words({job.program.string(), "submit", job.folder.string(), "--finish"}) + "\n");
}

std::string shell_words(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : " ") + quoted(word);
  return text;
}

std::string array_text(const std::vector<int>& shards) {
  std::string text;
  for (std::size_t i = 0; i < shards.size();) {
    std::size_t last = i;
    while (last + 1 < shards.size() && shards[last + 1] == shards[last] + 1) ++last;
    text += (text.empty() ? "" : ",") + std::to_string(shards[i]);
    if (last > i) text += "-" + std::to_string(shards[last]);
    i = last + 1;
  }
  return text;
}

std::int64_t minutes_from_text(const std::string& text) {
  int days = 0, hours = 0, minutes = 0, seconds = 0, length = 0;
  const auto is_all = [&](int fields, int wanted) {
    return fields == wanted && length == static_cast<int>(text.size());
  };
  const bool is_time =
      is_all(std::sscanf(text.c_str(), "%9d%n", &minutes, &length), 1) ||
      is_all(std::sscanf(text.c_str(), "%5d:%2d:%2d%n", &hours, &minutes, &seconds, &length), 3) ||
      is_all(std::sscanf(text.c_str(), "%4d-%2d:%2d:%2d%n", &days, &hours, &minutes, &seconds, &length), 4);
  const std::int64_t total = (std::int64_t{days} * 24 + hours) * 60 + minutes + (seconds > 0 ? 1 : 0);
  if (!is_time || days < 0 || hours < 0 || minutes < 0 || seconds < 0 || total < 1)
    throw InputError("--time-limit " + text + ": is not a time; give minutes, HOURS:MM:SS or DAYS-HH:MM:SS");
  return total;
}

std::string array_name(const ClusterJob& job, std::size_t round) {
  return job.name + "." + std::to_string(round + 1);
}

std::string merge_name(const ClusterJob& job, std::size_t round) {
  return array_name(job, round) + ".merge";
}

std::vector<std::string> array_command(const ClusterJob& job, std::size_t round) {
  const Round& r = job.rounds[round];
  auto words =
      sbatch_command(job, array_name(job, round), r.limits, job.threads, job.folder / "log" / "shard-%a.log");
  words.push_back("--array=" + array_text(r.shards) +
                  (job.tasks_at_once > 0 ? "%" + std::to_string(job.tasks_at_once) : ""));
  // To the script alone, which passes it on.
  words.push_back("--signal=B:TERM@" + std::to_string(stop_seconds));
  words.push_back((job.folder / "shard.sh").string());
  return words;
}

std::vector<std::string> merge_command(const ClusterJob& job, std::size_t round) {
  auto words =
      sbatch_command(job, merge_name(job, round), job.merge_limits, 1, job.folder / "log" / "merge.log");
  words.push_back("--dependency=afterany:" + std::to_string(job.rounds[round].array_job));
  words.push_back((job.folder / "merge.sh").string());
  return words;
}

bool QueuedTask::is_active() const {
  static const std::set<std::string> ended = {"BOOT_FAIL", "CANCELLED", "COMPLETED",     "DEADLINE",
                                              "FAILED",    "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED",
                                              "REVOKED",   "TIMEOUT"};
  return !ended.contains(state);
}

std::vector<std::string> queue_command(const ClusterJob& job) {
  std::string names;
  for (std::size_t round = 0; round < job.rounds.size(); ++round)
    names += (names.empty() ? "" : ",") + array_name(job, round) + "," + merge_name(job, round);
  return {"squeue",          "--noheader",
          "--array",         "--states=all",
          "--name=" + names, "--Format=Name:|,ArrayJobID:|,ArrayTaskID:|,State:|,RestartCnt:|,Reason:|"};
}

std::vector<QueuedTask> queue_from_text(const std::string& text) {
  std::vector<QueuedTask> queue;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream fields(line);
    std::string job, task, restarts;
    QueuedTask entry;
    if (!std::getline(fields, entry.name, '|') || !std::getline(fields, job, '|') ||
        !std::getline(fields, task, '|') || !std::getline(fields, entry.state, '|') ||
        !std::getline(fields, restarts, '|'))
      continue;
    const auto is_number = [](const std::string& word) {
      return !word.empty() && word.size() < 10 && word.find_first_not_of("0123456789") == std::string::npos;
    };
    if (!is_number(job)) continue;
    entry.job = std::stoll(job);
    if (is_number(task)) entry.task = std::stoi(task);
    if (is_number(restarts)) entry.restarts = std::stoi(restarts);
    if (std::string reason; std::getline(fields, reason, '|'))
      entry.is_held = entry.state == "PENDING" && reason.find("requeued") != std::string::npos &&
                      reason.find("held") != std::string::npos;
    queue.push_back(std::move(entry));
  }
  return queue;
}

TaskEnd task_end(const ClusterJob& job, int shard, const std::vector<QueuedTask>& queue) {
  TaskEnd end;
  const std::int64_t array_job = job.rounds.empty() ? 0 : job.rounds.back().array_job;
  for (const QueuedTask& entry : queue)
    if (entry.job == array_job && entry.task == shard) end.state = entry.state;
  std::ifstream record(end_file(job, shard));
  if (int status = 0; record >> status) {
    end.status = status;
    for (std::string word; record >> word;) end.host = word;  // Slurm's name of the node, where there is one
  }
  end.out_of_memory = (!end.status || end.status == 2) && lacked_memory(shard_log(job, shard));
  return end;
}

Retry retry_after(const TaskEnd& end, const TaskLimits& limits, std::int64_t node_memory_mib) {
  Retry retry{limits, ""};
  const auto more_memory = [&] {
    retry.limits.memory_mib *= 2;
    if (node_memory_mib > 0)
      retry.limits.memory_mib =
          std::max(limits.memory_mib, std::min(retry.limits.memory_mib, node_memory_mib));
  };
  const std::string memory = "its memory limit of " + std::to_string(limits.memory_mib) + " MiB";
  const int status = end.status.value_or(0);
  const bool was_stopped = status == 130 || status == 143;
  if (end.state == "OUT_OF_MEMORY" || end.out_of_memory || end.status == 137) {
    more_memory();
    retry.reason = end.status == 137 && end.state != "OUT_OF_MEMORY"
                       ? "was killed, as for exceeding " + memory
                       : "exceeded " + memory;
  } else if (end.state == "TIMEOUT" || end.state == "DEADLINE" || was_stopped) {
    retry.limits.minutes *= 2;
    retry.reason = "exceeded its time limit of " + std::to_string(limits.minutes) + " min";
  } else if (end.state == "NODE_FAIL" || end.state == "BOOT_FAIL" || end.state == "PREEMPTED") {
    retry.reason = "lost its node";
  } else if (!end.status) {
    more_memory();
    retry.limits.minutes *= 2;
    retry.reason = end.state == "CANCELLED" ? "was cancelled" : "ended without an exit status";
  } else if (*end.status == 0) {
    retry.reason = "is missing or damaged although its task succeeded";
  } else {
    retry.reason = "ended with exit status " + std::to_string(*end.status);
    retry.max_runs = 2;  // a refusal is likely to come again
  }
  if (!end.host.empty()) retry.reason += " on " + end.host;
  return retry;
}

NextRound next_round(const ClusterJob& job, const std::map<int, TaskEnd>& ends) {
  NextRound next;
  Round round{{}, job.rounds.back().limits};
  for (const auto& [shard, end] : ends) {
    const Retry retry = retry_after(end, job.rounds.back().limits, job.node_memory_mib);
    const std::string what = "shard " + std::to_string(shard) + " " + retry.reason;
    const int runs = runs_of(job, shard);
    if (runs >= retry.max_runs) {
      next.failure += (next.failure.empty() ? "" : "\n  ") + what + " in run " + std::to_string(runs) +
                      "; see " + shard_log(job, shard).string();
      continue;
    }
    round.shards.push_back(shard);
    round.limits.memory_mib = std::max(round.limits.memory_mib, retry.limits.memory_mib);
    round.limits.minutes = std::max(round.limits.minutes, retry.limits.minutes);
    next.notes.push_back(what + "; submitted again");
  }
  if (next.failure.empty() && !round.shards.empty()) next.round = round;
  return next;
}

}  // namespace refield::cli
