// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "core/light/light_map.h"
#include "core/light/monitor_placement.h"
#include "refield/session.h"

namespace refield {

/// What the rig did to a frame besides B = T L (estimate/rig/rig_model.h), for readers of training frames to
/// undo: photograph = gain · mixing · (B + room · room picture), moved by displacement().
struct FrameCorrection {
  std::array<double, 2> shift_px{};  ///< of the picture, to the right and down, against the first photograph
  std::array<double, 2> turn{};      ///< the same about its middle: clockwise, radians, and relative growth
  std::array<float, 3> gain{1.0f, 1.0f, 1.0f};  ///< of each channel, on top of CaptureFrame::gain
  float room = 0.0f;                            ///< room light, as a multiple of a picture of it
  /// The photograph of the room light; empty: the mean photograph in grey stands for it.
  fs::path ambient;
  Eigen::Matrix3f primaries_from_camera = Eigen::Matrix3f::Identity();
  /// The light that was emitted: white · (light / white)^tone of each channel.
  std::array<float, 3> tone{1.0f, 1.0f, 1.0f};
  float white = 1.0f;               ///< radiance of the light map's white
  int width_px = 0, height_px = 0;  ///< of the photograph

  /// To the right and down, of what the picture shows at (x, y).
  std::array<double, 2> displacement(int x, int y) const;
};

/// One photograph of the scene and the illumination that it was taken under.
struct CaptureFrame {
  std::string name;  ///< unique, for example "train_007"
  FrameRole role = FrameRole::train;
  std::string kind;       ///< of light: "natural", "bar", "square", "white", "black"; free text
  fs::path illumination;  ///< EXR: linear radiance that the light emitted
  fs::path observed;      ///< EXR: photograph, ambient light already subtracted
  /// When it was taken, in any unit that grows with time: what the manifest says, else its place there.
  double order = 0.0;
  /// By which read_observed() divides each channel; remove_drift() sets it.
  std::array<float, 3> gain = {1.0f, 1.0f, 1.0f};
  /// Images in memory, read in place of the files, whose paths are names for messages then. Without `sigma`
  /// the photograph's noise is not known.
  struct Views {
    ImageView light, photograph, sigma;
  };
  std::optional<Views> views = std::nullopt;
  /// By which read_observed() multiplies each pixel of the photograph, before the gain: CameraColour's.
  std::optional<Eigen::Matrix3f> rec709_from_camera = std::nullopt;
  /// Found by estimate, which undoes it where it reads photographs (read_observations()); read_illumination()
  /// applies the tone curve. Null: nothing to undo.
  std::shared_ptr<const FrameCorrection> correction = nullptr;
};

/// What a colour chart told of the camera. Photographs stay in the camera's channels on disk.
struct CameraColour {
  Eigen::Matrix3d rec709_from_camera = Eigen::Matrix3d::Identity();
  std::string chart;            ///< name of the photograph of the chart; free text
  double median_delta_e = 0.0;  ///< CIEDE2000 over the patches of the chart
  double largest_delta_e = 0.0;
};

/// A capture: what `acquire` and `simulate` leave on disk and `estimate` starts from. The session folder and
/// its manifest (session.toml) are described in docs/reference/capture-session-format.md. It stands in core
/// because stages meet in it.
struct CaptureSession {
  fs::path folder;  ///< empty for a capture given by globs
  LightDomain light;
  int width = 0;  ///< of the photographs
  int height = 0;
  std::vector<CaptureFrame> frames;
  std::optional<fs::path> ambient;
  std::optional<fs::path> mask;
  /// Where the monitor stood, one placement for each window of the light maps (check_placements()); empty
  /// where that is not known.
  std::vector<MonitorPlacement> monitors{};
  std::optional<CameraColour> colour{};

  /// Colour space of the images that read_observed() returns.
  ColourSpace colour_space() const { return colour ? ColourSpace::rec709 : ColourSpace::camera; }
  std::vector<CaptureFrame> frames_of(FrameRole role) const;
};

inline constexpr const char* session_manifest_name = "session.toml";

/// Writes folder/session.toml, atomically. Paths inside the folder are stored relative to it.
void write_session_manifest(const CaptureSession& session);

/// What 'acquire colour' and 'acquire geometry' found, of a manifest whose photographs may be gone: sets
/// `colour`, and `monitors` where the manifest has any. Throws InputError for a broken manifest.
void read_calibration_of_manifest(const fs::path& manifest, CaptureSession& session);

/// Reads a session. Throws InputError for a broken manifest or when a listed file is missing; the message
/// names the line. Image contents are not read.
CaptureSession read_capture_session(const fs::path& folder);

/// Pairs the files of two patterns (or folders) by what their wildcards stood for, else, when no wildcard is
/// shared, by the whole stem. Sorted by that. Throws InputError naming the first file without a partner, or
/// with two; `first_kind` and `second_kind` are what the message calls the files.
std::vector<std::pair<fs::path, fs::path>> pair_files(const std::string& first_glob,
                                                      const std::string& second_glob,
                                                      const std::string& first_kind,
                                                      const std::string& second_kind);

/// A capture from another tool: light maps and photographs paired by pair_files(), all of role train.
CaptureSession pair_by_globs(const std::string& light_glob, const std::string& observed_glob,
                             Parameterisation parameterisation = Parameterisation::monitor);

/// Checks that the headers of all images fit together, filling in sizes where the session does not state
/// them. Throws InputError naming the first image whose size differs.
void check_image_sizes(CaptureSession& session);

/// Reads a frame's light map and applies the tone curve of the frame's correction. Throws what
/// read_light_map() throws.
LightMap read_illumination(const CaptureFrame& frame, Parameterisation parameterisation,
                           const RunContext& run);
/// pattern_of() the light map without the correction.
std::string pattern_of(CaptureFrame frame, Parameterisation parameterisation, const RunContext& run);

/// Reads a frame's photograph, or its rows [first, last), and applies the frame's colour matrix and gain to
/// radiance and sigma. With a matrix, a pixel that was not measured in one channel counts as not measured.
Photograph read_observed(const CaptureFrame& frame);
Photograph read_observed_rows(const CaptureFrame& frame, int first, int last);

/// Reads a painted mask: non-zero where any channel exceeds one half. Throws InputError when the size
/// differs.
Mask read_mask(const fs::path& path, int width, int height);

/// Rows of a photograph beyond those wanted that undo_rig() needs, above and below.
int rig_margin(const FrameCorrection* correction);

/// Undoes shift, gain and colour mixing of `rows`, rows [first_row, first_row + rows.height) of a photograph,
/// and returns those from `first` to `last`. One interpolation (Keys' cubic convolution, a = −1/2). Beyond
/// the picture's edges the nearest pixel counts. `unmeasured` [samples of rows]: samples that show no more
/// than a lower bound, as clipped ones do; empty: none. A sample is NaN, not measured, where the nearest one
/// of its channel is unmeasured or such samples make up more than a quarter of it: else a highlight would
/// take along all pixels that are interpolated from it, in all photographs that moved.
Image undo_rig(const Image& rows, const std::vector<char>& unmeasured, int first_row, int first, int last,
               const FrameCorrection& correction);

/// Weights of the pixels −1, 0, 1, 2 for a value `t` in [0, 1) after pixel 0. Source: Keys 1981, eq. 15.
std::array<float, 4> cubic_weights(double t);

/// Most light cells (light sources, or blocks of a coarse display) that estimation gives a weight each. Time
/// per pixel and memory grow with the square of their number. Photographs of one cell at a time need no
/// choice of a prior for complete pixels, so that their limit is higher: docs/method/light-stages.md.
inline constexpr int max_light_cells = 256;
inline constexpr int max_single_light_cells = 512;

}  // namespace refield
