// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstdint>

namespace refield {

/// Counter-based random numbers (SplitMix64; Steele, Lea and Flood 2014). A stream is named by its keys, for
/// example Rng(seed, light, pixel): results do not depend on the order of work or on the number of threads.
class Rng {
 public:
  template <class... Keys>
  explicit Rng(std::uint64_t seed, Keys... keys) : state_(mix(seed + increment)) {
    ((state_ = mix(state_ ^ (static_cast<std::uint64_t>(keys) + increment))), ...);
  }

  std::uint64_t next() { return mix(state_ += increment); }
  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Uniform integer in [0, count), 0 < count < 2^53.
  std::uint64_t below(std::uint64_t count) {
    return static_cast<std::uint64_t>(uniform() * static_cast<double>(count));
  }
  /// Standard normal.
  double normal();
  /// Poisson with the given mean ≥ 0; exact below 64, a rounded normal above (relative error of its moments <
  /// 1e-3).
  double poisson(double mean);

 private:
  static constexpr std::uint64_t increment = 0x9e3779b97f4a7c15ull;
  static constexpr std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
    return z ^ (z >> 31);
  }
  std::uint64_t state_;
};

}  // namespace refield
