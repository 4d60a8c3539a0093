// SPDX-License-Identifier: Apache-2.0
// What the program does to files and what the system may refuse it: no input is ever replaced, only its own
// files are removed, and every refusal is exit status 2 with the cause.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/base/files.h"
#include "core/base/output_lock.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;
using testing::HasSubstr;

/// Runs a script of the shell, in which "refield" is the program.
test::CommandResult run_shell(const fs::path& folder, const std::string& script) {
  const std::string out = folder / "shell.out", err = folder / "shell.err";
  const std::string line = "cd '" + folder.string() + "'; refield() { '" REFIELD_PROGRAM "' \"$@\"; }; { " +
                           script + "; } >'" + out + "' 2>'" + err + "'";
  const int status = std::system(("bash -c '" +
                                  [&] {
                                    std::string quoted;
                                    for (const char c : line)
                                      quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
                                    return quoted;
                                  }() +
                                  "'")
                                     .c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_text(out), read_text(err)};
}

class Outputs : public testing::Test {
 protected:
  Outputs() {
    const test::SmallCapture capture(1);
    test::write_capture(session_, capture.truth, capture.lights);
    write_reflectance_field(field_, capture.truth);
  }

  /// The command must be refused with `cause`, and the file must stay as it is.
  void expect_kept(const fs::path& file, std::vector<std::string> arguments, const std::string& cause) {
    const std::string before = read_text(file);
    EXPECT_THAT(run_refield(arguments), RefusedNaming(file.filename().string(), cause)) << arguments[0];
    EXPECT_TRUE(read_text(file) == before) << arguments[0] << " replaced " << file;
  }

  test::TemporaryFolder folder_;
  const std::string session_ = folder_ / "session";
  const std::string field_ = folder_ / "f.rfield";
};

TEST_F(Outputs, NoVerbReplacesAnInput) {
  const fs::path photograph = folder_ / "session/observed/train_000.exr",
                 other = folder_ / "session/observed/train_001.exr";
  const fs::path manifest = folder_ / "session/session.toml";
  const std::string light = folder_ / "session/illumination/train_000.exr";
  write_text_atomically(folder_ / "tetra.obj",
                        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
  write_text_atomically(folder_ / "scene.toml", "[[object]]\nfile = \"tetra.obj\"\n");
  expect_kept(photograph, {"estimate", session_, "-o", photograph}, ".rfield");
  expect_kept(manifest, {"estimate", session_, "-o", manifest}, ".rfield");
  expect_kept(field_,
              {"estimate", "--light", folder_ / "session/illumination", "--observed",
               folder_ / "session/observed", "--mask", field_, "-o", field_},
              "also an input");
  expect_kept(folder_ / "tetra.obj", {"precompute", folder_ / "tetra.obj", "-o", folder_ / "tetra.obj"},
              ".rfield");
  expect_kept(folder_ / "scene.toml", {"precompute", folder_ / "scene.toml", "-o", folder_ / "scene.toml"},
              ".rfield");
  expect_kept(photograph, {"compare", photograph, other, "-o", photograph}, "also an input");
  expect_kept(other, {"compare", photograph, other, "-o", other}, "also an input");
  expect_kept(manifest, {"compare", field_, session_, "-o", manifest}, ".html");
  expect_kept(field_, {"compare", field_, session_, "-o", field_}, ".html");
  expect_kept(field_, {"merge", field_, "-o", field_}, "also an input");
  expect_kept(field_, {"pack", field_, "-o", field_}, "also an input");
  expect_kept(light, {"relight", field_, "--light", light, "-o", light}, "also an input");
  expect_kept(field_, {"relight", field_, "--light", light, "-o", field_}, "also an input");
  expect_kept(photograph, {"acquire", "import", photograph, other, "--exposures", "1,2", "-o", photograph},
              "also an input");
  expect_kept(photograph,
              {"acquire", "lights", folder_ / "session/observed", "--light-size", "4x4", "-o",
               folder_ / "session/observed", "--force"},
              "also an input");
  // Through links as well.
  fs::create_symlink(other, folder_ / "link.exr");
  expect_kept(other, {"compare", photograph, folder_ / "link.exr", "-o", other}, "also an input");
  EXPECT_FALSE(fs::exists(folder_ / ".lock-f.rfield"));
}

TEST_F(Outputs, TwoRunsOfOneOutput) {
  const OutputLock other_run(folder_ / "out.rfield", {});
  const std::string us = "process " + std::to_string(::getpid());
  EXPECT_THAT(run_refield({"estimate", session_, "-o", folder_ / "out.rfield"}),
              RefusedNaming("out.rfield", us));
  EXPECT_THAT(run_refield({"pack", field_, "-o", folder_ / "out.rfield"}), RefusedNaming("out.rfield", us));
  const OutputLock page(folder_ / "page.html", {}), web(folder_ / "web", {});
  EXPECT_THAT(run_refield({"compare", field_, session_, "-o", folder_ / "page.html"}),
              RefusedNaming("page.html", us));
  EXPECT_THAT(run_refield({"export-web", field_, "-o", folder_ / "web"}), RefusedNaming("web", us));
}

TEST_F(Outputs, WhatCannotBePrintedIsAnError) {
  write_text_atomically(folder_ / "commands",
                        "info f.rfield\n--json info f.rfield\n--help\npack --help\n--version\n"
                        "--json compare session/observed/train_000.exr session/observed/train_001.exr\n");
  std::ifstream commands(folder_ / "commands");
  for (std::string command; std::getline(commands, command);) {
    const auto result = run_shell(folder_.path(), "refield " + command + " >/dev/full");
    EXPECT_EQ(result.status, 2) << command;
    EXPECT_THAT(result.err, HasSubstr("standard output: cannot write: No space left")) << command;
  }
  EXPECT_THAT(run_shell(folder_.path(), "refield info f.rfield >&-"), Succeeded());
}

TEST_F(Outputs, NamesThatAreNotUtf8) {
  const std::string script =
      "cp f.rfield $'f\\xff.rfield'; cp -r session $'s\\xff';"
      "refield --json info $'f\\xff.rfield' && refield --json relight $'f\\xff.rfield' --bar 0.5 --frames 1 "
      "-o $'r\\xff' &&"
      "refield --json pack $'f\\xff.rfield' -o $'p\\xff.rfield' --max-error 0.01 && "
      "refield --json estimate $'s\\xff' --max-kernels 4 -o $'e\\xff.rfield'";
  const auto result = run_shell(folder_.path(), script);
  ASSERT_THAT(result, Succeeded());
  EXPECT_THAT(result.out, HasSubstr("r\xef\xbf\xbd"));
  EXPECT_NO_THROW(nlohmann::json::parse(read_text(folder_ / "e\xff.rfield.log.json")));
  EXPECT_EQ(read_reflectance_field(folder_ / "e\xff.rfield").width, 6);
}

TEST_F(Outputs, TooFewOpenFilesAreNoDamage) {
  // Descriptors that the caller of the tests left open would count, too.
  const auto result = run_shell(
      folder_.path(), "exec 3>&- 4>&- 5>&- 6>&- 7>&- 8>&- 9>&-; ulimit -n 5; refield info f.rfield");
  EXPECT_THAT(result, RefusedNaming("open files", "ulimit -n"));
  EXPECT_EQ(result.err.find("damaged"), std::string::npos);
}

TEST_F(Outputs, AFileThatGrowsTooLarge) {
  Rng rng(1);
  write_reflectance_field(field_, test::random_field(rng, 60, 50, test::SmallCapture::domain, 40, 12));
  const auto result =
      run_shell(folder_.path(), "ulimit -f 8; refield pack f.rfield -o p.rfield --max-error 2e-5");
  EXPECT_THAT(result, RefusedNaming("p.rfield", "ulimit -f"));
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    EXPECT_FALSE(entry.path().filename().string().starts_with(".")) << entry.path() << " was left behind";
}

TEST_F(Outputs, NamesThatTheSystemRefuses) {
  fs::create_symlink("b.rfield", folder_ / "a.rfield");
  fs::create_symlink("a.rfield", folder_ / "b.rfield");
  const std::string name = std::string(300, 'n') + ".rfield";
  for (const auto& [file, cause] :
       {std::pair<std::string, std::string>{"a.rfield", "symbolic link"}, {name, "name too long"}})
    for (const std::string command :
         {"info ", "relight --bar 0.5 -o o ", "pack f.rfield -o ", "estimate session -o ", "estimate ",
          "relight f.rfield -o o --light "}) {
      const auto result = run_shell(folder_.path(), "refield " + command + file);
      if (command.ends_with("-o ") && file != name) continue;  // a link is replaced, wherever it leads
      EXPECT_EQ(result.status, 2) << command << file << ": " << result.err;
      EXPECT_EQ(result.err.find("unexpected"), std::string::npos) << result.err;
    }
}

TEST_F(Outputs, AFolderThatMayNotBeEntered) {
  fs::create_directory(folder_ / "locked");
  fs::rename(field_, folder_ / "locked/f.rfield");
  fs::rename(session_, folder_ / "locked/session");
  std::string as_user = "bash -c";
  if (::geteuid() == 0) {
    if (std::system("setpriv --reuid=65534 --regid=65534 --clear-groups true") != 0)
      GTEST_SKIP() << "setpriv is needed to run as another user than root";
    as_user = "setpriv --reuid=65534 --regid=65534 --clear-groups bash -c";
    if (std::system((as_user + " '\"" REFIELD_PROGRAM "\" --version >/dev/null'").c_str()) != 0)
      GTEST_SKIP() << "another user than root cannot run " REFIELD_PROGRAM;
  }
  fs::permissions(folder_.path(), fs::perms::all);
  fs::permissions(folder_ / "locked", fs::perms::none);
  for (const std::string arguments :
       {"info locked/f.rfield", "estimate locked/session -o o.rfield", "acquire import locked/a.exr -o o.exr",
        "compare 'locked/*.exr' locked -o o.exr", "relight locked/f.rfield --bar 0.5 -o o",
        "precompute locked/a.obj -o o.rfield", "compare locked/f.rfield locked/session -o o.html"}) {
    const auto result = run_shell(folder_.path(), as_user + " \"'" REFIELD_PROGRAM "' " + arguments + "\"");
    EXPECT_EQ(result.status, 2) << arguments << ": " << result.err;
    EXPECT_THAT(result.err, HasSubstr("locked")) << arguments;
    EXPECT_EQ(result.err.find("unexpected"), std::string::npos) << result.err;
  }
  fs::permissions(folder_ / "locked", fs::perms::all);
}

TEST_F(Outputs, APageReplacesOnlyAPage) {
  const fs::path page = folder_ / "site";
  fs::create_directory(page);
  write_text_atomically(page / "index.html", "<p>mine</p>");
  const auto result = run_refield({"export-web", field_, "-o", page});
  EXPECT_THAT(result, RefusedNaming("index.html", "empty or new folder"));
  EXPECT_EQ(read_text(page / "index.html"), "<p>mine</p>");
  fs::remove(page / "index.html");
  write_text_atomically(page / "notes.txt", "mine");
  EXPECT_THAT(run_refield({"export-web", field_, "-o", page}), Succeeded());
  EXPECT_THAT(run_refield({"export-web", field_, "-o", page}), Succeeded())
      << "a page of our own was not replaced";
  EXPECT_EQ(read_text(page / "notes.txt"), "mine");
}

TEST_F(Outputs, AnotherSimulationKeepsFilesOfTheUser) {
  const std::vector<std::string> command = {
      "simulate",     REFIELD_SOURCE_DIR "/datasets_synthetic/tabletop/recipe.toml",
      "-o",           folder_ / "truth",
      "--size",       "8x6",
      "--light-size", "8x8",
      "--train",      "2",
      "--test",       "1,0,0",
      "--quality",    "1",
      "--force"};
  ASSERT_THAT(run_refield(command), Succeeded());
  write_text_atomically(folder_ / "truth/observed/notes.txt", "mine");
  write_exr(folder_ / "truth/observed/train_007.exr", Image(2, 2, 3));  // as of an earlier, larger simulation
  ASSERT_THAT(run_refield(command), Succeeded());
  EXPECT_EQ(read_text(folder_ / "truth/observed/notes.txt"), "mine");
  EXPECT_FALSE(fs::exists(folder_ / "truth/observed/train_007.exr"));
}

}  // namespace
}  // namespace refield
