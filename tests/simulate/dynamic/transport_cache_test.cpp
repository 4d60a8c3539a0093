// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/transport_cache.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>

#include "core/base/files.h"
#include "simulate/geometry/mesh_shapes.h"
#include "tests/support/temporary_folder.h"

namespace refield::dynamic {
namespace {

namespace fs = std::filesystem;

MovingObject glossy_ball() {
  MovingObject ball{"ball", prt::sphere_mesh(3), {}, {}};
  ball.brdf.specular = {0.1f, 0.2f, 0.3f};
  ball.brdf.lobe = Lobe::phong;
  ball.brdf.exponent = 6.0f;
  ball.motion.path = {{0.0, {0.0f, 1.0f, 0.0f}}};
  return ball;
}

TransportOptions quick() {
  TransportOptions options;
  options.fields = true;
  options.rings = 2;
  options.shells = 3;
  options.directions = 64;
  options.functions = 8;
  return options;
}

void expect_same(const ObjectTransport& a, const ObjectTransport& b) {
  EXPECT_EQ(a.order, b.order);
  EXPECT_EQ(a.radius, b.radius);
  EXPECT_EQ(a.terms(), b.terms());
  EXPECT_EQ(a.factors.error(), b.factors.error());
  const Eigen::Vector3f from = Eigen::Vector3f(0.3f, -0.2f, 0.8f).normalized();
  EXPECT_TRUE((a.factors(from, from) == b.factors(from, from)).all());
  EXPECT_EQ(a.modes.count(), b.modes.count());
  EXPECT_EQ(a.modes.to_weights, b.modes.to_weights);
  ASSERT_EQ(a.grid.points(), b.grid.points());
  EXPECT_EQ(a.grid.position(a.grid.points() - 1), b.grid.position(b.grid.points() - 1));
  for (const auto part : {&ObjectTransport::leaving, &ObjectTransport::returning}) {
    EXPECT_EQ((a.*part).blocks, (b.*part).blocks);
    EXPECT_EQ((a.*part).width, (b.*part).width);
    EXPECT_EQ((a.*part).rank, (b.*part).rank);
    EXPECT_EQ((a.*part).values, (b.*part).values);
    EXPECT_EQ((a.*part).scale, (b.*part).scale);
    EXPECT_EQ((a.*part).mix, (b.*part).mix);
    EXPECT_EQ((a.*part).error, (b.*part).error);
  }
  EXPECT_EQ(a.coverage, b.coverage);
  EXPECT_EQ(a.outside, b.outside);
  EXPECT_EQ(a.receiving, b.receiving);
}

class TransportCacheTest : public testing::Test {
 protected:
  const test::TemporaryFolder folder_;
  const TransportCache cache_{folder_ / "cache"};
  const MovingObject ball_ = glossy_ball();
  const ObjectTransport transport_ = object_transport(ball_, prt::MeshRays(ball_.mesh), quick());
};

TEST_F(TransportCacheTest, FindsWhatItStored) {
  EXPECT_FALSE(cache_.load(ball_, quick()));
  cache_.store(ball_, quick(), transport_);
  MovingObject elsewhere = ball_;  // the transport is the object's own, wherever it goes
  elsewhere.name = "the same ball";
  elsewhere.motion.path = {{0.0, {1.0f, 2.0f, 3.0f}}};
  const auto found = cache_.load(elsewhere, quick());
  ASSERT_TRUE(found);
  expect_same(*found, transport_);
}

TEST_F(TransportCacheTest, DoesNotFindWhatIsOtherwise) {
  cache_.store(ball_, quick(), transport_);
  MovingObject other = ball_;
  other.mesh.positions[7].x() += 1e-6f;
  EXPECT_FALSE(cache_.load(other, quick()));
  other = ball_;
  other.mesh.colours[0][1] = 0.5f;
  EXPECT_FALSE(cache_.load(other, quick()));
  other = ball_;
  std::swap(other.mesh.triangles[0], other.mesh.triangles[1]);
  EXPECT_FALSE(cache_.load(other, quick()));
  other = ball_;
  other.brdf.exponent = 7.0f;
  EXPECT_FALSE(cache_.load(other, quick()));
  TransportOptions options = quick();
  options.directions = 65;
  EXPECT_FALSE(cache_.load(ball_, options));
  options = quick();
  options.factors.error = 0.1;
  EXPECT_FALSE(cache_.load(ball_, options));
}

TEST_F(TransportCacheTest, IgnoresDamagedAndForeignFiles) {
  cache_.store(ball_, quick(), transport_);
  const fs::path file = cache_.file_of(ball_, quick());
  const std::string good = read_text(file);
  for (const std::size_t place : {std::size_t{0}, std::size_t{30}, good.size() / 2, good.size() - 1}) {
    std::string bad = good;
    bad[place] = static_cast<char>(bad[place] ^ 4);
    write_text_atomically(file, bad);
    EXPECT_FALSE(cache_.load(ball_, quick())) << place;
  }
  for (const std::string& bad : {std::string(), good.substr(0, 25), good.substr(0, good.size() - 8),
                                 good + "x", std::string("something else")}) {
    write_text_atomically(file, bad);
    EXPECT_FALSE(cache_.load(ball_, quick())) << bad.size();
  }
  fs::remove(file);
  fs::create_directory(file);
  EXPECT_FALSE(cache_.load(ball_, quick()));
  cache_.store(ball_, quick(), transport_);  // cannot be written: no error
  fs::remove(file);
  cache_.store(ball_, quick(), transport_);
  EXPECT_TRUE(cache_.load(ball_, quick()));
}

TEST_F(TransportCacheTest, RemovesWhatWasUsedLeastRecently) {
  cache_.store(ball_, quick(), transport_);
  const auto bytes = fs::file_size(cache_.file_of(ball_, quick()));
  const TransportCache small(cache_.folder(), 2 * bytes + bytes / 2);
  const auto of_exponent = [&](float exponent) {
    MovingObject object = ball_;
    object.brdf.exponent = exponent;
    return object;
  };
  const auto used_before = [&](const MovingObject& object, std::chrono::seconds age) {
    fs::last_write_time(small.file_of(object, quick()), fs::file_time_type::clock::now() - age);
  };
  write_text_atomically(cache_.folder() / "notes.txt", std::string(3 * bytes, 'x'));  // not its own: stays
  small.store(of_exponent(8.0f), quick(), transport_);
  used_before(ball_, std::chrono::seconds(100));
  used_before(of_exponent(8.0f), std::chrono::seconds(50));
  EXPECT_TRUE(small.load(ball_, quick()));  // now the last one used
  small.store(of_exponent(9.0f), quick(), transport_);
  EXPECT_TRUE(small.load(ball_, quick()));
  EXPECT_FALSE(small.load(of_exponent(8.0f), quick()));
  EXPECT_TRUE(small.load(of_exponent(9.0f), quick()));
  EXPECT_TRUE(fs::exists(cache_.folder() / "notes.txt"));
  const TransportCache tiny(folder_ / "tiny", bytes / 2);
  tiny.store(ball_, quick(), transport_);  // larger than all that may be stored
  EXPECT_FALSE(fs::exists(tiny.file_of(ball_, quick())));
}

TEST_F(TransportCacheTest, StandsWhereTheEnvironmentSays) {
  const auto folder = [](const char* own, const char* xdg) {
    ::setenv("REFIELD_CACHE", own, 1);
    ::setenv("XDG_CACHE_HOME", xdg, 1);
    ::setenv("HOME", "/home/someone", 1);
    return TransportCache::from_environment().folder();
  };
  EXPECT_EQ(folder("", "/tmp/xdg"), "/tmp/xdg/refield");
  EXPECT_EQ(folder("/tmp/own", "/tmp/xdg"), "/tmp/own");
  EXPECT_EQ(folder("", ""), "/home/someone/.cache/refield");
  EXPECT_EQ(folder("", "relative"), "/home/someone/.cache/refield");
  EXPECT_EQ(folder("off", "/tmp/xdg"), "");
  const TransportCache none = TransportCache::from_environment();
  none.store(ball_, quick(), transport_);
  EXPECT_FALSE(none.load(ball_, quick()));
}

}  // namespace
}  // namespace refield::dynamic
