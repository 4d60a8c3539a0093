// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>

#include "simulate/dynamic/object_transport.h"

namespace refield::dynamic {

/// Precomputed transport on disk, one file per object. A file is found by a 128-bit hash of everything that
/// object_transport() reads (mesh, BRDF, options) and of the program file's size and date, so that a changed
/// mesh file, a changed material or another version never finds it; a changed position, motion or light
/// source still does. Errors of the file system and damaged or foreign files cost a new precomputation,
/// nothing else.
class TransportCache {
 public:
  static constexpr std::uint64_t default_max_bytes = std::uint64_t{1} << 30;

  /// Nothing is stored where `folder` is empty. `max_bytes`: of all files together; those used least recently
  /// are removed first.
  explicit TransportCache(std::filesystem::path folder, std::uint64_t max_bytes = default_max_bytes);
  /// In $REFIELD_CACHE, else $XDG_CACHE_HOME/refield, else ~/.cache/refield; REFIELD_CACHE=off stores
  /// nothing.
  static TransportCache from_environment();

  const std::filesystem::path& folder() const { return folder_; }
  /// Where the transport of an object is stored.
  std::filesystem::path file_of(const MovingObject& object, const TransportOptions& options) const;

  /// The stored transport; nothing where there is none that can be used.
  std::optional<ObjectTransport> load(const MovingObject& object, const TransportOptions& options) const;
  /// Never throws an Error: what cannot be written is precomputed again next time.
  void store(const MovingObject& object, const TransportOptions& options,
             const ObjectTransport& transport) const;

 private:
  void remove_oldest() const;

  std::filesystem::path folder_;
  std::uint64_t max_bytes_;
};

}  // namespace refield::dynamic
