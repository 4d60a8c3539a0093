// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <string>
#include <vector>

namespace refield::chart {

/// A point with a name, or a line of them.
struct Track {
  std::string label;
  int colour = 0;  ///< of the method, see panel_style()
  std::vector<std::array<double, 2>> points;
};

/// One chart: logarithmic axes, labels that keep clear of each other, and the Pareto front of all points
/// where asked for.
struct Panel {
  std::string title;
  std::string x_label;
  std::string y_label;
  bool lines = false;  ///< join the points of a track, name it at its right end
  std::vector<Track> tracks;
  bool front = true;  ///< draw the Pareto front
};

inline constexpr double panel_width = 560.0, panel_height = 400.0;

/// The style of all panels of a picture, for its head.
std::string panel_style();

/// The panel as an SVG group at (0, 0), panel_width × panel_height. Points that are not finite or not above
/// zero are left out, since a logarithm has no place for them.
std::string panel_svg(const Panel& panel);

/// Panels side by side in rows of `columns`, as a whole SVG file.
std::string picture_svg(const std::string& title, const std::vector<Panel>& panels, int columns);

/// Round numbers inside [low, high], low > 0: powers of ten, with more digits between them the fewer decades
/// there are.
std::vector<double> log_ticks(double low, double high);

}  // namespace refield::chart
