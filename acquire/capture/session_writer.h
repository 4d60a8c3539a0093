// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/session/capture_session.h"
#include "core/session/journal.h"

namespace refield {

/// What to do with an output folder that already holds a capture.
enum class IfExists { refuse, resume, replace };

/// Throws InputError when `folder` may not be written under `if_exists`: it holds a capture and neither
/// resume nor replace was asked for, or it holds something else. Changes nothing.
void check_session_folder(const fs::path& folder, IfExists if_exists);

/// What the import found and did, a sentence per line, for 'refield info'; not there where it found nothing.
inline constexpr const char* session_notes_name = "notes.txt";

/// The role of the frame under a light of that name: test… is held out, reference… and …_reference show
/// drift, all others are for training.
FrameRole role_of_light(const std::string& name);

/// plan.toml of a capture that was begun in `folder`; nullopt when there is none.
std::optional<std::string> stored_plan(const fs::path& folder);

/// The capture session folder while it grows, see docs/reference/capture-session-format.md. At every moment
/// the disk says which steps are finished: files land by rename, then the journal names them. plan.toml comes
/// first and says what the capture is to become; session.toml comes last and says that it is complete.
class SessionWriter {
 public:
  /// Opens `folder` for a capture that `plan` (text of plan.toml) describes in full, made of `steps`.
  /// On resume the plan must be the same to the letter; steps whose files are missing or damaged will be done
  /// again. The caller holds the folder (OutputLock). Throws InputError as check_session_folder() does, and
  /// when the plans differ, naming the first line that does.
  SessionWriter(fs::path folder, const std::string& plan, std::vector<std::string> steps, IfExists if_exists);

  const fs::path& folder() const { return folder_; }
  bool is_complete() const { return complete_; }
  bool is_done(const std::string& step) const;
  std::size_t found_done() const { return found_done_; }  ///< steps taken over from an earlier run
  std::size_t found_damaged() const {
    return found_damaged_;
  }  ///< steps to do again since their files changed

  /// Records that a step's files (paths relative to the folder) are on disk.
  void finish_step(const std::string& step, const std::vector<std::string>& files);

  /// Records that a step is not needed: it is done, and there is nothing of it.
  void leave_out(const std::string& step) { finish_step(step, {}); }
  bool is_left_out(const std::string& step) const;

  /// Puts the journal in the order of the steps, then writes the manifest. Every step must be done. Of a
  /// session that was complete before, colours and monitors stay as its manifest had them.
  void finish(CaptureSession session);

 private:
  void clear();
  void take_over_finished_steps();
  fs::path folder_;
  std::vector<std::string> steps_;
  std::vector<JournalEntry> entries_;
  std::size_t found_done_ = 0;
  std::size_t found_damaged_ = 0;
  bool complete_ = false;
};

}  // namespace refield
