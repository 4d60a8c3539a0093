// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

// What librefield.so exports; all else in it is hidden.
#define REFIELD_API __attribute__((visibility("default")))

/// What the caller of a long operation supplies, and what the library throws.
///
/// The library writes nothing to standard error, reads no global flag and handles no signal.
namespace refield {

struct IsolatedReading;

inline namespace v0_2 {

/// A message of several parts: texts and paths as they are, numbers as std::to_string() writes them.
template <class... Parts>
std::string concatenated(const Parts&... parts) {
  std::string message;
  const auto append = [&]<class Part>(const Part& part) {
    if constexpr (std::is_same_v<Part, std::filesystem::path>)
      message += part.string();
    else if constexpr (std::is_arithmetic_v<Part> && !std::is_same_v<Part, char>)
      message += std::to_string(part);
    else
      message += part;
  };
  (append(parts), ...);
  return message;
}

/// Base of every error that refield expects. The message names the file or option, the offending value and
/// the remedy. The command line prints it and exits with status 2; anything else is a defect (status 1).
class REFIELD_API Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What the user gave cannot be used: an option out of range, images that do not fit together, too few
/// images.
class REFIELD_API InputError : public Error {
 public:
  using Error::Error;
  /// The message is concatenated() `parts`.
  template <class... Parts>
  requires(sizeof...(Parts) > 1) explicit InputError(const Parts&... parts) : Error(concatenated(parts...)) {}
};

/// A file's content breaks its format: truncated, of another kind, of another version.
class REFIELD_API FormatError : public Error {
 public:
  FormatError(const std::filesystem::path& path, const std::string& what)
      : Error(path.string() + ": " + what), path_(path) {}
  /// `offset` is the byte position at which reading failed.
  FormatError(const std::filesystem::path& path, std::uint64_t offset, const std::string& what)
      : Error(path.string() + " at byte " + std::to_string(offset) + ": " + what), path_(path) {}
  /// The message is concatenated() of the parts, the first of which is no number.
  template <class First, class... Parts>
  requires(sizeof...(Parts) > 0 && !std::is_arithmetic_v<First>)
      FormatError(const std::filesystem::path& path, const First& first, const Parts&... parts)
      : FormatError(path, concatenated(first, parts...)) {}
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// The operating system refused an operation on a device or a file system: unplugged, no space, no
/// permission.
class REFIELD_API DeviceError : public Error {
 public:
  /// `error_number` is errno as it stood after the failed call.
  DeviceError(const std::string& device, int error_number, const std::string& what);
  template <class... Parts>
  requires(sizeof...(Parts) > 1)
      DeviceError(const std::string& device, int error_number, const Parts&... what)
      : DeviceError(device, error_number, concatenated(what...)) {}
  int error_number() const { return error_number_; }

 private:
  int error_number_;
};

/// A numerical method could not reach a valid answer.
class REFIELD_API SolverError : public Error {
 public:
  using Error::Error;
};

/// The user asked to stop (Ctrl-C, SIGTERM). Work done so far is on disk; the command line exits with 130.
class REFIELD_API Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

/// How far a stage of a long operation is. A stage is reported when it starts (done = 0), at most ten times
/// per second while it runs, and once when it ends; stages may contain others.
struct StageProgress {
  enum class Event { started, advanced, ended };
  Event event = Event::advanced;
  std::string stage;        ///< for people: "estimate", "light maps"
  std::uint64_t done = 0;   ///< units of work, such as pixels or files
  std::uint64_t total = 1;  ///< at least 1; a stage that throws ends with done < total
};

/// Reads a file in another process, for libraries that a damaged file can crash.
using IsolatedReader = std::function<std::optional<std::string>(const IsolatedReading&)>;

/// What the caller of a long operation supplies: where progress and notes go, a flag that stops the
/// operation, and a limit of threads. The default one is silent and never stops. Objects that work for long
/// keep a copy.
struct REFIELD_API RunContext {
  /// Called from any thread, for one stage never by two at once; must be quick and must not throw.
  std::function<void(const StageProgress&)> on_progress = nullptr;
  /// Receives findings that are no errors, such as frames that are left out: one line, without a line end.
  /// Called from any thread.
  std::function<void(const std::string&)> on_note = nullptr;
  /// The operation throws Interrupted soon after this becomes true. The caller owns it; a signal handler may
  /// set it. It must outlive the operation.
  const std::atomic<bool>* stop = nullptr;
  /// Reads fields (HDF5) and meshes (assimp) elsewhere, see isolated_reader(). Empty: they are read in this
  /// process, which is faster and meant for files of known origin.
  IsolatedReader read_isolated = nullptr;
  /// Limit of threads; 0: all that oneTBB has.
  int max_threads = 0;

  /// Sends concatenated() `parts` to on_note.
  template <class... Parts>
  void note(const Parts&... parts) const {
    if (on_note) on_note(concatenated(parts...));
  }
  bool is_stopped() const { return stop && *stop; }
  /// Throws Interrupted once a stop was requested, or the caller's group of TBB tasks was cancelled. Called
  /// between units of work whose results are already safe on disk.
  void throw_if_stopped() const;
};

/// For RunContext::read_isolated: starts `program`, the installed libexec/refield/refield-reader, for each
/// file. Until `stop` is set, where it is given; the caller owns it. A file that crashes the program, hangs
/// it or exhausts its limits makes the operation throw FormatError.
REFIELD_API IsolatedReader isolated_reader(const std::filesystem::path& program,
                                           const std::atomic<bool>* stop = nullptr);

}  // namespace v0_2
}  // namespace refield
