// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/capture/session_writer.h"
#include "acquire/import/bracket_merge.h"
#include "acquire/import/light_sources.h"
#include "acquire/series/capture_time.h"
#include "core/base/units.h"

namespace refield {

/// The files of one view.
struct BracketGroup {
  std::string name;  ///< what `{light}` stood for, else the first file's stem
  std::vector<fs::path> paths;
};

/// How files of a folder fall into brackets.
struct GroupRule {
  /// File names (with or without extension) with {light} where the view's name stands and * or ? for anything
  /// else:
  /// "{light}_e*.tif". Within a bracket files are sorted by name.
  std::string pattern;
  int count = 0;  ///< without a pattern: that many files, in the order of names, make a bracket
  /// Without either, an exposure time that the bracket has already begins the next one: then each file must
  /// state its time.
};

/// Groups files, which come sorted by name; brackets come in that order. `exposures`: of each file where
/// known. Throws InputError naming the file and the rule: a name that does not match, a count that does not
/// go up, an unknown exposure, or brackets whose numbers of exposures differ.
std::vector<BracketGroup> group_brackets(const std::vector<fs::path>& files,
                                         const std::vector<std::optional<Seconds>>& exposures,
                                         const GroupRule& rule);

/// What the files of lights hold.
enum class LightContent {
  radiance,     ///< linear radiance above the monitor's black, as EXR holds it; PNG and JPEG are decoded from
                ///< sRGB
  drive_levels  ///< 8-bit levels that were sent to the monitor; its calibration says what it emitted
};

/// Photographs from other tools.
struct ImportRequest {
  std::vector<fs::path> photographs;  ///< sorted by name
  GroupRule rule;
  BracketCamera camera;
  std::vector<Seconds> exposures;  ///< of a bracket's files, in order; empty: as their metadata state them
  std::vector<fs::path> ambient;   ///< files of one bracket, taken out of the photographs; may be empty
  bool ambient_first = false;      ///< the first bracket is the ambient one
  /// Lights, in the order of their names; empty: photographs are merged, and no session is made.
  std::vector<fs::path> lights;
  /// The n-th light belongs to the n-th bracket; else the light NAME.* to the bracket NAME.
  bool lights_by_order = false;
  LightContent light_content = LightContent::radiance;
  fs::path monitor;  ///< calibration.toml with [monitor], for drive levels
  Parameterisation parameterisation = Parameterisation::monitor;
  /// Light sources of a dome or light stage, in place of `lights`; the parameterisation is lat-long then.
  /// Each belongs to the bracket with the file of its name, else to the bracket of that name (with or without
  /// extension), or, without names, to the bracket of its place. Photographs that belong to none are left
  /// out, with a note.
  LightStage stage;
  /// In place of both: each bracket is a light source, whose direction the ball shows. The ball is excluded
  /// from the session's mask.
  std::optional<ChromeBall> ball;
  /// White cards under the light sources, see divide_by_card(); grouped and named like the photographs, or as
  /// many. Intensities of `stage` do not count then. May be empty.
  std::vector<fs::path> flat_fields;
  std::optional<fs::path> mask;
  std::vector<MonitorPlacement> monitors{};  ///< where the monitor stood; empty: not known
  int test_every =
      0;  ///< every that many frames one is held out, beside those whose light is named test…; 0: none
  Precision precision = Precision::single;
  fs::path folder;
  IfExists if_exists = IfExists::refuse;

  bool has_light_sources() const { return !stage.sources.empty() || ball; }
  bool makes_session() const { return !lights.empty() || has_light_sources(); }
};

struct ImportSummary {
  std::size_t photographs = 0;
  std::size_t found_done = 0;           ///< of them, taken over from an earlier run
  std::vector<Seconds> exposures;       ///< of the first bracket
  std::vector<double> useful_fraction;  ///< [exposures], mean over this run's photographs; empty when none
  double clipped_fraction = 0.0;
  std::size_t timed = 0;            ///< photographs whose time is known
  bool response_estimated = false;  ///< from the brackets, which contradicted the assumed one
  std::vector<std::string> notes;   ///< what the user should know of the camera's response and the times
};

/// Merges bracketed exposures to photographs of linear radiance. With lights: into a capture session
/// (illumination/, observed/, ambient light subtracted), resumable like any capture; roles by the lights'
/// names: test…, reference…, all others train. Without: as NAME.exr into a folder, with times.tsv, for
/// match_series() or probe_light(). Before, some brackets are checked by settle_response(). Throws
/// InputError, FormatError or DeviceError naming the file.
ImportSummary import_series(const ImportRequest& request, const RunContext& run = {});

/// A bracket, the frame that it becomes, and its light.
struct ImportedView {
  BracketGroup bracket;
  std::string name;
  fs::path light;  ///< empty without a session and under light sources
  std::optional<ClockSeconds> time{};
  std::size_t source = 0;  ///< of ImportRequest::stage, where that has sources
  BracketGroup card{};     ///< white card under the same light, if any
};

/// The request's photographs in brackets, each with its light where a session is made; light sources that a
/// ball is to show are those of the request's stage that are yet to come, in the order of the views. With
/// `ambient_first` the first bracket becomes the request's ambient one. Adds to the notes of the request's
/// stage. Throws InputError naming the file when brackets and lights do not belong together or two views
/// would have one name.
std::vector<ImportedView> views_of(ImportRequest& request, const RunContext& run);

/// Samples of at most `max_brackets` of the views' brackets, evenly spread over the series, with progress.
/// Throws as read_bracket(), Interrupted.
std::vector<BracketSamples> sample_series(const std::vector<ImportedView>& views,
                                          const ImportRequest& request, std::size_t max_brackets,
                                          const RunContext& run);

/// Role of the frame `name`, the `place`th of the session.
FrameRole role_of(const ImportRequest& request, const std::string& name, std::size_t place);

/// What decides the content of an import, with names and sizes of its files: only the same can be resumed.
std::string plan_of(const ImportRequest& request, const std::vector<ImportedView>& views);

}  // namespace refield
