// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <numbers>

#include "core/base/errors.h"
#include "core/base/rng.h"
#include "core/field_io/packed_field.h"
#include "core/field_io/reflectance_field_file.h"
#include "core/image/metrics.h"
#include "core/light/cube_map.h"
#include "relight/environment/environment.h"
#include "relight/field_pictures.h"
#include "relight/pack/pack.h"
#include "relight/relighter.h"
#include "tests/support/message_of.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

// What RelightPrecision promises; twice that where harmonics of both signs cancel.
constexpr double fast_error = 2e-3, fine_error = 2e-5;
constexpr int side = 12;
constexpr std::size_t vertices = 1500;  // more than one row of tiles

/// A field over a mesh under a cube map: harmonics and vector boxes that all outputs have, squares that
/// neighbours share. `grey`: all channels weigh alike. `order`: of the harmonics; 0: none.
ReflectanceField random_mesh_field(bool grey, int order = 3) {
  Rng rng(3);
  ReflectanceField field;
  field.basis = {cube_domain(side), {}, {}, Measure::solid_angle, {order}};
  for (int i = 0; i < 60; ++i) field.basis.boxes.push_back(test::random_box(rng, side, cube_faces * side));
  for (int i = 0; i < 20; ++i) {
    const Box on_face = test::random_box(rng, side, side);
    const int top = side * static_cast<int>(rng.below(cube_faces));
    field.basis.vector_boxes.push_back({{on_face.x0, on_face.y0 + top, on_face.x1, on_face.y1 + top},
                                        {static_cast<float>(rng.uniform()), 0.5f, -0.2f}});
  }
  OutputMesh mesh;
  for (std::size_t i = 0; i < vertices; ++i) {
    const auto angle = static_cast<float>(i);
    mesh.positions.emplace_back(angle, 0.0f, 1.0f);
    mesh.normals.emplace_back(0.0f, 1.0f, 0.0f);
    mesh.colours.emplace_back(0.5f, 0.6f, 0.7f);
  }
  mesh.triangles = {{0, 1, 2}, {2, 1, 3}};
  mesh.camera = PinholeCamera{};
  field.width = output_image_width;
  field.height = output_image_height(mesh.outputs());
  field.mesh = std::move(mesh);
  std::vector<std::size_t> output(static_cast<std::size_t>(field.width) * field.height, vertices);
  for (std::size_t i = 0; i < vertices; ++i) output[pixel_of_output(i)] = i;
  for (const std::size_t of_pixel : output) {
    std::vector<std::uint32_t> columns;
    std::vector<float> weights;
    for (std::uint32_t k = 0; of_pixel < vertices && k < field.basis.size(); ++k) {
      const bool harmonic = field.basis.is_smooth(k);
      // Of each harmonic either sign; squares by groups of 16.
      if (harmonic ? (k + of_pixel) % 2 != 0 : (k * 7 + of_pixel / 16) % 5 != 0) continue;
      columns.push_back(k);
      for (int c = 0; c < 3; ++c)
        weights.push_back(grey && c > 0 ? weights.back() : static_cast<float>(rng.uniform()));
    }
    field.transfer.append_row(columns, weights);
  }
  return field;
}

LightMap random_light(std::uint64_t seed) {
  Rng rng(seed);
  return test::random_light(rng, cube_domain(side));
}

FieldRows rows_of(const ReflectanceField& field) {
  FieldRows rows{field, {}};
  rows.rows = [&field](RowRange range) {
    const auto width = static_cast<std::size_t>(field.width);
    return field.transfer.slice(static_cast<std::size_t>(range.first) * width,
                                static_cast<std::size_t>(range.last) * width);
  };
  return rows;
}

class PrecomputedField : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(GreyOrColoured, PrecomputedField, testing::Bool());

TEST_P(PrecomputedField, IsRelitByTheSameRelighter) {
  const ReflectanceField field = random_mesh_field(GetParam());
  const LightMap light = random_light(1);
  const Image expected = field.relight(light);
  TileRelighter fast(field), fine(field, RelightPrecision::fine), by_rows(pack_rows(rows_of(field), 8));
  EXPECT_LT(relative_rmse(fast.relight(light), expected), fast_error);
  EXPECT_LT(relative_rmse(by_rows.relight(light), expected), fast_error);
  EXPECT_LT(relative_rmse(fine.relight(light), expected), fine_error);

  LightMap changed = light;
  const Box part{2, 20, 7, 31};
  const LightMap other = random_light(2);
  for (int y = part.y0; y < part.y1; ++y)
    for (int x = part.x0; x < part.x1; ++x)
      for (int c = 0; c < 3; ++c) changed.radiance.at(x, y, c) = other.radiance.at(x, y, c);
  for (TileRelighter* relighter : {&fast, &by_rows})
    EXPECT_LT(relative_rmse(relighter->update(changed, part), field.relight(changed)), fast_error);
  EXPECT_LT(relative_rmse(fine.update(changed, part), field.relight(changed)), fine_error);
}

// Area lights leave most of the rectangle that they moved in as it was: what is passed by there must not be
// missing.
TEST_P(PrecomputedField, FollowsAreaLightsAsIfComputedAnew) {
  const ReflectanceField field = random_mesh_field(GetParam());
  LightMap light = random_light(1);
  for (const auto precision : {RelightPrecision::fast, RelightPrecision::fine}) {
    TileRelighter moving(field, precision), anew(field, precision);
    moving.relight(light);
    Rng rng(7);
    for (int step = 0; step < 40; ++step) {
      const Box part = test::random_box(rng, side, cube_faces * side);
      for (int texels = 1 + step % 4; texels > 0; --texels) {
        const int x = part.x0 + static_cast<int>(rng.below(static_cast<std::uint64_t>(part.width()))),
                  y = part.y0 + static_cast<int>(rng.below(static_cast<std::uint64_t>(part.height())));
        light.radiance.at(x, y, step % 3) = static_cast<float>(20.0 * rng.uniform());
      }
      ASSERT_LT(relative_rmse(moving.update(light, part), anew.relight(light)), 5e-6) << "step " << step;
    }
  }
}

TEST(PrecomputedFields, OfGreyTransferTakeAThirdOfTheBytes) {
  const PackedField grey = pack_rows(rows_of(random_mesh_field(true)), 8),
                    coloured = pack_rows(rows_of(random_mesh_field(false)), 8);
  const auto bytes = [](const PackedField& packed) {
    return static_cast<double>(std::get<0>(packed.tiles).bytes());
  };
  // Kernels and their numbers are in both; harmonics of either sign, in sparse form, too.
  EXPECT_LT(bytes(grey), 0.7 * bytes(coloured));
}

TEST_P(PrecomputedField, ComesBackFromItsFile) {
  const test::TemporaryFolder folder;
  const ReflectanceField field = random_mesh_field(GetParam());
  const auto path = folder.path() / "mesh.rfield", packed_path = folder.path() / "packed.rfield";
  write_reflectance_field(path, field);
  write_packed_field(packed_path, pack_rows(rows_of(field), 16));
  const LightMap light = random_light(1);
  const Image expected = field.relight(light);
  for (const auto& file : {path, packed_path}) {
    const ReflectanceField back = read_reflectance_field(file);
    EXPECT_LT(relative_rmse(back.relight(light), expected), fine_error);
    EXPECT_EQ(back.basis.measure, Measure::solid_angle);
    EXPECT_EQ(back.basis.harmonics, field.basis.harmonics);
    EXPECT_EQ(back.basis.vector_boxes, field.basis.vector_boxes);
    ASSERT_TRUE(back.mesh);
    ASSERT_EQ(back.mesh->positions.size(), vertices);
    EXPECT_EQ(back.mesh->positions[77], field.mesh->positions[77]);
    EXPECT_EQ(back.mesh->normals[77], field.mesh->normals[77]);
    EXPECT_TRUE((back.mesh->colours[77] == field.mesh->colours[77]).all());
    EXPECT_EQ(back.mesh->triangles, field.mesh->triangles);
    ASSERT_TRUE(back.mesh->camera);
    EXPECT_EQ(back.mesh->camera->width, field.mesh->camera->width);
  }
}

TEST(PrecomputedFields, HaveVectorBoxesOnOneFaceEach) {
  const test::TemporaryFolder folder;
  ReflectanceField field = random_mesh_field(true);
  field.basis.vector_boxes[3].box = {0, side - 1, 1, side + 1};
  const auto path = folder.path() / "mesh.rfield";
  write_reflectance_field(path, field);
  EXPECT_NE(test::message_of<FormatError>([&] { read_reflectance_field(path); }).find("basis/vector_boxes"),
            std::string::npos);
}

// As of an open plane: it sees all of the upper face, and no square needs a constant.
TEST(PrecomputedFields, MayHaveVectorBoxesAlone) {
  constexpr int resolution = 16;
  const Box up{0, 2 * resolution, resolution, 3 * resolution};
  ReflectanceField field;
  field.width = field.height = 1;
  field.basis = {cube_domain(resolution), {}, {}, Measure::solid_angle};
  field.basis.vector_boxes = {{up, {0.0f, 1.0f, 0.0f}}};
  field.transfer.append_row(std::vector<std::uint32_t>{0}, std::vector<float>(3, 0.5f));
  const LightMap white{Image(resolution, cube_faces * resolution, 3, 1.0f), Parameterisation::cube};
  const float expected = field.relight(white).values[0];
  EXPECT_GT(expected, 0.8f);
  const PreparedEnvironment environment({Image(64, 32, 3, 1.0f), Parameterisation::lat_long});
  for (const auto precision : {RelightPrecision::fast, RelightPrecision::fine}) {
    TileRelighter relighter(field, precision);
    EXPECT_NEAR(relighter.relight(white).values[0], expected, 1e-5);
    EXPECT_NEAR(relighter.relight(relighter.box_projector().value().project(environment, {})).values[0],
                expected, 1e-5);
  }
}

TEST(PrecomputedFields, SumLightBySolidAngle) {
  ReflectanceField field;
  field.width = field.height = 1;
  field.basis = {cube_domain(side), {}, {{0, 0, side, cube_faces * side}}, Measure::solid_angle};
  field.transfer.append_row(std::vector<std::uint32_t>{0}, std::vector<float>(3, 1.0f));
  LightMap light{Image(side, cube_faces * side, 3), Parameterisation::cube};
  std::ranges::fill(light.radiance.values, 1.0f);
  EXPECT_NEAR(field.relight(light).values[0], 4.0 * std::numbers::pi, 1e-5);
}

// Sums over boxes straight from the environment give the picture that the cube map of it gives: kernels that
// tiles share and their own, rows as they are, tiles and packed tiles. Under a light of one colour, since
// inside a texel the map has no directions, which vector boxes tell apart.
TEST(PrecomputedFields, EnvironmentsLightClustersWithoutALightMap) {
  ReflectanceField field = random_mesh_field(false, 0);
  ASSERT_TRUE(box_sums_suffice(field.basis));
  EXPECT_FALSE(box_sums_suffice(random_mesh_field(false).basis));
  LightMap of_one_colour{Image(64, 32, 3, 0.7f), Parameterisation::lat_long};
  for (std::size_t i = 0; i < of_one_colour.radiance.values.size(); i += 3)
    of_one_colour.radiance.values[i] = 2.0f;
  const auto environment = std::make_shared<const PreparedEnvironment>(std::move(of_one_colour));
  const EulerAngles turn{30, 40, 50};
  const LightMap map = EnvironmentProjector(field.basis.domain, {}).project_exactly(*environment, turn).light;
  const Image expected = field.relight(map);
  constexpr double float_error = 1e-5;

  TileRelighter relighter(field, RelightPrecision::fine);
  const std::vector<float> sums = relighter.box_projector().value().project(*environment, turn);
  EXPECT_LT(relative_rmse(relighter.relight(sums), expected), fine_error);
  EXPECT_LT(relative_rmse(relighter.update(map, {0, 0, side, cube_faces * side}), expected), fine_error);
  EXPECT_THROW(relighter.relight(std::span(sums).first(3)), InputError);
  TileRelighter copy = relighter;
  EXPECT_EQ(copy.relight(sums).values, relighter.relight(sums).values);

  // Without a mesh the outputs themselves.
  field.mesh.reset();
  FieldPictures pictures(field);
  EXPECT_LT(relative_rmse(pictures.picture(SceneEnvironment{environment, turn}, 0), expected), float_error);
  pictures.lay_out(RelightPrecision::fine);
  EXPECT_LT(relative_rmse(pictures.picture(SceneEnvironment{environment, turn}, 0), expected), fine_error);
  EXPECT_LT(relative_rmse(pictures.picture(map, 0), expected), fine_error);
}

}  // namespace
}  // namespace refield
