// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/light_maps.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <map>
#include <numeric>

#include "core/base/number_text.h"
#include "core/base/rng.h"
#include "core/image/metrics.h"

namespace refield {

namespace {

constexpr int views_of_a_panorama = 6;
// A view of 70° then has about one panorama pixel a texel.
constexpr int panorama_widths_of_a_map = 8;
constexpr int largest_panorama = 3072;
constexpr int first_coloured_view = 9999 * views_of_a_panorama;  // of panoramas that show no other light

std::string numbered(const char* role, int number) {
  return formatted("%s_%03d", role, number);
}

void fill(Image& image, int x0, int y0, int x1, int y1) {
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x)
      for (int c = 0; c < 3; ++c) image.at(x, y, c) = 1.0f;
}

// Scales a view so that its bright parts reach about 1, and clips, as a camera with automatic exposure does.
void expose(Image& view, double stops) {
  std::vector<float> brightness(view.pixel_count());
  for (std::size_t p = 0; p < brightness.size(); ++p)
    brightness[p] = std::max({view.values[3 * p], view.values[3 * p + 1], view.values[3 * p + 2]});
  const double bright = std::max(1e-3, quantile(std::move(brightness), 0.95));
  const auto scale = static_cast<float>(std::exp2(stops) / bright);
  for (float& v : view.values) v = std::clamp(v * scale, 0.0f, 1.0f);
}

int view_of(const LightSpec& spec) {
  return spec.kind == "coloured" ? first_coloured_view + spec.number : spec.number;
}

Image natural_light(const Image& panorama, std::uint64_t seed, std::uint64_t stream, int view_number,
                    int width, int height) {
  Rng rng(seed, 0x766965u, stream, view_number);
  PanoramaView view;
  view.turn.yaw = 360.0 * (view_number % views_of_a_panorama + rng.uniform()) / views_of_a_panorama;
  view.turn.pitch = rng.uniform(-35.0, 35.0);
  view.turn.roll = rng.uniform(-25.0, 25.0);
  view.horizontal_fov_degrees = rng.uniform(50.0, 90.0);
  Image image = view_of_panorama(panorama, view, width, height);
  expose(image, rng.uniform(-0.4, 0.6));
  return image;
}

/// Leaves one or two channels of a view.
void colour(Image& view, int number) {
  constexpr int kept[] = {1, 2, 4, 6, 5, 3};  // bits of red, green, blue
  for (std::size_t i = 0; i < view.values.size(); ++i)
    if ((kept[number % 6] >> i % 3 & 1) == 0) view.values[i] = 0.0f;
}

LightMap made_light(const LightSpec& spec, int count, const LightDomain& domain) {
  LightMap light{Image(domain.width, domain.height, 3), domain.parameterisation};
  Image& image = light.radiance;
  if (spec.kind == "white") fill(image, 0, 0, domain.width, domain.height);
  if (spec.kind == "bar") {
    const int width = std::max(1, domain.width / 8);
    const double step = count > 1 ? static_cast<double>(domain.width - width) / (count - 1) : 0.0;
    const int left = static_cast<int>(std::lround(spec.number * step));
    fill(image, left, 0, left + width, domain.height);
  }
  if (spec.kind == "square") {
    const int side = std::max(1, domain.width / 16);
    // The R2 sequence (Roberts 2018) spreads any number of places evenly.
    const double u = std::fmod(0.5 + 0.7548776662466927 * (spec.number + 1), 1.0);
    const double v = std::fmod(0.5 + 0.5698402909980532 * (spec.number + 1), 1.0);
    const int x = static_cast<int>(u * (domain.width - side + 1)),
              y = static_cast<int>(v * (domain.height - side + 1));
    fill(image, x, y, x + side, y + side);
  }
  return light;
}

}  // namespace

std::vector<LightSpec> list_lights(const LightPlan& plan) {
  std::vector<LightSpec> list;
  for (int i = 0; i < plan.train; ++i) list.push_back({numbered("train", i), FrameRole::train, plan.kind, i});
  int number = 0;
  const auto add = [&](const char* kind, int count) {
    for (int i = 0; i < count; ++i) list.push_back({numbered("test", number++), FrameRole::test, kind, i});
  };
  add("natural", plan.natural);
  add("bar", plan.bars);
  add("square", plan.squares);
  add("coloured", plan.coloured);
  add("white", plan.white);
  add("black", plan.black);
  return list;
}

Image uniform_light(int width, int height, const std::array<float, 3>& colour) {
  Image light(width, height, 3);
  for (std::size_t i = 0; i < light.values.size(); ++i) light.values[i] = colour[i % 3];
  return light;
}

void make_lights(const std::vector<LightSpec>& list, const LightDomain& domain, std::uint64_t seed,
                 const std::function<void(std::size_t, LightMap&&)>& sink, const RunContext& run) {
  const ThreadLimit limit(run);
  // Views grouped by panorama: (stream, places). Test panoramas are streams of their own.
  std::map<std::uint64_t, std::vector<std::size_t>> places_of;
  std::map<std::string, int> count_of;
  for (std::size_t place = 0; place < list.size(); ++place) {
    const LightSpec& spec = list[place];
    ++count_of[spec.kind];
    if (spec.kind != "natural" && spec.kind != "coloured") continue;
    const std::uint64_t test = spec.role == FrameRole::train ? 0 : 1;
    places_of[2 * static_cast<std::uint64_t>(view_of(spec) / views_of_a_panorama) + test].push_back(place);
  }
  Progress progress(run, "light maps", list.size());
  const std::vector<std::pair<std::uint64_t, std::vector<std::size_t>>> groups(places_of.begin(),
                                                                               places_of.end());
  const int panorama_width = std::min(largest_panorama, panorama_widths_of_a_map * domain.width) / 2 * 2;
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    run.throw_if_stopped();
    const auto& [stream, places] = groups[g];
    const Image panorama = make_panorama(seed, stream, panorama_width);
    for (const std::size_t place : places) {
      run.throw_if_stopped();
      const LightSpec& spec = list[place];
      Image view = natural_light(panorama, seed, stream, view_of(spec), domain.width, domain.height);
      if (spec.kind == "coloured") colour(view, spec.number);
      sink(place, {std::move(view), domain.parameterisation});
      progress.advance();
    }
  });
  std::optional<LeafPatterns> leaves;
  for (std::size_t place = 0; place < list.size(); ++place) {
    run.throw_if_stopped();
    const LightSpec& spec = list[place];
    if (spec.kind == "natural" || spec.kind == "coloured") continue;
    if (spec.kind == "designed") {
      if (!leaves) leaves.emplace(domain, seed);
      sink(place, leaves->next());
    } else {
      sink(place, made_light(spec, count_of[spec.kind], domain));
    }
    progress.advance();
  }
}

namespace {

// docs/method/patterns.md has the experiments that chose these.
constexpr double smallest_side = 1.0 / 128,
                 largest_side = 0.7;          // geometric mean of a leaf's sides, of the width
constexpr double largest_elongation = 1.0;    // of each side, exponent of two
constexpr int design_columns = 32;            // cells of the design grid across
constexpr double shortest_kernel = 1.0 / 24;  // of the map; the longest covers it
constexpr double design_noise = 0.05;         // of the response to half of white
constexpr double mean_weight = 20.0;          // of the mean's deviation against what a pattern tells
constexpr int sweeps = 2;

/// Second moments of the mean over one interval of [0, cells) whose length is uniform in the logarithm and
/// whose place is uniform, over the parts that lie inside: Σ over lengths and places of s sᵀ, where s is the
/// covered share of each cell.
Eigen::MatrixXd interval_covariance(int cells) {
  constexpr int lengths = 24, places = 256;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(cells, cells);
  for (int l = 0; l < lengths; ++l) {
    const double length = cells * std::pow(shortest_kernel, (l + 0.5) / lengths);
    for (int p = 0; p < places; ++p) {
      const double start = -0.5 * length + cells * (p + 0.5) / places, end = start + length;
      Eigen::VectorXd share(cells);
      for (int i = 0; i < cells; ++i)
        share[i] = std::clamp(std::min(i + 1.0, end) - std::max<double>(i, start), 0.0, 1.0);
      sum += share * share.transpose() / (share.sum() * share.sum() * lengths * places);
    }
  }
  return sum;
}

}  // namespace

LeafPatterns::LeafPatterns(const LightDomain& domain, std::uint64_t seed)
    : domain_(domain),
      seed_(seed),
      columns_(std::min(design_columns, domain.width)),
      rows_(std::clamp(static_cast<int>(std::lround(1.0 * columns_ * domain.height / domain.width)), 1,
                       std::min(domain.height, 2 * design_columns))) {
  const Eigen::MatrixXd across = interval_covariance(columns_), down = interval_covariance(rows_);
  covariance_.resize(columns_ * rows_, columns_ * rows_);
  for (int j = 0; j < rows_; ++j)
    for (int i = 0; i < rows_; ++i)
      covariance_.block(i * columns_, j * columns_, columns_, columns_) = down(i, j) * across;
  noise_variance_ = design_noise * design_noise * 0.25 * covariance_.sum();
}

std::vector<LeafPatterns::Leaf> LeafPatterns::place_leaves(int number, int channel,
                                                           std::vector<int>& owner) const {
  const int width = domain_.width, height = domain_.height;
  Rng rng(seed_, 0x6c656166u, number, channel);
  owner.assign(static_cast<std::size_t>(width) * height, -1);
  std::vector<Leaf> leaves;
  // From front to back until nothing is uncovered: later leaves fill what earlier ones left.
  for (std::size_t uncovered = owner.size(); uncovered > 0;) {
    const double size = width * smallest_side * std::pow(largest_side / smallest_side, rng.uniform());
    const double elongation = std::exp2(rng.uniform(-largest_elongation, largest_elongation));
    const int w = std::max(1, static_cast<int>(std::lround(size * elongation)));
    const int h = std::max(1, static_cast<int>(std::lround(size / elongation)));
    const int x0 = static_cast<int>(std::floor(rng.uniform(-w, width))) + 1,
              y0 = static_cast<int>(std::floor(rng.uniform(-h, height))) + 1;
    std::map<int, int> texels_of_cell;
    int visible = 0;
    for (int y = std::max(0, y0); y < std::min(height, y0 + h); ++y)
      for (int x = std::max(0, x0); x < std::min(width, x0 + w); ++x) {
        int& leaf = owner[static_cast<std::size_t>(y) * width + x];
        if (leaf >= 0) continue;
        leaf = static_cast<int>(leaves.size());
        ++texels_of_cell[y * rows_ / height * columns_ + x * columns_ / width];
        ++visible;
      }
    if (visible == 0) continue;
    uncovered -= visible;
    Leaf leaf;
    leaf.area = static_cast<double>(visible) / static_cast<double>(owner.size());
    for (const auto& [cell, texels] : texels_of_cell)
      leaf.cells.emplace_back(
          cell, texels * static_cast<double>(columns_ * rows_) / static_cast<double>(owner.size()));
    leaves.push_back(std::move(leaf));
  }
  return leaves;
}

std::vector<int> LeafPatterns::choose_levels(std::vector<Leaf>& leaves, int number, int channel) {
  Rng rng(seed_, 0x6c6576656cu, number, channel);
  std::vector<int> level(leaves.size());
  for (int& l : level) l = rng.below(2) == 0 ? -1 : 1;
  Eigen::VectorXd light = Eigen::VectorXd::Zero(covariance_.rows());
  double mean = 0.0, total = 0.0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    Leaf& leaf = leaves[i];
    leaf.variance = 0.0;
    for (const auto& [a, s] : leaf.cells)
      for (const auto& [b, t] : leaf.cells) leaf.variance += s * t * covariance_(a, b);
    for (const auto& [cell, share] : leaf.cells) light[cell] += level[i] * share;
    mean += level[i] * leaf.area;
    total += leaf.variance;
  }
  Eigen::VectorXd response = covariance_ * light;
  std::vector<int> order(leaves.size());
  std::iota(order.begin(), order.end(), 0);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[rng.below(i)]);
    for (const int i : order) {
      const Leaf& leaf = leaves[i];
      double product = 0.0;
      for (const auto& [cell, share] : leaf.cells) product += share * response[cell];
      const double flipped = mean - 2.0 * level[i] * leaf.area;
      const double gain = -4.0 * (level[i] * product - leaf.variance) -
                          mean_weight * total * (flipped * flipped - mean * mean);
      if (gain <= 0.0) continue;
      for (const auto& [cell, share] : leaf.cells) response -= 2.0 * level[i] * share * covariance_.col(cell);
      mean = flipped;
      level[i] = -level[i];
    }
  }
  light.setZero();
  for (std::size_t i = 0; i < leaves.size(); ++i)
    if (level[i] > 0)
      for (const auto& [cell, share] : leaves[i].cells) light[cell] += share;
  response = covariance_ * light;
  covariance_ -= response * response.transpose() / (light.dot(response) + noise_variance_);
  return level;
}

LightMap LeafPatterns::next() {
  LightMap map{Image(domain_.width, domain_.height, 3), domain_.parameterisation};
  std::vector<int> owner;
  for (int c = 0; c < 3; ++c) {
    std::vector<Leaf> leaves = place_leaves(made_, c, owner);
    const std::vector<int> level = choose_levels(leaves, made_, c);
    for (std::size_t p = 0; p < owner.size(); ++p)
      map.radiance.values[3 * p + c] = level[owner[p]] > 0 ? 1.0f : 0.0f;
  }
  ++made_;
  return map;
}

}  // namespace refield
