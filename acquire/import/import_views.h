// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "acquire/import/bracket_response.h"
#include "acquire/import/import_series.h"
#include "acquire/series/capture_time.h"

namespace refield {

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
