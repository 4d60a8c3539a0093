// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/field_io/reflectance_field_file.h"
#include "core/image/image_io.h"
#include "core/image/metrics.h"
#include "tests/cli/matchers.h"
#include "tests/support/random_data.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

using nlohmann::json;
using test::RefusedNaming;
using test::run_refield;
using test::Succeeded;

TEST(PackVerb, MakesASmallFieldThatGoesWhereverAFieldGoes) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  const ReflectanceField field = test::random_field(rng, 64, 48, {32, 24}, 300, 25);
  write_reflectance_field(folder / "f.rfield", field);
  write_exr(folder / "light.exr", test::random_image(rng, 32, 24, 3));
  const auto result =
      run_refield({"pack", folder / "f.rfield", "-o", folder / "p.rfield", "--max-error", "2e-3", "--json"});
  ASSERT_THAT(result, Succeeded());
  const json figures = json::parse(result.out);
  EXPECT_EQ(figures["bytes"], std::filesystem::file_size((folder / "p.rfield").string()));
  EXPECT_LT(2 * figures["bytes"].get<double>(), figures["bytes_before"].get<double>());
  EXPECT_LE(figures["error"].get<double>(), 2e-3);
  EXPECT_EQ(figures["error_by_kind_of_light"].size(), 5u);
  EXPECT_EQ(figures["weights"], field.transfer.entries());

  for (const char* name : {"f", "p"})
    ASSERT_THAT(run_refield({"relight", folder / (std::string(name) + ".rfield"), "--light",
                             folder / "light.exr", "-o", folder / (std::string(name) + ".exr")}),
                Succeeded());
  EXPECT_LT(relative_rmse(read_image(folder / "p.exr"), read_image(folder / "f.exr")), 2e-3);
  const json info = json::parse(run_refield({"info", folder / "p.rfield", "--json"}).out);
  EXPECT_EQ(info["kind"], "packed reflectance field");
  EXPECT_EQ(info["transfer"]["weight_bits"], figures["weight_bits"]);
  EXPECT_EQ(info["provenance"]["pack"]["pruned"], figures["pruned"]);
}

TEST(PackVerb, RefusesWhatItCannotDo) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  write_reflectance_field(folder / "f.rfield", test::random_field(rng, 20, 20, {16, 12}, 60, 9));
  const std::string field = folder / "f.rfield", packed = folder / "p.rfield";
  EXPECT_THAT(run_refield({"pack", field, "-o", field}), RefusedNaming("f.rfield", "another output"));
  EXPECT_THAT(run_refield({"pack", field, "-o", packed, "--max-error", "1e-9"}),
              RefusedNaming("16 bits", "allow a larger error"));
  EXPECT_FALSE(std::filesystem::exists(packed));
  ASSERT_THAT(run_refield({"pack", field, "-o", packed}), Succeeded());
  EXPECT_THAT(run_refield({"pack", packed, "-o", folder / "q.rfield"}),
              RefusedNaming("p.rfield", "give the full field"));
}

}  // namespace
}  // namespace refield
