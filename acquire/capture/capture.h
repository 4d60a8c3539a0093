// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/calibrate/calibration.h"
#include "acquire/camera.h"
#include "acquire/capture/exposure_plan.h"
#include "acquire/capture/frame_pairing.h"
#include "acquire/capture/session_writer.h"
#include "acquire/illuminator.h"
#include "core/session/capture_session.h"

namespace refield {

/// A light to photograph the scene under. The file holds wanted linear radiance above the monitor's black;
/// the session stores what the monitor's drive levels make of it.
struct CaptureLight {
  std::string name;  ///< unique; becomes file names
  FrameRole role = FrameRole::train;
  std::string kind;
  fs::path wanted;
};

/// Where the mask of the scene comes from.
struct MaskSource {
  enum class Kind { none, painted, automatic };
  Kind kind = Kind::none;
  fs::path file;  ///< painted: the mask; automatic: a photograph of the background under white, or empty
};

/// Number of frames per exposure of the ambient photograph, from that of all training photographs. Its
/// noise goes into every other photograph and does not average out as theirs does, so that it counts the more
/// the more there are: one for eight, 4 to 64 (docs/method/capture.md, "Ambient light").
int usual_ambient_count(int training_frames);

/// All that decides what a capture gives. Two captures of one request with the same devices are equal to the
/// byte, however often they were interrupted.
struct CaptureRequest {
  fs::path folder;
  std::vector<CaptureLight> lights;
  CameraCalibration camera;
  MonitorCalibration monitor;
  std::optional<TimingCalibration> timing;   ///< without it: as the devices describe themselves
  std::vector<MonitorPlacement> monitors{};  ///< where it stands, for the manifest; empty: not known
  std::string rig;                           ///< names the devices and what they look at; part of the plan
  std::vector<Seconds> exposures;            ///< empty: by exposure_plan
  ExposurePlanOptions exposure_plan;         ///< without a shortest exposure it is metered under white
  int frames_per_exposure = 1;               ///< all enter the fit
  int ambient_repeats = 0;                   ///< see ambient_count(); 0: by the number of lights
  double gain = 1.0;
  MaskSource mask;
  bool keep_raw = false;
  Precision precision = Precision::single;  ///< of observed images
  IfExists if_exists = IfExists::refuse;
  /// Called before each light's turn, with its place in `lights`: a rig that stands for real devices learns
  /// by it how far the capture is. May be null.
  std::function<void(std::size_t)> before_light = nullptr;
  /// Shown each photograph that was taken, ambient light subtracted, once it is on disk. May be null.
  std::function<void(const Photograph&)> on_photograph = nullptr;

  /// Asked after each training photograph, in the order of `lights` (those of an earlier run included); once
  /// it says true, the training lights that are left are not taken. Null: all are.
  std::function<bool(const CaptureFrame& taken)> is_enough = nullptr;
  std::string stop_rule;  ///< says in words what is_enough goes by; part of the plan

  /// Frames per exposure of the ambient photograph; by default usual_ambient_count().
  int ambient_count() const;

  bool is_metered() const {
    return exposures.empty() && (exposure_plan.shortest.count() <= 0.0 || exposure_plan.relative_noise > 0.0);
  }

  /// Throws InputError naming the option and the remedy.
  void check(const CameraDescription& camera, const IlluminatorDescription& display,
             const RunContext& run = {}) const;
};

struct CaptureSummary {
  std::size_t lights = 0;         ///< photographed, by this run or an earlier one
  std::size_t left_out = 0;       ///< training lights that were not needed
  std::size_t found_done = 0;     ///< steps taken over from an earlier run
  std::size_t found_damaged = 0;  ///< steps done again since their files had changed
  std::vector<Seconds> exposures;
  std::string exposure_note;  ///< how they follow from the scene, where this run planned them by noise
  std::vector<double> useful_fraction;  ///< [exposures], mean over this run's photographs; empty when none
  double clipped_fraction = 0.0;        ///< of the samples, mean over this run's photographs
  std::vector<std::string> darker_than_ambient;  ///< this run's photographs, see darker_share()
  std::size_t out_of_range_lights = 0;           ///< lights with texels brighter than the monitor
  PairingCounts discarded;
  double seconds = 0.0;
};

/// Photographs the scene under each light into a capture session folder: ambient light first, then the mask,
/// then the lights in order, as far as CaptureRequest::is_enough wants them. Talks to interfaces only. Stops
/// between photographs when asked to (throws Interrupted); whatever ends it, the folder can be resumed.
/// Throws InputError, FormatError or DeviceError. `trigger` may be null.
CaptureSummary capture(const CaptureRequest& request, Camera& camera, Illuminator& illuminator,
                       Trigger* trigger, const RunContext& run = {});

/// CRC-32 of a file, eight hexadecimal digits: how plan.toml names what it rests on.
std::string checksum_of(const fs::path& file);

/// Text of plan.toml: everything that decides the capture's content, with a checksum of every input file.
std::string capture_plan_text(const CaptureRequest& request, const std::vector<Seconds>& exposures,
                              const CameraDescription& camera, const IlluminatorDescription& display);

/// The exposure times that a plan.toml states.
std::vector<Seconds> exposures_of_plan(const fs::path& plan);

}  // namespace refield
