// SPDX-License-Identifier: Apache-2.0
#include "core/base/isolated.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <stdexcept>

namespace refield {
namespace {

TEST(Isolated, GivesTheAnswer) {
  EXPECT_EQ(run_isolated([] { return std::string("a\0b", 3); }), std::string("a\0b", 3));
  const std::string longer_than_a_pipe(1 << 20, 'x');
  EXPECT_EQ(run_isolated([&] { return longer_than_a_pipe; }), longer_than_a_pipe);
}

TEST(Isolated, LeavesTheParentAsItIs) {
  int value = 1;
  run_isolated([&] { return std::to_string(value = 2); });
  EXPECT_EQ(value, 1);
}

TEST(Isolated, KeepsACrashIn) {
  EXPECT_FALSE(run_isolated([]() -> std::string { std::raise(SIGSEGV), std::abort(); }));
  EXPECT_FALSE(run_isolated([]() -> std::string { std::abort(); }));
  EXPECT_FALSE(run_isolated([]() -> std::string { throw std::runtime_error("no answer"); }));
}

TEST(Isolated, EndsALoop) {
  IsolationLimits limits;
  limits.cpu_seconds = 1;
  EXPECT_FALSE(run_isolated(
      []() -> std::string {
        for (;;) std::rand();
      },
      limits));
}

TEST(Isolated, EndsWhatWaitsForEver) {
  IsolationLimits limits;
  limits.wall_seconds = 1;
  EXPECT_FALSE(run_isolated(
      []() -> std::string {
        for (;;) ::pause();
      },
      limits));
}

// Else what was started to read a file would live on after `kill -9`.
TEST(Isolated, TheChildEndsWithItsParent) {
  ::prctl(PR_SET_CHILD_SUBREAPER, 1);  // the grandchild becomes this process's when its parent is gone
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  const pid_t parent = ::fork();
  if (parent == 0) {
    run_isolated([&]() -> std::string {
      const pid_t self = ::getpid();
      if (::write(ends[1], &self, sizeof self) != sizeof self) ::_exit(1);
      for (;;) ::pause();
    });
    ::_exit(0);
  }
  pid_t grandchild = 0;
  ASSERT_EQ(::read(ends[0], &grandchild, sizeof grandchild), static_cast<ssize_t>(sizeof grandchild));
  ::kill(parent, SIGKILL);
  ::waitpid(parent, nullptr, 0);
  int status = 0;
  pid_t ended = 0;
  for (int i = 0; i < 500 && ended == 0; ++i) {
    ::usleep(10'000);
    ended = ::waitpid(grandchild, &status, WNOHANG);
  }
  EXPECT_EQ(ended, grandchild) << "still runs after five seconds";
  if (ended == 0) ::kill(grandchild, SIGKILL);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
  ::prctl(PR_SET_CHILD_SUBREAPER, 0);
  ::close(ends[0]);
  ::close(ends[1]);
}

TEST(Isolated, RefusesTooLongAnAnswer) {
  IsolationLimits limits;
  limits.answer_bytes = 1000;
  EXPECT_FALSE(run_isolated([] { return std::string(1001, 'x'); }, limits));
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(Isolated, RefusesTooMuchMemory) {
  IsolationLimits limits;
  limits.memory_bytes = 64 << 20;
  const auto allocate = [](std::size_t bytes) {
    return ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) != MAP_FAILED;
  };
  EXPECT_EQ(run_isolated([&] { return std::string(allocate(32 << 20) ? "given" : "refused"); }, limits),
            "given");
  EXPECT_EQ(run_isolated([&] { return std::string(allocate(96 << 20) ? "given" : "refused"); }, limits),
            "refused");
}
#endif

}  // namespace
}  // namespace refield
