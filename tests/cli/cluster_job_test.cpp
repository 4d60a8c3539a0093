// SPDX-License-Identifier: Apache-2.0
// What `refield submit` knows without a cluster: its state on disk, Slurm's words, and what it does about
// failures. tests/cluster runs it on a real one.
#include "cli/cluster/cluster_job.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "tests/support/temporary_folder.h"

namespace refield::cli {
namespace {

using test::TemporaryFolder;
using testing::ElementsAre;
using testing::HasSubstr;

ClusterJob small_job(const std::filesystem::path& folder) {
  ClusterJob job;
  job.folder = folder;
  job.name = "refield-scene-00ff00";
  job.output = "/data/scene.rfield";
  job.directory = "/data";
  job.program = "/usr/bin/refield";
  job.estimate = {"it's a session", "--max-kernels=5"};
  job.sbatch = {"--account=optics"};
  job.shards = 5;
  job.tasks_at_once = 2;
  job.threads = 4;
  job.node_memory_mib = 6000;
  job.merge_limits = {1024, 10};
  job.rounds = {{{1, 2, 3, 4, 5}, {1000, 10}, 17, 18}};
  for (const char* name : {"shards", "end", "log"}) create_folders(folder / name);
  return job;
}

TEST(ClusterJob, SurvivesItsFile) {
  const TemporaryFolder folder;
  ClusterJob job = small_job(folder / "");
  job.outcome = Outcome::failed;
  job.message = "shard 3 ended";
  write_cluster_job(job);
  const ClusterJob read = read_cluster_job(folder / "");
  EXPECT_EQ(read.estimate, job.estimate);
  EXPECT_EQ(read.rounds[0].shards, job.rounds[0].shards);
  EXPECT_EQ(read.rounds[0].limits.memory_mib, 1000);
  EXPECT_EQ(read.rounds[0].array_job, 17);
  EXPECT_EQ(read.outcome, Outcome::failed);
  EXPECT_EQ(read.message, job.message);
}

TEST(ClusterJob, RefusesFoldersOfOtherKindsAndDamage) {
  const TemporaryFolder folder;
  EXPECT_THROW(read_cluster_job(folder / ""), InputError);
  for (const char* text : {"", "{}", "[1]", "{\"shards\": \"many\"}"}) {
    write_text_atomically(folder / "job.json", text);
    EXPECT_THROW(read_cluster_job(folder / ""), FormatError) << text;
  }
}

TEST(ClusterJob, MissingShardsAreThoseWithoutAFile) {
  const TemporaryFolder folder;
  const ClusterJob job = small_job(folder / "");
  for (const int shard : {1, 4}) write_text_atomically(shard_file(job, shard), "x");
  EXPECT_THAT(missing_shards(job), ElementsAre(2, 3, 5));
}

TEST(ClusterJob, WritesArraysAndTimesAsSlurmDoes) {
  EXPECT_EQ(array_text({1, 2, 3, 7, 9, 10}), "1-3,7,9-10");
  EXPECT_EQ(minutes_from_text("90"), 90);
  EXPECT_EQ(minutes_from_text("1:30:00"), 90);
  EXPECT_EQ(minutes_from_text("0:00:01"), 1);
  EXPECT_EQ(minutes_from_text("2-01:00:00"), 2 * 24 * 60 + 60);
  for (const char* text : {"", "0", "-5", "1:30", "5m", "1:00:00:00", "2-01"})
    EXPECT_THROW(minutes_from_text(text), InputError) << text;
}

TEST(ClusterJob, SubmitsTheMissingShardsAndADependentMerge) {
  const TemporaryFolder folder;
  ClusterJob job = small_job(folder / "");
  job.rounds.push_back({{2, 3, 5}, {2000, 20}, 21, 0});
  const auto array = array_command(job, 1);
  EXPECT_THAT(array, testing::IsSupersetOf({"--account=optics", "--array=2-3,5%2", "--mem=2000M", "--time=20",
                                            "--cpus-per-task=4", "--requeue"}));
  EXPECT_THAT(merge_command(job, 1), testing::Contains("--dependency=afterany:21"));
}

TEST(ClusterJob, ScriptsQuoteWhatTheShellWouldRead) {
  EXPECT_EQ(shell_words({"a b", "it's", "$x"}), R"('a b' 'it'\''s' '$x')");
  const TemporaryFolder folder;
  const ClusterJob job = small_job(folder / "");
  write_scripts(job);
  EXPECT_THAT(
      read_text(job.folder / "shard.sh"),
      HasSubstr(R"('/usr/bin/refield' 'estimate' 'it'\''s a session' '--max-kernels=5' --rows "$shard/5")"));
}

TEST(ClusterJob, ReadsTheQueue) {
  const auto queue = queue_from_text(
      "squeue: warning of a plugin\n"
      "refield-scene-00ff00.1|17|3|RUNNING|2|\n"
      "refield-scene-00ff00.1|17|4|NODE_FAIL|0|None|\n"
      "refield-scene-00ff00.1|17|5|PENDING|1|launch failed requeued held|\n"
      "refield-scene-00ff00.1.merge|N/A|N/A|PENDING|0|\n"
      "refield-scene-00ff00.1.merge|18|N/A|PENDING|0|\n");
  ASSERT_EQ(queue.size(), 4u);
  EXPECT_EQ(queue[0].job, 17);
  EXPECT_EQ(queue[0].task, 3);
  EXPECT_EQ(queue[0].restarts, 2);
  EXPECT_TRUE(queue[0].is_active());
  EXPECT_FALSE(queue[1].is_active());
  EXPECT_FALSE(queue[1].is_held);
  EXPECT_TRUE(queue[2].is_held);
  EXPECT_EQ(queue[3].job, 18);
  EXPECT_FALSE(queue[3].task);
  EXPECT_TRUE(queue[3].is_active());
}

TEST(ClusterJob, FailuresRaiseTheLimitThatTheyHit) {
  const TaskLimits limits{1000, 10};
  const auto after = [&](const TaskEnd& end) { return retry_after(end, limits, 1500).limits; };
  for (const TaskEnd& memory :
       {TaskEnd{"OUT_OF_MEMORY", 0}, TaskEnd{"FAILED", 137}, TaskEnd{"FAILED", 2, "n1", true}}) {
    EXPECT_EQ(after(memory).memory_mib, 1500);  // that of the node
    EXPECT_EQ(after(memory).minutes, 10);
  }
  EXPECT_EQ(retry_after({"OUT_OF_MEMORY"}, limits, 0).limits.memory_mib, 2000);
  for (const TaskEnd& time : {TaskEnd{"TIMEOUT"}, TaskEnd{"FAILED", 130}}) {
    EXPECT_EQ(after(time).memory_mib, 1000);
    EXPECT_EQ(after(time).minutes, 20);
  }
  EXPECT_EQ(after({""}).memory_mib, 1500);
  EXPECT_EQ(after({""}).minutes, 20);
  for (const TaskEnd& other : {TaskEnd{"NODE_FAIL"}, TaskEnd{"FAILED", 2}, TaskEnd{"COMPLETED", 0}}) {
    EXPECT_EQ(after(other).memory_mib, 1000);
    EXPECT_EQ(after(other).minutes, 10);
  }
}

TEST(ClusterJob, ShardsAreRunFourTimesAtMostAndRefusedOnesTwice) {
  const TemporaryFolder folder;
  ClusterJob job = small_job(folder / "");
  const std::map<int, TaskEnd> times = {{2, {"TIMEOUT"}}, {4, {"TIMEOUT"}}};
  for (int run = 2; run <= 4; ++run) {
    const NextRound next = next_round(job, times);
    ASSERT_TRUE(next.round) << run;
    EXPECT_THAT(next.round->shards, ElementsAre(2, 4));
    job.rounds.push_back(*next.round);
  }
  EXPECT_EQ(job.rounds.back().limits.minutes, 80);
  const NextRound last = next_round(job, times);
  EXPECT_FALSE(last.round);
  EXPECT_THAT(last.failure, HasSubstr("shard 2 exceeded its time limit of 80 min in run 4"));
  EXPECT_THAT(last.failure, HasSubstr(shard_log(job, 4).string()));
  job.first_round = 3;  // after --resume earlier runs do not count
  EXPECT_TRUE(next_round(job, times).round);

  job = small_job(folder / "");
  const std::map<int, TaskEnd> refused = {{3, {"FAILED", 2, "n2"}}};
  const NextRound second = next_round(job, refused);
  ASSERT_TRUE(second.round);
  job.rounds.push_back(*second.round);
  EXPECT_THAT(next_round(job, refused).failure, HasSubstr("shard 3 ended with exit status 2 on n2 in run 2"));
}

TEST(ClusterJob, ReadsHowATaskEnded) {
  const TemporaryFolder folder;
  const ClusterJob job = small_job(folder / "");
  const std::vector<QueuedTask> queue = {{"refield-scene-00ff00.1", 17, 3, "FAILED"}};
  EXPECT_FALSE(task_end(job, 3, queue).status);
  EXPECT_EQ(task_end(job, 3, queue).state, "FAILED");
  write_text_atomically(job.folder / "end/3", "2 host node7\n");
  EXPECT_EQ(task_end(job, 3, queue).host, "node7");
  EXPECT_FALSE(task_end(job, 3, queue).out_of_memory);
  write_text_atomically(shard_log(job, 3),
                        std::string(5000, '.') + "\nrefield: out of memory; close programs\n");
  EXPECT_TRUE(task_end(job, 3, queue).out_of_memory);
  write_text_atomically(shard_log(job, 4),
                        "slurmstepd-n2: error: StepId=5.batch exceeded memory limit (712192000 > 429916160), "
                        "being killed\n");
  EXPECT_TRUE(task_end(job, 4, queue).out_of_memory);
}

}  // namespace
}  // namespace refield::cli
