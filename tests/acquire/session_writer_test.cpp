// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/session_writer.h"

#include <gtest/gtest.h>

#include <fstream>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/image/image_io.h"
#include "core/session/journal.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::TemporaryFolder;

TEST(Journal, ChecksumIsThatOfZlibAndPython) {
  EXPECT_EQ(crc32_of("123456789"), 0xcbf43926u);
}

TEST(Journal, RoundTrip) {
  const TemporaryFolder folder;
  const std::vector<JournalEntry> entries = {{"ambient", {{"ambient.exr", 17, 0xdeadbeef}}},
                                             {"a name with spaces", {{"x/1.exr", 0, 0}, {"y/1.exr", 99, 1}}},
                                             {"nothing", {}}};
  for (const auto& entry : entries) append_to_journal(folder / "journal", entry);
  EXPECT_EQ(read_journal(folder / "journal"), entries);
  write_journal(folder / "again", entries);
  EXPECT_EQ(read_text(folder / "again"), read_text(folder / "journal"));
  EXPECT_TRUE(read_journal(folder / "none").empty());
}

TEST(Journal, TornAtAnyByteItKeepsTheWholeLines) {
  const TemporaryFolder folder;
  const JournalEntry first{"one", {{"one.exr", 10, 1}}};
  const JournalEntry second{"two", {{"two.exr", 20, 2}}};
  write_journal(folder / "journal", {first});
  const std::size_t whole = read_text(folder / "journal").size();
  write_journal(folder / "journal", {first, second});
  const std::string text = read_text(folder / "journal");
  for (std::size_t size = whole; size < text.size(); ++size) {
    write_text_atomically(folder / "torn", text.substr(0, size));
    EXPECT_EQ(read_journal(folder / "torn"), std::vector<JournalEntry>{first}) << size;
  }
}

TEST(Journal, AFlippedByteSpoilsItsLineAlone) {
  const TemporaryFolder folder;
  write_journal(folder / "journal", {{"one", {{"one.exr", 10, 1}}}, {"two", {{"two.exr", 20, 2}}}});
  std::string text = read_text(folder / "journal");
  text[5] = 'X';
  write_text_atomically(folder / "journal", text);
  const auto entries = read_journal(folder / "journal");
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].step, "two");
}

class SessionWriterTest : public ::testing::Test {
 protected:
  void write_step(SessionWriter& session, const std::string& step) {
    write_text_atomically(session.folder() / "observed" / step, "content of " + step);
    session.finish_step(step, {"observed/" + step});
  }
  CaptureSession manifest() const {
    CaptureSession session;
    session.folder = folder;
    session.width = session.height = 1;
    session.light = {1, 1, Parameterisation::monitor};
    return session;
  }
  TemporaryFolder temporary;
  fs::path folder = temporary / "session";
  std::vector<std::string> steps = {"ambient", "a", "b"};
};

TEST_F(SessionWriterTest, TakesOverWhatIsFinished) {
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    write_step(session, "ambient");
    write_step(session, "a");
  }
  std::ofstream(folder / "observed" / ".partial-b") << "left by a crash";
  std::ofstream(folder / "journal", std::ios::app) << "b\tobserved/b\t1";
  SessionWriter session(folder, "plan", steps, IfExists::resume);
  EXPECT_TRUE(session.is_done("ambient"));
  EXPECT_TRUE(session.is_done("a"));
  EXPECT_FALSE(session.is_done("b"));
  EXPECT_FALSE(fs::exists(folder / "observed" / ".partial-b"));
  write_step(session, "b");
  EXPECT_EQ(read_journal(folder / "journal").size(), 3u);  // the torn line has gone, nothing is glued to it
}

TEST_F(SessionWriterTest, RepeatsWhatIsDamagedOrMissing) {
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    for (const auto& step : steps) write_step(session, step);
    session.finish(manifest());
  }
  EXPECT_TRUE(SessionWriter(folder, "plan", steps, IfExists::resume).is_complete());
  std::ofstream(folder / "observed" / "a", std::ios::in) << "C";  // same size, other content
  fs::remove(folder / "observed" / "b");
  SessionWriter session(folder, "plan", steps, IfExists::resume);
  EXPECT_FALSE(session.is_complete());
  EXPECT_FALSE(fs::exists(folder / session_manifest_name)) << "an incomplete session must not look complete";
  EXPECT_EQ(session.found_damaged(), 2u);
  EXPECT_FALSE(session.is_done("a"));
  EXPECT_FALSE(session.is_done("b"));
}

TEST_F(SessionWriterTest, AJournalThatNamesFilesOfOthersIsNotBelieved) {
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    for (const auto& step : steps) write_step(session, step);
    session.finish(manifest());
  }
  write_text_atomically(temporary / "b_outside", "content");
  for (const std::string forged : {"../b_outside", "observed/a"}) {
    auto entries = read_journal(folder / "journal");
    entries.back() = {"b", {inspect_file(folder, forged)}};
    write_journal(folder / "journal", entries);
    SessionWriter session(folder, "plan", steps, IfExists::resume);
    EXPECT_FALSE(session.is_complete()) << forged;
    EXPECT_FALSE(session.is_done("b")) << forged;
    write_step(session, "b");
    session.finish(manifest());
  }
}

TEST_F(SessionWriterTest, AManifestThatNamesAnotherPhotographIsRefused) {
  CaptureSession session = manifest();
  for (const char* name : {"a", "b"}) {
    const std::string file = std::string(name) + ".exr";
    session.frames.push_back(
        {name, FrameRole::train, "", folder / "illumination" / file, folder / "observed" / file});
  }
  {
    SessionWriter writer(folder, "plan", {"a", "b"}, IfExists::refuse);
    for (const char* name : {"a", "b"}) {
      const std::vector<std::string> files = {"illumination/" + std::string(name) + ".exr",
                                              "observed/" + std::string(name) + ".exr"};
      for (const std::string& file : files) write_exr(folder / file, Image(1, 1, 3, 1.0f));
      writer.finish_step(name, files);
    }
    writer.finish(session);
  }
  EXPECT_TRUE(SessionWriter(folder, "plan", {"a", "b"}, IfExists::resume).is_complete());
  session.frames[1].observed = session.frames[0].observed;
  write_session_manifest(session);
  EXPECT_THROW(SessionWriter(folder, "plan", {"a", "b"}, IfExists::resume), InputError);
}

TEST_F(SessionWriterTest, RepairsLeaveColoursAndMonitorsAsTheyWereFound) {
  CaptureSession found = manifest();
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    for (const auto& step : steps) write_step(session, step);
    found.colour = CameraColour{Eigen::Vector3d(2.0, 1.0, 3.0).asDiagonal(), "chart.exr", 0.4, 1.5};
    found.monitors = {MonitorPlacement{.width_mm = 600, .height_mm = 340, .distance_mm = 500}};
    session.finish(found);
  }
  const std::string before = read_text(folder / session_manifest_name);
  for (const char* step : {"a", "b"}) {
    fs::remove(folder / "observed" / step);
    {
      const SessionWriter killed(folder, "plan", steps, IfExists::resume);
      EXPECT_FALSE(killed.is_complete());
    }
    SessionWriter session(folder, "plan", steps, IfExists::resume);
    write_step(session, step);
    session.finish(manifest());
    EXPECT_EQ(read_text(folder / session_manifest_name), before);
    EXPECT_FALSE(fs::exists(folder / "session.before.toml"));
  }
}

TEST_F(SessionWriterTest, FinishesInOrderWhateverWasRepeated) {
  SessionWriter session(folder, "plan", steps, IfExists::refuse);
  EXPECT_THROW(session.finish(manifest()), InputError);
  for (const char* step : {"b", "ambient", "a"}) write_step(session, step);
  session.finish(manifest());
  const auto entries = read_journal(folder / "journal");
  for (std::size_t i = 0; i < steps.size(); ++i) EXPECT_EQ(entries[i].step, steps[i]);
}

TEST_F(SessionWriterTest, RefusesAnotherPlanAndSaysWhatDiffers) {
  { SessionWriter(folder, "same\nseed = 1\nend", steps, IfExists::refuse); }
  try {
    SessionWriter(folder, "same\nseed = 2\nend", steps, IfExists::resume);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("'seed = 1', now 'seed = 2'"), std::string::npos)
        << error.what();
  }
}

TEST_F(SessionWriterTest, OverwritesOnlyWhenTold) {
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    write_step(session, "a");
  }
  EXPECT_THROW(SessionWriter(folder, "plan", steps, IfExists::refuse), InputError);
  SessionWriter session(folder, "other plan", steps, IfExists::replace);
  EXPECT_FALSE(session.is_done("a"));
  EXPECT_FALSE(fs::exists(folder / "observed" / "a"));
}

TEST_F(SessionWriterTest, ReplacingKeepsFilesOfTheUser) {
  {
    SessionWriter session(folder, "plan", steps, IfExists::refuse);
    for (const auto& step : steps) write_step(session, step);
    session.finish(manifest());
  }
  std::ofstream(folder / "observed" / "notes.txt") << "precious";
  SessionWriter session(folder, "other plan", {"c"}, IfExists::replace);
  EXPECT_EQ(read_text(folder / "observed" / "notes.txt"), "precious");
  for (const auto& step : steps) EXPECT_FALSE(fs::exists(folder / "observed" / step)) << step;
  EXPECT_FALSE(fs::exists(folder / session_manifest_name));
}

TEST_F(SessionWriterTest, LeavesForeignFoldersAlone) {
  create_folders(folder);
  std::ofstream(folder / "thesis.txt") << "precious";
  for (IfExists mode : {IfExists::refuse, IfExists::resume, IfExists::replace})
    EXPECT_THROW(SessionWriter(folder, "plan", steps, mode), InputError);
  EXPECT_EQ(read_text(folder / "thesis.txt"), "precious");
}

}  // namespace
}  // namespace refield
