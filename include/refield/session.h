// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "refield/light_map.h"

/// A capture session: the photographs of a scene and the lights that they were taken under, as a folder on
/// disk (docs/reference/capture-session-format.md) or as pairs of files.
namespace refield {

struct CaptureSession;

inline namespace v0_2 {

/// What a frame is for: estimation, held-out validation, or a repeated reference for drift.
enum class FrameRole { train, test, reference };

REFIELD_API std::string_view name_of(FrameRole role);

/// A photograph and the light map that it was taken under.
struct SessionFrame {
  std::string name;  ///< unique, for example "train_007"
  FrameRole role = FrameRole::train;
  std::string kind;  ///< of light: "natural", "bar", "square", "white", "black"; free text
  std::filesystem::path light, observed;
};

/// A capture. Copies share it; what changes one of them leaves the others as they are.
class REFIELD_API Session {
 public:
  /// Reads the manifest of a session's folder. Throws InputError for a broken one, naming the line, or when a
  /// listed file is missing. Image contents are not read.
  explicit Session(const std::filesystem::path& folder);
  /// Light map and photograph j belong together; all are training frames. Throws InputError for other numbers
  /// of both, and naming the first image whose size differs.
  Session(std::span<const std::filesystem::path> lights, std::span<const std::filesystem::path> observed,
          Parameterisation parameterisation);
  /// Pairs the files of two patterns (or folders) by what their wildcards stood for, else, when no wildcard
  /// is shared, by the whole stem. Throws InputError naming the first file without a partner, or with two.
  Session(const std::string& lights, const std::string& observed, Parameterisation parameterisation);
  explicit Session(CaptureSession&& session);

  const std::filesystem::path& folder() const;  ///< empty for pairs of files
  int width() const;                            ///< of the photographs, pixels
  int height() const;
  LightDomain light_domain() const;
  ColourSpace colour_space() const;  ///< of observed()

  std::size_t size() const;  ///< number of frames
  /// Frame i < size(), else throws InputError.
  SessionFrame frame(std::size_t i) const;
  LightMap light(std::size_t i, const RunContext& run = {}) const;
  Photograph observed(std::size_t i) const;
  Mask mask() const;  ///< empty: all pixels count

  /// Every `every`-th training frame takes the role test. Throws InputError for fewer than 2, or where that
  /// leaves none or takes none.
  void hold_out(int every);
  void set_mask(const std::filesystem::path& file);
  /// Where the monitor stood: one placement for each window of the light maps.
  void set_monitors(std::vector<MonitorPlacement> monitors);

  /// For the library itself.
  const CaptureSession& internal() const { return *session_; }

 private:
  std::shared_ptr<const CaptureSession> session_;
};

}  // namespace v0_2
}  // namespace refield
