// SPDX-License-Identifier: Apache-2.0
// Parts of a field: what joins, to the bit, and what is refused, by name.
#include "core/field_io/field_shard.h"

#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <numeric>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;

constexpr int width = 5;
constexpr int height = 12;

/// Boxes numbered in order of first use, as estimation leaves them.
ReflectanceField renumbered(const ReflectanceField& field, RowRange rows) {
  ReflectanceField result;
  result.width = field.width;
  result.height = rows.count();
  result.basis.domain = field.basis.domain;
  result.provenance = field.provenance;
  std::vector<std::uint32_t> number(field.basis.boxes.size(), UINT32_MAX);
  for (int p = rows.first * width; p < rows.last * width; ++p) {
    std::vector<std::uint32_t> columns;
    const std::uint64_t first = field.transfer.row_start[p];
    const std::uint64_t last = field.transfer.row_start[p + 1];
    for (std::uint64_t e = first; e < last; ++e) {
      std::uint32_t& k = number[field.transfer.column[e]];
      if (k == UINT32_MAX) {
        k = static_cast<std::uint32_t>(result.basis.boxes.size());
        result.basis.boxes.push_back(field.basis.boxes[field.transfer.column[e]]);
      }
      columns.push_back(k);
    }
    result.transfer.append_row(columns,
                               std::span(field.transfer.weight).subspan(3 * first, 3 * (last - first)));
    result.quality.training_error.push_back(0.25f * static_cast<float>(p));
  }
  return result;
}

class FieldParts : public testing::Test {
 protected:
  FieldParts() : field_(test::random_field(rng_, width, height, {9, 7, Parameterisation::monitor}, 30, 4)) {
    field_.provenance = R"({"kernels":4})";
  }
  fs::path write(const std::string& name, RowRange rows, const std::string& job = "job") {
    write_field_part(folder_ / name, {renumbered(field_, rows), rows, height, job});
    return folder_ / name;
  }
  std::string refusal(const std::vector<fs::path>& paths) const {
    try {
      merge_field_parts(paths, folder_ / "refused.rfield");
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  Rng rng_{3};
  ReflectanceField field_;
  test::TemporaryFolder folder_;
};

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool memory_is_the_program_s_own = false;
#else
constexpr bool memory_is_the_program_s_own = true;
#endif

/// Bytes of memory that this process held at most since mark_peak().
std::uint64_t peak_bytes() {
  std::ifstream status("/proc/self/status");
  std::uint64_t kibibytes = 0;
  for (std::string word; status >> word;)
    if (word == "VmHWM:") status >> kibibytes;
  return kibibytes * 1024;
}
bool mark_peak() {
  return static_cast<bool>(std::ofstream("/proc/self/clear_refs") << 5 << std::flush);
}

TEST_F(FieldParts, WrittenInPiecesAreTheSameToTheBit) {
  const ReflectanceField whole = renumbered(field_, {0, height});
  write_reflectance_field(folder_ / "whole.rfield", whole);
  const FieldPart part{whole, {0, height}, height, "job", std::vector<ErrorEvidence>(width * height)};
  write_field_part(folder_ / "part.rfield", part);
  for (const int rows : {1, 5, height}) {
    std::vector<SparseTransfer> pieces;
    for (int first = 0; first < width * height; first += rows * width) {
      SparseTransfer& piece = pieces.emplace_back();
      for (int p = first; p < std::min(first + rows * width, width * height); ++p) {
        const std::uint64_t begin = whole.transfer.row_start[p], end = whole.transfer.row_start[p + 1];
        piece.append_row(std::span(whole.transfer.column).subspan(begin, end - begin),
                         std::span(whole.transfer.weight).subspan(3 * begin, 3 * (end - begin)));
      }
    }
    const TransferPieces transfer{whole.transfer.row_start, pieces.size(),
                                  [&](std::size_t i) -> const SparseTransfer& { return pieces[i]; }};
    write_reflectance_field(folder_ / "in_pieces.rfield", whole, transfer, {});
    EXPECT_TRUE(read_text(folder_ / "in_pieces.rfield") == read_text(folder_ / "whole.rfield"));
    write_field_part(folder_ / "part_in_pieces.rfield", part, transfer, {});
    EXPECT_TRUE(read_text(folder_ / "part_in_pieces.rfield") == read_text(folder_ / "part.rfield"));
  }
}

TEST_F(FieldParts, PiecesThatDoNotFitLeaveTheFileAsItWas) {
  const ReflectanceField whole = renumbered(field_, {0, height});
  write_reflectance_field(folder_ / "whole.rfield", whole);
  const std::string before = read_text(folder_ / "whole.rfield");
  SparseTransfer wrong = whole.transfer;
  wrong.column.back() = static_cast<std::uint32_t>(whole.basis.size());
  const auto give = [&](const SparseTransfer& piece, std::size_t count) {
    write_reflectance_field(
        folder_ / "whole.rfield", whole,
        {whole.transfer.row_start, count, [&](std::size_t) -> const SparseTransfer& { return piece; }}, {});
  };
  EXPECT_THROW(give(wrong, 1), SolverError);
  EXPECT_THROW(give(whole.transfer, 2), SolverError);
  EXPECT_THROW(give(whole.transfer, 0), SolverError);
  EXPECT_TRUE(read_text(folder_ / "whole.rfield") == before);
  const auto files = fs::directory_iterator(folder_ / ".");
  EXPECT_EQ(std::distance(begin(files), end(files)), 1);  // nothing half written
}

/// Fields of 16 rows of 4 MiB; all of them at once would be 64 MiB.
class LargeFieldParts : public FieldParts {
 protected:
  static constexpr int rows = 16, kernels = 64, pixels = 4096;

  LargeFieldParts() {
    outline_.width = pixels;
    outline_.basis.domain = {kernels, 1, Parameterisation::monitor};
    for (int k = 0; k < kernels; ++k) outline_.basis.boxes.push_back({k, 0, k + 1, 1});
  }
  static SparseTransfer row(std::size_t number) {
    std::vector<std::uint32_t> columns(kernels);
    std::iota(columns.begin(), columns.end(), 0u);
    const std::vector<float> weights(3 * kernels, static_cast<float>(number));
    SparseTransfer transfer;
    for (int p = 0; p < pixels; ++p) transfer.append_row(columns, weights);
    return transfer;
  }
  /// Whether `work` keeps to half of the field's memory.
  template <class Work>
  void expect_within_half(Work work) {
    if (!memory_is_the_program_s_own || !mark_peak()) GTEST_SKIP() << "peak memory says nothing here";
    const std::uint64_t before = peak_bytes();
    work();
    EXPECT_LT(peak_bytes() - before, 32u << 20);
    EXPECT_GT(fs::file_size(folder_ / "field.rfield"), 64u << 20);
  }
  ReflectanceField outline_;
};

TEST_F(LargeFieldParts, AreWrittenOneAtATime) {
  outline_.height = rows;
  for (std::uint64_t p = 1; p <= std::uint64_t{pixels} * rows; ++p)
    outline_.transfer.row_start.push_back(p * kernels);
  SparseTransfer piece;
  const auto make = [&](std::size_t i) -> const SparseTransfer& {
    piece = {};
    piece = row(i);
    return piece;
  };
  expect_within_half([&] {
    write_reflectance_field(folder_ / "field.rfield", outline_, {outline_.transfer.row_start, rows, make},
                            {});
  });
}

TEST_F(LargeFieldParts, AreMergedOneAtATime) {
  std::vector<fs::path> parts;
  outline_.height = 1;
  for (int y = 0; y < rows; ++y) {
    FieldPart part{outline_, {y, y + 1}, rows, "job"};
    part.field.transfer = row(static_cast<std::size_t>(y));
    part.field.quality.training_error.assign(pixels, 0.1f);
    parts.push_back(folder_ / (std::to_string(y) + ".rfield"));
    write_field_part(parts.back(), part);
  }
  expect_within_half([&] { merge_field_parts(parts, folder_ / "field.rfield"); });
}

TEST_F(FieldParts, JoinToTheBitInAnyOrder) {
  write_reflectance_field(folder_ / "whole.rfield", renumbered(field_, {0, height}));
  const auto a = write("a.rfield", {0, 5});
  const auto b = write("b.rfield", {5, 6});
  const auto c = write("c.rfield", {6, height});
  for (const auto& order : {std::vector{a, b, c}, std::vector{c, a, b}}) {
    merge_field_parts(order, folder_ / "joined.rfield");
    EXPECT_TRUE(read_text(folder_ / "joined.rfield") == read_text(folder_ / "whole.rfield"));
  }
}

TEST_F(FieldParts, FitTheInterpolationOfTheWholeField) {
  const LightDomain domain{16, 8, Parameterisation::lat_long};
  field_ = test::random_field(rng_, width, height, domain, 30, 4);
  const auto part_of = [&](RowRange rows) {
    ReflectanceField part = renumbered(field_, rows);
    for (int x = 0; x < 16; x += 2) part.observed_light.push_back({x, x % 3 + 2, x + 1, x % 3 + 3});
    return part;
  };
  ReflectanceField whole = part_of({0, height});
  whole.fit_interpolation();
  ASSERT_TRUE(whole.basis.interpolation);
  write_field_part(folder_ / "a.rfield", {part_of({0, 5}), {0, 5}, height, "job"});
  write_field_part(folder_ / "b.rfield", {part_of({5, height}), {5, height}, height, "job"});
  const std::vector<fs::path> parts = {folder_ / "b.rfield", folder_ / "a.rfield"};
  EXPECT_EQ(merge_field_parts(parts, folder_ / "joined.rfield").basis.interpolation,
            whole.basis.interpolation);
}

TEST_F(FieldParts, SayWhichRowsTheyHold) {
  const auto path = write("part.rfield", {3, 7}, "the job");
  const FieldPart part = read_field_part(path);
  EXPECT_EQ(part.rows, (RowRange{3, 7}));
  EXPECT_EQ(part.image_height, height);
  EXPECT_EQ(part.job, "the job");
  EXPECT_EQ(part.field.transfer.rows(), 4u * width);
  EXPECT_TRUE(is_field_part(path));
}

TEST_F(FieldParts, AreNoFieldsAndFieldsAreNoParts) {
  const auto path = write("part.rfield", {3, 7});
  try {
    read_reflectance_field(path);
    ADD_FAILURE() << "a part passed for a field";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("rows 3 to 6 of a field of 12 rows"), std::string::npos);
  }
  write_reflectance_field(folder_ / "whole.rfield", renumbered(field_, {0, height}));
  EXPECT_FALSE(is_field_part(folder_ / "whole.rfield"));
  EXPECT_FALSE(is_field_part(folder_ / "none.rfield"));
  EXPECT_THROW(read_field_part(folder_ / "whole.rfield"), InputError);
}

TEST_F(FieldParts, GapsAndOverlapsAreNamed) {
  const auto top = write("top.rfield", {0, 4});
  const auto middle = write("middle.rfield", {4, 9});
  const auto wide = write("wide.rfield", {3, 9});
  const auto bottom = write("bottom.rfield", {9, height});
  EXPECT_EQ(refusal({top, middle, bottom}), "");
  EXPECT_NE(refusal({top, bottom}).find("rows 4 to 8 of 12 are missing; estimate them with --rows 4:9"),
            std::string::npos);
  EXPECT_NE(refusal({top, bottom}).find("top.rfield and"), std::string::npos);
  EXPECT_NE(refusal({middle, bottom}).find("rows 0 to 3"), std::string::npos);
  EXPECT_NE(refusal({top, middle}).find("rows 9 to 11"), std::string::npos);
  const std::string overlap = refusal({top, wide, bottom});
  EXPECT_NE(overlap.find("both hold row 3"), std::string::npos) << overlap;
  EXPECT_NE(overlap.find("wide.rfield"), std::string::npos);
  EXPECT_NE(refusal({top, middle, middle, bottom}).find("both hold rows 4 to 8"), std::string::npos);
}

TEST_F(FieldParts, OtherJobsAreNamed) {
  const auto top = write("top.rfield", {0, 4});
  const auto other = write("other.rfield", {4, height}, "another job");
  EXPECT_NE(refusal({top, other}).find("other.rfield and"), std::string::npos);
  field_.provenance = R"({"kernels":5})";
  EXPECT_NE(refusal({top, write("options.rfield", {4, height})}).find("different options"),
            std::string::npos);
  EXPECT_NE(refusal({}), "");
}

}  // namespace
}  // namespace refield
