// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace refield {

/// Base of every error that refield expects. The message names the file or option, the offending value and
/// the remedy. The command line prints it and exits with status 2; anything else is a defect (status 1).
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What the user gave cannot be used: an option out of range, images that do not fit together, too few
/// images.
class InputError : public Error {
 public:
  using Error::Error;
};

/// A file's content breaks its format: truncated, of another kind, of another version.
class FormatError : public Error {
 public:
  FormatError(const std::filesystem::path& path, const std::string& what)
      : Error(path.string() + ": " + what), path_(path) {}
  /// `offset` is the byte position at which reading failed.
  FormatError(const std::filesystem::path& path, std::uint64_t offset, const std::string& what)
      : Error(path.string() + " at byte " + std::to_string(offset) + ": " + what), path_(path) {}
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// The operating system refused an operation on a device or a file system: unplugged, no space, no
/// permission.
class DeviceError : public Error {
 public:
  /// `error_number` is errno as it stood after the failed call.
  DeviceError(const std::string& device, int error_number, const std::string& what);
  int error_number() const { return error_number_; }

 private:
  int error_number_;
};

/// A numerical method could not reach a valid answer.
class SolverError : public Error {
 public:
  using Error::Error;
};

/// The user asked to stop (Ctrl-C, SIGTERM). Work done so far is on disk; the command line exits with 130.
class Interrupted : public std::runtime_error {
 public:
  Interrupted() : std::runtime_error("interrupted") {}
};

}  // namespace refield
