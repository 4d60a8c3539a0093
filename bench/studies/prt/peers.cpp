// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/prt/peers.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <utility>

#include "bench/studies/prt/harmonic_window.h"
#include "bench/studies/prt/measure.h"
#include "bench/studies/prt/wavelets.h"
#include "cli/run_context.h"
#include "core/base/errors.h"
#include "core/field_io/reflectance_field_file.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
#include "simulate/prt/clusters.h"
#include "simulate/prt/harmonic_transfer.h"

namespace refield::prt_chart {

namespace {

constexpr double group_epsilons[] = {4e-3, 1e-3, 4e-4, 2e-4, 1e-4};
/// As in the paper's figure 9, whose scene has 73 196 vertices, and one more; they are set right for others.
constexpr double paper_epsilons[] = {2.5e-4, 1e-4, 7e-5, 5e-5};
constexpr double paper_vertices = 73196.0;
constexpr double wavelet_thresholds[] = {0.03, 0.005};
constexpr int wavelet_terms[] = {100, 400, 1600, 6400};
constexpr int orders[] = {2, 3, 5, 8};

/// The fastest of some runs: others use the machine, too.
double fastest_ms(const std::function<void()>& action) {
  constexpr int runs = 30;
  double best = seconds_of(action);
  for (int run = 1; run < runs; ++run) best = std::min(best, seconds_of(action));
  return 1e3 * best;
}

std::string text_of(const char* format, double value) {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::vector<Eigen::Array3f> at_vertices(const Image& outputs, const std::vector<std::uint32_t>& vertices) {
  std::vector<Eigen::Array3f> shading;
  for (const std::uint32_t v : vertices)
    shading.push_back(Eigen::Map<const Eigen::Array3f>(outputs.values.data() + 3 * pixel_of_output(v)));
  return shading;
}

template <class Weight>
double count_weights(const TiledTransfer<Weight>& tiles) {
  double weights = 0.0;
  for (int at = 0; at < tiles.tiles(); ++at)
    for_each_weight(tiles.tile(at), [&](std::size_t, std::size_t, const auto&) { ++weights; });
  return weights;
}

/// Relights a field.
void show(PackedField packed, const ChartScene& chart, const std::vector<ChartLight>& lights,
          const LightMap ChartLight::*map, Peer& peer) {
  peer.kernels = packed.outline.basis.size();
  TileRelighter relighter(std::move(packed));
  std::visit(
      [&](const auto& tiles) {
        peer.bytes = static_cast<double>(tiles.bytes());
        peer.weights = count_weights(tiles) / static_cast<double>(chart.scene.mesh.positions.size());
      },
      relighter.transfer());
  for (const ChartLight& light : lights)
    peer.shading.push_back(at_vertices(relighter.relight(light.*map), chart.vertices));
  peer.relight_ms = fastest_ms([&] { relighter.relight(lights.front().*map); });
  peer.two_area_lights_ms = measure_relighting(relighter).two_area_lights_ms;
}

Peer clusters(const ChartScene& chart, const std::vector<ChartLight>& lights, int resolution,
              prt::Similarity similarity, double epsilon) {
  Peer peer{.method = similarity == prt::Similarity::group ? "clusters" : "clusters of the paper",
            .setting = "ε " + text_of("%g", epsilon)};
  prt::ClusterOptions options;
  options.resolution = resolution;
  options.similarity = similarity;
  options.epsilon = epsilon;
  prt::ClusterStatistics statistics;
  FieldRows rows;
  peer.precompute_seconds =
      seconds_of([&] { rows = prt::cluster_transfer(chart.scene, options, statistics, run_context()); });
  show(pack_rows(std::move(rows), 8, run_context()), chart, lights, &ChartLight::fine, peer);
  return peer;
}

Peer harmonics(const ChartScene& chart, const std::vector<ChartLight>& lights, int order,
               HarmonicWindow window) {
  Peer peer{.method = window == HarmonicWindow::none ? "harmonics" : "harmonics, Hann window",
            .setting = "order " + std::to_string(order)};
  prt::HarmonicOptions options;
  options.order = order;
  options.until = 1.0;  // no interreflection, which the others have not
  prt::HarmonicStatistics statistics;
  prt::HarmonicTransfer transfer;
  peer.precompute_seconds =
      seconds_of([&] { transfer = prt::harmonic_transfer(chart.scene, options, statistics, run_context()); });
  const std::vector<double> factors = window_factors(window, order);
  for (std::size_t i = 0; i < transfer.values.size(); ++i)
    transfer.values[i] *= static_cast<float>(factors[i % factors.size()]);
  show(pack_rows(prt::harmonic_field(chart.scene, std::move(transfer), options.map_resolution), 8,
                 run_context()),
       chart, lights, &ChartLight::coarse, peer);
  return peer;
}

/// One for each number of terms.
std::vector<Peer> wavelets(const ChartScene& chart, const std::vector<ChartLight>& lights, int resolution,
                           double threshold) {
  const prt::TransferSamples samples(chart.scene, {}, chart.vertices);
  std::optional<prt::WaveletTransfer> transfer;
  const double seconds = seconds_of([&] { transfer.emplace(samples, resolution, threshold); });
  const LightMap& first = lights.front().fine;
  const double light_ms = fastest_ms([&] { transfer->relight(first, 1); });  // of the light's own transform
  std::vector<Peer> peers;
  for (const int terms : wavelet_terms) {
    Peer peer{
        .method = "wavelets, " + text_of("%g", threshold),
        .setting = std::to_string(terms) + " of the light",
        .kernels = static_cast<std::uint64_t>(terms),
        .weights = static_cast<double>(transfer->entries()) / static_cast<double>(chart.vertices.size()),
        .bytes = static_cast<double>(transfer->bytes() - transfer->entry_bytes()) +
                 static_cast<double>(transfer->entry_bytes()) / chart.share(),
        .precompute_seconds = seconds / chart.share()};
    for (const ChartLight& light : lights) {
      peer.shading.push_back(transfer->relight(light.fine, terms));
      peer.shading.back().resize(chart.vertices.size());
    }
    const double sum_ms = fastest_ms([&] { transfer->relight(first, terms); }) - light_ms;
    peer.relight_ms = light_ms + std::max(0.0, sum_ms) / chart.share();
    peers.push_back(std::move(peer));
  }
  return peers;
}

}  // namespace

std::vector<Peer> all_peers(const ChartScene& chart, const std::vector<ChartLight>& lights, int resolution) {
  std::vector<Peer> peers;
  for (const double epsilon : group_epsilons)
    peers.push_back(clusters(chart, lights, resolution, prt::Similarity::group, epsilon));
  // ‖T_C − T_l‖ ∕ N falls with √N where vertices become more and their light stays alike.
  const double finer = std::sqrt(paper_vertices / static_cast<double>(chart.scene.mesh.positions.size()));
  for (const double epsilon : paper_epsilons)
    peers.push_back(clusters(chart, lights, resolution, prt::Similarity::all_outputs, finer * epsilon));
  for (const double threshold : wavelet_thresholds)
    std::ranges::move(wavelets(chart, lights, resolution, threshold), std::back_inserter(peers));
  for (const auto window : {HarmonicWindow::none, HarmonicWindow::hann})
    for (const int order : orders) peers.push_back(harmonics(chart, lights, order, window));
  return peers;
}

Peer peer_of_field(const std::filesystem::path& path, const ChartScene& chart,
                   const std::vector<ChartLight>& lights) {
  auto field = read_either_field(path, run_context());
  auto* packed = std::get_if<PackedField>(&field);
  if (packed == nullptr || !packed->outline.mesh ||
      packed->outline.mesh->positions != chart.scene.mesh.positions)
    throw InputError(path.string() + " was not made of this scene by 'refield precompute'");
  if (const LightDomain domain = packed->outline.basis.domain; domain != lights.front().fine.domain())
    throw InputError(path.string() + " is lit by cube maps of " + std::to_string(domain.width) +
                     " texels per side; give --resolution " + std::to_string(domain.width));
  Peer peer{.method = "fields", .setting = path.stem().string()};
  show(std::move(*packed), chart, lights, &ChartLight::fine, peer);
  return peer;
}

}  // namespace refield::prt_chart
