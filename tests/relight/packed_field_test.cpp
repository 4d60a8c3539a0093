// SPDX-License-Identifier: Apache-2.0
#include "core/field_io/packed_field.h"

#include <gmock/gmock.h>

#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <utility>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
#include "tests/fuzz/hdf5_checksums.h"
#include "tests/relight/mixed_field.h"
#include "tests/support/isolating_run.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr LightDomain monitor{50, 40, Parameterisation::monitor};

/// Whole and cut tiles, several bands, both forms of weights.
PackedField make_sample(double error = 5e-3) {
  ReflectanceField field = test::mixed_field(37, 70, monitor);
  field.quality.training_error.assign(37 * 70, 0.25f);
  field.provenance = R"({"note": "Übung"})";
  field.monitors = {{520, 320, 600, {90, -5.5, 0.1}, 10, -20}};
  return pack_field(field, error).field;
}

const PackedField& sample() {
  static const PackedField packed = make_sample();
  return packed;
}

LightMap some_light() {
  Rng rng(8);
  return test::random_light(rng, monitor);
}

PackedField read_packed_field(const fs::path& path) {
  return std::get<PackedField>(read_either_field(path));
}

std::string message_of(const fs::path& path) {
  return test::message_of<FormatError>([&] { read_reflectance_field(path); });
}

TEST(PackedField, ShowsTheSameFromTilesRowsAndFile) {
  const test::TemporaryFolder folder;
  for (const double error : {5e-3, 2e-5}) {
    const PackedField packed = make_sample(error);
    write_packed_field(folder / "a.rfield", packed);
    PackedField back = read_packed_field(folder / "a.rfield");
    EXPECT_EQ(back.bits(), error > 1e-3 ? 8 : 16);
    EXPECT_EQ(back.outline.quality.training_error, packed.outline.quality.training_error);
    EXPECT_EQ(back.outline.provenance, packed.outline.provenance);
    EXPECT_EQ(packed.outline.monitors.size(), 1u);
    EXPECT_EQ(back.outline.monitors, packed.outline.monitors);
    const ReflectanceField rows = read_reflectance_field(folder / "a.rfield");
    const LightMap light = some_light();
    const Image expected = TileRelighter(PackedField(packed)).relight(light);
    EXPECT_EQ(TileRelighter(std::move(back)).relight(light).values, expected.values);
    EXPECT_LT(relative_rmse(rows.relight(light), expected), error > 1e-3 ? 1e-5 : 1e-6);
    EXPECT_EQ(expand(PackedField(packed)).transfer.weight, rows.transfer.weight);
  }
}

TEST(PackedField, UpdatesAfterReading) {
  const test::TemporaryFolder folder;
  write_packed_field(folder / "a.rfield", sample());
  TileRelighter relighter(read_packed_field(folder / "a.rfield"));
  LightMap light = some_light();
  relighter.relight(light);
  const Box part = {5, 6, 30, 21};
  for (int y = part.y0; y < part.y1; ++y)
    for (int x = part.x0; x < part.x1; ++x) light.radiance.at(x, y, 1) = 3.0f;
  const Image updated = relighter.update(light, part);
  EXPECT_LT(relative_rmse(updated, relighter.relight(light)), 1e-6);
}

TEST(PackedField, ExpandsToFieldsThatCanBeWrittenAsRows) {
  const test::TemporaryFolder folder;
  const ReflectanceField rows = expand(PackedField(sample()));
  write_reflectance_field(folder / "rows.rfield", rows);
  EXPECT_EQ(read_reflectance_field(folder / "rows.rfield").transfer.column, rows.transfer.column);
}

TEST(PackedField, WithoutAnyWeight) {
  const test::TemporaryFolder folder;
  ReflectanceField dark;
  dark.width = dark.height = 2;
  dark.basis.domain = {4, 4};
  for (int i = 0; i < 4; ++i) dark.transfer.append_row({}, {});
  write_packed_field(folder / "a.rfield", pack_field(dark, 1e-3).field);
  EXPECT_EQ(read_reflectance_field(folder / "a.rfield").transfer.rows(), 4u);
}

TEST(PackedField, EqualFieldsGiveEqualBytes) {
  const test::TemporaryFolder folder;
  write_packed_field(folder / "a.rfield", make_sample());
  write_packed_field(folder / "b.rfield", make_sample());
  EXPECT_EQ(read_text(folder / "a.rfield"), read_text(folder / "b.rfield"));
}

using Tiles8 = TiledTransfer<std::uint8_t>;

template <class Value>
Value& writable(std::span<const Value> values, std::size_t at) {
  return const_cast<Value&>(values[at]);
}

/// The fault that a change to the first tile makes.
template <class Damage>
std::string fault_after(const Damage& damage) {
  PackedField packed = sample();
  damage(std::get<Tiles8>(packed.tiles));
  return fault_of_tiles(packed);
}

TEST(DamagedPackedField, EveryNumberIsLookedAt) {
  constexpr std::uint32_t huge = std::numeric_limits<std::uint32_t>::max();
  EXPECT_EQ(fault_after([](Tiles8&) {}), "");
  for (std::size_t length = 0; length < 12; ++length)
    for (const std::uint32_t wrong : {huge, huge / 8, 1u << 28, 0u})
      EXPECT_THAT(fault_after([&](Tiles8& tiles) {
                    std::memcpy(tiles.bands[0].memory.data() + 4 * length, &wrong, 4);
                  }),
                  HasSubstr("tile 0 holds"))
          << "length " << length << " as " << wrong;
  const auto expect = [](const char* word, const auto& damage) {
    EXPECT_THAT(fault_after([&](Tiles8& tiles) { damage(tiles.tile(0)); }), HasSubstr(word));
  };
  using Damaged = const Tile<std::uint8_t>&;
  expect("outside the light map", [](Damaged tile) { writable(tile.support, 0).x0 = -1; });
  expect("outside the light map",
         [](Damaged tile) { writable(tile.support, tile.support.size() - 1).x1 = 51; });
  expect("does not exist", [](Damaged tile) { writable(tile.common, 0) = huge; });
  expect("dense weights", [](Damaged tile) { writable(tile.dense_kernels, 0) = huge; });
  expect("dense weights", [](Damaged tile) { writable(tile.dense_start, 1) = huge; });
  expect("dense weights", [](Damaged tile) { writable(tile.places, 0) = huge; });
  expect("dense weights", [](Damaged tile) { writable(tile.group, 1) = huge; });
  expect("dense weights", [](Damaged tile) { writable(tile.record_kernel, 0) = huge; });
  expect("arrays", [](Damaged tile) { writable(tile.runs, 0).uses = huge; });
  expect("arrays", [](Damaged tile) { writable(tile.runs, 0).kernels = huge; });
  expect("scale", [](Damaged tile) { writable(tile.scale, 0) = -INFINITY; });
  expect("scale", [](Damaged tile) { writable(tile.scale, 0) = 3e38f; });
  expect("scale", [](Damaged tile) { writable(tile.record_scale, 0) = NAN; });
  // Only five of the last tile's sixteen columns are in the picture.
  EXPECT_THAT(fault_after([](Tiles8& tiles) { writable(tiles.tile(2).sparse, 0).pixel = 2 * group_pixels; }),
              HasSubstr("outside the picture"));
}

// Wrong bits and words anywhere in the tiles: what passes the check must be safe to use.
TEST(DamagedPackedField, AnyMemoryIsRefusedOrUsable) {
  const PackedField whole = sample();
  const LightMap light = some_light();
  Rng rng(5);
  int refused = 0;
  for (int round = 0; round < test::fuzz_rounds(); ++round) {
    PackedField damaged = whole;
    auto& bands = std::get<Tiles8>(damaged.tiles).bands;
    auto& memory = bands[rng.below(bands.size())].memory;
    for (std::uint64_t i = 1 + rng.below(3); i > 0; --i) {
      const std::size_t word = rng.below(memory.size() / 4) * 4;
      const std::uint32_t values[] = {0, 1, 0xffffffff, 0x7fffffff, static_cast<std::uint32_t>(rng.next())};
      if (rng.below(2) == 0)
        memory[rng.below(memory.size())] ^= static_cast<std::byte>(1 << rng.below(8));
      else
        std::memcpy(memory.data() + word, values + rng.below(5), 4);
    }
    if (!fault_of_tiles(damaged).empty()) {
      ++refused;
      continue;
    }
    std::get<Tiles8>(damaged.tiles).mark_parts();
    PackedField copy = damaged;
    TileRelighter relighter(std::move(copy));
    relighter.relight(light);
    relighter.update(light, {3, 3, 20, 20});
    expand(std::move(damaged)).relight(light);
  }
  EXPECT_GT(refused, test::fuzz_rounds() / 20);
}

TEST(DamagedPackedField, FilesAreRefusedOrHarmless) {
  const test::TemporaryFolder folder;
  write_packed_field(folder / "whole.rfield", sample());
  const std::string bytes = read_text(folder / "whole.rfield");
  const ReflectanceField whole = read_reflectance_field(folder / "whole.rfield");
  Rng rng(2);
  for (int round = 0; round < test::fuzz_rounds() / 6; ++round) {
    std::string damaged = bytes;
    for (std::uint64_t i = 1 + rng.below(4); i > 0; --i)
      damaged[rng.below(damaged.size())] ^= static_cast<char>(1 << rng.below(8));
    const bool forged = round % 2 == 0;
    if (forged) fuzz::renew_hdf5_checksums({reinterpret_cast<std::uint8_t*>(damaged.data()), damaged.size()});
    std::ofstream(folder / "damaged.rfield", std::ios::binary) << damaged;
    try {
      const ReflectanceField back = read_reflectance_field(folder / "damaged.rfield", test::isolating_run());
      if (!forged) {
        EXPECT_EQ(back.transfer.weight, whole.transfer.weight) << "round " << round;
      }
    } catch (const Error&) {
      continue;
    }
  }
  for (std::size_t length = 0; length < bytes.size(); length += 1 + bytes.size() / 25) {
    std::ofstream(folder / "cut.rfield", std::ios::binary) << bytes.substr(0, length);
    EXPECT_THAT(message_of(folder / "cut.rfield"), HasSubstr("cut.rfield")) << "cut to " << length;
  }
}

}  // namespace
}  // namespace refield
