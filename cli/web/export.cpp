// SPDX-License-Identifier: Apache-2.0
#include "cli/web/export.h"

#include <zlib.h>

#include <fstream>
#include <set>

#include "cli/report/page.h"
#include "core/base/files.h"
#include "core/base/json.h"
#include "core/base/number_text.h"
#include "core/image/metrics.h"
#include "core/image/tone_map.h"
#include "relight/relight.h"

namespace refield::web {

namespace {

constexpr int mantissa_bits = 9;
constexpr int largest_mantissa = (1 << mantissa_bits) - 1;
constexpr int largest_exponent = 31;
constexpr int max_count =
    std::numeric_limits<std::uint16_t>::max();  // of kernels of a pixel, texels of a side

/// The basis of a field without the boxes that no pixel uses. `number` [kernels of the field] becomes their
/// numbers in it.
LightBasis used_basis(const ReflectanceField& field, std::vector<std::uint32_t>& number) {
  const LightBasis& basis = field.basis;
  std::vector<bool> used(basis.size(), false);
  for (const std::uint32_t kernel : field.transfer.column) used[kernel] = true;
  LightBasis kept = basis;
  kept.boxes.clear();
  number.assign(basis.size(), 0);
  for (std::size_t k = 0; k < number.size(); ++k) {
    const bool is_box = k >= basis.first_vector_box();
    if (is_box && !used[k]) continue;
    number[k] = static_cast<std::uint32_t>(is_box ? kept.size() : k);
    if (is_box) kept.boxes.push_back(basis.box(k));
  }
  return kept;
}

// Browsers parse a script as a whole, and some hosts refuse large files.
constexpr std::size_t part_bytes = std::size_t{12} << 20;

/// Bytes of equal significance one after another: they resemble one another and compress well.
template <class Values>
std::string shuffled(const Values& values, const RunContext& run) {
  constexpr std::size_t size = sizeof(values[0]);
  std::string bytes(values.size() * size, '\0');
  for (std::size_t b = 0; b < size; ++b) {
    run.throw_if_stopped();
    for (std::size_t i = 0; i < values.size(); ++i)
      bytes[b * values.size() + i] = static_cast<char>(values[i] >> (8 * b));
  }
  return bytes;
}

std::string deflated(std::string_view bytes) {
  uLongf size = compressBound(bytes.size());
  std::string packed(size, '\0');
  if (compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(bytes.data()),
               bytes.size()) != Z_OK)
    throw std::bad_alloc();
  packed.resize(size);
  return packed;
}

bool is_data(std::string_view file) {
  return file.starts_with("data") && file.ends_with(".js");
}

/// Throws InputError when the folder holds files of the page's names that no export wrote. Data comes first
/// and the page's own files last, so where one of those is ours, the data lies beside it.
void require_page_folder(const fs::path& folder) {
  if (!fs::is_directory(folder)) return;
  const auto starts_with = [](const fs::path& path, std::string_view start) {
    std::string read(start.size(), '\0');
    return fs::is_regular_file(path) && std::ifstream(path).read(read.data(), std::ssize(read)) &&
           read == start;
  };
  const auto refuse = [](const fs::path& path) {
    throw InputError(path,
                     ": already exists and is not part of an exported page; give an empty or new folder");
  };
  const bool exported = starts_with(folder / "data.js", "refield.describe(");
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    const bool data = is_data(name);
    if (data && !starts_with(entry.path(), "refield.")) refuse(entry.path());
    if (!data && !exported && std::ranges::find(page_files(), name, &PageFile::name) != page_files().end())
      refuse(entry.path());
  }
}

/// Writes files into the page's folder and counts them.
class PageWriter {
 public:
  explicit PageWriter(fs::path folder) : folder_(std::move(folder)) { create_folders(folder_); }

  void write(const std::string& name, std::string_view content, const RunContext& run) {
    run.throw_if_stopped();
    write_text_atomically(folder_ / name, content);
    names_.insert(name);
    bytes_ += content.size();
  }
  /// Removes data that an earlier export left and this one did not replace.
  void remove_other_data() const {
    std::vector<fs::path> old;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string name = entry.path().filename().string();
      if (is_data(name) && !names_.contains(name)) old.push_back(entry.path());
    }
    for (const fs::path& path : old) fs::remove(path);
  }
  std::size_t files() const { return names_.size(); }
  std::uint64_t bytes() const { return bytes_; }

 private:
  fs::path folder_;
  std::set<std::string> names_;
  std::uint64_t bytes_ = 0;
};

/// Deflated, as a script holds it.
std::string script_text(std::string_view bytes) {
  const std::string packed = deflated(bytes);
  return "'" + report::base64({reinterpret_cast<const std::uint8_t*>(packed.data()), packed.size()}) + "'";
}

/// Writes arrays as scripts `data-NNN.js`, each of which hands a part to the page.
class DataWriter {
 public:
  explicit DataWriter(PageWriter& page) : page_(page) {}

  template <class Values>
  void add(const char* name, const Values& values, const RunContext& run, const char* kind = nullptr) {
    const std::string bytes = shuffled(values, run);
    Json parts = Json::array();
    for (std::size_t at = 0; at < bytes.size(); at += part_bytes) {
      const std::string file = formatted("data-%03zu.js", count_++);
      page_.write(file,
                  "refield.receive(" + script_text(std::string_view(bytes).substr(at, part_bytes)) + ");\n",
                  run);
      parts.push_back(file);
    }
    arrays_[name] = {{"values", values.size()}, {"bytes", sizeof(values[0])}, {"parts", parts}};
    if (kind) arrays_[name]["kind"] = kind;
  }

  /// Numbers one after another, as floats or as half floats.
  void add_halves(const char* name, std::span<const float> values, const RunContext& run) {
    std::vector<std::uint16_t> bits(values.size());
    std::ranges::transform(values, bits.begin(), [](float value) {
      return Eigen::numext::bit_cast<std::uint16_t>(Eigen::half(value));
    });
    add(name, bits, run, "half");
  }

  const Json& arrays() const { return arrays_; }

 private:
  PageWriter& page_;
  std::size_t count_ = 0;
  Json arrays_;
};

std::vector<std::uint16_t> corners_of(const std::vector<Box>& boxes) {
  std::vector<std::uint16_t> corners;
  for (const auto corner : {&Box::x0, &Box::y0, &Box::x1, &Box::y1})
    for (const Box& box : boxes) corners.push_back(static_cast<std::uint16_t>(box.*corner));
  return corners;
}

/// Sets the exposure and what the page's rounding costs.
void measure(const ReflectanceField& full, const ReflectanceField& shown, ExportReport& report,
             const RunContext& run) {
  const LightDomain& domain = full.basis.domain;
  constexpr int bars = 4;
  double squares = 0.0, reference = 0.0;
  for (int i = -1; i < bars; ++i) {
    run.throw_if_stopped();
    const bool is_white = i < 0;  // first, since it tells the exposure
    const LightMap light =
        is_white ? LightMap{Image(domain.width, domain.height, 3, 1.0f), domain.parameterisation}
                 : sliding_bar(domain, 0.125, i, bars);
    const Image expected = full.relight(light);
    if (is_white) report.exposure = exposure_to_white(expected);
    run.throw_if_stopped();
    const Image seen = shown.relight(light);
    const auto a = tone_mapped(expected, {report.exposure}), b = tone_mapped(seen, {report.exposure});
    for (std::size_t v = 0; v < a.size(); ++v) {
      const double difference = static_cast<double>(seen.values[v]) - expected.values[v];
      squares += difference * difference;
      reference += static_cast<double>(expected.values[v]) * expected.values[v];
      report.largest_difference = std::max(report.largest_difference, std::abs(a[v] - b[v]));
    }
  }
  report.relative_rmse = reference > 0.0 ? std::sqrt(squares / reference) : 0.0;
}

/// Where the one window of a monitor is seen: the direction of its top left corner, and what its width and
/// its height add to that. Null where the page must not show panoramas through it.
Json window_of(const ReflectanceField& field) {
  if (field.basis.domain.parameterisation != Parameterisation::monitor || field.monitors.size() != 1)
    return nullptr;
  const MonitorPlacement& monitor = field.monitors.front();
  const Eigen::Vector3d corner = screen_direction(monitor, 0.0, 0.0);
  Json window;
  for (const Eigen::Vector3d& vector : {corner, Eigen::Vector3d(screen_direction(monitor, 1.0, 0.0) - corner),
                                        Eigen::Vector3d(screen_direction(monitor, 0.0, 1.0) - corner)})
    window.push_back({vector.x(), vector.y(), vector.z()});
  return window;
}

/// Adds a map as half floats, brightest sample 65504, and describes it.
Json add_map(const PageMap& map, std::size_t number, DataWriter& data, const RunContext& run) {
  const float peak = std::max(*std::ranges::max_element(map.radiance.values), 1e-30f);
  const float scale = peak / 65504.0f;
  std::vector<float> scaled(map.radiance.values.size());
  std::ranges::transform(map.radiance.values, scaled.begin(), [&](float value) { return value / scale; });
  const std::string array = "map" + std::to_string(number);
  data.add_halves(array.c_str(), scaled, run);
  return {{"name", map.name},
          {"width", map.radiance.width},
          {"height", map.radiance.height},
          {"scale", scale},
          {"array", array}};
}

Json interpolation_of(const LightInterpolation& of) {
  Json interpolation{{"length", of.length},
                     {"fineShare", of.fine_share},
                     {"fineLength", of.fine_length},
                     {"reach", of.reach},
                     {"sources", Json::array()}};
  for (const Box& box : of.sources)
    interpolation["sources"].push_back(std::array{box.x0, box.y0, box.x1, box.y1});
  return interpolation;
}

/// Adds the field and describes it.
Json add_field(const ReflectanceField& field, const std::string& title, DataWriter& data,
               ExportReport& report, const RunContext& run) {
  const auto [shown, exponent] = page_field(field, run);
  measure(field, shown, report, run);
  const SparseTransfer& transfer = shown.transfer;
  std::vector<std::uint16_t> counts;
  for (std::size_t p = 0; p < transfer.rows(); ++p)
    counts.push_back(static_cast<std::uint16_t>(transfer.row_start[p + 1] - transfer.row_start[p]));
  std::vector<std::uint32_t> weights;
  for (std::size_t i = 0; i < transfer.entries(); ++i)
    weights.push_back(exponent.packed(&transfer.weight[3 * i]));
  data.add("counts", counts, run);
  data.add("kernels", transfer.column, run);
  data.add("weights", weights, run);
  data.add("boxes", corners_of(shown.basis.boxes), run);
  const LightDomain& light = field.basis.domain;
  const HatGrid& hats = shown.basis.hats;
  Json described{{"title", title},
                 {"width", shown.width},
                 {"height", shown.height},
                 {"light",
                  {{"width", light.width},
                   {"height", light.height},
                   {"parameterisation", std::string(name_of(light.parameterisation))},
                   {"window", window_of(field)}}},
                 {"hats", {{"columns", hats.columns}, {"rows", hats.rows}}},
                 {"exposure", report.exposure},
                 {"exponent_offset", exponent.offset}};
  if (field.mixes_colours())
    for (const auto& row : field.output_from_primaries.rowwise())
      for (const float entry : row) described["mixing"].push_back(entry);
  if (shown.basis.interpolation) described["interpolation"] = interpolation_of(*shown.basis.interpolation);
  return described;
}

}  // namespace

SharedExponent SharedExponent::for_largest(float weight) {
  int exponent = 0;
  std::frexp(std::max(weight, std::numeric_limits<float>::min()), &exponent);
  // One more, should the largest mantissa round up.
  return {largest_exponent + mantissa_bits - exponent - 1};
}

std::uint32_t SharedExponent::packed(const float* rgb) const {
  const float largest = std::max({rgb[0], rgb[1], rgb[2]});
  if (!(largest > 0.0f)) return 0;
  int power = 0;
  std::frexp(largest, &power);
  int e = std::clamp(power - mantissa_bits + offset, 0, largest_exponent);
  if (std::lround(std::ldexp(largest, offset - e)) > largest_mantissa) ++e;
  std::uint32_t bits = static_cast<std::uint32_t>(e) << (3 * mantissa_bits);
  for (int c = 0; c < 3; ++c)
    bits |= static_cast<std::uint32_t>(std::lround(std::ldexp(rgb[c], offset - e))) << (mantissa_bits * c);
  return bits;
}

void SharedExponent::unpack(std::uint32_t bits, float* rgb) const {
  const int e = static_cast<int>(bits >> (3 * mantissa_bits));
  for (int c = 0; c < 3; ++c)
    rgb[c] = std::ldexp(static_cast<float>(bits >> (mantissa_bits * c) & largest_mantissa), e - offset);
}

PageField page_field(const ReflectanceField& field, const RunContext& run) {
  const LightDomain& domain = field.basis.domain;
  if (domain.width > max_count || domain.height > max_count)
    throw InputError("the light map of ", domain.width, "×", domain.height,
                     " is too large for a page; at most 65535 texels per side are supported");
  if (field.mesh || field.basis.measure == Measure::solid_angle)
    throw InputError(
        "a precomputed field is lit by a cube map, which a page has not; relight it by 'refield relight' or "
        "'refield view'");
  const SparseTransfer& transfer = field.transfer;
  if (std::ranges::any_of(transfer.weight, [](float weight) { return weight < 0.0f; }))
    throw InputError(
        "the field has negative weights, which a page cannot hold; relight it by 'refield relight' or "
        "'refield view'");
  for (std::size_t p = 0; p < transfer.rows(); ++p)
    if (const std::uint64_t count = transfer.row_start[p + 1] - transfer.row_start[p]; count > max_count)
      throw InputError("a pixel has ", count, " kernels; a page shows at most 65535");
  const float largest = transfer.weight.empty() ? 0.0f : *std::ranges::max_element(transfer.weight);
  PageField page;
  page.exponent = SharedExponent::for_largest(largest);
  page.field.width = field.width;
  page.field.height = field.height;
  page.field.output_from_primaries = field.output_from_primaries;
  page.field.transfer = transfer;
  std::vector<std::uint32_t> number;
  page.field.basis = used_basis(field, number);
  for (std::size_t i = 0; i < transfer.entries(); ++i) {
    if (i % 65536 == 0) run.throw_if_stopped();
    page.field.transfer.column[i] = number[transfer.column[i]];
    page.exponent.unpack(page.exponent.packed(&transfer.weight[3 * i]), &page.field.transfer.weight[3 * i]);
  }
  return page;
}

ExportReport export_page(const ReflectanceField& field, const std::string& title, const fs::path& folder,
                         const std::vector<PageMap>& maps, const RunContext& run) {
  require_page_folder(folder);
  ExportReport report;
  PageWriter page(folder);
  DataWriter data(page);
  auto described = add_field(field, title, data, report, run);
  described["maps"] = Json::array();
  for (std::size_t i = 0; i < maps.size(); ++i) described["maps"].push_back(add_map(maps[i], i, data, run));
  described["arrays"] = data.arrays();
  page.write("data.js", "refield.describe(" + json_text(described) + ");\n", run);
  for (const PageFile& file : page_files()) page.write(file.name, file.content, run);
  page.remove_other_data();
  report.files = page.files();
  report.bytes = page.bytes();
  return report;
}

}  // namespace refield::web
