// SPDX-License-Identifier: Apache-2.0
#include "relight/pack/pack.h"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "core/base/rng.h"
#include "core/base/run_context.h"

namespace refield {

namespace {

LightMap dark(const LightDomain& domain) {
  return {Image(domain.width, domain.height, 3), domain.parameterisation};
}

/// White inside a rectangle given in shares of the map; at least one texel.
LightMap rectangle(const LightDomain& domain, double x0, double y0, double width, double height) {
  const auto span_of = [](double first, double size, int texels) {
    const int from = std::clamp(static_cast<int>(std::lround(first * texels)), 0, texels - 1);
    const int count = std::max(1, static_cast<int>(std::lround(size * texels)));
    return std::pair(from, std::min(from + count, texels));
  };
  const auto [left, right] = span_of(x0, width, domain.width);
  const auto [top, bottom] = span_of(y0, height, domain.height);
  LightMap light = dark(domain);
  for (int y = top; y < bottom; ++y) std::fill_n(&light.radiance.at(left, y, 0), 3 * (right - left), 1.0f);
  return light;
}

LightMap single_texels(const LightDomain& domain, Rng& rng) {
  LightMap light = dark(domain);
  const auto texels = light.radiance.pixel_count();
  for (std::size_t i = 0; i < std::max<std::size_t>(1, texels / 100); ++i) {
    const std::size_t at = rng.below(texels);
    for (std::size_t c = 0; c < 3; ++c) light.radiance.values[3 * at + c] = static_cast<float>(rng.uniform());
  }
  return light;
}

/// Adds random values on a grid of nodes, linear in between.
void add_octave(LightMap& light, int nodes, double amplitude, Rng& rng) {
  const auto side = static_cast<std::size_t>(nodes) + 1;
  std::vector<double> values(side * side * 3);
  for (double& value : values) value = amplitude * rng.uniform();
  Image& radiance = light.radiance;
  for (int y = 0; y < radiance.height; ++y)
    for (int x = 0; x < radiance.width; ++x) {
      const double u = (x + 0.5) / radiance.width * nodes, v = (y + 0.5) / radiance.height * nodes;
      const auto i = static_cast<std::size_t>(u), j = static_cast<std::size_t>(v);
      const double right = u - static_cast<double>(i), below = v - static_cast<double>(j);
      for (std::size_t c = 0; c < 3; ++c) {
        const auto node = [&](std::size_t column, std::size_t row) {
          return values[(row * side + column) * 3 + c];
        };
        radiance.at(x, y, static_cast<int>(c)) +=
            static_cast<float>((node(i, j) * (1 - right) + node(i + 1, j) * right) * (1 - below) +
                               (node(i, j + 1) * (1 - right) + node(i + 1, j + 1) * right) * below);
      }
    }
}

LightMap smooth(const LightDomain& domain, Rng& rng) {
  LightMap light = dark(domain);
  for (int nodes = 2; nodes <= std::max(2, std::min(domain.width, domain.height) / 2); nodes *= 2)
    add_octave(light, nodes, 1.0 / nodes, rng);
  // Bright places few and far between, as area lights and windows are.
  for (float& value : light.radiance.values) value = value * value * value;
  return light;
}

}  // namespace

std::vector<ProbeLights> probe_lights(const LightDomain& domain) {
  Rng rng(20);
  std::vector<ProbeLights> probes = {{"white", {rectangle(domain, 0, 0, 1, 1)}},
                                     {"texels", {}},
                                     {"bar", {}},
                                     {"square", {}},
                                     {"smooth", {}}};
  constexpr double bar = 1.0 / 8;
  for (const double at : {0.25, 0.625}) {
    probes[1].lights.push_back(single_texels(domain, rng));
    probes[2].lights.push_back(rectangle(domain, at, 0, bar, 1));
    probes[2].lights.push_back(rectangle(domain, 0, at, 1, bar));
    probes[4].lights.push_back(smooth(domain, rng));
  }
  const double side = std::min(domain.width, domain.height) / 20.0;
  for (const auto& [x, y] : {std::pair(0.15, 0.15), std::pair(0.8, 0.15), std::pair(0.5, 0.5),
                             std::pair(0.15, 0.8), std::pair(0.8, 0.8)})
    probes[3].lights.push_back(rectangle(domain, x, y, side / domain.width, side / domain.height));
  return probes;
}

namespace {

using RgbSums = std::array<double, 3>;
constexpr int levels_an_octave = 4;
constexpr std::size_t stretch = 4096;  // pixels that a pass looks at before it gives memory back
constexpr int least_octave = -24;      // of the lowest threshold, in units of the picture's energy

/// A pixel's kernels from weak to strong.
struct RankedEntry {
  std::uint64_t entry = 0;
  float energy = 0.0f;
  int level = 0;  // from which on it is pruned
};

class PixelRanking {
 public:
  PixelRanking(const ReflectanceField& field, const std::vector<float>& area, double unit, bool has_negative)
      : transfer_(field.transfer), area_(area), unit_(unit), has_negative_(has_negative) {}

  /// What a channel's other kernels are multiplied by when `pruned` of its energy `all` is left out. One for
  /// fields whose weights have both signs: there white light's picture is a difference, and says little.
  double factor_of(double all, double pruned) const {
    return !has_negative_ && pruned > 0.0 && pruned < all ? all / (all - pruned) : 1.0;
  }

  float energy(std::uint64_t entry, int channel) const {
    return std::abs(transfer_.weight[3 * entry + static_cast<std::size_t>(channel)]) *
           area_[transfer_.column[entry]];
  }

  void rank(std::size_t pixel, std::vector<RankedEntry>& ranked) const {
    ranked.clear();
    for (auto e = transfer_.row_start[pixel]; e < transfer_.row_start[pixel + 1]; ++e) {
      const float strongest = std::max({energy(e, 0), energy(e, 1), energy(e, 2)});
      ranked.push_back({e, strongest, first_level_above(strongest)});
    }
    std::ranges::sort(ranked, [](const RankedEntry& a, const RankedEntry& b) {
      return a.energy != b.energy ? a.energy < b.energy : a.entry < b.entry;
    });
    if (!ranked.empty()) ranked.back().level = Pruning::levels;
  }

 private:
  int first_level_above(double energy) const {
    if (energy <= 0.0) return 1;
    const double octaves = std::log2(energy / unit_) - least_octave;
    return std::clamp(static_cast<int>(std::floor(octaves * levels_an_octave)) + 1, 1, Pruning::levels);
  }

  const SparseTransfer& transfer_;
  const std::vector<float>& area_;
  double unit_;
  bool has_negative_;
};

/// Light of all probes under each kernel.
class ProbeCoefficients {
 public:
  ProbeCoefficients(const LightBasis& basis, const std::vector<ProbeLights>& probes) {
    for (std::size_t kind = 0; kind < probes.size(); ++kind)
      kinds.insert(kinds.end(), probes[kind].lights.size() * 3, kind);
    values_.resize(basis.size() * kinds.size());
    std::size_t first = 0;
    for (const ProbeLights& probe : probes)
      for (const LightMap& light : probe.lights) {
        const std::vector<float> projected = basis.project(light);
        for (std::size_t k = 0; k < basis.size(); ++k)
          std::copy_n(projected.data() + 3 * k, 3, values_.data() + k * kinds.size() + first);
        first += 3;
      }
  }
  /// [lights × 3], a kernel's.
  const float* of(std::uint32_t kernel) const { return values_.data() + kernel * kinds.size(); }
  std::vector<std::size_t> kinds;  ///< [lights × 3]

 private:
  std::vector<float> values_;
};

/// Σ of squares by kind.
using SumsByKind = std::vector<double>;

/// Gathers, pixel by pixel, the squares of the pictures and by how much each level changes those of its
/// error.
class ErrorSums {
 public:
  ErrorSums(const SparseTransfer& transfer, const PixelRanking& ranking, const ProbeCoefficients& light,
            std::size_t kinds)
      : signal(kinds, 0.0),
        steps(Pruning::levels, SumsByKind(kinds, 0.0)),
        transfer_(transfer),
        ranking_(ranking),
        light_(light),
        full_(light.kinds.size()),
        pruned_(light.kinds.size()) {}

  void add_pixel(std::size_t pixel) {
    ranking_.rank(pixel, ranked_);
    RgbSums energy{}, pruned_energy{};
    std::ranges::fill(full_, 0.0f);
    std::ranges::fill(pruned_, 0.0f);
    for (const RankedEntry& ranked : ranked_) {
      add(ranked.entry, full_);
      for (int c = 0; c < 3; ++c) energy[static_cast<std::size_t>(c)] += ranking_.energy(ranked.entry, c);
    }
    for (std::size_t i = 0; i < full_.size(); ++i) signal[light_.kinds[i]] += double{full_[i]} * full_[i];
    SumsByKind before(signal.size(), 0.0), now(signal.size());
    for (std::size_t i = 0; i < ranked_.size() && ranked_[i].level < Pruning::levels; ++i) {
      add(ranked_[i].entry, pruned_);
      for (int c = 0; c < 3; ++c)
        pruned_energy[static_cast<std::size_t>(c)] += ranking_.energy(ranked_[i].entry, c);
      if (ranked_[i + 1].level == ranked_[i].level) continue;
      sum_squares(energy, pruned_energy, now);
      SumsByKind& step = steps[static_cast<std::size_t>(ranked_[i].level)];
      for (std::size_t kind = 0; kind < step.size(); ++kind) step[kind] += now[kind] - before[kind];
      before = now;
    }
  }

  SumsByKind signal;
  std::vector<SumsByKind> steps;  // [levels]

 private:
  void add(std::uint64_t entry, std::vector<float>& picture) const {
    const float* light = light_.of(transfer_.column[entry]);
    const float* weight = transfer_.weight.data() + 3 * entry;
    for (std::size_t i = 0; i < picture.size(); i += 3)
      for (std::size_t c = 0; c < 3; ++c) picture[i + c] += weight[c] * light[i + c];
  }

  /// Sums the squared error, full − factor · (full − pruned), written so that small ones keep their digits.
  void sum_squares(const RgbSums& energy, const RgbSums& pruned_energy, SumsByKind& sums) const {
    std::ranges::fill(sums, 0.0);
    RgbSums factor;
    for (std::size_t c = 0; c < 3; ++c) factor[c] = ranking_.factor_of(energy[c], pruned_energy[c]);
    for (std::size_t i = 0; i < full_.size(); ++i) {
      const double error = factor[i % 3] * pruned_[i] - (factor[i % 3] - 1.0) * full_[i];
      sums[light_.kinds[i]] += error * error;
    }
  }

  const SparseTransfer& transfer_;
  const PixelRanking& ranking_;
  const ProbeCoefficients& light_;
  std::vector<float> full_, pruned_;  // [lights × 3], a pixel's under each
  std::vector<RankedEntry> ranked_;
};

}  // namespace

Pruning::Pruning(const ReflectanceField& field, const std::vector<ProbeLights>& probes, const RunContext& run)
    : field_(field) {
  area_.resize(field.basis.size());
  tbb::parallel_for(std::size_t{0}, area_.size(),
                    [&](std::size_t k) { area_[k] = static_cast<float>(field.basis.area(k)); });
  const std::size_t pixels = field.transfer.rows();
  for (std::size_t p = 0; p < pixels; ++p) {
    RgbSums energy{};
    for (auto e = field.transfer.row_start[p]; e < field.transfer.row_start[p + 1]; ++e)
      for (std::size_t c = 0; c < 3; ++c) {
        const float weight = field.transfer.weight[3 * e + c];
        has_negative_ = has_negative_ || weight < 0.0f;
        energy[c] += std::abs(weight) * area_[field.transfer.column[e]];
      }
    const double strongest = std::ranges::max(energy);
    unit_ += strongest * strongest / static_cast<double>(pixels);
    if (const std::size_t done = p + 1; done % stretch == 0 || done == pixels)
      field.transfer.pass_by_rows(p / stretch * stretch, done);
  }
  unit_ = unit_ > 0.0 ? std::sqrt(unit_) : 1.0;
  measure(probes, run);
}

void Pruning::measure(const std::vector<ProbeLights>& probes, const RunContext& run) {
  const ProbeCoefficients light(field_.basis, probes);
  const PixelRanking ranking(field_, area_, unit_, has_negative_);
  // A sum for each stretch of pixels, added up in their order: the result does not depend on the cores.
  const std::size_t pixels = field_.transfer.rows();
  const ErrorSums none(field_.transfer, ranking, light, probes.size());
  std::vector<ErrorSums> sums((pixels + stretch - 1) / stretch, none);
  Progress progress(run, "computing kernel weights", sums.size());
  tbb::parallel_for(std::size_t{0}, sums.size(), [&](std::size_t i) {
    run.throw_if_stopped();
    const std::size_t first = i * stretch, last = std::min(first + stretch, pixels);
    for (std::size_t p = first; p < last; ++p) sums[i].add_pixel(p);
    field_.transfer.pass_by_rows(first, last);
    progress.advance();
  });
  SumsByKind signal(probes.size(), 0.0), error(probes.size(), 0.0);
  for (const ErrorSums& part : sums) std::ranges::transform(signal, part.signal, signal.begin(), std::plus());
  for (std::size_t level = 0; level < levels; ++level) {
    for (const ErrorSums& part : sums)
      std::ranges::transform(error, part.steps[level], error.begin(), std::plus());
    std::vector<double>& squared = squared_errors_.emplace_back();
    for (std::size_t kind = 0; kind < error.size(); ++kind)
      squared.push_back(signal[kind] > 0.0 ? std::max(0.0, error[kind]) / signal[kind] : 0.0);
  }
}

SparseTransfer Pruning::prune(int level, RowRange rows) const {
  const SparseTransfer& from = field_.transfer;
  const PixelRanking ranking(field_, area_, unit_, has_negative_);
  std::vector<SparseTransfer> parts(static_cast<std::size_t>(rows.count()));  // one for each row
  const auto width = static_cast<std::size_t>(field_.width);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t y) {
    SparseTransfer& pruned = parts[y];
    std::vector<RankedEntry> ranked;
    const std::size_t first = (static_cast<std::size_t>(rows.first) + y) * width;
    for (std::size_t p = first; p < first + width; ++p) {
      ranking.rank(p, ranked);
      RgbSums energy{}, pruned_energy{};
      for (const RankedEntry& entry : ranked)
        for (int c = 0; c < 3; ++c) {
          const auto channel = static_cast<std::size_t>(c);
          energy[channel] += ranking.energy(entry.entry, c);
          if (entry.level <= level) pruned_energy[channel] += ranking.energy(entry.entry, c);
        }
      std::erase_if(ranked, [&](const RankedEntry& entry) { return entry.level <= level; });
      std::ranges::sort(ranked, {}, &RankedEntry::entry);
      for (const RankedEntry& entry : ranked) {
        pruned.column.push_back(from.column[entry.entry]);
        for (std::size_t c = 0; c < 3; ++c)
          pruned.weight.push_back(static_cast<float>(from.weight[3 * entry.entry + c] *
                                                     ranking.factor_of(energy[c], pruned_energy[c])));
      }
      pruned.row_start.push_back(pruned.column.size());
    }
  });
  from.pass_by_rows(static_cast<std::size_t>(rows.first) * width,
                    static_cast<std::size_t>(rows.last) * width);
  SparseTransfer pruned;
  for (const SparseTransfer& part : parts) {
    const std::size_t before = pruned.entries();
    pruned.column.insert(pruned.column.end(), part.column.begin(), part.column.end());
    pruned.weight.insert(pruned.weight.end(), part.weight.begin(), part.weight.end());
    for (std::size_t p = 1; p < part.row_start.size(); ++p)
      pruned.row_start.push_back(before + part.row_start[p]);
  }
  return pruned;
}

}  // namespace refield
