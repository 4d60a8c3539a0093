// SPDX-License-Identifier: Apache-2.0
// A capture whose brightness drifts gives nearly the field of one that does not, where reference frames were
// taken.
#include <gtest/gtest.h>

#include <cmath>

#include "core/image/image_io.h"
#include "estimate/estimate.h"
#include "estimate/job/estimate_job.h"
#include "tests/support/stability.h"
#include "tests/support/synthetic_capture.h"
#include "tests/support/temporary_folder.h"

namespace refield {
namespace {

class DriftingCapture : public testing::Test {
 protected:
  DriftingCapture() {
    options_.kernels = 12;
    options_.spatial_passes = 0;
  }
  /// 80 lights, and every tenth time the first one again; the last photograph is `change` brighter than the
  /// first.
  CaptureSession capture(double change) {
    std::vector<LightMap> lights;
    std::vector<bool> is_reference;
    for (std::size_t j = 0; j <= scene_.lights.size(); ++j) {
      if (j % 10 == 0) {
        lights.push_back(scene_.lights[0]);
        is_reference.push_back(true);
      }
      if (j == scene_.lights.size()) break;
      lights.push_back(scene_.lights[j]);
      is_reference.push_back(false);
    }
    CaptureSession session = test::write_capture(folder_ / "session", scene_.truth, lights, 0.005);
    for (std::size_t j = 0; j < lights.size(); ++j) {
      session.frames[j].order = static_cast<double>(j);
      if (is_reference[j]) session.frames[j].role = FrameRole::reference;
      const double share = static_cast<double>(j) / static_cast<double>(lights.size() - 1);
      test::change_photograph(session.frames[j], [&](Image& image) {
        for (std::size_t i = 0; i < image.values.size(); ++i)
          image.values[i] *= static_cast<float>(1.0 + change * (1.0 - 0.2 * (i % 3)) * std::sqrt(share));
      });
    }
    return session;
  }

  test::StabilityScene scene_;
  test::TemporaryFolder folder_;
  EstimateOptions options_;
};

TEST_F(DriftingCapture, IsEstimatedAsIfItDidNotDrift) {
  const CaptureSession steady = capture(0.0);
  const double undisturbed = scene_.error(estimate_field(steady, options_));
  for (const double change : {-0.05, 0.2}) {
    const CaptureSession session = capture(change);
    EstimateJob job = open_job(session, options_);
    EXPECT_TRUE(job.drift.significant);
    for (const CaptureFrame& frame : job.frames) {
      const double share = frame.order / (session.frames.size() - 1.0);
      for (int c = 0; c < 3; ++c)  // what is left of the drift in each photograph
        EXPECT_NEAR(frame.gain[c] / (1.0 + change * (1.0 - 0.2 * c) * std::sqrt(share)), 1.0,
                    0.1 * std::abs(change));
    }
    const double removed = scene_.error(estimate_field(session, options_));
    EstimateOptions keep = options_;
    keep.keep_drift = true;
    const double kept = scene_.error(estimate_field(session, keep));
    const double constant = scene_.error_of_constant(session);
    const double ridge = scene_.error_of_ridge(session);
    const std::string setting =
        std::to_string(static_cast<int>(std::lround(100.0 * change))) + " % over the capture";
    test::record_figure({"drift", setting + ", removed", removed, undisturbed, constant, ridge});
    test::record_figure({"drift", setting + ", kept", kept, undisturbed, constant, ridge});
    EXPECT_LT(removed, undisturbed + 0.1 * std::abs(change));
    EXPECT_GT(kept, 3.0 * removed) << "the drift did no harm: the test shows nothing";
  }
}

TEST_F(DriftingCapture, ThatDoesNotDriftIsLeftAlone) {
  const CaptureSession session = capture(0.0);
  CaptureSession without = session;
  std::erase_if(without.frames, [](const CaptureFrame& frame) { return frame.role == FrameRole::reference; });
  const auto with_references = estimate_field(session, options_);
  const auto without_references = estimate_field(without, options_);
  EXPECT_EQ(with_references.transfer.weight, without_references.transfer.weight);
  EXPECT_EQ(with_references.basis.boxes, without_references.basis.boxes);
}

TEST_F(DriftingCapture, TellsWhatItRemoved) {
  const CaptureSession session = capture(-0.05);
  const auto summary = estimate_to_file(session, options_, folder_ / "f.rfield", false);
  ASSERT_EQ(summary.frames.drift.points.size(), 9u);
  EXPECT_NEAR(summary.frames.drift.largest, 0.05, 0.002);
  EXPECT_NE(estimate_field(session, options_).provenance.find("drift_removed"), std::string::npos);
}

}  // namespace
}  // namespace refield
