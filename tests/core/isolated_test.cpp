// SPDX-License-Identifier: Apache-2.0
#include "core/base/isolated.h"

#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <thread>

#include "core/base/errors.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

std::optional<std::string> read(const std::string& reader, const std::vector<std::string>& arguments = {},
                                const IsolationLimits& limits = {}, const RunContext& run = {}) {
  return read_in_process(TEST_READER, {reader, arguments, limits}, run);
}

TEST(Isolated, GivesTheAnswer) {
  EXPECT_EQ(read("text", {"c d"}), std::string("a\0bc d", 6));
  EXPECT_EQ(read("bytes", {"1048576"}), std::string(1 << 20, 'x'));  // more than a pipe holds
}

TEST(Isolated, KeepsACrashIn) {
  EXPECT_FALSE(read("segmentation fault"));
  EXPECT_FALSE(read("abort"));
  EXPECT_FALSE(read("exception"));
  EXPECT_FALSE(read("no such reader"));
}

TEST(Isolated, EndsALoop) {
  EXPECT_FALSE(read("loop", {}, {.cpu_seconds = 1}));
}

TEST(Isolated, EndsWhatWaitsForEver) {
  EXPECT_FALSE(read("pause", {}, {.wall_seconds = 1}));
}

/// The number of the process that `read("pause", {pipe})` starts, once it runs.
pid_t process_from(const std::filesystem::path& pipe) {
  std::string line;
  std::ifstream stream(pipe);
  return std::getline(stream, line) ? std::stoi(line) : 0;
}

TEST(Isolated, StopsWithTheRun) {
  const test::TemporaryFolder folder;
  const std::filesystem::path pipe = folder / "pid";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  std::atomic<bool> stop{false};
  const std::jthread stopper([&] {
    EXPECT_GT(process_from(pipe), 0);
    stop = true;
  });
  EXPECT_THROW(read("pause", {pipe.string()}, {}, {.stop = &stop}), Interrupted);
}

TEST(Isolated, NamesAProgramThatIsMissing) {
  try {
    read_in_process("/no/such/reader", {"text", {}}, {});
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("/no/such/reader"), std::string::npos);
  }
}

TEST(Isolated, ReadsHereUnlessTheCallerIsolates) {
  const auto here = [](const std::vector<std::string>& arguments) { return "here " + arguments.at(0); };
  EXPECT_EQ(answer_of({"text", {"x"}}, here, {}), "here x");
  EXPECT_FALSE(answer_of({"text", {}}, here, {}));  // it throws
  RunContext run;
  run.read_isolated = [](const IsolatedReading& reading) { return reading.reader; };
  EXPECT_EQ(answer_of({"text", {"x"}}, here, run), "text");
}

// Else what was started to read a file would live on after `kill -9`.
TEST(Isolated, TheProcessEndsWithItsParent) {
  const test::TemporaryFolder folder;
  const std::filesystem::path pipe = folder / "pid";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  ::prctl(PR_SET_CHILD_SUBREAPER, 1);  // the grandchild becomes this process's when its parent is gone
  const pid_t parent = ::fork();
  if (parent == 0) {
    read("pause", {pipe.string()});
    ::_exit(0);
  }
  const pid_t grandchild = process_from(pipe);
  ASSERT_GT(grandchild, 0);
  ::kill(parent, SIGKILL);
  ::waitpid(parent, nullptr, 0);
  int status = 0;
  EXPECT_EQ(::waitpid(grandchild, &status, 0), grandchild);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  ::prctl(PR_SET_CHILD_SUBREAPER, 0);
}

TEST(Isolated, RefusesTooLongAnAnswer) {
  EXPECT_FALSE(read("bytes", {"1001"}, {.answer_bytes = 1000}));
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(Isolated, RefusesTooMuchMemory) {
  const IsolationLimits limits{.memory_bytes = 64 << 20};
  EXPECT_EQ(read("allocate", {std::to_string(32 << 20)}, limits), "given");
  EXPECT_EQ(read("allocate", {std::to_string(96 << 20)}, limits), "refused");
}
#endif

}  // namespace
}  // namespace refield
