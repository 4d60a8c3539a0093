// SPDX-License-Identifier: Apache-2.0
#include "acquire/capture/session_writer.h"

#include <sstream>

#include "core/base/files.h"

namespace refield {

namespace {

constexpr const char* plan_name = "plan.toml";
constexpr const char* journal_name = "journal";
/// The manifest of a session that was complete, while damaged files are taken again.
constexpr const char* former_manifest_name = "session.before.toml";
// In the order in which replacing removes them: the plan goes last, so that a session stays recognisable.
constexpr std::array<const char*, 11> contents = {session_manifest_name,
                                                  former_manifest_name,
                                                  journal_name,
                                                  "ambient.exr",
                                                  "mask.png",
                                                  "raw",
                                                  "observed",
                                                  session_notes_name,
                                                  "illumination",
                                                  "calibration.toml",
                                                  plan_name};

/// A crash leaves temporaries of write_atomically() behind.
bool is_leftover(const fs::path& path) {
  return path.filename().string().starts_with(".partial-");
}

bool holds_anything(const fs::path& folder) {
  if (!fs::exists(folder)) return false;
  if (!fs::is_directory(folder)) throw InputError(folder, ": is no folder; name another output folder");
  return !std::ranges::all_of(fs::directory_iterator(folder),
                              [](const auto& entry) { return is_leftover(entry.path()); });
}

void remove_leftovers(const fs::path& folder) {
  std::vector<fs::path> leftovers;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file() && is_leftover(entry.path())) leftovers.push_back(entry.path());
  for (const fs::path& path : leftovers) fs::remove(path);
}

/// Removes a file that a journal names, unless that leads out of the folder.
void remove_inside(const fs::path& folder, const fs::path& file) {
  const fs::path normal = file.lexically_normal();
  if (normal.is_absolute() || normal.empty() || *normal.begin() == "..") return;
  std::error_code ignored;
  if (!fs::is_directory(folder / normal, ignored)) fs::remove(folder / normal, ignored);
}

/// Whether a step may have left a file: one of its name, inside the folder.
bool is_own(const std::string& step, const fs::path& file) {
  const fs::path normal = file.lexically_normal();
  return normal.is_relative() && *normal.begin() != ".." && normal.filename().string().starts_with(step);
}

/// Throws where the manifest of a complete session names other files than its frames left. One that cannot be
/// read is left to its readers.
void require_frames_of(const std::vector<JournalEntry>& entries, const fs::path& folder) {
  CaptureSession session;
  try {
    session = read_capture_session(folder);
  } catch (const Error&) {
    return;
  }
  for (const CaptureFrame& frame : session.frames) {
    const auto entry = std::ranges::find(entries, frame.name, &JournalEntry::step);
    for (const fs::path& path : {frame.illumination, frame.observed}) {
      const std::string file = path.lexically_relative(folder).generic_string();
      if (entry == entries.end() ||
          std::ranges::find(entry->files, file, &JournalFile::path) == entry->files.end())
        throw InputError(folder / session_manifest_name, ": frame '", frame.name, "' names ", path,
                         ", which the capture did not write for it; correct the manifest, or remove it so "
                         "that --resume writes it again");
    }
  }
}

void require_same_plan(const fs::path& path, const std::string& stored, const std::string& wanted) {
  if (stored == wanted) return;
  std::istringstream old_lines(stored);
  std::istringstream new_lines(wanted);
  std::string before;
  std::string now;
  do {
    before.clear();
    now.clear();
    std::getline(old_lines, before);
    std::getline(new_lines, now);
  } while (before == now && old_lines && new_lines);
  throw InputError(path, ": the capture was begun with other inputs or options ('", before, "', now '", now,
                   "'); resume with the same ones, or start again with --force");
}

}  // namespace

void check_session_folder(const fs::path& folder, IfExists if_exists) {
  if (!holds_anything(folder)) return;
  if (!fs::exists(folder / plan_name))
    throw InputError(folder, ": holds files that are not from a capture; name an empty or new folder");
  if (if_exists != IfExists::refuse) return;
  const bool complete = fs::exists(folder / session_manifest_name);
  throw InputError(folder, ": already holds ", complete ? "a complete" : "an incomplete",
                   " capture; --resume continues it, --force replaces it");
}

FrameRole role_of_light(const std::string& name) {
  if (name.starts_with("reference") || name.ends_with("_reference")) return FrameRole::reference;
  return name.starts_with("test") ? FrameRole::test : FrameRole::train;
}

std::optional<std::string> stored_plan(const fs::path& folder) {
  if (!fs::is_regular_file(folder / plan_name)) return std::nullopt;
  return read_text(folder / plan_name);
}

SessionWriter::SessionWriter(fs::path folder, const std::string& plan, std::vector<std::string> steps,
                             IfExists if_exists)
    : folder_(std::move(folder)), steps_(std::move(steps)) {
  check_session_folder(folder_, if_exists);
  create_folders(folder_);
  if (if_exists == IfExists::replace) clear();
  remove_leftovers(folder_);
  if (const auto stored = stored_plan(folder_))
    require_same_plan(folder_ / plan_name, *stored, plan);
  else
    write_text_atomically(folder_ / plan_name, plan);
  create_folders(folder_ / "illumination");
  create_folders(folder_ / "observed");
  take_over_finished_steps();
}

void SessionWriter::clear() {
  // What the journal does not name is the user's, or a file of a step that was under way.
  for (const JournalEntry& entry : read_journal(folder_ / journal_name))
    for (const JournalFile& file : entry.files) remove_inside(folder_, file.path);
  for (const std::string& step : steps_)
    for (const char* kind : {"illumination", "observed"})
      remove_inside(folder_, kind + ("/" + step + ".exr"));
  std::error_code ignored;
  for (const char* name : contents) fs::remove(folder_ / name, ignored);  // folders, once they are empty
}

void SessionWriter::take_over_finished_steps() {
  const auto found = read_journal(folder_ / journal_name);
  for (const std::string& step : steps_) {
    const auto entry = std::ranges::find(found, step, &JournalEntry::step);
    if (entry == found.end()) continue;
    if (std::ranges::all_of(entry->files, [&](const JournalFile& file) {
          return is_own(step, file.path) && is_intact(folder_, file);
        }))
      entries_.push_back(*entry);
    else
      ++found_damaged_;
  }
  found_done_ = entries_.size();
  complete_ = entries_.size() == steps_.size() && fs::exists(folder_ / session_manifest_name);
  if (complete_) return require_frames_of(entries_, folder_);
  if (fs::exists(folder_ / session_manifest_name))
    fs::rename(folder_ / session_manifest_name, folder_ / former_manifest_name);
  // Torn lines and lines of damaged steps go, so that what follows is appended to a sound journal.
  write_journal(folder_ / journal_name, entries_);
}

bool SessionWriter::is_done(const std::string& step) const {
  return std::ranges::find(entries_, step, &JournalEntry::step) != entries_.end();
}

bool SessionWriter::is_left_out(const std::string& step) const {
  const auto entry = std::ranges::find(entries_, step, &JournalEntry::step);
  return entry != entries_.end() && entry->files.empty();
}

void SessionWriter::finish_step(const std::string& step, const std::vector<std::string>& files) {
  JournalEntry entry{step, {}};
  for (const std::string& file : files) entry.files.push_back(inspect_file(folder_, file));
  append_to_journal(folder_ / journal_name, entry);
  entries_.push_back(std::move(entry));
}

void SessionWriter::finish(CaptureSession session) {
  std::vector<JournalEntry> ordered;
  for (const std::string& step : steps_) {
    const auto entry = std::ranges::find(entries_, step, &JournalEntry::step);
    if (entry == entries_.end()) throw InputError("step '", step, "' of the capture is not done");
    ordered.push_back(*entry);
  }
  write_journal(folder_ / journal_name, ordered);
  // Found from other photographs than those that were damaged, and so still valid.
  const fs::path former = folder_ / former_manifest_name;
  if (fs::exists(former)) read_calibration_of_manifest(former, session);
  write_session_manifest(session);
  fs::remove(former);
  complete_ = true;
}

}  // namespace refield
