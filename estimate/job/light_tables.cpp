// SPDX-License-Identifier: Apache-2.0
#include "estimate/job/light_tables.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <vector>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/json_text.h"
#include "core/base/output_lock.h"
#include "estimate/quality/error_evidence.h"

namespace refield {

namespace fs = std::filesystem;

namespace {

// A file is a line of JSON, padded to whole pages, and then the sums over hats, directions, variances and the
// summed-area table, each from the beginning of a page.
constexpr std::size_t page = 4096;

constexpr const char* not_shared = "the tables of the lights are not shared with other shards: ";

std::size_t whole_pages(std::size_t bytes) {
  return (bytes + page - 1) / page * page;
}

HatGrid hats_of_job(const EstimateJob& job, const EstimateOptions& options) {
  return hats_of(options, job.session.light, static_cast<int>(job.frames.size()));
}

/// What the tables follow from, beside the images' weights.
std::string tables_key(const EstimateJob& job, const EstimateOptions& options) {
  return job_key(job, options) + json_text(nlohmann::json(job.noise.image_weights));
}

/// Of the header, the small parts and 64 pages of the table: to read all of it would take as long as to sum
/// it.
std::string digest_of(std::string_view header, std::span<const std::span<const std::byte>> small,
                      std::span<const std::byte> table) {
  constexpr std::size_t samples = 64;
  std::uint64_t hash = 0xcbf29ce484222325ull;  // FNV-1a, 64 bits
  const auto add = [&](std::span<const std::byte> bytes) {
    for (const std::byte byte : bytes) hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3ull;
  };
  add(std::as_bytes(std::span(header)));
  for (const auto& part : small) add(part);
  if (table.size() <= samples * page) {
    add(table);
  } else {
    for (std::size_t i = 1; i <= samples; ++i) add(table.subspan((table.size() - page) / samples * i, page));
  }
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  return text;
}

}  // namespace

struct LightTables::Content {
  BoxTable table;
  std::vector<Box> cells;
  LightErrorModel light_error;
  bool has_texels = false, weighs_images = false;

  /// Nothing where the file is not there, of another job, or damaged.
  static std::optional<Content> read(const fs::path& file, const EstimateJob& job,
                                     const EstimateOptions& options, const std::string& key);
};

LightTables::LightTables(const EstimateJob& job, const EstimateOptions& options, const RunContext& run)
    : table_(job.frames, job.session.light, hats_of_job(job, options), run) {
  if (options.mode == EstimateMode::refined) texels_.emplace(table_);
  // Photographs of one light source at a time leave nothing unknown of the light that they were taken under;
  // for light in between see ReflectanceField::fit_interpolation().
  const auto regression = texels_ ? texels_->of_all() : nullptr;
  if (options.predict_errors && !(regression && regression->is_interpolating()))
    light_error_ = light_error_model(table_, texels_ ? texels_->cells() : std::vector<Box>{});
  weighs_images_ = texels_ && texels_->cells().empty() && !job.noise.image_weights.empty();
  if (weighs_images_) table_.weight_images(job.noise.image_weights);
}

LightTables::LightTables(Content content)
    : table_(std::move(content.table)),
      light_error_(std::move(content.light_error)),
      weighs_images_(content.weighs_images) {
  if (content.has_texels) texels_.emplace(table_, std::move(content.cells));
}

std::unique_ptr<LightTables> LightTables::shared(const fs::path& file, const EstimateJob& job,
                                                 const EstimateOptions& options, const RunContext& run) {
  const std::string key = tables_key(job, options);
  if (auto content = Content::read(file, job, options, key))
    return std::unique_ptr<LightTables>(new LightTables(std::move(*content)));
  std::optional<OutputLock> lock;
  try {
    lock.emplace(file, std::vector<fs::path>{});
    // Twice the room: shards and finished rows come into the same folder.
    require_free_space(file, 2 * BoxTable::bytes(job.session.light, job.frames.size()));
  } catch (const InputError&) {  // another shard is about to write it
  } catch (const DeviceError& error) {
    lock.reset();
    run.note(std::string(not_shared) + error.what());
  }
  auto tables = std::make_unique<LightTables>(job, options, run);
  if (lock) try {
      tables->write(file, key);
    } catch (const DeviceError& error) {
      run.note(std::string(not_shared) + error.what());
    }
  return tables;
}

void LightTables::write(const fs::path& file, const std::string& key) const {
  const auto small =
      std::array{std::as_bytes(table_.all_hat_sums()), std::as_bytes(std::span(light_error_.directions)),
                 std::as_bytes(std::span(light_error_.variances))};
  const auto sums = std::as_bytes(table_.sums());
  const auto numbers = [](const std::vector<Box>& boxes) {
    auto list = nlohmann::json::array();
    for (const Box& box : boxes) list.push_back({box.x0, box.y0, box.x1, box.y1});
    return list;
  };
  nlohmann::json header = {{"job", key},
                           {"has_texels", texels_.has_value()},
                           {"cells", numbers(texels_ ? texels_->cells() : std::vector<Box>{})},
                           {"error_cells", numbers(light_error_.cells)},
                           {"weighs_images", weighs_images_},
                           {"unit", table_.unit()},
                           {"bytes", {small[0].size(), small[1].size(), small[2].size(), sums.size()}}};
  header["digest"] = digest_of(json_text(header), small, sums);
  std::string line = json_text(header) + "\n";
  line.resize(whole_pages(line.size()), ' ');
  write_atomically(file, [&](const fs::path& temporary) {
    std::FILE* stream = std::fopen(temporary.c_str(), "wbe");
    if (!stream) throw DeviceError(file.string(), errno, "cannot create");
    errno = 0;
    bool written = std::fwrite(line.data(), 1, line.size(), stream) == line.size();
    for (const auto& part : {small[0], small[1], small[2], sums}) {
      if (part.empty()) continue;
      const std::string padding(whole_pages(part.size()) - part.size(), ' ');
      written = written && std::fwrite(part.data(), 1, part.size(), stream) == part.size() &&
                std::fwrite(padding.data(), 1, padding.size(), stream) == padding.size();
    }
    const bool closed = std::fclose(stream) == 0;
    if (!written || !closed) throw DeviceError(file.string(), errno, "cannot write");
  });
}

std::optional<LightTables::Content> LightTables::Content::read(const fs::path& file, const EstimateJob& job,
                                                               const EstimateOptions& options,
                                                               const std::string& key) try {
  if (!fs::exists(file)) return std::nullopt;
  const auto mapped = std::make_shared<const MappedFile>(file);
  const auto all = mapped->bytes();
  if (all.empty()) return std::nullopt;
  const auto* text = reinterpret_cast<const char*>(all.data());
  const auto* end = static_cast<const char*>(std::memchr(text, '\n', all.size()));
  if (!end) return std::nullopt;
  auto header = nlohmann::json::parse(text, end);
  if (header.at("job") != key) return std::nullopt;
  const auto sizes = header.at("bytes").get<std::array<std::size_t, 4>>();
  std::array<std::span<const std::byte>, 4> parts;
  std::size_t at = whole_pages(static_cast<std::size_t>(end - text) + 1);
  for (std::size_t i = 0; i < parts.size(); at += whole_pages(sizes[i++])) {
    if (at > all.size() || sizes[i] > all.size() - at) return std::nullopt;
    parts[i] = all.subspan(at, sizes[i]);
  }
  const std::string digest = header.at("digest");
  header.erase("digest");
  if (digest != digest_of(json_text(header), std::span(parts).first(3), parts[3])) return std::nullopt;
  const auto boxes = [&](const char* name) {
    std::vector<Box> list;
    for (const auto& box : header.at(name)) {
      const auto edges = box.get<std::array<int, 4>>();
      list.push_back({edges[0], edges[1], edges[2], edges[3]});
    }
    return list;
  };
  const auto copied = [](std::span<const std::byte> bytes, auto& values) {
    values.resize(bytes.size() / sizeof values[0]);
    if (!values.empty()) std::memcpy(values.data(), bytes.data(), values.size() * sizeof values[0]);
  };
  const bool weighs = header.at("weighs_images");
  const auto images = static_cast<int>(job.frames.size());
  BoxTable::Stored stored;
  stored.domain = job.session.light;
  stored.images = images;
  stored.hats = hats_of_job(job, options);
  header.at("unit").get_to(stored.unit);
  stored.weights = weighs ? job.noise.image_weights : std::vector<float>(images, 1.0f);
  copied(parts[0], stored.hat_sums);
  stored.sums = {mapped, reinterpret_cast<const double*>(parts[3].data())};
  if (!stored.fits(parts[3].size() / sizeof(double))) return std::nullopt;
  Content content{
      BoxTable(std::move(stored)), boxes("cells"), {}, header.at("has_texels").get<bool>(), weighs};
  content.light_error.cells = boxes("error_cells");
  copied(parts[1], content.light_error.directions);
  copied(parts[2], content.light_error.variances);
  return content;
} catch (const nlohmann::json::exception&) {
  return std::nullopt;
} catch (const DeviceError&) {
  return std::nullopt;
}

}  // namespace refield
