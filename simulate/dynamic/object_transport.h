// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/harmonics.h"
#include "core/run_context.h"
#include "simulate/dynamic/dynamic_scene.h"
#include "simulate/dynamic/low_rank.h"
#include "simulate/dynamic/shell_grid.h"
#include "simulate/dynamic/surface_modes.h"
#include "simulate/prt/mesh_rays.h"

namespace refield::dynamic {

/// How an object's patterns of light are made: the paper's way, each term by itself, or all together.
enum class ModeKind { joint, separate };

struct TransportOptions {
  int order = 4;       ///< n: light that arrives at a point is told by n² spherical harmonics
  int functions = 32;  ///< N: patterns an object shines in
  FactorOptions factors{.largest = 0, .error = 0.2};  ///< K; for light that bounces
  ModeKind modes = ModeKind::joint;
  int rings = 8, shells = 14;                         ///< ShellGrid
  float smallest_radius = 0.06f, largest_radius = 4;  ///< of the shells, in radii of the object
  int directions = 1024;                              ///< rays a point
  double compression = 0.03;                          ///< relative error that LowRank may leave; 0: none

  /// Throws InputError naming the option and its range.
  void check() const;
  bool operator==(const TransportOptions&) const = default;
};

/// What an object does to light, computed once, in its own axes: the same wherever it goes. Angular functions
/// are told by n² harmonics, of radiance by the direction that it comes from.
struct ObjectTransport {
  BrdfFactors factors;
  SurfaceModes modes;
  ShellGrid grid;
  /// Source radiance field (Iwasaki et al., section 4.2): what the object sends to each point of the grid, a
  /// block of n² harmonics each. Columns: colour · modes + mode.
  LowRank leaving;
  /// What it sends to its own vertices after one reflection: L_k, a block of K each. Nothing stands between.
  LowRank returning;
  /// Share of each direction that the object covers, [n² × points of the grid] (its occlusion field, Zhou et
  /// al. 2005).
  Eigen::MatrixXf coverage;
  std::vector<bool> outside;  ///< [points of the grid]: not within the object or behind a sheet
  /// L_k of a vertex from what arrives: ∫ V h_k cosθ y dω with its own object's shadow, [n² × vertices · K].
  Eigen::MatrixXf receiving;
  int order = 0;        ///< n
  float radius = 0.0f;  ///< of the sphere around it

  int terms() const { return factors.terms(); }
  std::size_t bytes() const;
};

/// The grid around an object whose sphere has that radius.
ShellGrid shell_grid_of(const TransportOptions& options, float radius);

/// Runs on all cores, with progress. Throws InputError, Interrupted.
ObjectTransport object_transport(const MovingObject& object, const prt::MeshRays& rays,
                                 const TransportOptions& options, const RunContext& run = {});

}  // namespace refield::dynamic
