// SPDX-License-Identifier: Apache-2.0
#include "core/base/output_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "core/base/files.h"
#include "core/session/capture_session.h"

namespace refield {

namespace {

/// Files of a session folder beside those that its manifest lists.
constexpr const char* session_files[] = {session_manifest_name, "plan.toml",      "journal",
                                         "calibration.toml",    "ambient.exr",    "mask.png",
                                         "transport.rfield",    "simulation.json"};

/// The files that an input stands for, as far as they can be told; whoever reads it reports what is wrong.
std::vector<fs::path> files_of(const fs::path& input) {
  std::error_code error;
  std::vector<fs::path> files;
  if (fs::is_regular_file(input, error)) return {input};
  const bool session = fs::is_regular_file(input / session_manifest_name, error);
  if (session)
    for (const char* name : session_files) files.push_back(input / name);
  try {
    if (session) {
      const CaptureSession read = read_capture_session(input);
      for (const CaptureFrame& frame : read.frames) {
        files.push_back(frame.illumination);
        files.push_back(frame.observed);
      }
      if (read.ambient) files.push_back(*read.ambient);
      if (read.mask) files.push_back(*read.mask);
    } else {
      for (const fs::path& file : expand_globs({input.string()})) files.push_back(file);
    }
  } catch (const Error&) {
  }
  return files;
}

/// The process that holds a lock on the file: 0 where the system does not say.
long holder_of(const struct stat& file) {
  // "1: FLOCK  ADVISORY  WRITE 1234 08:01:5678 0 EOF": the process, then device and inode.
  std::ifstream locks("/proc/locks");
  const std::string inode = ":" + std::to_string(file.st_ino);
  for (std::string line; std::getline(locks, line);) {
    std::istringstream words(line);
    std::string number, kind, advisory, mode, place;
    long process = 0;
    if (words >> number >> kind >> advisory >> mode >> process >> place && kind == "FLOCK" && process > 0 &&
        place.ends_with(inode))
      return process;
  }
  return 0;
}

enum class Outcome { locked, unsupported, gone };

/// `file` is empty for a folder, which stays where it is.
Outcome lock(int descriptor, const fs::path& file, const fs::path& output) {
  struct stat held {
  }, now{};
  ::fstat(descriptor, &held);
  if (::flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK) return Outcome::unsupported;
    const long process = holder_of(held);
    throw InputError(output, ": another run",
                     process > 0 ? " (process " + std::to_string(process) + ")" : std::string(),
                     " writes this output; wait for it, stop it, or give another output");
  }
  if (file.empty()) return Outcome::locked;
  // The earlier holder may have removed the file between our opening and locking it.
  const bool same =
      ::lstat(file.c_str(), &now) == 0 && now.st_ino == held.st_ino && now.st_dev == held.st_dev;
  return same ? Outcome::locked : Outcome::gone;
}

fs::path lock_file_of(const fs::path& output) {
  constexpr std::size_t max_tail = 240;
  const std::string name = output.filename().string();
  const std::string lock_name =
      ".lock-" + (name.size() > max_tail ? name.substr(name.size() - max_tail) : name);
  return output.parent_path() / lock_name;
}

/// Temporaries of write_atomically() for the files of `folder` that are `wanted`.
template <class Wanted>
void remove_leftovers(const fs::path& folder, Wanted wanted) {
  constexpr std::string_view prefix = ".partial-";
  constexpr std::size_t digits = 16;
  std::error_code ignored;
  for (fs::directory_iterator entry(folder, ignored), end; entry != end; entry.increment(ignored)) {
    if (ignored) return;
    const std::string name = entry->path().filename().string();
    if (name.starts_with(prefix) && name.size() > prefix.size() + digits + 1 &&
        wanted(name.substr(prefix.size() + digits + 1)) &&
        entry->symlink_status(ignored).type() == fs::file_type::regular)
      fs::remove(entry->path(), ignored);
  }
}

}  // namespace

void require_not_an_input(const fs::path& output, const std::vector<fs::path>& inputs) {
  std::error_code error;
  if (output.empty() || !fs::exists(output, error)) return;
  for (const fs::path& input : inputs) {
    if (input.empty()) continue;
    const bool folder = fs::is_directory(input, error);
    for (const fs::path& file : files_of(input))
      if (fs::equivalent(file, output, error))
        throw InputError(output, ": is also an input",
                         folder ? ", a file of " + input.string() : std::string(), "; give another output");
  }
}

void require_outside(const fs::path& folder, const std::vector<fs::path>& inputs) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) return;
  for (const fs::path& input : inputs)
    for (const fs::path& file : input.empty() ? std::vector<fs::path>{} : files_of(input))
      for (fs::path above = fs::canonical(file, error).parent_path(); !error && above.has_relative_path();
           above = above.parent_path())
        if (fs::equivalent(above, folder, error))
          throw InputError(file, ": is an input in the output folder ", folder,
                           ", whose content is to be replaced; give another output folder");
}

OutputLock::OutputLock(const fs::path& given, const std::vector<fs::path>& inputs,
                       const std::string& extension) {
  if (given.empty()) throw InputError("the output has no name; give one");
  if (!extension.empty() && given.extension() != extension)
    throw InputError(given, ": the output is a file of the kind ", extension, "; give a name that ends in ",
                     extension);
  require_not_an_input(given, inputs);
  // Throws for names that the system refuses, before hours of work rather than after them.
  const bool is_folder = fs::is_directory(given);
  if (is_folder && !extension.empty()) throw InputError(given, ": is a folder; give the name of a file");
  fs::path output = fs::absolute(given).lexically_normal();
  if (!output.has_filename()) output = output.parent_path();
  create_folders(output.parent_path());
  for (;;) {
    file_ = lock_file_of(output);
    // On NFS only files that are open for writing can be locked.
    for (const int access : {O_RDWR, O_RDONLY})
      if (descriptor_ < 0)
        descriptor_ = ::open(file_.c_str(), access | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0666);
    if (descriptor_ < 0 && is_folder && (errno == EACCES || errno == EROFS || errno == EPERM)) {
      file_.clear();
      descriptor_ = ::open(output.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    }
    if (descriptor_ < 0) throw DeviceError(given.string(), errno, "cannot create the output");
    try {
      const Outcome outcome = lock(descriptor_, file_, given);
      if (outcome != Outcome::gone) break;
    } catch (...) {
      ::close(descriptor_);
      throw;
    }
    ::close(descriptor_);
    descriptor_ = -1;
  }
  // No one writes them now: those in a folder belong to runs that hold the folder, or the file itself.
  if (!file_.empty())
    remove_leftovers(output.parent_path(),
                     [&](const std::string& name) { return name == output.filename(); });
  if (is_folder)
    remove_leftovers(output,
                     [&](const std::string& name) { return !fs::exists(lock_file_of(output / name)); });
}

OutputLock::~OutputLock() {
  if (!file_.empty()) ::unlink(file_.c_str());
  ::close(descriptor_);
}

}  // namespace refield
