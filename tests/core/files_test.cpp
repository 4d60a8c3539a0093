// SPDX-License-Identifier: Apache-2.0
#include "core/base/files.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <cerrno>
#include <fstream>
#include <set>

#include "core/base/errors.h"
#include "tests/support/small_disk.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

int files_in(const fs::path& folder) {
  return static_cast<int>(std::ranges::distance(fs::directory_iterator(folder)));
}

void touch(const fs::path& path) {
  std::ofstream(path) << "x";
}

TEST(WriteAtomically, ReplacesTheOldContent) {
  const test::TemporaryFolder folder;
  write_text_atomically(folder / "a.txt", "old");
  write_text_atomically(folder / "a.txt", std::string("new\0binary", 10));
  EXPECT_EQ(read_text(folder / "a.txt"), std::string("new\0binary", 10));
  EXPECT_EQ(files_in(folder.path()), 1);
}

TEST(WriteAtomically, KeepsTheOldContentWhenWritingFails) {
  const test::TemporaryFolder folder;
  write_text_atomically(folder / "a.txt", "old");
  EXPECT_THROW(write_atomically(folder / "a.txt",
                                [](const fs::path& temporary) {
                                  std::ofstream(temporary) << "half";
                                  throw InputError("the device was unplugged");
                                }),
               InputError);
  EXPECT_EQ(read_text(folder / "a.txt"), "old");
  EXPECT_EQ(files_in(folder.path()), 1) << "the temporary file was left behind";
}

TEST(WriteAtomically, TheTemporaryHasTheSameExtensionAndFolder) {
  const test::TemporaryFolder folder;
  write_atomically(folder / "a.exr", [&](const fs::path& temporary) {
    EXPECT_EQ(temporary.extension(), ".exr");
    EXPECT_EQ(temporary.parent_path(), folder.path());
    touch(temporary);
  });
}

TEST(WriteAtomically, FollowsNoLinkThatSomebodyPlaced) {
  const test::TemporaryFolder folder;
  write_text_atomically(folder / "victim", "precious");
  fs::create_symlink("victim", folder / ".partial-a.txt");
  std::set<fs::path> temporaries;
  for (int i = 0; i < 2; ++i)
    write_atomically(folder / "a.txt", [&](const fs::path& temporary) {
      EXPECT_TRUE(fs::is_regular_file(fs::symlink_status(temporary)));
      temporaries.insert(temporary);
      std::ofstream(temporary) << "new";
    });
  EXPECT_EQ(temporaries.size(), 2u) << "the name of the temporary can be estimated";
  EXPECT_EQ(read_text(folder / "victim"), "precious");
  EXPECT_EQ(read_text(folder / "a.txt"), "new");
}

TEST(WriteAtomically, LongNames) {
  const test::TemporaryFolder folder;
  const std::string longest = std::string(251, 'n') + ".txt";
  write_text_atomically(folder / longest, "x");
  EXPECT_EQ(read_text(folder / longest), "x");
  bool asked = false;
  EXPECT_THROW(write_atomically(folder / ("n" + longest), [&](const fs::path&) { asked = true; }),
               DeviceError);
  EXPECT_FALSE(asked) << "the name was refused only after the work";
}

TEST(WriteAtomically, SaysWhyItCannotWrite) {
  const test::TemporaryFolder folder;
  try {
    write_text_atomically(folder / "no/such/folder/a.txt", "x");
    FAIL() << "wrote into a folder that does not exist";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ENOENT);
    EXPECT_THAT(error.what(), HasSubstr("no/such/folder/a.txt"));
  }
}

TEST(WriteAtomically, KeepsTheOldContentOnAFullDisk) {
  const test::SmallDisk disk(256);
  if (!disk.mounted()) GTEST_SKIP() << test::needs_mounting;
  write_text_atomically(disk / "a.txt", "old");
  try {
    write_text_atomically(disk / "a.txt", std::string(1 << 20, 'x'));
    FAIL() << "wrote 1 MB to a disk of 256 kB";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ENOSPC);
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("a.txt"), HasSubstr("free some space")));
  }
  EXPECT_EQ(read_text(disk / "a.txt"), "old");
  EXPECT_EQ(disk.files(), 1);
}

TEST(ReadText, NamesTheFileThatItCannotRead) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(read_text(folder / "missing.txt"), DeviceError);
  EXPECT_THROW(read_text(folder.path()), DeviceError);
}

TEST(ReadText, DoesNotWaitForAPipeThatNoOneWritesTo) {
  const test::TemporaryFolder folder;
  const std::filesystem::path pipe = folder / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THROW(read_text(pipe), FormatError);
}

TEST(CreateFolders, RefusesAFileInTheWay) {
  const test::TemporaryFolder folder;
  touch(folder / "file");
  EXPECT_THROW(create_folders(folder / "file/inside"), DeviceError);
  create_folders(folder / "a/b/c");
  EXPECT_TRUE(fs::is_directory(folder / "a/b/c"));
  create_folders(folder / "a/b/c");  // again is fine
}

TEST(RequireFreeSpace, LooksAtTheNearestExistingFolder) {
  const test::TemporaryFolder folder;
  EXPECT_NO_THROW(require_free_space(folder / "not/yet/there.rfield", 1));
  try {
    require_free_space(folder / "not/yet/there.rfield", 1ull << 62);
    FAIL() << "found four exabytes";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.error_number(), ENOSPC);
  }
}

std::vector<std::string> wildcards(const std::vector<GlobMatch>& matches) {
  std::vector<std::string> found;
  for (const GlobMatch& match : matches) found.push_back(match.wildcard);
  return found;
}

TEST(ExpandGlob, SortsAndTellsWhatTheWildcardsStandFor) {
  const test::TemporaryFolder folder;
  for (const char* name : {"train_010.exr", "train_002.exr", "test_001.exr", "train_2.png", ".train_9.exr"})
    touch(folder / name);
  EXPECT_THAT(wildcards(expand_glob((folder / "train_*.exr").string())), ElementsAre("002", "010"));
  EXPECT_THAT(wildcards(expand_glob((folder / "t*_0??.exr").string())),
              ElementsAre("est/0/1", "rain/0/2", "rain/1/0"));
  EXPECT_THAT(wildcards(expand_glob((folder / "test_001.exr").string())), ElementsAre(""));
}

TEST(ExpandGlob, NumbersInNamesCount) {
  const test::TemporaryFolder folder;
  for (const char* name :
       {"a10.exr", "a9.exr", "a09.exr", "a1_2.exr", "a1_11.exr", "b.exr", "a.exr", "a2x.exr"})
    touch(folder / name);
  EXPECT_THAT(wildcards(expand_glob((folder / "*.exr").string())),
              ElementsAre("a", "a1_2", "a1_11", "a2x", "a09", "a9", "a10", "b"));
  EXPECT_TRUE(comes_before("img12345678901234567890.png", "img12345678901234567891.png"));
  EXPECT_FALSE(comes_before("a1.png", "a1.png"));
}

// A matcher that tries every way to share the letters among the stars would take longer than any time-out.
TEST(ExpandGlob, ManyStarsEnd) {
  const test::TemporaryFolder folder;
  touch(folder / (std::string(120, 'a') + ".exr"));
  std::string pattern;
  for (int i = 0; i < 10; ++i) pattern += "*a";
  EXPECT_THROW(expand_glob((folder / (pattern + "*b.exr")).string()), InputError);
  EXPECT_EQ(wildcards(expand_glob((folder / (pattern + "*.exr")).string())).size(), 1u);
  touch(folder / "ab_abc_abd.exr");
  EXPECT_THAT(wildcards(expand_glob((folder / "*_*b?.exr").string())), ElementsAre("ab/abc_a/d"));
  EXPECT_THAT(wildcards(expand_glob((folder / "*ab?.exr").string())), ElementsAre("ab_abc_/d"));
  EXPECT_THROW(expand_glob((folder / "ab_*_abd_*.exr").string()), InputError);
}

TEST(ExpandGlob, AFolderStandsForItsImages) {
  const test::TemporaryFolder folder;
  for (const char* name : {"b.exr", "a.PNG", "notes.txt", ".hidden.exr"}) touch(folder / name);
  fs::create_directory(folder / "sub.exr");
  EXPECT_THAT(wildcards(expand_glob(folder.path().string())), ElementsAre("a", "b"));
}

TEST(ExpandGlob, NothingFoundIsAnError) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(expand_glob((folder / "*.exr").string()), InputError);
  EXPECT_THROW(expand_glob((folder / "missing/*.exr").string()), InputError);
  EXPECT_THROW(expand_glob(folder.path().string()), InputError);
  for (const char* name : {"photo.9.tga", "photo.10.tga"}) touch(folder / name);
  try {
    expand_glob(folder.path().string());
    ADD_FAILURE();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("no images (EXR"));
    EXPECT_THAT(error.what(), testing::HasSubstr("photo.9.tga"));
  }
  EXPECT_THROW(expand_glob(""), InputError);
}

TEST(ReadText, EndsOnADeviceThatDoesNot) {
  EXPECT_EQ(read_text("/dev/null"), "");
  EXPECT_THROW(read_text("/dev/zero"), FormatError);
}

}  // namespace
}  // namespace refield
