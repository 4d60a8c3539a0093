// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace refield::cli {

/// What a task may use of its node. Slurm ends a task that uses more.
struct TaskLimits {
  std::int64_t memory_mib = 0;
  std::int64_t minutes = 0;
};

/// One submission of some shards: a job array, and the job that merges the shards once the array has ended.
struct Round {
  std::vector<int> shards;  ///< counted from 1
  TaskLimits limits;
  std::int64_t array_job = 0;  ///< Slurm's job number; 0: not submitted, or not recorded
  std::int64_t merge_job = 0;
};

enum class Outcome { running, complete, failed, cancelled };

/// The estimation of one field as shards. Everything lies in one folder, so that any process can take over at
/// any time: job.json (this structure), shard.sh and merge.sh (what the tasks run), shards/ (shards and
/// their finished rows), end/N (exit status of the last run of shard N, and its host) and log/.
struct ClusterJob {
  std::filesystem::path folder;       ///< absolute; not stored
  std::string name;                   ///< prefix of the names of Slurm's jobs, unique
  std::string engine = "slurm";       ///< or "parallel"
  std::filesystem::path output;       ///< absolute
  std::filesystem::path directory;    ///< working directory of the tasks
  std::filesystem::path program;      ///< refield
  std::vector<std::string> estimate;  ///< words after `refield estimate`
  std::vector<std::string> sbatch;    ///< further options of sbatch
  int shards = 0;
  int tasks_at_once = 0;             ///< limit of tasks that run at the same time; 0: none
  int threads = 0;                   ///< processors per task
  std::int64_t node_memory_mib = 0;  ///< no task can have more; 0: unknown
  TaskLimits merge_limits;
  std::vector<Round> rounds;
  int first_round = 0;  ///< first one since the last --resume; earlier failures do not count
  Outcome outcome = Outcome::running;
  std::string message;  ///< why it failed
};

/// Reads and writes FOLDER/job.json. Throws InputError where there is none, FormatError where it is damaged.
ClusterJob read_cluster_job(const std::filesystem::path& folder);
void write_cluster_job(const ClusterJob& job);

std::filesystem::path shard_file(const ClusterJob& job, int shard);
std::filesystem::path shard_log(const ClusterJob& job, int shard);
std::vector<int> missing_shards(const ClusterJob& job);

/// Writes shard.sh and merge.sh.
void write_scripts(const ClusterJob& job);

/// Words of a command, quoted for sh.
std::string shell_words(const std::vector<std::string>& words);

/// Shards as Slurm writes them in --array: "1-3,7".
std::string array_text(const std::vector<int>& shards);

/// Minutes from "90", "H:MM:SS" or "D-HH:MM:SS", rounded up. Throws InputError for anything else.
std::int64_t minutes_from_text(const std::string& text);

/// Names of Slurm's jobs of a round, counted from 0.
std::string array_name(const ClusterJob& job, std::size_t round);
std::string merge_name(const ClusterJob& job, std::size_t round);

/// The commands that submit a round's array and its merge job; both print the number of the job.
std::vector<std::string> array_command(const ClusterJob& job, std::size_t round);
std::vector<std::string> merge_command(const ClusterJob& job, std::size_t round);

/// A job or task of an array, as squeue lists it.
struct QueuedTask {
  std::string name;         ///< of the job
  std::int64_t job = 0;     ///< of the whole array
  std::optional<int> task;  ///< of an array
  std::string state;        ///< RUNNING, PENDING, NODE_FAIL, ...
  int restarts = 0;
  bool is_held = false;    ///< requeued by Slurm, but only to run when it is released
  bool is_active() const;  ///< running, or going to run
};

/// The command that lists all tasks of a job, those that have ended lately too, and what it printed.
std::vector<std::string> queue_command(const ClusterJob& job);
std::vector<QueuedTask> queue_from_text(const std::string& text);

/// How the last run of a shard that is missing ended.
struct TaskEnd {
  std::string state = {};          ///< Slurm's; empty where it has forgotten the task
  std::optional<int> status = {};  ///< exit status as the task recorded it; none for a task that was killed
  std::string host = {};           ///< empty: unknown
  bool out_of_memory = false;      ///< its log says so
};
TaskEnd task_end(const ClusterJob& job, int shard, const std::vector<QueuedTask>& queue);

/// What to do about a shard that is missing.
struct Retry {
  TaskLimits limits;
  std::string reason;  ///< "exceeded its memory limit of 2048 MiB"
  int max_runs = 4;    ///< including the first
};
Retry retry_after(const TaskEnd& end, const TaskLimits& limits, std::int64_t node_memory_mib);

/// The next round, with notes such as "shard 7: exceeded its time limit of 10 min; again with 20 min", or
/// why there is none, which names the shards that failed and their logs.
struct NextRound {
  std::optional<Round> round;
  std::vector<std::string> notes;
  std::string failure;
};
NextRound next_round(const ClusterJob& job, const std::map<int, TaskEnd>& ends);

}  // namespace refield::cli
