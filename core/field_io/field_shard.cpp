// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/field_shard.h"

#include <unordered_map>

#include "core/field_io/reflectance_field_file.h"

namespace refield {

namespace {

struct Outline {
  fs::path path;
  FieldPart part;
};

std::string rows_text(int first, int last) {
  return last - first == 1 ? "row " + std::to_string(first)
                           : "rows " + std::to_string(first) + " to " + std::to_string(last - 1);
}

void require_same_job(const Outline& one, const Outline& other) {
  const ReflectanceField& a = one.part.field;
  const ReflectanceField& b = other.part.field;
  const std::string names = other.path.string() + " and " + one.path.string() + ": ";
  if (a.width != b.width || one.part.image_height != other.part.image_height ||
      a.basis.domain != b.basis.domain || a.basis.hats != b.basis.hats || a.monitors != b.monitors ||
      a.observed_light != b.observed_light)
    throw InputError(names,
                     "are shards of captures with different image sizes, light maps or monitor placements; "
                     "merge shards of one capture");
  if (one.part.job != other.part.job || a.provenance != b.provenance)
    throw InputError(names,
                     "were estimated from different captures, with different options or by different "
                     "versions ('refield info' shows both); estimate the differing shard again");
}

/// Rows must follow one another from the first to the last.
void require_whole(const std::vector<Outline>& parts) {
  const int height = parts.front().part.image_height;
  const auto missing = [&](int first, int last, const std::string& where) {
    throw InputError(where, ": ", rows_text(first, last), " of ", height,
                     " are missing; estimate them with --rows ", first, ":", last);
  };
  int next = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const RowRange rows = parts[i].part.rows;
    if (rows.first > next)
      missing(next, rows.first,
              i == 0 ? "before " + parts[i].path.string()
                     : "between " + parts[i - 1].path.string() + " and " + parts[i].path.string());
    if (rows.first < next)
      throw InputError(parts[i - 1].path, " and ", parts[i].path, ": both hold ",
                       rows_text(rows.first, std::min(next, rows.last)), "; remove one of them");
    next = rows.last;
  }
  if (next < height) missing(next, height, "after " + parts.back().path.string());
}

/// Appends rows to a field; boxes get their numbers in order of first use, as in a run over all rows.
class Joiner {
 public:
  explicit Joiner(const FieldPart& outline) : whole_(outline.field) { whole_.height = outline.image_height; }

  /// Whether the whole transfer must be held, since interpolation between light sources is fitted to it.
  bool holds_transfer() const { return can_interpolate(whole_.observed_light, whole_.basis.domain); }

  /// Takes in a part; columns and weights only where holds_transfer().
  void append(FieldPart shard) {
    const ReflectanceField& part = shard.field;
    std::vector<std::uint64_t>& row_start = whole_.transfer.row_start;
    const std::uint64_t before = row_start.back();
    for (std::size_t p = 1; p <= part.transfer.rows(); ++p)
      row_start.push_back(before + part.transfer.row_start[p]);
    for (const std::uint32_t kernel : part.transfer.column)
      if (!part.basis.is_smooth(kernel)) number(part.basis.box(kernel));
    const auto join = [](auto& all, const auto& more) { all.insert(all.end(), more.begin(), more.end()); };
    join(whole_.quality.training_error, part.quality.training_error);
    join(whole_.quality.training_signal, part.quality.training_signal);
    join(whole_.quality.light_class, part.quality.light_class);
    join(error_evidence_, shard.error_evidence);
    if (!holds_transfer()) return;
    const SparseTransfer rows = transfer_of(std::move(shard));
    join(whole_.transfer.column, rows.column);
    join(whole_.transfer.weight, rows.weight);
  }
  /// The transfer of a part that append() took in, with the numbers of the whole.
  SparseTransfer transfer_of(FieldPart shard) const {
    const LightBasis& basis = shard.field.basis;
    for (std::uint32_t& kernel : shard.field.transfer.column)
      if (!basis.is_smooth(kernel)) kernel = numbers_.at(basis.box(kernel));
    return std::move(shard.field.transfer);
  }
  /// Errors are predicted now that all rows are there, as a run over all of them does at its end.
  ReflectanceField take() {
    predict_errors(whole_, error_evidence_);
    whole_.fit_interpolation();
    return std::move(whole_);
  }

 private:
  void number(const Box& box) {
    if (numbers_.try_emplace(box, static_cast<std::uint32_t>(whole_.basis.size())).second)
      whole_.basis.boxes.push_back(box);
  }
  ReflectanceField whole_;
  std::vector<ErrorEvidence> error_evidence_;
  std::unordered_map<Box, std::uint32_t, BoxHash> numbers_;
};

}  // namespace

ReflectanceField merge_field_parts(std::span<const fs::path> paths, const fs::path& output,
                                   const RunContext& run) {
  if (paths.empty()) throw InputError("no shards of a field are given");
  std::vector<Outline> parts;
  for (const fs::path& path : paths) parts.push_back({path, read_field_part_outline(path, run)});
  for (const Outline& part : parts) require_same_job(parts.front(), part);
  std::ranges::stable_sort(parts, {}, [](const Outline& outline) { return outline.part.rows.first; });
  require_whole(parts);
  Joiner joiner(parts.front().part);
  for (const Outline& part : parts) {
    run.throw_if_stopped();
    joiner.append(read_field_part(part.path, run));
  }
  const bool is_held = joiner.holds_transfer();
  ReflectanceField whole = joiner.take();
  if (is_held) {
    write_reflectance_field(output, whole);
    return whole;
  }
  SparseTransfer piece;
  write_reflectance_field(output, whole,
                          {whole.transfer.row_start, parts.size(),
                           [&](std::size_t i) -> const SparseTransfer& {
                             piece = {};  // before the next is read
                             piece = joiner.transfer_of(read_field_part(parts[i].path, run));
                             return piece;
                           }},
                          run);
  return whole;
}

}  // namespace refield
