// SPDX-License-Identifier: Apache-2.0
#include "core/base/output_lock.h"

#include <gmock/gmock.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/capture_session.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr const char* nothing = "(nothing was thrown)";

class OutputLockTest : public testing::Test {
 protected:
  std::string refusal(const fs::path& output, const std::vector<fs::path>& inputs,
                      const std::string& extension = "") {
    return test::message_of([&] { const OutputLock lock(output, inputs, extension); });
  }
  int files() const {
    return static_cast<int>(std::ranges::distance(fs::directory_iterator(folder_.path())));
  }
  test::TemporaryFolder folder_;
};

TEST_F(OutputLockTest, OneRunAtATime) {
  const fs::path output = folder_ / "a.rfield";
  {
    const OutputLock lock(output, {});
    EXPECT_THAT(
        refusal(output, {}),
        AllOf(HasSubstr("a.rfield"), HasSubstr("another run (process " + std::to_string(::getpid()) + ")")));
    EXPECT_EQ(refusal(folder_ / "b.rfield", {}), nothing);
    EXPECT_THAT(refusal(folder_ / "c/../a.rfield", {}), HasSubstr("another run"));
  }
  EXPECT_EQ(refusal(output, {}), nothing);
  fs::remove(folder_ / "c");
  EXPECT_EQ(files(), 0) << "the lock's file was left behind";
}

TEST_F(OutputLockTest, AFolderThatIsThereOrComesIntoBeing) {
  const fs::path output = folder_ / "new/chart";
  const OutputLock lock(output, {});
  EXPECT_THAT(refusal(output, {}), HasSubstr("another run"));
  create_folders(output);
  EXPECT_THAT(refusal(output, {}), HasSubstr("another run"));
  EXPECT_THAT(refusal(output / "", {}), HasSubstr("another run"));
}

TEST_F(OutputLockTest, RemovesWhatKilledRunsLeftInAFolder) {
  const fs::path output = folder_ / "pictures";
  create_folders(output);
  const fs::path left = output / ".partial-0123456789abcdef-a.exr",
                 in_use = output / ".partial-0123456789abcdef-b.exr", own = output / ".partial-notes";
  for (const fs::path& file : {left, in_use, own}) std::ofstream(file) << "x";
  std::ofstream(output / ".lock-b.exr") << "";  // of a run that writes this file alone
  const OutputLock lock(output, {});
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(in_use));
  EXPECT_TRUE(fs::exists(own)) << "no name of a temporary";
}

TEST_F(OutputLockTest, EndsWithAKilledProcess) {
  const fs::path output = folder_ / "a.rfield";
  int ready[2];
  ASSERT_EQ(::pipe(ready), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const OutputLock lock(output, {});
    std::ofstream(folder_ / ".partial-0123456789abcdef-a.rfield") << "half";
    static_cast<void>(::write(ready[1], "x", 1));
    for (;;) ::pause();
  }
  char byte = 0;
  ASSERT_EQ(::read(ready[0], &byte, 1), 1);
  EXPECT_THAT(refusal(output, {}), HasSubstr(std::to_string(child)));
  ::kill(child, SIGKILL);
  ::waitpid(child, nullptr, 0);
  std::ofstream(folder_ / ".partial-0123456789abcdef-b.rfield") << "of another output";
  EXPECT_EQ(refusal(output, {}), nothing);
  EXPECT_EQ(files(), 1) << "what the killed process left is still there, or more than that has gone";
  for (const int end : ready) ::close(end);
}

TEST_F(OutputLockTest, RefusesInputsByIdentity) {
  write_text_atomically(folder_ / "in.exr", "x");
  fs::create_symlink("in.exr", folder_ / "symbolic.exr");
  fs::create_hard_link(folder_ / "in.exr", folder_ / "hard.exr");
  for (const char* output : {"in.exr", "symbolic.exr", "hard.exr"})
    for (const fs::path& input : {folder_ / "in.exr", folder_ / "*in.exr", folder_.path()})
      EXPECT_THAT(refusal(folder_ / output, {"", input}),
                  AllOf(HasSubstr(output), HasSubstr("is also an input")))
          << input;
  EXPECT_EQ(refusal(folder_ / "out.exr", {folder_ / "in.exr", folder_.path()}), nothing);
  EXPECT_EQ(refusal(folder_ / "hard.exr", {folder_ / "missing.exr", folder_ / "none*.exr"}), nothing);
}

TEST_F(OutputLockTest, RefusesFilesOfASession) {
  Rng rng(1);
  const LightDomain domain{4, 3, Parameterisation::monitor};
  test::write_capture(folder_ / "s", test::random_field(rng, 5, 4, domain, 4, 2),
                      {test::random_light(rng, domain)});
  for (const char* file : {"session.toml", "observed/train_000.exr", "illumination/train_000.exr"})
    EXPECT_THAT(refusal(folder_ / "s" / file, {folder_ / "s"}),
                AllOf(HasSubstr(file), HasSubstr("is also an input")));
  write_text_atomically(folder_ / "s/earlier.rfield", "x");
  EXPECT_EQ(refusal(folder_ / "s/earlier.rfield", {folder_ / "s"}, ".rfield"), nothing);
  EXPECT_THAT(test::message_of([&] { require_outside(folder_ / "s", {folder_ / "s/observed/*.exr"}); }),
              HasSubstr("train_000.exr"));
  EXPECT_EQ(test::message_of([&] { require_outside(folder_ / "t", {folder_ / "s"}); }), nothing);
}

TEST_F(OutputLockTest, RefusesOtherKindsOfFile) {
  EXPECT_THAT(refusal(folder_ / "mesh.obj", {}, ".rfield"),
              AllOf(HasSubstr("mesh.obj"), HasSubstr(".rfield")));
  create_folders(folder_ / "d.rfield");
  EXPECT_THAT(refusal(folder_ / "d.rfield", {}, ".rfield"), HasSubstr("is a folder"));
  EXPECT_THAT(refusal("", {}), HasSubstr("no name"));
}

}  // namespace
}  // namespace refield
