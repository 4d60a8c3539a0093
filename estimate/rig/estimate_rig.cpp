// SPDX-License-Identifier: Apache-2.0
#include "estimate/rig/estimate_rig.h"

#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>

#include "core/base/aligned_memory.h"
#include "core/base/linear_algebra.h"
#include "core/base/rng.h"
#include "core/session/capture_session.h"
#include "estimate/fit/vector_kernels.h"
#include "estimate/job/observations.h"
#include "estimate/rig/camera_path.h"
#include "estimate/rig/light_predictors.h"

namespace refield {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::MatrixXf;
using Eigen::VectorXd;

// ---- The sample of the picture ----

/// Pixels beside a tile's inner ones, for moving it and for gradients.
constexpr int tile_margin = 8;
constexpr int inner_width = 32, inner_height = 16;
constexpr int bands = 4, tiles_across = 4;
/// Of samples: a picture of no more is taken as one tile.
constexpr std::size_t max_whole_samples = std::size_t{8} << 20;

/// A part of all photographs.
struct Tile {
  int x0 = 0, y0 = 0, width = 0, height = 0;
  std::size_t stride = 0;
  AlignedFloats values;      ///< [height][width][3][stride]
  std::vector<char> usable;  ///< [height × width]: measured in all photographs, as are its neighbours

  float* at(int x, int y, int c) {
    return values.data() + ((static_cast<std::size_t>(y) * width + x) * 3 + c) * stride;
  }
  const float* at(int x, int y, int c) const { return const_cast<Tile*>(this)->at(x, y, c); }
};

Tile cut(const ObservationBand& band, int x0, int x1, int picture_width, int picture_height,
         const Mask& mask) {
  Tile tile;
  tile.x0 = x0;
  tile.y0 = band.first_row();
  tile.width = x1 - x0;
  tile.height = band.last_row() - band.first_row();
  tile.stride = padded_length(band.images());
  tile.values.assign(static_cast<std::size_t>(tile.width) * tile.height * 3 * tile.stride, 0.0f);
  const auto at = [&](int x, int y, int c, int j) -> std::optional<float> {
    if (x < 0 || y < 0 || x >= tile.width || y >= tile.height) return std::nullopt;
    const float value = band.samples(x0 + x, tile.y0 + y, c)[j];
    return std::isfinite(value) ? std::optional(value) : std::nullopt;
  };
  // Of pixels: what their neighbours cannot replace, and hot pixels, whose neighbours do.
  std::vector<char> bad(static_cast<std::size_t>(tile.width) * tile.height, 0), replaced = bad;
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; ++x)
      for (int c = 0; c < 3; ++c) {
        float* to = tile.at(x, y, c);
        for (int j = 0; j < band.images(); ++j) {
          if (const auto value = at(x, y, c, j)) {
            to[j] = *value;
            continue;
          }
          const auto left = at(x - 1, y, c, j), right = at(x + 1, y, c, j), up = at(x, y - 1, c, j),
                     down = at(x, y + 1, c, j);
          const bool known = left && right && up && down;
          to[j] = known ? 0.25f * (*left + *right + *up + *down) : 0.0f;
          (known ? replaced : bad)[static_cast<std::size_t>(y) * tile.width + x] = 1;
        }
      }
  tile.usable.assign(bad.size(), 0);
  constexpr int near_px = 4;
  const auto margin = [](int edge, int picture_edge) { return edge == picture_edge ? near_px : tile_margin; };
  const int left = margin(x0, 0), right = margin(x1, picture_width), top = margin(tile.y0, 0),
            bottom = margin(band.last_row(), picture_height);
  for (int y = top; y < tile.height - bottom; ++y)
    for (int x = left; x < tile.width - right; ++x) {
      if (!mask.empty() && mask[static_cast<std::size_t>(tile.y0 + y) * picture_width + x0 + x] == 0)
        continue;
      bool good = !replaced[static_cast<std::size_t>(y) * tile.width + x];
      for (int v = -near_px; v <= near_px; ++v)
        for (int u = -near_px; u <= near_px; ++u)
          good = good && !bad[static_cast<std::size_t>(y + v) * tile.width + x + u];
      tile.usable[static_cast<std::size_t>(y) * tile.width + x] = good;
    }
  return tile;
}

/// Where a band of all columns has most structure: first columns of the inner parts, apart from each other.
std::vector<int> structured_columns(const ObservationBand& band, int width) {
  std::vector<double> structure(width, 0.0);
  for (int x = 1; x < width; ++x)
    for (int y = band.first_row(); y < band.last_row(); ++y) {
      const float *left = band.samples(x - 1, y, 1), *here = band.samples(x, y, 1);
      double difference = 0.0, sum = 1e-12;
      for (int j = 0; j < band.images(); j += 8) {
        if (!std::isfinite(left[j]) || !std::isfinite(here[j])) continue;
        difference += std::abs(static_cast<double>(here[j]) - left[j]);
        sum += std::abs(static_cast<double>(here[j]));
      }
      structure[x] += std::min(1.0, difference / sum);
    }
  std::vector<int> found;
  const int quarter = (width - 2 * tile_margin) / tiles_across;
  for (int k = 0; k < tiles_across; ++k) {  // the best of each quarter
    const int first = tile_margin + k * quarter, last = first + quarter - inner_width;
    int best = first;
    double most = -1.0,
           now = std::accumulate(structure.begin() + first, structure.begin() + first + inner_width, 0.0);
    for (int x = first; x <= last; ++x) {
      if (now > most) {
        most = now;
        best = x;
      }
      now += structure[x + inner_width] - structure[x];
    }
    found.push_back(best);
  }
  return found;
}

std::vector<Tile> read_tiles(std::span<const CaptureFrame> frames, int width, int height, const Mask& mask,
                             float clip_level, const RunContext& run) {
  std::vector<Tile> tiles;
  const std::size_t samples = static_cast<std::size_t>(width) * height * 3 * padded_length(frames.size());
  const int band_height = inner_height + 2 * tile_margin;
  if (samples <= max_whole_samples || width < tiles_across * (inner_width + 1) + 2 * tile_margin ||
      height < band_height) {
    const auto band = read_observations(frames, width, 0, height, clip_level, run);
    tiles.push_back(cut(band, 0, width, width, height, mask));
    return tiles;
  }
  const int blocks = std::max(1, (height - band_height) / 16);  // bands begin where EXR files' blocks do
  for (int b = 0; b < bands; ++b) {
    const int y0 = std::min(blocks * (2 * b + 1) / (2 * bands) * 16, height - band_height);
    const auto band = read_observations(frames, width, y0, y0 + band_height, clip_level, run);
    for (const int x : structured_columns(band, width))
      tiles.push_back(cut(band, x - tile_margin, x + inner_width + tile_margin, width, height, mask));
  }
  return tiles;
}

/// One pixel of a tile.
struct Place {
  std::size_t tile;
  int x, y;
};

/// Calls use(tile, place) for each usable pixel, tile by tile and row by row.
template <class Use>
void for_each_usable(const std::vector<Tile>& tiles, Use use) {
  for (std::size_t t = 0; t < tiles.size(); ++t)
    for (int y = 0; y < tiles[t].height; ++y)
      for (int x = 0; x < tiles[t].width; ++x)
        if (tiles[t].usable[static_cast<std::size_t>(y) * tiles[t].width + x]) use(tiles[t], Place{t, x, y});
}

// ---- The estimation ----

constexpr int pixels_for_colour = 400;   ///< of all channels
constexpr int pixels_for_gains = 3000;   ///< of which the principal directions have little noise
constexpr int pixels_for_motion = 2000;  ///< samples of one channel
constexpr int max_alternations = 3, max_steps = 6;
/// Photographs are smoothed by that many pixels (standard deviation) before gradients are taken.
constexpr double gradient_blur_px = 0.7;
/// Steps below that many pixels end the search for the shifts.
constexpr double small_step_px = 0.002;
/// Undisturbed captures show shifts of .005 to .013 pixels per photograph: scatter below explains nothing,
/// and paths that stay within the other are no motion.
constexpr double shift_floor_px = 0.005, min_motion_px = 0.03, min_turn_px = 0.06;
/// Undisturbed captures show mixing of up to .005, exponents of .997 to 1.003.
constexpr double min_mixing = 0.01, max_mixing = 0.8, min_exponent = 0.01;
/// Mixing on which pixels do not agree is told from there: a light stage shows .02, 30 photographs of the
/// tabletop with mixing of .1 show .15. It must not contradict them either: with an LED matrix of 64 sources
/// and 40 photographs it shows .1 to .12, but the agreement is -1.6 to -.8; in a synthetic scene with mixing
/// of .15 and 24 photographs it is 1.3 to 1.5.
constexpr double min_doubtful_mixing = 0.05;
/// Twice the logarithm of the likelihood, of one independent pixel, that mixing, a tone curve or room light
/// must gain. Undisturbed captures gain up to .6, those with gains that are not yet known 1.6, a tone curve
/// of 1.03 and mixing of 2 % gain more than 8.
constexpr double min_evidence = 20.0;
/// The same for a tone curve, counting lights that differ; and how well that evidence must tell its
/// exponents. The predictor's errors follow the lights and agree in all pixels where these see a few random
/// texels. Without any tone curve, 60 lights of 32 such texels gain 3.5 for exponents of 1.07 (uncertain by
/// .027), 120 of 192 texels 3.8 for 1.09 (.031), 30 that are shown four times 3.7 for 1.28 (.10). A tone
/// curve of 1.03 and 120 photographs of cycles-b with all other effects gains 1.8 (.019), of 1.06 and 60
/// lights 4.2 (.021), of .95 and 30 of the demo's scene 8.7 (.012), of .98 and 110 of the tabletop 1.2
/// (.018), of 1.02 .43 (.018), which raise the error under natural light by a fifth. Of 72 undisturbed
/// captures 70 show no exponent beyond .01 of 1, the others .02.
constexpr double min_tone_evidence = 0.35, max_tone_uncertainty = 0.024;
/// Gains are expected to be of that size, or so much wider than what was found with that expectation, and
/// pixels count as that many independent ones: the predictor's errors are common to all pixels.
constexpr double expected_gain = 0.01, no_balance = 0.001, wider = 1.3, independent_pixels = 67.0;
/// What gains must gain of the criterion, and their standard deviation. Undisturbed: .023 and .005.
constexpr double min_gain_gain = 0.04, min_gain = 0.0085;
/// Of the residuals along the photographs themselves: undisturbed captures have 1.5 to 9, gains of 1 % 30, of
/// 2 % 75 and more.
constexpr double min_own_share = 15.0;
/// The same within each channel, where the camera moved: with designed patterns, whose detail the predictor
/// does not know, undisturbed captures show up to 34, natural light 2; white balance that varies by 1.5 %
/// shows 88 and more, by 2 % of cycles-b 69.
constexpr double min_own_share_of_channels = 48.0;
constexpr Index own_directions = 8;
/// Of gains, explained by the lights: mixtures of a light stage's sources show .72 to .91, gains of 1 % and
/// more -1.6 to -.4.
constexpr double max_share_of_lights = 0.5;
/// The same for gains that channels have besides, by refined_gains() where the camera rested: 12 undisturbed
/// captures with 60 and 120 photographs show .0008 to .0030 (by solve_gains() up to .0085), a white balance
/// that varies by 1.2 % .0083 and .0088; its correction takes 18 % off the error of the whole picture under
/// bars. A camera that walks at random leaves more than .008 without any.
constexpr double min_balance_gain = 0.05, min_balance = 0.006, min_balance_of_moving = 0.0095;
/// Of a drift of the brightness: squares of its coefficients by their covariance, in one channel, and the
/// largest deviation. Undisturbed captures show 1 to 12, a drift of 3 % in 100 photographs 280 and more.
/// Where the camera moves or photographs are predicted badly it must be clearer: without any drift, a camera
/// that creeps by .1 to .3 pixels under designed patterns shows 42 to 67, an LED matrix whose photographs are
/// predicted to 5 % up to 31.
constexpr double min_drift_evidence = 30.0, min_drift_evidence_in_doubt = 120.0, min_drift = 0.003;
constexpr double max_residual_of_drift = 0.04;
/// Of agreement(). Undisturbed captures show less than 1.2. A jump shortly before the end is seen by few
/// photographs.
constexpr double min_agreement = 2.2, min_motion_agreement = 1.5;
/// Of the criterion, by which motion is clear without. A creep of half a pixel gains .4.
constexpr double clear_motion_gain = 0.1;
/// Relative residuals beyond which the predictor is not good enough to tell a tone curve or gains from what
/// it does not know of the light, and different lights for gains: with 40 of sharp boxes it took its own
/// errors for gains of 9 %.
constexpr double max_residual_of_tone = 0.1, max_residual_of_gains = 0.08;
constexpr int min_lights_for_gains = 60;
/// That pixels have constants, once the changes of the room light are undone: room light of 2.5 % shows 7.6
/// then, undisturbed captures -7 to -2. Designed patterns, all of one mean brightness, show -3.9 to -0.6, and
/// a mean of any sign.
constexpr double min_room_agreement = 1.0;
/// Below, pixels have none: natural light without room light shows -6.5 and -5.6.
constexpr double no_room_agreement = -4.5;
/// Of room light: mean share, standard deviation over the photographs, and gain. Undisturbed: .003, .001 and
/// 0.
constexpr double min_room = 0.008, min_room_change = 0.002, min_room_gain = 0.015;
constexpr double room_floor = 0.001;
/// Photographs of cycles-b and the tabletop of 128x96 pixels and more, moved back by .3 to .9 pixels, gain 10
/// to 16 standard errors, those of 64x48 pixels, whose fields do not become better, -1.5 to 1.7.
constexpr double min_served = 3.0;
constexpr Index min_targets = 8;
/// Beyond that many pixels photographs are not comparable at all.
constexpr double max_shift_px = 4.0;
/// Stretches of photographs whose sums are compared, and how far. Sums of at least 6 photographs of cycles-b
/// and the tabletop that show the same edges in the same place agree by .42 to .65, by .1 and less 2 pixels
/// away.
constexpr Index min_block = 6, max_blocks = 12;
constexpr int max_jump_px = 16;
constexpr double clear_structure = 0.25, blurred_structure = 0.5;

class RigEstimation {
 public:
  RigEstimation(std::span<const CaptureFrame> frames, const std::vector<char>& left_out,
                const CaptureSession& session, const Mask& mask, float clip_level,
                const LightFeatures& lights, const RunContext& run)
      : frames_(static_cast<int>(frames.size())),
        chosen_(chosen_of(left_out)),
        lights_(lights),
        run_(run),
        predictors_(lights, chosen_) {
    std::vector<CaptureFrame> taking_part;
    for (const int j : chosen_) taking_part.push_back(frames[j]);
    if (session.ambient) {
      taking_part.push_back(frames.front());
      taking_part.back().observed = *session.ambient;
      taking_part.back().gain = {1.0f, 1.0f, 1.0f};
      taking_part.back().views.reset();
    }
    has_ambient_ = session.ambient.has_value();
    original_ = read_tiles(taking_part, session.width, session.height, mask, clip_level, run);
    images_ = static_cast<Index>(chosen_.size());
    motion_ = MatrixXd::Zero(images_, 4);
    centre_ = {0.5 * (session.width - 1), 0.5 * (session.height - 1)};
    model_.white = lights.white > 0.0 ? lights.white : 1.0;
    for (const CaptureFrame& frame : frames) model_.photographs.push_back(frame.name);
  }

  RigReport run() {
    current_ = original_;
    places_ = bright_places(pixels_for_colour);
    if (places_.size() < 50) return report();
    choose_way();
    before_ = total_criterion();
    measured_mixing_ = measure_mixing();
    if (measured_mixing_ && !measured_mixing_->isIdentity()) {
      model_.mixing = *measured_mixing_;
      prepare();
      choose_way();
    }
    if (jumps_far()) lose_track();
    alternate();
    // Rotation and scale come last, when the other effects are known.
    const bool told = path_[shifts].kind != CapturePath::Kind::rest && model_.shift_px.empty();
    if (!told && predictors_.are_mixtures() && estimate_motion(turns, true)) alternate();
    if (!(total_criterion() < before_)) forget();
    return report();
  }

 private:
  enum Motion { shifts, turns };  // of two columns of motion_ each

  void alternate() {
    for (int round = 0; round < max_alternations; ++round) {
      bool moved = (round == 0 || !model_.shift_px.empty()) && estimate_motion(shifts, round == 0);
      if (!model_.turn.empty() && estimate_motion(turns, false)) moved = true;
      if (relative(total_criterion()) > max_residual_of_tone) break;
      const bool bent = estimate_colour_and_tone();
      const bool brighter = estimate_brightness();
      if (!moved && !brighter && (round > 0 || !bent)) break;
      if (brighter) estimate_colour_and_tone();
    }
  }

  static std::vector<int> chosen_of(const std::vector<char>& left_out) {
    std::vector<int> chosen;
    for (std::size_t j = 0; j < left_out.size(); ++j)
      if (!left_out[j]) chosen.push_back(static_cast<int>(j));
    return chosen;
  }

  /// The model becomes the identity.
  void forget() {
    // Else motion was found, and is not corrected anyway.
    if (!model_.shift_px.empty() || !model_.turn.empty()) path_ = {};
    RigModel none;
    none.photographs = std::move(model_.photographs);
    none.white = model_.white;
    model_ = std::move(none);
  }
  std::vector<Place> bright_places(std::size_t most) const;
  void choose_way();
  void prepare();
  void scale(Tile& tile) const;
  using RoomPicture = std::array<Eigen::VectorXf, 3>;  ///< of each place
  RoomPicture room_picture(const std::array<MatrixXf, 3>& y);
  void subtract_room(std::size_t tile, int x, int y);
  MatrixXf series(int channel) const { return series(channel, places_); }
  MatrixXf series(int channel, const std::vector<Place>& places) const;
  void use_exponents();
  double total_criterion() const;
  Eigen::RowVector2d displacement(const Eigen::RowVector4d& motion, const Place& place) const;
  void move_back(std::size_t t);
  void move_by(const MatrixXd& motion);
  bool moving_back_serves(const MatrixXd& less, const MatrixXd& more) const;
  std::pair<double, std::array<MatrixXf, 3>> smoothed_residuals();
  bool estimate_motion(Motion kind, bool first);
  bool lose_track();
  bool jumps_far();
  MatrixXd motion_step(VectorXd& variance, Motion kind) const;
  bool estimate_colour_and_tone();
  std::optional<Eigen::Matrix3d> measure_mixing() const;
  void estimate_colour();
  std::array<double, 3> best_exponents();
  std::array<MatrixXf, 3> relative_residuals() const;
  bool estimate_brightness();
  struct Brightness;
  Brightness solve_brightness(const std::array<MatrixXf, 3>& y, const RoomPicture& scene) const;
  double mean_room_light(const std::array<MatrixXf, 3>& y, const RoomPicture& scene, double least) const;
  MatrixXd solve_gains(const std::array<MatrixXf, 3>& y, double expected_common,
                       double expected_balance) const;
  MatrixXd refined_gains(double expected_common, double expected_balance) const;
  bool estimate_drift(const std::array<MatrixXf, 3>& y, const RoomPicture& scene);
  double criterion_of(const std::array<MatrixXf, 3>& y) const;
  double share_of_lights(const MatrixXd& gains, const std::array<MatrixXf, 3>& y) const;
  double own_share(const std::array<MatrixXf, 3>& y, int first, int last) const;
  RigReport report() const;

  int frames_;
  std::vector<int> chosen_;  // numbers of the frames that take part
  const LightFeatures& lights_;
  const RunContext& run_;
  LightPredictors predictors_;
  Index images_ = 0;
  // As photographed, with the ambient photograph last where there is one, and with the model so far undone.
  std::vector<Tile> original_, current_;
  bool has_ambient_ = false;
  bool assumes_dark_ = false;  // that the photograph with the least room light has none
  double drift_ = 0.0;         // of the brightness, from the first photograph to the last
  double room_scale_ = 1.0;    // multiples of the room picture in one of a picture as bright as the scene
  std::vector<Place> places_;  // bright pixels, spread over the tiles; channel 0
  std::array<MatrixXf, 3> leave_one_out_;
  // [images × 4]: to the right, down, and by how many pixels rotation and growth move the picture's corners.
  MatrixXd motion_;
  std::optional<Eigen::Matrix3d> measured_mixing_;
  double doubtful_mixing_ = 0.0;      // its largest entry, where pixels do not agree on it
  Eigen::Vector2d centre_{0.0, 0.0};  // of the picture
  std::array<CapturePath, 2> path_;   // of each Motion
  bool lost_track_ = false;
  double jump_px_ = 0.0;
  int jump_near_ = 0;  // number of a photograph
  RigModel model_;
  double before_ = 0.0;
};

/// Bright usable pixels, evenly spread.
std::vector<Place> RigEstimation::bright_places(std::size_t most) const {
  std::vector<Place> all;
  std::vector<double> power;
  for_each_usable(current_, [&](const Tile& tile, const Place& place) {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c)
      for (Index j = 0; j < images_; j += 4)
        sum += static_cast<double>(tile.at(place.x, place.y, c)[j]) * tile.at(place.x, place.y, c)[j];
    all.push_back(place);
    power.push_back(sum);
  });
  if (all.empty()) return {};
  std::vector<double> ordered = power;
  std::ranges::sort(ordered);
  const double least = ordered[ordered.size() / 5];
  std::vector<Place> bright;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (power[i] >= least && power[i] > 0.0) bright.push_back(all[i]);
  const std::size_t count = std::min(most, bright.size());
  std::vector<Place> spread;
  for (std::size_t k = 0; k < count; ++k) spread.push_back(bright[k * bright.size() / count]);
  return spread;
}

MatrixXf RigEstimation::series(int channel, const std::vector<Place>& places) const {
  MatrixXf values(images_, static_cast<Index>(places.size()));
  for (std::size_t k = 0; k < places.size(); ++k) {
    const Place& place = places[k];
    values.col(static_cast<Index>(k)) =
        Eigen::Map<const Eigen::VectorXf>(current_[place.tile].at(place.x, place.y, channel), images_);
  }
  return values;
}

void RigEstimation::use_exponents() {
  tbb::parallel_for(0, 3, [&](int c) { leave_one_out_[c] = predictors_.leave_one_out(c, model_.tone[c]); });
}

double RigEstimation::total_criterion() const {
  double sum = 0.0;
  for (int c = 0; c < 3; ++c) sum += criterion(leave_one_out_[c], series(c));
  return sum / 3.0;
}

void RigEstimation::choose_way() {
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t w = 0; w < LightPredictors::ways; ++w) {
    run_.throw_if_stopped();
    predictors_.use(w);
    use_exponents();
    const double value = total_criterion();
    if (value >= least) continue;
    least = value;
    best = w;
  }
  predictors_.use(best);
  use_exponents();
}

void RigEstimation::scale(Tile& tile) const {
  std::array<AlignedFloats, 3> factors;
  for (int c = 0; c < 3; ++c) {
    factors[c].assign(tile.stride, 0.0f);
    for (Index i = 0; i < images_; ++i)
      factors[c][i] = static_cast<float>(1.0 / model_.gain[static_cast<std::size_t>(chosen_[i])][c]);
  }
  for (std::size_t k = 0; k < tile.values.size(); k += tile.stride) {
    const AlignedFloats& factor = factors[k / tile.stride % 3];
    for (std::size_t j = 0; j < tile.stride; ++j) tile.values[k + j] *= factor[j];
  }
}

/// The ambient photograph for the primaries of the light. It was taken where the camera stood first.
Eigen::Vector3f ambient_of(const Tile& original, int x, int y, Index place, const Eigen::Matrix3f& unmix) {
  return unmix * Eigen::Vector3f(original.at(x, y, 0)[place], original.at(x, y, 1)[place],
                                 original.at(x, y, 2)[place]);
}

void RigEstimation::subtract_room(std::size_t t, int x, int y) {
  Tile& tile = current_[t];
  double sum = 0.0;
  for (int c = 0; c < 3; ++c) sum += std::accumulate(tile.at(x, y, c), tile.at(x, y, c) + images_, 0.0);
  Eigen::Vector3f room =
      Eigen::Vector3f::Constant(static_cast<float>(sum / static_cast<double>(3 * images_)));
  if (model_.ambient_room)
    room = ambient_of(original_[t], x, y, images_, model_.mixing.inverse().cast<float>());
  for (int c = 0; c < 3; ++c)
    for (Index i = 0; i < images_; ++i)
      tile.at(x, y, c)[i] -= static_cast<float>(model_.room[static_cast<std::size_t>(chosen_[i])] * room[c]);
}

/// What the room light shows at the places, as bright as the mean photograph in grey, which stands for it
/// where there is no ambient photograph or a dark one, which is noise.
RigEstimation::RoomPicture RigEstimation::room_picture(const std::array<MatrixXf, 3>& y) {
  constexpr double min_ambient = 0.01;  // of the mean photograph
  const Eigen::VectorXf grey =
      (y[0].colwise().mean() + y[1].colwise().mean() + y[2].colwise().mean()).transpose() / 3.0f;
  RoomPicture picture{grey, grey, grey};
  model_.ambient_room = false;
  room_scale_ = 1.0;
  if (!has_ambient_) return picture;
  const Eigen::Matrix3f unmix = model_.mixing.inverse().cast<float>();
  Eigen::Matrix3Xf ambient(3, grey.size());
  for (Index k = 0; k < grey.size(); ++k) {
    const Place& place = places_[static_cast<std::size_t>(k)];
    ambient.col(k) = ambient_of(original_[place.tile], place.x, place.y, images_, unmix);
  }
  const double brightness = ambient.norm() / (std::sqrt(3.0f) * grey.norm() + 1e-20f);
  if (brightness < min_ambient) return picture;
  model_.ambient_room = true;
  room_scale_ = 1.0 / brightness;
  for (int c = 0; c < 3; ++c) picture[c] = static_cast<float>(room_scale_) * ambient.row(c).transpose();
  return picture;
}

/// Undoes the model in all tiles.
void RigEstimation::prepare() {
  const Eigen::Matrix3f unmix = model_.mixing.inverse().cast<float>();
  tbb::parallel_for(std::size_t{0}, original_.size(), [&](std::size_t t) {
    move_back(t);
    Tile& tile = current_[t];
    if (!model_.gain.empty()) scale(tile);
    if (!model_.mixes_colours() && model_.room.empty()) return;
    for (int y = 0; y < tile.height; ++y)
      for (int x = 0; x < tile.width; ++x) {
        float *r = tile.at(x, y, 0), *g = tile.at(x, y, 1), *b = tile.at(x, y, 2);
        for (std::size_t j = 0; j < tile.stride; ++j) {
          const Eigen::Vector3f value(r[j], g[j], b[j]);
          r[j] = unmix.row(0).dot(value);
          g[j] = unmix.row(1).dot(value);
          b[j] = unmix.row(2).dot(value);
        }
        if (!model_.room.empty()) subtract_room(t, x, y);
      }
  });
}

/// Interpolation weights of each image, [taps][stride], for the pixels first, first + 1, …
struct Taps {
  int first = 0;
  std::vector<AlignedFloats> weights;
};

Taps taps_of(const VectorXd& shift, std::size_t stride) {
  const int lowest = static_cast<int>(std::floor(shift.minCoeff())),
            highest = static_cast<int>(std::floor(shift.maxCoeff()));
  Taps taps{lowest - 1, {}};
  taps.weights.assign(static_cast<std::size_t>(highest - lowest + 4), AlignedFloats(stride, 0.0f));
  for (Index j = 0; j < shift.size(); ++j) {
    const int whole = static_cast<int>(std::floor(shift[j]));
    const auto weights = cubic_weights(shift[j] - whole);
    for (int i = 0; i < 4; ++i) taps.weights[static_cast<std::size_t>(whole - lowest + i)][j] = weights[i];
  }
  return taps;
}

/// `from` moved back by shift [images × 2].
void shift_back(const Tile& from, const MatrixXd& shift, Tile& to) {
  const Taps across = taps_of(shift.col(0), from.stride), down = taps_of(shift.col(1), from.stride);
  const std::size_t row_size = static_cast<std::size_t>(from.width) * 3 * from.stride;
  AlignedFloats row(row_size);
  for (int y = 0; y < from.height; ++y) {
    std::ranges::fill(row, 0.0f);
    for (std::size_t i = 0; i < down.weights.size(); ++i) {
      const float* source =
          from.at(0, std::clamp(y + down.first + static_cast<int>(i), 0, from.height - 1), 0);
      const float* weights = down.weights[i].data();
      for (std::size_t k = 0; k < row_size; k += from.stride)
        for (std::size_t j = 0; j < from.stride; ++j) row[k + j] += weights[j] * source[k + j];
    }
    for (int x = 0; x < from.width; ++x)
      for (int c = 0; c < 3; ++c) {
        float* out = to.at(x, y, c);
        std::fill_n(out, from.stride, 0.0f);
        for (std::size_t i = 0; i < across.weights.size(); ++i) {
          const int column = std::clamp(x + across.first + static_cast<int>(i), 0, from.width - 1);
          const float* source = row.data() + (static_cast<std::size_t>(column) * 3 + c) * from.stride;
          const float* weights = across.weights[i].data();
          for (std::size_t j = 0; j < from.stride; ++j) out[j] += weights[j] * source[j];
        }
      }
  }
}

/// Image i of a tile at a place moved by `shift`.
float interpolated(const Tile& tile, const Place& place, const Eigen::RowVector2d& shift, int channel,
                   Index i) {
  const int x = static_cast<int>(std::floor(shift[0])), y = static_cast<int>(std::floor(shift[1]));
  const auto across = cubic_weights(shift[0] - x), down = cubic_weights(shift[1] - y);
  float value = 0.0f;
  for (int v = 0; v < 4; ++v)
    for (int u = 0; u < 4; ++u)
      value += down[v] * across[u] *
               tile.at(std::clamp(place.x + x + u - 1, 0, tile.width - 1),
                       std::clamp(place.y + y + v - 1, 0, tile.height - 1), channel)[i];
  return value;
}

Eigen::RowVector2d RigEstimation::displacement(const Eigen::RowVector4d& motion, const Place& place) const {
  const Tile& tile = original_[place.tile];
  const double u = (tile.x0 + place.x - centre_[0]) / centre_.norm(),
               v = (tile.y0 + place.y - centre_[1]) / centre_.norm();
  return {motion[0] - motion[2] * v + motion[3] * u, motion[1] + motion[2] * u + motion[3] * v};
}

/// Undoes the motion in a tile.
void RigEstimation::move_back(std::size_t t) {
  const Tile& from = original_[t];
  Tile& to = current_[t];
  if (motion_.isZero(0.0)) {
    to.values = from.values;
    return;
  }
  if (motion_.rightCols(2).isZero(0.0)) return shift_back(from, motion_.leftCols(2), to);
  tbb::parallel_for(0, from.height, [&](int y) {
    for (int x = 0; x < from.width; ++x)
      for (Index i = 0; i < images_; ++i) {
        const Place place{t, x, y};
        const Eigen::RowVector2d moved = displacement(motion_.row(i), place);
        for (int c = 0; c < 3; ++c) to.at(x, y, c)[i] = interpolated(from, place, moved, c, i);
      }
  });
}

void RigEstimation::move_by(const MatrixXd& motion) {
  motion_ = motion;
  prepare();
}

/// Smooths a tile by a Gaussian of gradient_blur_px.
Tile smoothed(const Tile& tile) {
  constexpr int reach = 3;
  std::array<float, 2 * reach + 1> kernel;
  float sum = 0.0f;
  for (int i = -reach; i <= reach; ++i)
    sum += kernel[i + reach] =
        static_cast<float>(std::exp(-0.5 * i * i / (gradient_blur_px * gradient_blur_px)));
  for (float& weight : kernel) weight /= sum;
  Tile across = tile, result = tile;
  const std::size_t pixel = 3 * tile.stride;
  tbb::parallel_for(0, tile.height, [&](int y) {
    for (int x = 0; x < tile.width; ++x) {
      float* out = across.at(x, y, 0);
      std::fill_n(out, pixel, 0.0f);
      for (int i = -reach; i <= reach; ++i) {
        const float* from = tile.at(std::clamp(x + i, 0, tile.width - 1), y, 0);
        for (std::size_t k = 0; k < pixel; ++k) out[k] += kernel[i + reach] * from[k];
      }
    }
  });
  tbb::parallel_for(0, tile.height, [&](int y) {
    const std::size_t row = pixel * tile.width;
    float* out = result.at(0, y, 0);
    std::fill_n(out, row, 0.0f);
    for (int i = -reach; i <= reach; ++i) {
      const float* from = across.at(0, std::clamp(y + i, 0, tile.height - 1), 0);
      for (std::size_t k = 0; k < row; ++k) out[k] += kernel[i + reach] * from[k];
    }
  });
  return result;
}

/// The samples of one channel that tell most about motion, and their gradients.
struct MotionSamples {
  MatrixXf values, right, down;  ///< [images × samples]
  Eigen::VectorXf weights;       ///< 1 / residual variance
  Eigen::VectorXf x, y;          ///< place in the picture

  /// Gradients by rotation and scale about a centre, of as many pixels at its corner (0, 0).
  void turn(const Eigen::Vector2d& centre) {
    const auto radius = static_cast<float>(centre.norm());
    const Eigen::VectorXf u = (x.array() - static_cast<float>(centre[0])) / radius,
                          v = (y.array() - static_cast<float>(centre[1])) / radius;
    const MatrixXf rotation = down * u.asDiagonal() - right * v.asDiagonal();
    down = right * u.asDiagonal() + down * v.asDiagonal();
    right = rotation;
  }
};

MotionSamples motion_samples(const std::vector<Tile>& tiles, int channel, Index images,
                             const MatrixXf& leave_one_out) {
  struct Scored {
    Place place;
    double score;
  };
  std::vector<Scored> all;
  for_each_usable(tiles, [&](const Tile& tile, const Place& place) {
    const auto at = [&](int dx, int dy) { return tile.at(place.x + dx, place.y + dy, channel); };
    const float *here = at(0, 0), *left = at(-1, 0), *right = at(1, 0), *up = at(0, -1), *down = at(0, 1);
    double energy = 0.0, power = 1e-20;
    for (Index j = 0; j < images; j += 2) {
      const double dx = right[j] - left[j], dy = down[j] - up[j];
      energy += dx * dx + dy * dy;
      power += static_cast<double>(here[j]) * here[j];
    }
    all.push_back({place, energy / power});
  });
  std::ranges::stable_sort(all, std::greater<>{}, &Scored::score);
  all.resize(std::min<std::size_t>(all.size(), pixels_for_motion));
  const auto gather = [&](auto value) {
    MatrixXf values(images, static_cast<Index>(all.size()));
    for (std::size_t k = 0; k < all.size(); ++k) {
      const Place& place = all[k].place;
      const auto at = [&](int dx, int dy) {
        return tiles[place.tile].at(place.x + dx, place.y + dy, channel);
      };
      for (Index j = 0; j < images; ++j) values(j, static_cast<Index>(k)) = value(at, j);
    }
    return values;
  };
  MotionSamples samples;
  samples.values = gather([](const auto& at, Index j) { return at(0, 0)[j]; });
  samples.right = gather([](const auto& at, Index j) { return 0.5f * (at(1, 0)[j] - at(-1, 0)[j]); });
  samples.down = gather([](const auto& at, Index j) { return 0.5f * (at(0, 1)[j] - at(0, -1)[j]); });
  Eigen::VectorXf variance =
      (leave_one_out * samples.values).colwise().squaredNorm().transpose() / static_cast<float>(images);
  std::vector<float> ordered(variance.data(), variance.data() + variance.size());
  std::ranges::sort(ordered);
  const float floor = ordered.empty() ? 1.0f : 1e-2f * ordered[ordered.size() / 2] + 1e-20f;
  samples.weights = (variance.array() + floor).inverse();
  // The best third by information, its gradients' power over the residual's.
  std::vector<Index> order(all.size());
  std::iota(order.begin(), order.end(), Index{0});
  const Eigen::VectorXf information =
      (samples.right.colwise().squaredNorm() + samples.down.colwise().squaredNorm())
          .transpose()
          .cwiseProduct(samples.weights);
  std::ranges::stable_sort(order, [&](Index a, Index b) { return information[a] > information[b]; });
  order.resize(std::min<std::size_t>(order.size(), pixels_for_motion / 3));
  samples.values = MatrixXf(samples.values(Eigen::all, order));
  samples.right = MatrixXf(samples.right(Eigen::all, order));
  samples.down = MatrixXf(samples.down(Eigen::all, order));
  samples.weights = Eigen::VectorXf(samples.weights(order));
  samples.x = samples.y = samples.weights;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Place& place = all[static_cast<std::size_t>(order[k])].place;
    samples.x[static_cast<Index>(k)] = static_cast<float>(tiles[place.tile].x0 + place.x);
    samples.y[static_cast<Index>(k)] = static_cast<float>(tiles[place.tile].y0 + place.y);
  }
  return samples;
}

/// One Gauss-Newton step for the shifts of all photographs: minimises Σ w ‖A (B + d ∘ G)‖² over d, in which
/// the normal matrix is (AᵀA) ∘ (G W Gᵀ), element by element. [images × 2], mean 0. `variance`: of each
/// photograph's shift, up to a common factor.
MatrixXd RigEstimation::motion_step(VectorXd& variance, Motion kind) const {
  std::vector<Tile> smooth;
  for (const Tile& tile : current_) smooth.push_back(smoothed(tile));
  MatrixXd normal = MatrixXd::Zero(2 * images_, 2 * images_);
  VectorXd right = VectorXd::Zero(2 * images_);
  for (int c = 0; c < 3; ++c) {
    run_.throw_if_stopped();
    const MatrixXf& a = leave_one_out_[c];
    MotionSamples samples = motion_samples(smooth, c, images_, a);
    if (kind == turns) samples.turn(centre_);
    const MatrixXf squared = a.transpose() * a;
    const MatrixXf pull = a.transpose() * (a * samples.values);
    const std::array<const MatrixXf*, 2> gradients{&samples.right, &samples.down};
    for (int i = 0; i < 2; ++i) {
      const MatrixXf weighted = *gradients[i] * samples.weights.asDiagonal();
      right.segment(i * images_, images_) -= weighted.cwiseProduct(pull).rowwise().sum().cast<double>();
      for (int k = i; k < 2; ++k) {
        const MatrixXf products = weighted * gradients[k]->transpose();
        const MatrixXd part = squared.cwiseProduct(products).cast<double>();
        normal.block(i * images_, k * images_, images_, images_) += part;
        if (k != i) normal.block(k * images_, i * images_, images_, images_) += part.transpose();
      }
    }
  }
  normal.diagonal().array() += 1e-6 * normal.trace() / static_cast<double>(normal.rows()) + 1e-20;
  const MatrixXd covariance = inverse(normal);
  const VectorXd step = covariance * right;
  variance = covariance.diagonal().head(images_) + covariance.diagonal().tail(images_);
  MatrixXd result(images_, 2);
  result.col(0) = step.head(images_);
  result.col(1) = step.tail(images_);
  result.rowwise() -= result.colwise().mean().eval();
  return result;
}

/// Gradients of the logarithm of what photographs [first, last) show together, of one tile; 0 where a pixel
/// or a neighbour is dark.
std::vector<std::array<float, 2>> structure_of(const Tile& tile, Index first, Index last) {
  std::vector<float> sums(static_cast<std::size_t>(tile.width) * tile.height);
  for (std::size_t p = 0; p < sums.size(); ++p)
    for (int c = 0; c < 3; ++c) {
      const float* values = tile.values.data() + (3 * p + c) * tile.stride;
      sums[p] += std::accumulate(values + first, values + last, 0.0f);
    }
  std::vector<std::array<float, 2>> gradients(sums.size());
  const auto slope = [](float before, float after) {
    return before > 0.0f && after > 0.0f ? std::log(after / before) : 0.0f;
  };
  for (int y = 1; y + 1 < tile.height; ++y)
    for (int x = 1; x + 1 < tile.width; ++x) {
      const std::size_t p = static_cast<std::size_t>(y) * tile.width + x;
      gradients[p] = {slope(sums[p - 1], sums[p + 1]), slope(sums[p - tile.width], sums[p + tile.width])};
    }
  return gradients;
}

/// How well gradients of two sums of photographs agree if the second is moved by (dx, dy), 1 at best.
double structure_agreement(const Tile& tile, const std::vector<std::array<float, 2>>& a,
                           const std::vector<std::array<float, 2>>& b, int dx, int dy) {
  double product = 0.0, of_a = 1e-12, of_b = 1e-12;
  for (int y = std::max(0, -dy); y < std::min(tile.height, tile.height - dy); ++y)
    for (int x = std::max(0, -dx); x < std::min(tile.width, tile.width - dx); ++x) {
      const auto& here = a[static_cast<std::size_t>(y) * tile.width + x];
      const auto& there = b[static_cast<std::size_t>(y + dy) * tile.width + x + dx];
      product += here[0] * there[0] + here[1] * there[1];
      of_a += here[0] * here[0] + here[1] * here[1];
      of_b += there[0] * there[0] + there[1] * there[1];
    }
  return product / std::sqrt(of_a * of_b);
}

/// Whether some stretch of the photographs shows the scene further away than steps of the search for shifts
/// reach: the edges of the stretch's sum agree with those of the first elsewhere, and not in place.
bool RigEstimation::jumps_far() {
  const Index stretch = std::max<Index>(min_block, images_ / max_blocks);
  const Tile& tile =
      *std::ranges::max_element(current_, {}, [](const Tile& t) { return t.width * t.height; });
  const int reach = std::min(max_jump_px, std::min(tile.width, tile.height) / 4);
  const auto start = structure_of(tile, 0, stretch);
  for (Index first = stretch; first + stretch <= images_; first += stretch) {
    run_.throw_if_stopped();
    const auto now = structure_of(tile, first, first + stretch);
    const double in_place = structure_agreement(tile, start, now, 0, 0);
    if (in_place > clear_structure) continue;
    double best = in_place;
    for (int dy = -reach; dy <= reach; ++dy)
      for (int dx = -reach; dx <= reach; ++dx) {
        const double agrees = structure_agreement(tile, start, now, dx, dy);
        if (agrees <= best) continue;
        best = agrees;
        jump_px_ = std::hypot(dx, dy);
      }
    jump_near_ = chosen_[static_cast<std::size_t>(first)];
    if (best > clear_structure && in_place < blurred_structure * best && jump_px_ > max_shift_px) return true;
  }
  return false;
}

/// The photographs moved too far to be compared: none is moved back.
bool RigEstimation::lose_track() {
  lost_track_ = true;
  path_ = {};
  model_.shift_px.clear();
  model_.turn.clear();
  move_by(MatrixXd::Zero(images_, 4));
  return false;
}

/// Whether photographs moved back by `more` in place of `less` [images × 4] predict better those nearest the
/// first one's position, which stay as they are: by the mean over pixels of the logarithm of the ratio of
/// residuals' powers, in its standard errors. Residuals of moved photographs do not tell: they are blurred by
/// interpolation. `current_` must not be moved.
bool RigEstimation::moving_back_serves(const MatrixXd& less, const MatrixXd& more) const {
  std::vector<Index> order(static_cast<std::size_t>(images_));
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::stable_sort(order, {}, [&](Index i) { return (more.row(i) - more.row(0)).squaredNorm(); });
  order.resize(static_cast<std::size_t>(std::max(min_targets, images_ / 8)));
  Eigen::ArrayXd gains = Eigen::ArrayXd::Zero(static_cast<Index>(places_.size()));
  tbb::parallel_for(Index{0}, gains.size(), [&](Index p) {
    const Place& place = places_[static_cast<std::size_t>(p)];
    const Tile& tile = current_[place.tile];
    for (int c = 0; c < 3; ++c) {
      double before = 1e-20, after = 1e-20;
      for (const Index target : order) {
        float resting = 0.0f, moved = 0.0f;
        for (Index i = 0; i < images_; ++i) {
          const float weight = leave_one_out_[c](target, i);
          const auto at = [&](const MatrixXd& motion) {
            return interpolated(tile, place, displacement(motion.row(i) - motion.row(target), place), c, i);
          };
          resting += weight * at(less);
          moved += weight * at(more);
        }
        before += static_cast<double>(resting) * resting;
        after += static_cast<double>(moved) * moved;
      }
      gains[p] += std::log(before / after) / 3.0;
    }
  });
  const auto count = static_cast<double>(gains.size());
  const double deviation = std::sqrt((gains - gains.mean()).square().sum() / (count - 1.0));
  return gains.mean() > min_served * deviation / std::sqrt(count);
}

/// Criterion and residuals of the photographs smoothed, which interpolation hardly changes.
std::pair<double, std::array<MatrixXf, 3>> RigEstimation::smoothed_residuals() {
  std::vector<Tile> sharp;
  for (const Tile& tile : current_) sharp.push_back(smoothed(tile));
  std::swap(sharp, current_);
  auto result = std::pair(total_criterion(), relative_residuals());
  std::swap(sharp, current_);
  return result;
}

/// `first`: whether there is any, too.
bool RigEstimation::estimate_motion(Motion kind, bool first) {
  if (lost_track_) return false;
  // Shadows of single light sources move: photographs of a relief were "moved" by up to 3.6 pixels.
  if (!predictors_.are_mixtures() && relative(total_criterion()) > max_residual_of_tone) return false;
  const MatrixXd before = motion_;
  const auto with = [&](const MatrixXd& columns) {
    MatrixXd motion = before;
    motion.middleCols<2>(2 * kind) = columns;
    return motion;
  };
  CapturePath& path = path_[kind];
  const double least = kind == shifts ? min_motion_px : min_turn_px;
  MatrixXd measured = before.middleCols<2>(2 * kind);
  VectorXd variance;
  for (int step = 0; step < max_steps; ++step) {
    const MatrixXd change = motion_step(variance, kind);
    measured += change;
    if (step == 0 && first) {
      path = choose_path(measured, variance, chosen_, frames_, shift_floor_px);
      if (path.kind == CapturePath::Kind::rest || path.values.cwiseAbs().maxCoeff() < least / 2) {
        path.kind = CapturePath::Kind::rest;
        return false;
      }
      // Where single photographs tell little, the path is nearer.
      if (!(measured.cwiseAbs().maxCoeff() < max_shift_px)) {
        measured = path.values(chosen_, Eigen::all);
        measured *= std::min(1.0, 0.9 * max_shift_px / measured.cwiseAbs().maxCoeff());
      }
    }
    if (!(measured.cwiseAbs().maxCoeff() < max_shift_px)) {
      const double moved = total_criterion();
      move_by(before);
      const double resting = total_criterion();
      if (!first || relative(resting) > max_residual_of_tone || resting - moved > clear_motion_gain)
        return lose_track();
      path.kind = CapturePath::Kind::rest;  // what moves on and on and explains nothing are shadows
      return false;
    }
    move_by(with(measured));
    if (change.cwiseAbs().maxCoeff() < small_step_px) break;
  }
  path = choose_path(measured, variance, chosen_, frames_, shift_floor_px);
  if (path.values.cwiseAbs().maxCoeff() < least) path.kind = CapturePath::Kind::rest;
  auto& found = kind == shifts ? model_.shift_px : model_.turn;
  found.clear();
  const MatrixXd without = with(MatrixXd::Zero(images_, 2));
  move_by(MatrixXd::Zero(images_, 4));
  if (path.kind != CapturePath::Kind::rest) {
    const MatrixXd moved = with(path.values(chosen_, Eigen::all));
    const bool serves = moving_back_serves(without, moved);
    move_by(without);
    const auto [start, residuals] = smoothed_residuals();
    move_by(moved);
    const auto [end, moved_residuals] = smoothed_residuals();
    // Photographs near the mean position gain nothing where the camera moved steadily.
    if (first && start - end < clear_motion_gain &&
        agreement(residuals, moved_residuals) < min_motion_agreement)
      path.kind = CapturePath::Kind::rest;
    const double unit = kind == shifts ? 1.0 : centre_.norm();
    for (int j = 0; j < frames_ && serves && path.kind != CapturePath::Kind::rest; ++j)
      found.push_back({path.values(j, 0) / unit, path.values(j, 1) / unit});
  }
  if (found.empty()) move_by(without);
  return (motion_ - before).cwiseAbs().maxCoeff() > 2.0 * small_step_px;
}

/// Products ⟨A_c y_k, A_d y_l⟩ of the residuals of camera channel k under the lights of primary c, of each
/// pixel: [pixels] of [3 c + k][3 d + l]; and what colour mixing makes of them.
class MixingCriterion {
 public:
  MixingCriterion(const std::array<MatrixXf, 3>& leave_one_out, const std::array<MatrixXf, 3>& y) {
    std::array<MatrixXf, 9> residuals;
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k) residuals[3 * c + k] = leave_one_out[c] * y[k];
    products_.resize(static_cast<std::size_t>(y[0].cols()));
    for (std::size_t p = 0; p < products_.size(); ++p)
      for (int a = 0; a < 9; ++a)
        for (int b = a; b < 9; ++b)
          products_[p](a, b) = products_[p](b, a) = residuals[a].col(p).dot(residuals[b].col(p));
  }

  /// Minus twice the logarithm of the likelihood of the residuals, normally distributed with a covariance of
  /// the three primaries that each pixel has, mean over pixels and images: log det R − 2 log |det M|, R the
  /// products of the residuals of M y. Noise that channels have on their own and residuals that they have in
  /// common leave it as it is; residuals that the other primaries explain do not. `gradient`: by M.
  double at(const Eigen::Matrix3d& unmix, Eigen::Matrix3d* gradient = nullptr) const {
    double value = 0.0;
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const auto& products : products_) {
      Eigen::Matrix<double, 3, 9> half;  // of M y's primary c with [3 d + l]
      for (int c = 0; c < 3; ++c) half.row(c) = unmix.row(c) * products.middleRows<3>(3 * c);
      Eigen::Matrix3d r;
      for (int d = 0; d < 3; ++d) r.col(d) = half.middleCols<3>(3 * d) * unmix.row(d).transpose();
      r.diagonal().array() += 1e-12 * r.trace() + 1e-30;
      value += std::log(r.determinant());
      if (!gradient) continue;
      const Eigen::Matrix3d inverse = r.inverse();
      for (int d = 0; d < 3; ++d) sum.row(d) += 2.0 * inverse.row(d) * half.middleCols<3>(3 * d);
    }
    const auto count = static_cast<double>(products_.size());
    if (gradient) *gradient = sum / count - 2.0 * unmix.inverse().transpose();
    return value / count - 2.0 * std::log(std::abs(unmix.determinant()));
  }

 private:
  std::vector<Eigen::Matrix<double, 9, 9>> products_;
};

/// Minimises the criterion over the entries beside the diagonal by Newton's method, with differences of the
/// gradient for the second derivatives.
Eigen::Matrix3d best_unmixing(const MixingCriterion& criterion) {
  using Entries = Eigen::Matrix<double, 6, 1>;
  constexpr std::array<std::array<int, 2>, 6> places{{{0, 1}, {0, 2}, {1, 0}, {1, 2}, {2, 0}, {2, 1}}};
  const auto with = [&](Eigen::Matrix3d m, const Entries& entries) {
    for (int i = 0; i < 6; ++i) m(places[i][0], places[i][1]) += entries[i];
    return m;
  };
  const auto gradient_at = [&](const Eigen::Matrix3d& m) {
    Eigen::Matrix3d all;
    criterion.at(m, &all);
    Entries gradient;
    for (int i = 0; i < 6; ++i) gradient[i] = all(places[i][0], places[i][1]);
    return gradient;
  };
  Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
  double value = criterion.at(m);
  for (int step = 0; step < 12; ++step) {
    constexpr double difference = 1e-4;
    Eigen::MatrixXd hessian(6, 6);
    for (int i = 0; i < 6; ++i)
      hessian.col(i) = (gradient_at(with(m, difference * Entries::Unit(i))) -
                        gradient_at(with(m, -difference * Entries::Unit(i)))) /
                       (2.0 * difference);
    const auto eigen = symmetric_eigen(0.5 * (hessian + hessian.transpose()));
    // Directions that the data say nothing about, such as under grey light, are not gone.
    const Entries along = eigen.vectors.transpose() * gradient_at(m);
    Entries move = Entries::Zero();
    for (int i = 0; i < 6; ++i)
      if (std::abs(eigen.values[i]) > 1e-3)
        move -= along[i] / std::abs(eigen.values[i]) * eigen.vectors.col(i);
    move *= std::min(1.0, 0.3 / (move.cwiseAbs().maxCoeff() + 1e-12));
    double after = criterion.at(with(m, move));
    for (int halving = 0; !(after < value) && halving < 8; ++halving) {
      move *= 0.5;
      after = criterion.at(with(m, move));
    }
    if (!(after < value)) break;
    m = with(m, move);
    value = after;
    if (move.cwiseAbs().maxCoeff() < 1e-5) break;
  }
  return m;
}

/// Residuals of all channels, each pixel's relative to what it shows.
std::array<MatrixXf, 3> RigEstimation::relative_residuals() const {
  std::array<MatrixXf, 3> residuals;
  for (int c = 0; c < 3; ++c) {
    const MatrixXf values = series(c);
    residuals[c] = leave_one_out_[c] * values;
    residuals[c].array().rowwise() /= values.colwise().norm().array() + 1e-20f;
  }
  return residuals;
}

/// A tone curve that is left out looks like colour mixing, and the other way round: both together are
/// compared with mixing alone.
bool RigEstimation::estimate_colour_and_tone() {
  const Eigen::Matrix3d mixing_before = model_.mixing;
  const auto tone_before = model_.tone;
  constexpr std::array<double, 3> straight{1.0, 1.0, 1.0};
  const auto use_tone = [&](const std::array<double, 3>& tone) {
    model_.tone = tone;
    use_exponents();
  };
  if (model_.bends_tone()) use_tone(straight);
  estimate_colour();
  const Eigen::Matrix3d mixing_alone = model_.mixing;
  const auto residuals = relative_residuals();
  const double straight_criterion = total_criterion();
  for (int k = 0; k < 4 && predictors_.are_mixtures(); ++k) {
    const auto tone = best_exponents();
    double change = 0.0;
    for (int c = 0; c < 3; ++c) change = std::max(change, std::abs(tone[c] - model_.tone[c]));
    if (change < 1e-3) break;
    use_tone(tone);
    estimate_colour();
  }
  if (model_.bends_tone()) {
    const double agrees = agreement(residuals, relative_residuals());
    const double evidence = predictors_.different_lights() * (straight_criterion - total_criterion());
    double bend = 0.0;
    for (const double exponent : model_.tone) bend = std::max(bend, std::abs(exponent - 1.0));
    // Of a normal distribution, evidence is half of the square of bend ∕ uncertainty.
    if (agrees < min_agreement || evidence < min_tone_evidence ||
        bend > max_tone_uncertainty * std::sqrt(2.0 * evidence)) {
      model_.mixing = mixing_alone;
      prepare();
      use_tone(straight);
    }
  }
  double change = (model_.mixing - mixing_before).cwiseAbs().maxCoeff();
  for (int c = 0; c < 3; ++c) change = std::max(change, std::abs(model_.tone[c] - tone_before[c]));
  return change > 1e-3;
}

/// Channels of photographs under single primaries, over the primary's own: medians over the pixels that are
/// brighter there than the median. The tone curve and gains do not matter, nor do shifts.
std::optional<Eigen::Matrix3d> RigEstimation::measure_mixing() const {
  const auto median = [](std::vector<double> values) {
    const auto middle = values.begin() + std::ssize(values) / 2;
    std::ranges::nth_element(values, middle);
    return *middle;
  };
  const std::array<MatrixXf, 3> y{series(0), series(1), series(2)};
  const auto primaries = primary_images(lights_);
  Eigen::Matrix3d mixing = Eigen::Matrix3d::Identity();
  for (int c = 0; c < 3; ++c) {
    std::array<std::vector<double>, 3> ratios;
    for (Index i = 0; i < images_; ++i) {
      if (std::ranges::find(primaries[c], chosen_[static_cast<std::size_t>(i)]) == primaries[c].end())
        continue;
      const double least = median({y[c].row(i).begin(), y[c].row(i).end()});
      for (Index p = 0; p < y[c].cols(); ++p)
        if (const double own = y[c](i, p); own > 0.0 && own >= least)
          for (int k = 0; k < 3; ++k) ratios[k].push_back(y[k](i, p) / own);
    }
    if (ratios[0].empty()) return std::nullopt;
    for (int k = 0; k < 3; ++k) mixing(k, c) = k == c ? 1.0 : median(std::move(ratios[k]));
  }
  const Eigen::Matrix3d none = Eigen::Matrix3d::Identity();
  const double largest = (mixing - none).cwiseAbs().maxCoeff();
  if (largest < min_mixing) return none;
  const MixingCriterion criterion(leave_one_out_, y);  // the other photographs must not contradict it
  const double evidence =
      static_cast<double>(images_) * (criterion.at(none) - criterion.at(mixing.inverse()));
  if (!(largest < max_mixing) || !(evidence > min_evidence)) return std::nullopt;
  return mixing;
}

void RigEstimation::estimate_colour() {
  if (measured_mixing_) return;
  doubtful_mixing_ = 0.0;
  if (model_.mixes_colours()) {
    model_.mixing.setIdentity();
    prepare();
  }
  const MixingCriterion criterion(leave_one_out_, {series(0), series(1), series(2)});
  const Eigen::Matrix3d unmix = best_unmixing(criterion);
  Eigen::Matrix3d mixing = unmix.inverse();
  mixing = (mixing * mixing.diagonal().cwiseInverse().asDiagonal()).eval();
  const double largest = (mixing - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  const double evidence =
      static_cast<double>(images_) * (criterion.at(Eigen::Matrix3d::Identity()) - criterion.at(unmix));
  if (!mixing.allFinite() || largest < min_mixing || largest > max_mixing || evidence < min_evidence) return;
  const auto residuals = relative_residuals();
  model_.mixing = mixing;
  prepare();
  const double agrees = agreement(residuals, relative_residuals());
  if (agrees > min_agreement) return;
  if (largest > min_doubtful_mixing && agrees > 0.0) doubtful_mixing_ = largest;
  model_.mixing.setIdentity();
  prepare();
}

/// The exponent of each channel, by a search for the least criterion that ends with a parabola.
std::array<double, 3> RigEstimation::best_exponents() {
  predictors_.prepare_exponents();
  std::array<double, 3> found{1.0, 1.0, 1.0};
  tbb::parallel_for(0, 3, [&](int c) {
    const MatrixXf values = series(c);
    const auto at = [&](double exponent) {
      run_.throw_if_stopped();
      return criterion(predictors_.leave_one_out(c, exponent), values);
    };
    double centre = 1.0, width = 0.04, middle = at(1.0), low = at(centre - width), high = at(centre + width);
    for (int step = 0; step < 16 && (low < middle || high < middle) && std::abs(centre - 1.0) < 0.4; ++step) {
      if (low < high) {
        centre -= width;
        high = std::exchange(middle, low);
        low = at(centre - width);
      } else {
        centre += width;
        low = std::exchange(middle, high);
        high = at(centre + width);
      }
    }
    const bool has_minimum = middle <= low && middle <= high;
    for (int narrowing = 0; has_minimum && narrowing < 3; ++narrowing) {
      const double curvature = low - 2.0 * middle + high;
      if (!(curvature > 0.0)) break;
      const double best = centre + 0.5 * width * (low - high) / curvature;
      found[c] = best;
      if (std::abs(best - 1.0) < min_exponent) break;
      centre = best;
      width /= 3.0;
      middle = at(centre);
      low = at(centre - width);
      high = at(centre + width);
    }
  });
  for (double& exponent : found)
    if (std::abs(exponent - 1.0) < min_exponent) exponent = 1.0;
  return found;
}

struct RigEstimation::Brightness {
  VectorXd room, room_variance;  ///< [images]: share of the scene, mean 0
};

double RigEstimation::criterion_of(const std::array<MatrixXf, 3>& y) const {
  return (criterion(leave_one_out_[0], y[0]) + criterion(leave_one_out_[1], y[1]) +
          criterion(leave_one_out_[2], y[2])) /
         3.0;
}

/// Least squares of ‖A (y − gain ∘ y − room · scene)‖² with the expected size of both as prior.
RigEstimation::Brightness RigEstimation::solve_brightness(const std::array<MatrixXf, 3>& y,
                                                          const RoomPicture& scene) const {
  constexpr Index parts = 2;
  MatrixXd normal = MatrixXd::Zero(parts * images_, parts * images_);
  VectorXd right = VectorXd::Zero(parts * images_);
  for (int c = 0; c < 3; ++c) {
    const MatrixXf& a = leave_one_out_[c];
    const MatrixXf residual = a * y[c], squared = a.transpose() * a, pull = a.transpose() * residual;
    const Eigen::VectorXf weights = inverse_powers(residual);
    const std::array<MatrixXf, 2> by{y[c], scene[c].transpose().replicate(images_, 1)};
    for (Index i = 0; i < parts; ++i) {
      const MatrixXf weighted = by[i] * weights.asDiagonal();
      right.segment(i * images_, images_) += weighted.cwiseProduct(pull).rowwise().sum().cast<double>();
      for (Index k = 0; k < parts; ++k)
        normal.block(i * images_, k * images_, images_, images_) +=
            squared.cwiseProduct(MatrixXf(weighted * by[k].transpose())).cast<double>();
    }
  }
  const double share = independent_pixels * static_cast<double>(images_) / static_cast<double>(y[0].cols());
  normal *= share;
  normal.diagonal().array() += 1.0 / (expected_gain * expected_gain);
  const MatrixXd covariance = inverse(normal);
  const VectorXd solution = covariance * (share * right);
  Brightness found;
  found.room = solution.tail(images_);
  found.room.array() -= found.room.mean();
  found.room_variance = covariance.diagonal().tail(images_);
  return found;
}

/// How much more of the photographs' residuals lies along what they show themselves than along other
/// directions that photographs show (the largest own_directions − 1 principal ones): a wrong gain leaves a
/// residual proportional to the photograph, light that the predictor does not know leaves any. Of the
/// channels from `first` to before `last`.
double RigEstimation::own_share(const std::array<MatrixXf, 3>& y, int first, int last) const {
  MatrixXd seen = MatrixXd::Zero(images_, images_), crossed = seen;  // ⟨y_i, y_j⟩ and ⟨residual_i, y_j⟩
  for (int c = first; c < last; ++c) {
    const MatrixXf residual = leave_one_out_[c] * y[c];
    const Eigen::VectorXf weights = inverse_powers(residual);
    const MatrixXf weighted = y[c] * weights.asDiagonal();
    seen += MatrixXf(weighted * y[c].transpose()).cast<double>();
    crossed += MatrixXf(residual * weighted.transpose()).cast<double>();
  }
  const VectorXd lengths = seen.diagonal().cwiseSqrt().cwiseMax(1e-20);
  const auto normalise = lengths.cwiseInverse().asDiagonal();
  const auto eigen = symmetric_eigen(normalise * seen * normalise);
  const Index directions = std::min<Index>(own_directions, images_);
  const MatrixXd vectors = eigen.vectors.rightCols(directions);
  const VectorXd sizes = eigen.values.tail(directions).cwiseMax(1e-12).cwiseSqrt();
  const auto scale = sizes.cwiseInverse().asDiagonal();
  const MatrixXd of_residuals = crossed * normalise * vectors * scale;
  MatrixXd of_photographs = vectors * sizes.asDiagonal();
  of_photographs.rowwise().normalize();
  const VectorXd own = of_residuals.cwiseProduct(of_photographs).rowwise().sum().cwiseAbs2();
  const double others = of_residuals.squaredNorm() - own.sum();
  return others > 0.0 ? own.sum() * static_cast<double>(directions - 1) / others : 0.0;
}

/// Share of the power of gain × mean photograph that unblurred lights predict of each photograph from the
/// others: sources whose strength differs from that in their maps change the brightness of all pixels as
/// gains do, but follow from the light.
double RigEstimation::share_of_lights(const MatrixXd& gains, const std::array<MatrixXf, 3>& y) const {
  double residual = 0.0;
  for (int c = 0; c < 3; ++c) {
    const MatrixXd lights = lights_.of_channel[c][0](Eigen::all, chosen_);
    MatrixXd gram = lights.transpose() * lights;
    gram /= std::max(1e-30, gram.trace() / static_cast<double>(images_));
    gram.array() += 1.0;
    const MatrixXd inverse = ridge_inverse(gram, 1e-3);
    const Eigen::VectorXf weights = (y[c].colwise().norm().transpose().array() + 1e-20f).inverse();
    VectorXd change = gains.col(c).cwiseProduct((y[c] * weights).cast<double>());
    change.array() -= change.mean();
    residual +=
        (inverse * change).cwiseQuotient(inverse.diagonal()).squaredNorm() / (change.squaredNorm() + 1e-30);
  }
  return 1.0 - residual / 3.0;
}

/// A drift of each channel's brightness over the photographs in their order, as of a monitor that
/// warms up: polynomials of three degrees, distinguished from room light that drifts. All photographs measure
/// them, so that they are known ten times as well as the gain of one. Returns whether there is one.
bool RigEstimation::estimate_drift(const std::array<MatrixXf, 3>& y, const RoomPicture& scene) {
  constexpr Index degrees = 3;
  const auto polynomials = [&](double j) {  // of Legendre, over the capture
    const double t = 2.0 * j / std::max(1, frames_ - 1) - 1.0;
    return Eigen::RowVector3d(t, 0.5 * (3.0 * t * t - 1.0), 0.5 * (5.0 * t * t - 3.0) * t);
  };
  MatrixXd path(images_, degrees);
  for (Index i = 0; i < images_; ++i) path.row(i) = polynomials(static_cast<double>(chosen_[i]));
  Eigen::Matrix3d with_room, alone;  // [degrees × channels]
  double evidence = 0.0, evidence_of_room = 0.0;
  for (int c = 0; c < 3; ++c) {
    const MatrixXf& a = leave_one_out_[c];
    MatrixXf residual = a * y[c];
    const Eigen::VectorXf weights = inverse_powers(residual).cwiseSqrt();
    residual *= weights.asDiagonal();
    std::array<MatrixXf, 2 * degrees> columns;
    for (Index k = 0; k < degrees; ++k) {
      const Eigen::VectorXf along = path.col(k).cast<float>();
      columns[k] = a * (along.asDiagonal() * y[c] * weights.asDiagonal());
      columns[degrees + k] = a * along * scene[c].cwiseProduct(weights).transpose();
    }
    MatrixXd normal(2 * degrees, 2 * degrees), scores(images_, 2 * degrees);
    VectorXd right(2 * degrees), both;
    MatrixXf left = residual;
    // A few photographs that are predicted badly, as of a light stage, must not decide. The first pass, which
    // takes the drift itself for that, finds less of it.
    for (const bool decides : {true, false}) {
      const Eigen::VectorXf by_photograph = inverse_powers(left.transpose());
      const auto product = [&](const MatrixXf& u, const MatrixXf& v) {
        return VectorXd(u.cwiseProduct(v).rowwise().sum().cwiseProduct(by_photograph).cast<double>());
      };
      for (Index i = 0; i < 2 * degrees; ++i) {
        right[i] = product(columns[i], residual).sum();
        for (Index k = 0; k < 2 * degrees; ++k) normal(i, k) = product(columns[i], columns[k]).sum();
      }
      const MatrixXd inverse = ridge_inverse(normal, 1e-6 * normal.trace());
      both = inverse * right;
      if (!decides) break;
      left = residual;
      for (Index k = 0; k < 2 * degrees; ++k) left -= static_cast<float>(both[k]) * columns[k];
      // Errors of the predictor are common to the pixels of a photograph, and differ between photographs.
      for (Index k = 0; k < 2 * degrees; ++k) scores.col(k) = product(columns[k], left);
      const MatrixXd covariance = inverse * (scores.transpose() * scores) * inverse;
      const auto clear = [&](Index first) {
        const Eigen::Vector3d part = both.segment<degrees>(first);
        return part.dot(Eigen::Matrix3d(covariance.block<degrees, degrees>(first, first)).inverse() * part);
      };
      evidence = std::max(evidence, clear(0));
      evidence_of_room = std::max(evidence_of_room, clear(degrees));
    }
    with_room.col(c) = both.head<degrees>();
    alone.col(c) =
        Eigen::Matrix3d(normal.topLeftCorner<degrees, degrees>()).inverse() * right.head<degrees>();
  }
  const bool in_doubt = !model_.shift_px.empty() || relative(criterion_of(y)) > max_residual_of_drift;
  const double least = in_doubt ? min_drift_evidence_in_doubt : min_drift_evidence;
  const Eigen::Matrix3d& found = evidence_of_room < least ? alone : with_room;
  const MatrixXd drift = path * found;
  drift_ = 0.0;
  if (evidence < least || drift.cwiseAbs().maxCoeff() < min_drift ||
      share_of_lights(drift, y) > max_share_of_lights)
    return false;
  drift_ = ((polynomials(frames_ - 1) - polynomials(0)) * found).cwiseAbs().maxCoeff();
  model_.gain.resize(static_cast<std::size_t>(frames_));
  for (int j = 0; j < frames_; ++j)
    Eigen::RowVector3d::Map(model_.gain[static_cast<std::size_t>(j)].data()) =
        (1.0 - (polynomials(j) * found).array()).inverse();
  return true;
}

/// Gains of each photograph and channel, and room light, which changes along a path. Both change the
/// brightness: room light is taken where its few parameters explain as much.
bool RigEstimation::estimate_brightness() {
  if (predictors_.different_lights() < min_lights_for_gains ||
      relative(total_criterion()) > max_residual_of_gains)
    return false;
  const auto gain_before = model_.gain;
  const auto room_before = model_.room;
  model_.gain.clear();
  model_.room.clear();
  prepare();
  std::array<MatrixXf, 3> y{series(0), series(1), series(2)};
  RoomPicture scene = room_picture(y);
  if (estimate_drift(y, scene)) {
    prepare();
    y = {series(0), series(1), series(2)};
    scene = room_picture(y);
  }
  const double start = criterion_of(y);
  // Room light: its changes by the joint solution, its mean by the constants that pixels have.
  std::array<MatrixXf, 3> dark = y;
  VectorXd room = VectorXd::Zero(frames_), measured = VectorXd::Zero(images_);
  for (int step = 0; step < 3; ++step) {  // the prior holds back the first
    const Brightness found = solve_brightness(dark, scene);
    measured = room(chosen_) + found.room;
    room = choose_path(measured, found.room_variance, chosen_, frames_, room_floor).values.col(0);
    room.array() -= room(chosen_).mean();
    dark = y;
    for (int c = 0; c < 3; ++c) dark[c] -= room(chosen_).cast<float>() * scene[c].transpose();
    if (room.isZero()) break;
  }
  const double change = std::sqrt(room(chosen_).squaredNorm() / static_cast<double>(images_));
  const bool changes = change > min_room_change && start - criterion_of(dark) > min_room_gain;
  if (changes) y = dark;
  const double least_room = changes && !has_ambient_ ? -room(chosen_).minCoeff() : 0.0;
  const double mean_room = mean_room_light(y, scene, least_room);
  assumes_dark_ = least_room > 0.0 && mean_room == least_room;
  if (changes || mean_room != 0.0)
    for (int j = 0; j < frames_; ++j)
      model_.room.push_back(room_scale_ * (mean_room + (changes ? room[j] : 0.0)));
  if (model_.room.empty())
    model_.ambient_room = false;
  else
    prepare();
  // Gains: of all channels, and what each channel has besides.
  const auto corrected = [&](const MatrixXd& gains) {
    std::array<MatrixXf, 3> result = y;
    for (int c = 0; c < 3; ++c) result[c].array().colwise() *= (1.0 - gains.col(c).array()).cast<float>();
    return criterion_of(result);
  };
  const auto size_of = [](const MatrixXd& gains) {
    return std::sqrt(gains.squaredNorm() / static_cast<double>(gains.size()));
  };
  const auto common_of = [](const MatrixXd& gains) {
    return MatrixXd(gains.rowwise().mean().replicate(1, 3));
  };
  MatrixXd gain = solve_gains(y, expected_gain, expected_gain);
  MatrixXd common = common_of(gain);
  const auto balance_of = [&](const MatrixXd& gains) { return size_of(gains - common_of(gains)); };
  const auto is_clear = [&] {
    if (model_.shift_px.empty()) return balance_of(refined_gains(expected_gain, expected_gain)) > min_balance;
    return balance_of(gain) > min_balance_of_moving &&
           (own_share(y, 0, 1) + own_share(y, 1, 2) + own_share(y, 2, 3)) / 3.0 > min_own_share_of_channels;
  };
  const bool balances =
      corrected(common) - corrected(gain) > min_balance_gain && balance_of(gain) > min_balance && is_clear();
  const double expected_balance = balances ? std::max(expected_gain, wider * balance_of(gain)) : no_balance;
  const double expected_common = size_of(common) > 2.0 * expected_gain ? size_of(common) : expected_gain;
  gain = solve_gains(y, expected_common, expected_balance);
  common = common_of(gain);
  if (!balances) gain = common;
  // Channels that vary by themselves have a mean that varies, too.
  const bool gains = balances || (corrected(gain - common) - corrected(gain) > min_gain_gain &&
                                  size_of(common) > min_gain && own_share(y, 0, 3) > min_own_share);
  if (gains && share_of_lights(gain, y) < max_share_of_lights) {
    constexpr double free = 2.0;  // of a prior: hardly holds back what these tell better
    gain = refined_gains(expected_common, balances ? free * expected_balance : no_balance);
    if (!balances) gain = common_of(gain);
    model_.gain.resize(static_cast<std::size_t>(frames_), {1.0, 1.0, 1.0});  // which a drift has set
    for (Index i = 0; i < images_; ++i)
      for (int c = 0; c < 3; ++c) model_.gain[static_cast<std::size_t>(chosen_[i])][c] /= 1.0 - gain(i, c);
  }
  prepare();
  if (gain_before.size() != model_.gain.size() || room_before.size() != model_.room.size()) return true;
  double largest = 0.0;
  for (std::size_t j = 0; j < model_.gain.size(); ++j)
    for (int c = 0; c < 3; ++c) largest = std::max(largest, std::abs(model_.gain[j][c] - gain_before[j][c]));
  for (std::size_t j = 0; j < model_.room.size(); ++j)
    largest = std::max(largest, std::abs(model_.room[j] - room_before[j]));
  return largest > 1e-3;
}

/// Inverse covariance [3 images × 3 images], by channels, of gains that all channels have and of their own.
MatrixXd gain_prior(Index images, double expected_common, double expected_balance) {
  const Eigen::Matrix3d covariance = expected_common * expected_common * Eigen::Matrix3d::Ones() +
                                     expected_balance * expected_balance * Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d precision = covariance.inverse();
  MatrixXd prior = MatrixXd::Zero(3 * images, 3 * images);
  for (int c = 0; c < 3; ++c)
    for (int d = 0; d < 3; ++d)
      prior.block(c * images, d * images, images, images).diagonal().array() = precision(c, d);
  return prior;
}

/// Gains of each photograph and channel [images × 3], relative to 1: least squares of ‖A (y − gain ∘ y)‖²
/// with a prior of gains that all channels have, and of their own.
MatrixXd RigEstimation::solve_gains(const std::array<MatrixXf, 3>& y, double expected_common,
                                    double expected_balance) const {
  MatrixXd normal = gain_prior(images_, expected_common, expected_balance);
  VectorXd right(3 * images_);
  const double share = independent_pixels * static_cast<double>(images_) / static_cast<double>(y[0].cols());
  for (int c = 0; c < 3; ++c) {
    const MatrixXf& a = leave_one_out_[c];
    const MatrixXf residual = a * y[c], squared = a.transpose() * a, pull = a.transpose() * residual;
    const Eigen::VectorXf weights = inverse_powers(residual);
    const MatrixXf weighted = y[c] * weights.asDiagonal();
    normal.block(c * images_, c * images_, images_, images_) +=
        share * squared.cwiseProduct(MatrixXf(weighted * y[c].transpose())).cast<double>();
    right.segment(c * images_, images_) = share * weighted.cwiseProduct(pull).rowwise().sum().cast<double>();
  }
  const VectorXd solution = solve_symmetric(normal, right);
  MatrixXd gains = Eigen::Map<const MatrixXd>(solution.data(), images_, 3);
  gains.rowwise() -= gains.colwise().mean().eval();
  return gains;
}

/// Gains [images × 3] once more, by Gaussian processes: each principal direction of the pixels' series
/// follows from the lights by a covariance over the map, smooth or with more detail, and has noise of its
/// own, those that make it most likely (Rasmussen and Williams 2006, chapter 5). Directions that the lights
/// tell well count more, and what pixels have in common counts once. Pixels taken for independent, as in
/// solve_gains(), take the changes of the transport that they share for gains.
MatrixXd RigEstimation::refined_gains(double expected_common, double expected_balance) const {
  constexpr Index max_directions = 20;                                   // more hold noise
  constexpr int rounds = 3;                                              // more take the noise for gains
  constexpr std::array noises{1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0};  // variance, 1: of what is smooth
  const auto count = static_cast<double>(images_);
  const MatrixXd prior = gain_prior(images_, expected_common, expected_balance);
  const std::vector<Place> places = bright_places(pixels_for_gains);
  std::array<std::vector<SymmetricEigen>, 3> covariances;
  std::array<MatrixXd, 3> scaled;  // to the brightness of the light
  for (int c = 0; c < 3; ++c) {
    VectorXd brightness;
    for (const MatrixXd& gram : predictors_.smooth_grams(c, model_.tone[c], brightness))
      covariances[c].push_back(symmetric_eigen(gram));
    scaled[c] = brightness.cwiseInverse().asDiagonal() * series(c, places).cast<double>();
  }
  MatrixXd gains = MatrixXd::Zero(images_, 3);
  for (int round = 0; round < rounds; ++round) {
    MatrixXd normal = prior;
    VectorXd right = -prior * gains.reshaped();
    for (int c = 0; c < 3; ++c) {
      run_.throw_if_stopped();
      MatrixXd pixels = (1.0 - gains.col(c).array()).matrix().asDiagonal() * scaled[c];
      pixels.array().rowwise() /= pixels.colwise().norm().array() + 1e-20;
      const MatrixXd along =
          symmetric_eigen(pixels * pixels.transpose()).vectors.rightCols(std::min(max_directions, images_));
      VectorXd likelihood = VectorXd::Constant(along.cols(), -std::numeric_limits<double>::infinity());
      std::vector<std::pair<const SymmetricEigen*, VectorXd>> best(static_cast<std::size_t>(along.cols()));
      for (const SymmetricEigen& covariance : covariances[c]) {
        const MatrixXd powers = (covariance.vectors.transpose() * along).cwiseAbs2();
        for (const double noise : noises) {
          const VectorXd by = (covariance.values.array().max(0.0) + noise).inverse();
          for (Index k = 0; k < along.cols(); ++k) {
            const double variance = by.dot(powers.col(k)) / count;
            const double now = by.array().log().sum() - count * std::log(variance);
            if (now <= likelihood[k]) continue;
            likelihood[k] = now;
            best[static_cast<std::size_t>(k)] = {&covariance, by / variance};
          }
        }
      }
      for (Index k = 0; k < along.cols(); ++k) {
        const auto& [covariance, by] = best[static_cast<std::size_t>(k)];
        const MatrixXd inverse = covariance->vectors * by.asDiagonal() * covariance->vectors.transpose();
        const VectorXd pull = inverse * along.col(k);
        // The gain is seen where the others predict a sample: what it shows besides is noise.
        const VectorXd predicted = along.col(k) - pull.cwiseQuotient(inverse.diagonal());
        normal.block(c * images_, c * images_, images_, images_) +=
            inverse.cwiseProduct(predicted * predicted.transpose());
        right.segment(c * images_, images_) += predicted.cwiseProduct(pull);
      }
    }
    gains += solve_symmetric(normal, right).reshaped(images_, 3);
    gains.rowwise() -= gains.colwise().mean().eval();
  }
  return gains;
}

/// Room light that all photographs have, as a share of the scene; 0 where pixels have no constants. At least
/// `least`, so that no photograph shows less than none, where patterns of one brightness do not tell it.
double RigEstimation::mean_room_light(const std::array<MatrixXf, 3>& y, const RoomPicture& scene,
                                      double least) const {
  double product = 0.0, power = 0.0;
  std::array<MatrixXf, 3> without, with;
  for (int c = 0; c < 3; ++c) {
    const Eigen::VectorXf constants = predictors_.constants(c, model_.tone[c], y[c]);
    const MatrixXf residual = leave_one_out_[c] * y[c];
    const Eigen::VectorXf weights = inverse_powers(residual);
    product += weights.cwiseProduct(constants).dot(scene[c]);
    power += weights.cwiseProduct(scene[c]).dot(scene[c]);
    without[c] = predictors_.leave_one_out(c, model_.tone[c], false) * y[c];
    with[c] = residual;
  }
  const double mean = power > 0.0 ? product / power : 0.0;
  const double agrees = agreement(without, with);
  if (std::abs(mean) > min_room && agrees > min_room_agreement) return std::max(mean, least);
  return agrees > no_room_agreement ? least : 0.0;
}

RigReport RigEstimation::report() const {
  RigReport report{model_, {}};
  const double after = places_.size() < 50 ? 0.0 : total_criterion();
  const auto add = [&](const char* effect, bool corrected, double amount, const std::string& measured) {
    report.findings.push_back({effect, corrected ? RigFinding::State::corrected : RigFinding::State::good,
                               amount, measured, relative(before_), relative(corrected ? after : before_)});
  };
  char text[300];
  if (lost_track_) {
    std::snprintf(text, sizeof text, "the camera moved by more than %.0f pixels", max_shift_px);
    if (jump_px_ > max_shift_px)
      std::snprintf(text, sizeof text, "the camera moved by about %.0f pixels near %.100s", jump_px_,
                    model_.photographs[static_cast<std::size_t>(jump_near_)].c_str());
    add("motion", false, std::max(jump_px_, max_shift_px), std::string(text) + ", too far to be corrected");
    report.findings.back().state = RigFinding::State::unusable;
  } else if (path_[shifts].kind == CapturePath::Kind::rest) {
    add("motion", false, 0.0, "the camera rested");
  } else {
    const CapturePath& path = path_[shifts];
    Index at = 0;
    const double amount = std::sqrt(path.values.rowwise().squaredNorm().maxCoeff(&at));
    const Eigen::RowVector2d largest = path.values.row(at);
    std::string how = "the camera moved from photograph to photograph";
    if (path.kind == CapturePath::Kind::line) how = "the camera moved steadily";
    if (path.kind == CapturePath::Kind::jumps) {
      how = "the camera moved after";
      for (const int j : path.jumps) how += " " + model_.photographs[static_cast<std::size_t>(j - 1)];
    }
    std::snprintf(text, sizeof text, ", the picture by up to %.2f pixels (%+.2f to the right, %+.2f down)",
                  amount, largest[0], largest[1]);
    const bool moved_back = !model_.shift_px.empty();
    add("motion", moved_back, amount,
        how + text + (moved_back ? "" : "; moving photographs back would blur more than it corrects"));
    if (!moved_back) report.findings.back().state = RigFinding::State::suspicious;
  }
  if (const CapturePath& turn = path_[turns]; turn.kind != CapturePath::Kind::rest) {
    RigFinding& motion = report.findings.back();
    Index at = 0;
    const double amount = std::sqrt(turn.values.rowwise().squaredNorm().maxCoeff(&at));
    std::snprintf(
        text, sizeof text,
        "%sthe picture turned by %.2f degrees and grew by %.2f %%, up to %.2f pixels at its corners",
        motion.amount > 0.0 ? (motion.measured + "; ").c_str() : "",
        turn.values(at, 0) / centre_.norm() * 180.0 / std::numbers::pi,
        100.0 * turn.values(at, 1) / centre_.norm(), amount);
    motion.measured = text;
    motion.state = model_.turn.empty() ? RigFinding::State::suspicious : RigFinding::State::corrected;
    motion.residual_after = relative(model_.turn.empty() ? before_ : after);
    motion.amount = std::max(motion.amount, amount);
  }
  const Eigen::Matrix3d& m = model_.mixing;
  const double mixed = (m - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  std::snprintf(text, sizeof text,
                "the camera's red sees %.1f %% of green and %.1f %% of blue light, green %.1f %% of red and "
                "%.1f %% of blue, "
                "blue %.1f %% of red and %.1f %% of green",
                100 * m(0, 1), 100 * m(0, 2), 100 * m(1, 0), 100 * m(1, 2), 100 * m(2, 0), 100 * m(2, 1));
  add("colour", model_.mixes_colours(), mixed,
      model_.mixes_colours() ? text : "camera channels and primaries correspond");
  if (!model_.mixes_colours() && doubtful_mixing_ > 0.0) {
    std::snprintf(text, sizeof text,
                  "camera channels seem to see up to %.0f %% of other primaries, but pixels do not agree",
                  100.0 * doubtful_mixing_);
    report.findings.back().measured = text;
    report.findings.back().amount = doubtful_mixing_;
    report.findings.back().state = RigFinding::State::suspicious;
  }
  const auto& t = model_.tone;
  std::snprintf(text, sizeof text,
                "the light follows its maps with exponents of %.3f, %.3f, %.3f (red, green, blue)", t[0],
                t[1], t[2]);
  add("tone", model_.bends_tone(), std::max({std::abs(t[0] - 1), std::abs(t[1] - 1), std::abs(t[2] - 1)}),
      model_.bends_tone() ? text : "the light follows its maps");
  double most = 0.0;
  for (const auto& gain : model_.gain)
    for (const double of : gain) most = std::max(most, std::abs(of - 1.0));
  std::snprintf(text, sizeof text, "the brightness of photographs is off by up to %.1f %%", 100.0 * most);
  if (drift_ > 0.0)
    std::snprintf(text, sizeof text,
                  "the brightness of photographs is off by up to %.1f %%, and drifted by %.1f %% from the "
                  "first to the last",
                  100.0 * most, 100.0 * drift_);
  add("gain", !model_.gain.empty(), most, model_.gain.empty() ? "photographs are equally exposed" : text);
  most = 0.0;
  for (const double room : model_.room) most = std::max(most, std::abs(room));
  std::snprintf(text, sizeof text, "room light of up to %.1f %% of the %s photograph%s", 100.0 * most,
                model_.ambient_room ? "ambient" : "mean",
                model_.ambient_room ? " was left"
                : assumes_dark_     ? ", if the photograph with the least of it has none"
                                    : "");
  add("room light", !model_.room.empty(), most, model_.room.empty() ? "none was found" : text);
  return report;
}

}  // namespace

std::array<std::vector<int>, 3> primary_images(const LightFeatures& lights) {
  std::array<std::vector<int>, 3> images;
  for (int j = 0; j < lights.images(); ++j) {
    std::array<double, 3> sums;
    for (int c = 0; c < 3; ++c) sums[c] = lights.of_channel[c][0].col(j).sum();
    const double all = sums[0] + sums[1] + sums[2];
    for (int c = 0; c < 3; ++c)
      if (sums[c] > 0.0 && all - sums[c] <= 1e-6 * all) images[c].push_back(j);
  }
  return images;
}

RigReport estimate_rig(std::span<const CaptureFrame> frames, const std::vector<char>& left_out,
                       const CaptureSession& session, const Mask& mask, float clip_level,
                       const LightFeatures& lights, const RunContext& run) {
  if (std::ranges::count(left_out, 0) < min_frames_for_rig) return {};
  return RigEstimation(frames, left_out, session, mask, clip_level, lights, run).run();
}

}  // namespace refield
