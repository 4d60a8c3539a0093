// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "relight/environment.h"

namespace refield::cli {

/// How much of each environment the monitor's windows saw, so that nobody takes a part for the whole.
class SeenShares {
 public:
  /// From any thread.
  void add(const std::string& light, const EnvironmentShare& share);

  /// One line a light; of many, one line for all.
  void print() const;
  nlohmann::ordered_json json() const;

 private:
  struct Entry {
    std::string light;
    EnvironmentShare share;
  };
  std::mutex mutex_;
  std::vector<Entry> entries_;  // by name, as threads do not come in order
};

}  // namespace refield::cli
