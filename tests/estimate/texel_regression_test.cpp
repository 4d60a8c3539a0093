// SPDX-License-Identifier: Apache-2.0
#include "estimate/fit/texel_regression.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "core/field/light_error.h"
#include "core/image/metrics.h"
#include "estimate/estimate.h"
#include "estimate/quality/error_evidence.h"

namespace refield {
namespace {

/// A light stage: light sources on a hemisphere, each a lit texel of a light map, around a glossy sphere,
/// part of which is in the hard shadow of a board.
struct LightStage {
  static constexpr int width = 10, height = 8, map_width = 48, map_height = 24;
  std::vector<Eigen::Vector3d> directions;
  std::vector<Box> texels;
  Eigen::MatrixXd transport;  // [pixels × sources]

  explicit LightStage(int sources) {
    constexpr double golden_angle = 2.399963;
    for (int k = 0; k < sources; ++k) {
      const double z = 0.15 + 0.85 * (k + 0.5) / sources;
      const double r = std::sqrt(1.0 - z * z);
      directions.emplace_back(r * std::cos(golden_angle * k), r * std::sin(golden_angle * k), z);
      const int x = static_cast<int>((directions[k].x() + 1.0) / 2.0 * (map_width - 1));
      int y = static_cast<int>((1.0 - directions[k].y()) / 2.0 * (map_height - 1));
      const auto taken = [&] { return std::ranges::find(texels, Box{x, y, x + 1, y + 1}) != texels.end(); };
      while (taken()) y = (y + 1) % map_height;
      texels.push_back({x, y, x + 1, y + 1});
    }
    transport.resize(width * height, sources);
    for (int p = 0; p < width * height; ++p) {
      const double nx = 1.4 * ((p % width + 0.5) / width - 0.5),
                   ny = 1.4 * (0.5 - (p / width + 0.5) / height);
      const Eigen::Vector3d normal(nx, ny, std::sqrt(std::max(0.0, 1.0 - nx * nx - ny * ny)));
      for (int k = 0; k < sources; ++k) {
        const double cosine = std::max(0.0, normal.dot(directions[k]));
        const Eigen::Vector3d half = (directions[k] + Eigen::Vector3d::UnitZ()).normalized();
        const bool in_shadow = p % width < 2 && directions[k].x() > 0.3;
        transport(p, k) =
            in_shadow ? 0.0 : 0.6 * cosine + 0.4 * std::pow(std::max(0.0, normal.dot(half)), 20.0);
      }
    }
  }
  int sources() const { return static_cast<int>(directions.size()); }

  LightMap light_map(const Eigen::VectorXd& radiance) const {
    LightMap light{Image(map_width, map_height, 3), Parameterisation::monitor};
    for (int k = 0; k < sources(); ++k)
      for (int c = 0; c < 3; ++c)
        light.radiance.at(texels[k].x0, texels[k].y0, c) = static_cast<float>(radiance(k));
    return light;
  }
  Image photograph(const Eigen::VectorXd& samples) const {
    Image image(width, height, 3);
    for (int p = 0; p < width * height; ++p)
      for (int c = 0; c < 3; ++c) image.values[3 * p + c] = static_cast<float>(samples(p) * (1.0 - 0.2 * c));
    return image;
  }
  /// Bright areas of random place and size over a dim environment.
  Eigen::MatrixXd natural_light(int count, std::uint64_t seed) const {
    Rng rng(seed);
    Eigen::MatrixXd lights(count, sources());
    for (int j = 0; j < count; ++j) {
      lights.row(j).setConstant(0.2);
      for (int area = 0; area < 12; ++area) {
        const Eigen::Vector3d centre = directions[static_cast<std::size_t>(rng.uniform() * sources())];
        const double size = 0.15 + 0.6 * rng.uniform(), radiance = std::exp(2.0 * rng.normal());
        for (int k = 0; k < sources(); ++k)
          if ((directions[k] - centre).norm() < size) lights(j, k) += radiance;
      }
    }
    return lights;
  }
  /// Light sources whose x lies in a strip.
  Eigen::MatrixXd bars(int count) const {
    Eigen::MatrixXd lights = Eigen::MatrixXd::Zero(count, sources());
    for (int j = 0; j < count; ++j)
      for (int k = 0; k < sources(); ++k)
        if (std::abs(directions[k].x() - (-0.8 + 1.6 * j / (count - 1))) < 0.2) lights(j, k) = 1.0;
    return lights;
  }
};

/// Photographs [images × pixels] with noise of a part of each pixel's mean.
Eigen::MatrixXd photographs_of(const LightStage& stage, const Eigen::MatrixXd& lights, double noise,
                               std::uint64_t seed = 3) {
  Eigen::MatrixXd samples = lights * stage.transport.transpose();
  const Eigen::VectorXd mean = samples.colwise().mean();
  Rng rng(seed);
  for (Eigen::Index p = 0; p < samples.cols(); ++p)
    for (Eigen::Index j = 0; j < samples.rows(); ++j) samples(j, p) += noise * mean(p) * rng.normal();
  return samples;
}

ReflectanceField estimate_stage(const LightStage& stage, const Eigen::MatrixXd& lights,
                                const Eigen::MatrixXd& samples, bool predict_errors = false) {
  std::vector<LightMap> maps;
  std::vector<Image> images;
  for (Eigen::Index j = 0; j < lights.rows(); ++j) {
    maps.push_back(stage.light_map(lights.row(j)));
    images.push_back(stage.photograph(samples.row(j)));
  }
  EstimateOptions options;
  options.predict_errors = predict_errors;
  return estimate(std::vector<LightMapView>(maps.begin(), maps.end()),
                  std::vector<ImageView>(images.begin(), images.end()), {}, {}, options);
}

double median(std::vector<double> values) {
  std::ranges::nth_element(values, values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2));
  return values[values.size() / 2];
}

/// Median over pixels of the relative RMSE in the red channel.
double error_of(const Eigen::MatrixXd& predicted, const Eigen::MatrixXd& truth) {
  std::vector<double> errors;
  for (Eigen::Index p = 0; p < truth.cols(); ++p)
    if (truth.col(p).norm() > 0.0)
      errors.push_back((predicted.col(p) - truth.col(p)).norm() / truth.col(p).norm());
  return median(errors);
}

double error_of(const ReflectanceField& field, const LightStage& stage, const Eigen::MatrixXd& lights) {
  const Eigen::MatrixXd truth = lights * stage.transport.transpose();
  Eigen::MatrixXd predicted(truth.rows(), truth.cols());
  for (Eigen::Index j = 0; j < lights.rows(); ++j) {
    const Image image = field.relight(stage.light_map(lights.row(j)));
    for (Eigen::Index p = 0; p < truth.cols(); ++p) predicted(j, p) = image.values[3 * p];
  }
  return error_of(predicted, truth);
}

/// Weights [sources × pixels] by ridge regression, the parameter of each pixel by leave-one-out.
Eigen::MatrixXd ridge(const Eigen::MatrixXd& lights, const Eigen::MatrixXd& samples) {
  const SymmetricEigen solver = symmetric_eigen(lights * lights.transpose());
  const Eigen::MatrixXd& V = solver.vectors;
  const Eigen::MatrixXd coordinates = V.transpose() * samples;
  Eigen::MatrixXd dual = Eigen::MatrixXd::Zero(samples.rows(), samples.cols());
  Eigen::VectorXd best = Eigen::VectorXd::Constant(samples.cols(), std::numeric_limits<double>::infinity());
  for (double parameter = 1e-10; parameter < 10.0; parameter *= 2.0) {
    const Eigen::VectorXd inverse =
        (solver.values.array().max(0.0) + parameter * solver.values.maxCoeff()).inverse();
    const Eigen::MatrixXd candidate = V * inverse.asDiagonal() * coordinates;
    const Eigen::VectorXd diagonal = V.cwiseAbs2() * inverse;
    for (Eigen::Index p = 0; p < samples.cols(); ++p) {
      const double squared = (candidate.col(p).array() / diagonal.array()).square().sum();
      if (squared >= best(p)) continue;
      best(p) = squared;
      dual.col(p) = candidate.col(p);
    }
  }
  return lights.transpose() * dual;
}

TEST(TexelRegression, CellsAreLitTexelsAndBlocksOfEqualTexels) {
  std::vector<LightMap> lights;
  for (int j = 0; j < 6; ++j) {
    LightMap light{Image(20, 10, 3), Parameterisation::monitor};
    for (int c = 0; c < 3; ++c) {
      light.radiance.at(3, 2, c) = 1.0f + j;
      light.radiance.at(4, 2, c) = 5.0f - 0.5f * j;  // beside it, but a cell of its own
      for (int y = 5; y < 8; ++y)
        for (int x = 10; x < 14; ++x) light.radiance.at(x, y, c) = 0.5f * j * j;
    }
    lights.push_back(light);
  }
  const std::vector<Box> expected = {{3, 2, 4, 3}, {4, 2, 5, 3}, {10, 5, 14, 8}};
  EXPECT_EQ(light_cells(BoxTable(lights)), expected);
}

TEST(TexelRegression, LightWithManyDegreesOfFreedomHasNoCells) {
  Rng rng(1);
  std::vector<LightMap> lights(3, LightMap{Image(32, 24, 3), Parameterisation::monitor});
  for (LightMap& light : lights)
    for (float& value : light.radiance.values) value = static_cast<float>(rng.uniform());
  EXPECT_TRUE(light_cells(BoxTable(lights)).empty());
}

TEST(TexelRegression, SumsOfSingleLightsAreExact) {
  const LightStage stage(60);
  const Eigen::MatrixXd singles = Eigen::MatrixXd::Identity(60, 60);
  const auto field = estimate_stage(stage, singles, photographs_of(stage, singles, 0.0));
  constexpr double float32_weights = 1e-5;
  EXPECT_LT(error_of(field, stage, stage.natural_light(10, 99)), float32_weights);
  EXPECT_LT(error_of(field, stage, stage.bars(8)), float32_weights);
  EXPECT_LT(error_of(field, stage, singles), float32_weights);
}

TEST(TexelRegression, SingleLightsMayBeMoreThanLightsAtOnce) {
  constexpr int sources = max_light_cells + 44;
  const LightStage stage(sources);
  const Eigen::MatrixXd singles = Eigen::MatrixXd::Identity(sources, sources);
  const auto field = estimate_stage(stage, singles, photographs_of(stage, singles, 0.0));
  EXPECT_LT(error_of(field, stage, stage.natural_light(5, 99)), 1e-5);
  // Of light under several sources at once, as many degrees of freedom are left to rectangles.
  std::vector<LightMap> maps;
  const Eigen::MatrixXd lights = stage.natural_light(40, 1);
  for (Eigen::Index j = 0; j < lights.rows(); ++j) maps.push_back(stage.light_map(lights.row(j)));
  const BoxTable table(maps);
  EXPECT_GT(light_cells(table).size(), static_cast<std::size_t>(max_light_cells));
  EXPECT_TRUE(TexelRegressions(table).cells().empty());
}

TEST(TexelRegression, IsAtLeastAsGoodAsLeastSquaresAndRidge) {
  const LightStage stage(60);
  for (const int images : {30, 100}) {
    const Eigen::MatrixXd lights = stage.natural_light(images, 1);
    const Eigen::MatrixXd samples = photographs_of(stage, lights, 0.01);
    const auto field = estimate_stage(stage, lights, samples);
    const Eigen::MatrixXd by_ridge = ridge(lights, samples);
    const Eigen::MatrixXd by_least_squares =  // the solution of least norm
        lights.transpose() * solve_least_squares(lights * lights.transpose(), samples);
    const std::array<Eigen::MatrixXd, 3> tests = {stage.natural_light(12, 99), stage.bars(8),
                                                  Eigen::MatrixXd::Identity(60, 60)};
    for (const Eigen::MatrixXd& test : tests) {
      const Eigen::MatrixXd truth = test * stage.transport.transpose();
      const double best =
          std::min(error_of(test * by_ridge, truth), error_of(test * by_least_squares, truth));
      const double ours = error_of(field, stage, test);
      EXPECT_LT(ours, best) << images << " images";
    }
  }
}

TEST(TexelRegression, UnmeasuredSamplesAreLeftOut) {
  const LightStage stage(60);
  const Eigen::MatrixXd lights = stage.natural_light(80, 1);
  Eigen::MatrixXd samples = photographs_of(stage, lights, 0.002);
  const double complete =
      error_of(estimate_stage(stage, lights, samples), stage, stage.natural_light(12, 99));
  Rng rng(5);
  for (Eigen::Index p = 0; p < samples.cols(); ++p)
    for (Eigen::Index j = 0; j < samples.rows(); ++j)
      if (rng.uniform() < 0.05) samples(j, p) = 1e4;
  EstimateOptions options;
  options.predict_errors = false;
  options.keep_outliers = true;
  options.clip_level = 1e3f;
  std::vector<LightMap> maps;
  std::vector<Image> images;
  for (Eigen::Index j = 0; j < lights.rows(); ++j) {
    maps.push_back(stage.light_map(lights.row(j)));
    images.push_back(stage.photograph(samples.row(j)));
  }
  const auto field = estimate(std::vector<LightMapView>(maps.begin(), maps.end()),
                              std::vector<ImageView>(images.begin(), images.end()), {}, {}, options);
  constexpr double cost_of_a_twentieth = 1.3;
  EXPECT_LT(error_of(field, stage, stage.natural_light(12, 99)), cost_of_a_twentieth * complete);
}

TEST(TexelRegression, ErrorIsPredictedForLightOfTheSameKind) {
  const LightStage stage(60);
  const Eigen::MatrixXd lights = stage.natural_light(90, 1);
  const Eigen::MatrixXd samples = photographs_of(stage, lights, 0.01);
  const auto field = estimate_stage(stage, lights, samples, true);
  const auto& predicted_error = field.quality.predicted_error;
  ASSERT_EQ(predicted_error.size(), static_cast<std::size_t>(LightStage::width * LightStage::height));
  // New photographs as noisy as the training images. Their lights are seldom as bright as the brightest of
  // these, so errors are compared in units of the training samples.
  const Eigen::MatrixXd tests = stage.natural_light(40, 77);
  const Eigen::MatrixXd truth = tests * stage.transport.transpose();
  Eigen::MatrixXd squared = Eigen::MatrixXd::Zero(1, truth.cols());
  Rng rng(11);
  for (Eigen::Index j = 0; j < tests.rows(); ++j) {
    const Image image = field.relight(stage.light_map(tests.row(j)));
    for (Eigen::Index p = 0; p < truth.cols(); ++p) {
      const double noisy = truth(j, p) + 0.01 * samples.col(p).mean() * rng.normal();
      squared(0, p) += std::pow(image.values[3 * p] - noisy, 2.0) / static_cast<double>(tests.rows());
    }
  }
  std::vector<double> ratios;
  for (Eigen::Index p = 0; p < truth.cols(); ++p)
    ratios.push_back(predicted_error[p] *
                     std::sqrt(samples.col(p).squaredNorm() / samples.rows() / squared(0, p)));
  EXPECT_GT(median(ratios), 0.8);
  EXPECT_LT(median(ratios), 1.25);
}

/// Of the predicted and the true error of each pixel, noise-free.
struct Prediction {
  double rank, ratio;             ///< rank correlation, median of the ratio
  std::vector<float> true_error;  ///< [pixels], squared
};
Prediction prediction_of(const ReflectanceField& field, const LightStage& stage,
                         const Eigen::MatrixXd& lights) {
  const auto pixels = static_cast<std::size_t>(stage.transport.rows());
  const Eigen::MatrixXd truth = lights * stage.transport.transpose();
  std::vector<double> own(pixels, 0.0), squared(pixels, 0.0), ratios;
  for (Eigen::Index j = 0; j < lights.rows(); ++j) {
    const LightMap light = stage.light_map(lights.row(j));
    const Image image = field.relight(light), exact = stage.photograph(truth.row(j));
    const std::vector<double> predicted = own_squared_error_under(field, light.radiance);
    for (std::size_t p = 0; p < pixels; ++p) own[p] += predicted[p];
    for (std::size_t i = 0; i < 3 * pixels; ++i)
      squared[i / 3] += std::pow(image.values[i] - exact.values[i], 2.0);
  }
  std::vector<float> relative_predicted, relative_true;
  for (std::size_t p = 0; p < pixels; ++p) {
    const double signal = truth.col(static_cast<Eigen::Index>(p)).squaredNorm();
    relative_predicted.push_back(static_cast<float>(own[p] / signal));
    relative_true.push_back(static_cast<float>(squared[p] / signal));
    ratios.push_back(std::sqrt(own[p] / squared[p]));
  }
  return {rank_correlation(relative_predicted, relative_true), median(ratios), relative_true};
}

TEST(TexelRegression, ErrorIsPredictedForLightOfOtherKinds) {
  const LightStage stage(60);
  const Eigen::MatrixXd lights = stage.natural_light(40, 1);
  const struct {
    const char* kind;
    Eigen::MatrixXd lights;
  } tests[] = {{"natural", stage.natural_light(40, 77)},
               {"bars", stage.bars(12)},
               {"single sources", Eigen::MatrixXd::Identity(60, 60)}};
  // The error under light of few degrees of freedom is itself random. What a field's prediction has to do
  // with its error is compared with what another field's error has, which was made from other noise under the
  // same lights.
  constexpr std::size_t draws = 4;
  std::array<std::vector<Prediction>, std::size(tests)> of_light;
  for (std::size_t draw = 0; draw < draws; ++draw) {
    const auto field = estimate_stage(stage, lights, photographs_of(stage, lights, 0.01, 3 + draw), true);
    ASSERT_GT(field.quality.light_error.classes(), 1u);
    for (std::size_t i = 0; i < of_light.size(); ++i)
      of_light[i].push_back(prediction_of(field, stage, tests[i].lights));
  }
  for (std::size_t i = 0; i < of_light.size(); ++i) {
    double rank = 0.0, ratio = 0.0, others = 0.0;
    for (std::size_t draw = 0; draw < draws; ++draw) {
      const Prediction& own = of_light[i][draw];
      rank += own.rank / draws;
      ratio += own.ratio / draws;
      others += rank_correlation(own.true_error, of_light[i][(draw + 1) % draws].true_error) / draws;
    }
    EXPECT_GT(rank, 0.65 * others) << tests[i].kind;
    EXPECT_GT(rank, 0.4) << tests[i].kind;
    EXPECT_GT(ratio, 0.7) << tests[i].kind;
    EXPECT_LT(ratio, 1.4) << tests[i].kind;
  }
}

// The variance of a class is that of the Gaussian process given the training lights.
TEST(TexelRegression, ClassesOfTheErrorAreThoseOfTheRegression) {
  const LightStage stage(24);
  const Eigen::MatrixXd lights = stage.natural_light(30, 1);
  std::vector<LightMap> maps;
  for (Eigen::Index j = 0; j < lights.rows(); ++j) maps.push_back(stage.light_map(lights.row(j)));
  const BoxTable table(maps);
  const std::vector<Box> cells = light_cells(table);
  const LightErrorModel model = light_error_model(table, cells);
  const auto levels = static_cast<std::size_t>(cell_noise_levels);
  ASSERT_EQ(model.classes(), cell_priors().size() * levels);
  const LightMap bar = stage.light_map(stage.bars(5).row(2));
  const std::vector<double> variances = model.variances_under(bar.radiance);
  Eigen::RowVectorXd effect(24);
  for (Eigen::Index k = 0; k < 24; ++k) effect(k) = bar.radiance.at(cells[k].x0, cells[k].y0, 0);
  const Eigen::MatrixXd of_table = lights_of(table, cells)[0] / table.unit();
  for (const std::size_t prior : {0, 3, 6})
    for (const std::size_t level : {8, 14}) {
      const double noise = cell_noise_ratio(static_cast<int>(level));
      Eigen::MatrixXd covariance = weight_covariance(cell_priors()[prior].length,
                                                     cell_priors()[prior].independent, cells, table.domain());
      Eigen::MatrixXd samples = of_table * covariance * of_table.transpose();
      covariance *= 30.0 / samples.trace();
      samples *= 30.0 / samples.trace();
      const Eigen::MatrixXd precision = inverse(samples + noise * Eigen::MatrixXd::Identity(30, 30));
      covariance -= covariance * of_table.transpose() * precision * of_table * covariance;
      const double left_out = (precision.diagonal().cwiseInverse().array() - noise).mean();
      const double expected = (effect * covariance * effect.transpose())(0, 0) / left_out;
      // Directions are kept in single precision.
      EXPECT_NEAR(variances[prior * levels + level] / expected, 1.0, 1e-4) << prior << ' ' << level;
    }
}

TEST(TexelRegression, FieldStatesWhereLightWasObserved) {
  const LightStage stage(30);
  const Eigen::MatrixXd lights = stage.natural_light(20, 1);
  const auto field = estimate_stage(stage, lights, photographs_of(stage, lights, 0.0));
  std::vector<Box> expected = stage.texels;
  std::ranges::sort(expected, {}, [](const Box& box) { return std::pair(box.y0, box.x0); });
  EXPECT_EQ(field.observed_light, expected);
  LightMap light = stage.light_map(lights.row(0));
  EXPECT_NEAR(field.light_shares(light.radiance).unobserved, 0.0, 1e-6);
}

TEST(TexelRegression, WeightsAreNotNegative) {
  const LightStage stage(60);
  const Eigen::MatrixXd lights = stage.natural_light(30, 1);
  const auto field = estimate_stage(stage, lights, photographs_of(stage, lights, 0.05));
  EXPECT_TRUE(std::ranges::all_of(field.transfer.weight, [](float weight) { return weight >= 0.0f; }));
}

/// 30 lights on 192 texels, and pixels of two texels: all weights but a few are zero, so that those that are
/// held at zero are not found at once.
TEST(TexelRegression, FewLightsFindTheFewTexelsOfAPixel) {
  constexpr int width = 16, height = 12, pixels = 36;
  constexpr double noise = 0.01;
  Rng rng(4);
  std::vector<std::array<int, 2>> seen(pixels);
  for (auto& texels : seen) {
    texels[0] = static_cast<int>(rng.below(width * height));
    texels[1] = (texels[0] + 1 + static_cast<int>(rng.below(width * height - 1))) % (width * height);
  }
  const auto light = [&] {
    LightMap map{Image(width, height, 3), Parameterisation::monitor};
    for (float& value : map.radiance.values) value = static_cast<float>(rng.uniform());
    return map;
  };
  const auto photograph = [&](const LightMap& map, double relative_noise) {
    Image image(6, 6, 3);
    for (int p = 0; p < pixels; ++p)
      for (int c = 0; c < 3; ++c) {
        const auto at = [&](int texel) { return map.radiance.values[3 * texel + c]; };
        image.values[3 * p + c] =
            at(seen[p][0]) + 0.6f * at(seen[p][1]) + static_cast<float>(relative_noise * rng.normal());
      }
    return image;
  };
  std::vector<LightMap> lights;
  std::vector<Image> photographs;
  for (int j = 0; j < 30; ++j) {
    lights.push_back(light());
    photographs.push_back(photograph(lights.back(), noise));
  }
  const auto field = estimate(std::vector<LightMapView>(lights.begin(), lights.end()),
                              std::vector<ImageView>(photographs.begin(), photographs.end()), {}, {}, {});
  std::vector<double> squared(pixels, 0.0), errors;
  for (int j = 0; j < 10; ++j) {
    const LightMap map = light();
    const Image estimated = field.relight(map), exact = photograph(map, 0.0);
    for (int p = 0; p < pixels; ++p)
      for (int c = 0; c < 3; ++c)
        squared[p] += std::pow(estimated.values[3 * p + c] - exact.values[3 * p + c], 2.0) / 30.0;
  }
  for (const double each : squared) errors.push_back(std::sqrt(each));
  EXPECT_LT(median(errors), 2.0 * noise);
  const std::vector<double> predicted(field.quality.predicted_error.begin(),
                                      field.quality.predicted_error.end());
  EXPECT_LT(median(predicted), 3.0 * noise);
}

TEST(TexelRegression, LeaveOneOutEqualsLeavingOneOut) {
  const LightStage stage(24);
  const Eigen::MatrixXd lights = stage.natural_light(40, 1);
  const Eigen::MatrixXd samples = photographs_of(stage, lights, 0.03);
  std::vector<LightMap> maps;
  for (Eigen::Index j = 0; j < lights.rows(); ++j) maps.push_back(stage.light_map(lights.row(j)));
  const BoxTable table(maps);
  const TexelRegression regression(table, light_cells(table));
  for (const int pixel : {5, 44}) {
    AlignedFloats values(3 * table.stride());
    for (int c = 0; c < 3; ++c)
      for (int j = 0; j < 40; ++j) values[c * table.stride() + j] = static_cast<float>(samples(j, pixel));
    const PixelSamples all = {values.data(), values.data() + table.stride(),
                              values.data() + 2 * table.stride()};
    const PixelKernels kernels = regression.fit(all).kernels;
    MaskedSamples masked;
    masked.assign(all, table.stride(), table.images());
    AlignedFloats residuals(3 * table.stride());
    regression.leave_one_out(kernels, masked, residuals.data());
    // Held-out samples of the same pixel, one after another, each fitted anew.
    double squared = 0.0, slow = 0.0;
    for (int j = 0; j < 40; ++j) {
      AlignedFloats left(values);
      for (int c = 0; c < 3; ++c) left[c * table.stride() + j] = std::numeric_limits<float>::quiet_NaN();
      const PixelKernels fit =
          regression.fit({left.data(), left.data() + table.stride(), left.data() + 2 * table.stride()})
              .kernels;
      double predicted = 0.0;
      AlignedFloats column(table.stride());
      for (std::size_t k = 0; k < fit.boxes.size(); ++k) {
        table.channel_column(fit.boxes[k], 0, column.data());
        predicted += fit.weights[3 * k] * column[j];
      }
      slow += std::pow(samples(j, pixel) - predicted, 2.0);
      squared += std::pow(residuals[j], 2.0);
    }
    // Each fit without a sample selects its prior and its zeros anew, which leave-one-out holds: 12 % here.
    EXPECT_NEAR(std::sqrt(squared / slow), 1.0, 0.15) << pixel;
  }
}

TEST(TexelRegression, PhotographsOfSingleLightsPredictNoError) {
  const LightStage stage(40);
  const Eigen::MatrixXd singles = Eigen::MatrixXd::Identity(40, 40);
  const auto field = estimate_stage(stage, singles, photographs_of(stage, singles, 0.01), true);
  EXPECT_TRUE(std::ranges::all_of(field.quality.predicted_error, [](float error) { return error == 0.0f; }));
}

}  // namespace
}  // namespace refield
