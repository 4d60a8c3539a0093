// SPDX-License-Identifier: Apache-2.0
#include "cli/relight/seen_share.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace refield::cli {

void SeenShares::add(const std::string& light, const EnvironmentShare& share) {
  const std::scoped_lock lock(mutex_);
  entries_.insert(std::ranges::upper_bound(entries_, light, {}, &Entry::light), {light, share});
}

void SeenShares::print() const {
  constexpr std::size_t most_lines = 12;
  if (entries_.empty()) return;
  std::printf("The monitor covers %.1f %% of all directions; light from other directions is ignored.\n",
              100.0 * entries_.front().share.sphere);
  if (entries_.size() <= most_lines) {
    for (const Entry& entry : entries_)
      std::printf("%s: %.1f %% of the map's light comes from these directions\n", entry.light.c_str(),
                  100.0 * entry.share.energy);
    return;
  }
  const auto energy = [](const Entry& entry) { return entry.share.energy; };
  const auto [least, most] = std::ranges::minmax_element(entries_, {}, energy);
  std::printf("%.1f %% (%s) to %.1f %% (%s) of the maps' light comes from these directions\n",
              100.0 * energy(*least), least->light.c_str(), 100.0 * energy(*most), most->light.c_str());
}

nlohmann::ordered_json SeenShares::json() const {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Entry& entry : entries_)
    list.push_back({{"light", entry.light},
                    {"share_of_directions", entry.share.sphere},
                    {"share_of_light", entry.share.energy}});
  return list;
}

}  // namespace refield::cli
