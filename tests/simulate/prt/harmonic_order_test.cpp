// SPDX-License-Identifier: Apache-2.0
// How many harmonics light needs, and what windows do to those it does not have. With REFIELD_FIGURES=folder
// in the environment the figures go to folder/harmonics.csv, which bench/studies/draw.py draws for
// docs/method/harmonics.md.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <numbers>

#include "bench/studies/prt/harmonic_window.h"
#include "simulate/geometry/mesh_rays.h"
#include "simulate/prt/transfer_samples.h"
#include "tests/simulate/prt/harmonic_light.h"
#include "tests/simulate/prt/small_scenes.h"

namespace refield::prt {
namespace {

constexpr int highest_order = 8;

/// White light of a total of π that falls off as exp(s cos θ) about an axis.
struct Lobe {
  double sharpness;
  Eigen::Vector3f axis = Eigen::Vector3f(0.5f, 1.0f, -0.3f).normalized();

  /// Full width at half of its brightness.
  double degrees() const {
    return 2.0 * std::acos(1.0 - std::numbers::ln2 / sharpness) * 180.0 / std::numbers::pi;
  }
  /// Directions that all bring the same.
  std::vector<Eigen::Vector3f> directions() const {
    // Turns Z to the axis. (Eigen's FromTwoVectors takes fifteen seconds to compile.)
    const auto turn = Eigen::Quaternionf(1.0f + axis.z(), -axis.y(), axis.x(), 0.0f).normalized();
    std::vector<Eigen::Vector3f> directions;
    for (const Eigen::Vector3d& even : hammersley_sphere(2048)) {
      const double share = 0.5 * (1.0 - even.z());
      const double z = 1.0 + std::log(1.0 - share * (1.0 - std::exp(-2.0 * sharpness))) / sharpness;
      const Eigen::Vector2d around = even.head<2>().normalized() * std::sqrt(std::max(0.0, 1.0 - z * z));
      directions.push_back(turn * Eigen::Vector3d(around.x(), around.y(), z).cast<float>());
    }
    return directions;
  }
};

/// What one transfer makes of lobes of light, direct light alone, and what rays say.
class Shading {
 public:
  explicit Shading(const Lobe& lobe)
      : directions_(lobe.directions()), light_(Eigen::VectorXd::Zero(harmonics_of(highest_order))) {
    static const HarmonicTransfer transfer = [] {
      HarmonicStatistics statistics;
      return harmonic_transfer(scene(), {.order = highest_order, .until = 1.0}, statistics);
    }();
    transfer_ = &transfer;
    Eigen::VectorXd y(light_.size());
    const double of_direction = std::numbers::pi / static_cast<double>(directions_.size());
    for (const Eigen::Vector3f& direction : directions_) {
      evaluate_harmonics(highest_order, direction.cast<double>(),
                         {y.data(), static_cast<std::size_t>(y.size())});
      light_ += of_direction * y;
    }
    trace();
  }

  struct Figures {
    double error;    // relative RMSE over vertices
    double darkest;  // over the brightest
    double shadows;  // light where all is hidden, over what there would be
  };
  Figures of(int order, HarmonicWindow window) const {
    const std::vector<double> factors = window_factors(window, order);
    double wrong = 0.0, all = 0.0, low = 0.0, high = 0.0, in_shadow = 0.0, without = 0.0;
    for (std::size_t v = 0; v < expected_.size(); ++v) {
      double seen = 0.0;
      for (std::size_t j = 0; j < factors.size(); ++j)
        seen += factors[j] * transfer_->row(v, 0, 0)[j] * light_[static_cast<Eigen::Index>(j)];
      wrong += std::pow(seen - expected_[v], 2);
      all += std::pow(expected_[v], 2);
      low = std::min(low, seen);
      high = std::max(high, seen);
      if (expected_[v] > 0.0) continue;
      in_shadow += std::abs(seen);
      without += unshadowed_[v];
    }
    return {std::sqrt(wrong / all), low / high, without > 0.0 ? in_shadow / without : 0.0};
  }

 private:
  static const Scene& scene() {
    static const Scene scene = test::ball_scene({});
    return scene;
  }
  void trace() {
    const Mesh& mesh = scene().mesh;
    const MeshRays rays(mesh);
    expected_.assign(mesh.positions.size(), 0.0);
    unshadowed_ = expected_;
    for (std::size_t v = 0; v < expected_.size(); ++v) {
      const Eigen::Vector3f from = rays.off_surface(mesh.positions[v], mesh.normals[v]);
      for (const Eigen::Vector3f& direction : directions_) {
        const double share =
            std::max(0.0f, direction.dot(mesh.normals[v])) / static_cast<double>(directions_.size());
        unshadowed_[v] += share;
        if (share > 0.0 && (rays.unoccluded(std::span(&from, 1), direction) & 1)) expected_[v] += share;
      }
    }
  }

  std::vector<Eigen::Vector3f> directions_;
  Eigen::VectorXd light_;
  const HarmonicTransfer* transfer_;
  std::vector<double> expected_, unshadowed_;
};

void record(const Lobe& lobe, const Shading& shading) {
  const char* folder = std::getenv("REFIELD_FIGURES");
  if (!folder) return;
  const auto path = std::filesystem::path(folder) / "harmonics.csv";
  const bool fresh = !std::filesystem::exists(path);
  std::ofstream file(path, std::ios::app);
  if (fresh) file << "degrees,window,order,error,darkest\n";
  const std::pair<const char*, HarmonicWindow> windows[] = {
      {"none", HarmonicWindow::none}, {"lanczos", HarmonicWindow::lanczos}, {"hann", HarmonicWindow::hann}};
  for (const auto& [name, window] : windows)
    for (int order = 2; order <= highest_order; ++order) {
      const Shading::Figures figures = shading.of(order, window);
      file << lobe.degrees() << ',' << name << ',' << order << ',' << figures.error << ',' << figures.darkest
           << '\n';
    }
}

class SmoothLobe : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(HarmonicOrder, SmoothLobe, testing::Values(1.0, 4.0, 16.0));

TEST_P(SmoothLobe, IsNearerTheTruthWithEveryBandOrTwo) {
  const Lobe lobe{GetParam()};
  const Shading shading(lobe);
  record(lobe, shading);
  const auto error = [&](int order) { return shading.of(order, HarmonicWindow::none).error; };
  constexpr double samples = 0.004;  // what is left of rays that pass an edge closely
  for (int order = 3; order <= highest_order; ++order)
    EXPECT_LT(error(order), std::max(0.95 * error(order - 1), samples)) << order;
  EXPECT_LT(error(highest_order), 0.02);
}

/// What harmonics cannot do: at order 8 the hard shadows of a small light are lit in part, and the error is
/// many times that of smooth light.
TEST(HarmonicOrder, HardShadowsAreBeyondAll) {
  const Lobe lobe{2000.0};
  const Shading shading(lobe);
  record(lobe, shading);
  const Shading::Figures figures = shading.of(highest_order, HarmonicWindow::none);
  EXPECT_GT(figures.error, 0.08);
  EXPECT_GT(figures.shadows, 0.08);
}

TEST(HarmonicOrder, RingingIsDampedByWindows) {
  const Lobe lobe{100.0};
  const Shading shading(lobe);
  record(lobe, shading);
  for (const int order : {5, 8}) {
    const Shading::Figures plain = shading.of(order, HarmonicWindow::none),
                           lanczos = shading.of(order, HarmonicWindow::lanczos),
                           hann = shading.of(order, HarmonicWindow::hann);
    EXPECT_LT(plain.darkest, -0.04) << order;
    EXPECT_GT(lanczos.darkest, 0.4 * plain.darkest) << order;
    EXPECT_GT(hann.darkest, 0.4 * plain.darkest) << order;
    // It is paid for by shadows and highlights that are softer still.
    EXPECT_GT(hann.error, lanczos.error) << order;
    EXPECT_GT(lanczos.error, plain.error) << order;
  }
}

}  // namespace
}  // namespace refield::prt
