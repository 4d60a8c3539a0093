// SPDX-License-Identifier: Apache-2.0
#include "core/isolated.h"

#include <gtest/gtest.h>
#include <sys/mman.h>

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
