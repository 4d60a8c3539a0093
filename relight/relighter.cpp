// SPDX-License-Identifier: Apache-2.0
#include "relight/relighter.h"

#include <tbb/parallel_for.h>

#include <bit>

namespace refield {

namespace {

/// From how many texels on whole-number tables are not accurate enough (see FixedPointTable).
constexpr std::int64_t max_fixed_point_texels = 1 << 20;

/// Light that came or went leaves rounding of about 6e-8 of itself behind: at this many times all light, the
/// sum is 1e-6 of the image.
constexpr double max_moved_light = 16.0;

/// `common` keeps its memory from one light to the next.
void sum_common(const std::vector<double>& smooth, const BoxSumTable& table,
                const std::vector<SmallBox>& boxes, Coefficients& common) {
  common.resize(smooth.size() + boxes.size() * 3 + 1);
  std::ranges::transform(smooth, common.begin(), [](double sum) { return static_cast<float>(sum); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, boxes.size(), 1024), [&](const auto& range) {
    std::array<float, 4 * 64> sums;
    for (std::size_t first = range.begin(); first < range.end(); first += 64) {
      const std::size_t count = std::min<std::size_t>(64, range.end() - first);
      table.sum(std::span(boxes).subspan(first, count), sums.data());
      for (std::size_t k = 0; k < count; ++k)
        std::copy_n(sums.data() + 4 * k, 3, common.data() + smooth.size() + 3 * (first + k));
    }
  });
}

/// By the exponents' bits, which compilers compare in vectors.
bool are_finite(std::span<const float> values) {
  constexpr std::uint32_t exponent = 0x7f800000u;
  std::uint32_t largest = 0;
  for (const float value : values)
    largest = std::max(largest, std::bit_cast<std::uint32_t>(value) & exponent);
  return largest != exponent;
}

[[noreturn]] void refuse_light() {
  throw InputError("the light map contains NaN or infinite values; replace them");
}

/// Whether all values are finite.
bool copy(const ImageView& from, Image& to) {
  if (to.width != from.width || to.height != from.height) to = Image(from.width, from.height, 3);
  const bool is_dense = from.channel_stride == 1 && from.pixel_stride == 3;
  std::atomic<bool> finite = true;
  tbb::parallel_for(tbb::blocked_range<int>(0, from.height, 16), [&](const auto& range) {
    for (int y = range.begin(); y < range.end(); ++y) {
      float* out = to.row(y).data();
      if (is_dense)
        std::copy_n(from.values + y * from.row_stride, std::size_t{3} * from.width, out);
      else
        for (int x = 0; x < from.width; ++x)
          for (int c = 0; c < 3; ++c) *out++ = from.at(x, y, c);
      if (!are_finite(to.row(y))) finite = false;
    }
  });
  return finite;
}

double sum_of(const Image& image) {
  double sum = 0.0;
  for (const float value : image.values) sum += std::abs(value);
  return sum;
}

RelightPrecision precision_for(const ReflectanceField& field, RelightPrecision requested) {
  const auto is_negative = [](float weight) { return weight < 0.0f; };
  return std::ranges::any_of(field.transfer.weight, is_negative) ? RelightPrecision::fine : requested;
}

int bits_of(RelightPrecision precision) {
  return precision == RelightPrecision::fast ? 8 : 16;
}

}  // namespace

TileRelighter::TileRelighter(const FieldOutline& field, RelightPrecision precision)
    : domain_(field.basis.domain),
      output_from_primaries_(field.output_from_primaries),
      mixes_colours_(field.mixes_colours()),
      smooth_(field.basis),
      precision_(precision),
      image_(field.width, field.height, 3) {
  if (precision == RelightPrecision::fine ||
      std::int64_t{domain_.width} * domain_.height > max_fixed_point_texels)
    tables_.emplace<DoubleTable>();
}

TileRelighter::TileRelighter(const ReflectanceField& field, RelightPrecision precision)
    : TileRelighter(static_cast<const FieldOutline&>(field), precision_for(field, precision)) {
  transfer_ = std::make_shared<const TransferTiles>(tile_transfer(field, bits_of(precision_)));
  list_boxes(field.basis);
}

TileRelighter::TileRelighter(ReflectanceField&& field, RelightPrecision precision)
    : TileRelighter(static_cast<const FieldOutline&>(field), precision_for(field, precision)) {
  transfer_ = std::make_shared<const TransferTiles>(tile_transfer(std::move(field), bits_of(precision_)));
  // NOLINTNEXTLINE(bugprone-use-after-move): the transfer alone is gone.
  list_boxes(field.basis);
}

TileRelighter::TileRelighter(PackedField&& packed)
    : TileRelighter(packed.outline, packed.bits() == 8 ? RelightPrecision::fast : RelightPrecision::fine) {
  transfer_ = std::make_shared<const TransferTiles>(std::move(packed.tiles));
  list_boxes(packed.outline.basis);
}

void TileRelighter::list_boxes(const LightBasis& basis) {
  sums_suffice_ = box_sums_suffice(basis);
  std::visit(
      [&](const auto& transfer) {
        for (std::size_t i = smooth_.count(); i < transfer.common.size(); ++i)
          common_boxes_.push_back(small_box(basis.box(transfer.common[i])));
        if (!sums_suffice_) return;
        summed_vector_boxes_ = basis.vector_boxes;
        summed_boxes_ = common_boxes_;
        for (int at = 0; at < transfer.tiles(); ++at) {
          own_start_.push_back(static_cast<std::uint32_t>(summed_boxes_.size() - common_boxes_.size()));
          const auto tile = transfer.tile(at);
          const auto own_boxes = tile.support.subspan(tile.common.size());
          summed_boxes_.insert(summed_boxes_.end(), own_boxes.begin(), own_boxes.end());
        }
      },
      *transfer_);
  if (sums_suffice_ && precision_ == RelightPrecision::fast &&
      SquareSums::can_sum(domain_.width, summed_vector_boxes_, summed_boxes_))
    square_sums_ = std::make_shared<const SquareSums>(domain_.width, summed_vector_boxes_, summed_boxes_);
}

std::optional<BoxProjector> TileRelighter::box_projector() const {
  if (!sums_suffice_) return std::nullopt;
  return BoxProjector(domain_.width, summed_vector_boxes_, summed_boxes_);
}

void TileRelighter::show_sums(std::span<const float> sums, const PixelTarget& target) {
  const std::size_t shared = 3 * (summed_vector_boxes_.size() + common_boxes_.size());
  common_.resize(shared + 1);
  std::copy_n(sums.begin(), shared, common_.begin());
  const OwnSums own(sums.data() + shared, own_start_);
  std::visit([&](const auto& transfer) { multiply(transfer, common_, own, target); }, *transfer_);
}

const Image& TileRelighter::relight(std::span<const float> sums) {
  relight_into(sums, image_.values);
  return image_;
}

void TileRelighter::relight_into(std::span<const float> sums, std::span<float> out) {
  const std::size_t needed = 3 * (summed_vector_boxes_.size() + summed_boxes_.size());
  if (!sums_suffice_ || sums.size() != needed)
    throw InputError("the sums of light are ", sums.size(), " numbers, the field takes ", needed);
  require_image(out);
  show_sums(sums, target(out.data()));
  light_ = {};
}

const Image& TileRelighter::relight(const LightMap& light) {
  require_domain(light, domain_);
  show(light.radiance, target());
  updates_ = 0;
  moved_light_ = 0.0;
  total_light_ = -1.0;
  return image_;
}

void TileRelighter::require_image(std::span<const float> out) const {
  if (out.size() != image_.values.size())
    throw InputError("the array for the image has ", out.size(), " values, the image has ",
                     image_.values.size());
}

void TileRelighter::relight_into(const LightMapView& light, std::span<float> out) {
  require_domain(light, domain_);
  if (light.radiance.channels != 3) throw InputError("the light map does not have three channels");
  require_image(out);
  show(light.radiance, target(out.data()));
  updates_ = refresh_period;
}

void TileRelighter::show(const ImageView& light, const PixelTarget& target) {
  // The copy first: it is what the caches hold then.
  bool finite = true;
  if (square_sums_) {
    light_ = light_.empty() ? Image(domain_.width, domain_.height, 3) : std::move(light_);
    sums_.resize(3 * (summed_vector_boxes_.size() + summed_boxes_.size()));
    finite = square_sums_->project(light, light_, sums_);
  } else {
    finite = copy(light, light_);
  }
  if (!finite) {
    light_ = {};
    refuse_light();
  }
  if (square_sums_)
    show_sums(sums_, target);
  else
    show_light(target);
}

const BoxSumTable& TileRelighter::tabulate(const Image& values) {
  table().build(values);
  return table();
}

void TileRelighter::show_light(const PixelTarget& target) {
  const Box whole{0, 0, domain_.width, domain_.height};
  if (smooth_.weighs()) {
    copy(light_, weighed_);
    smooth_.weigh(weighed_, whole);
  }
  const Image& values = smooth_.weighs() ? weighed_ : light_;
  const std::vector<double> smooth = smooth_.project(values, whole);
  const BoxSumTable& table = tabulate(values);
  sum_common(smooth, table, common_boxes_, common_);
  std::visit([&](const auto& transfer) { multiply(transfer, common_, table, target); }, *transfer_);
}

Image TileRelighter::take_change(const LightMap& light, const Box& changed) {
  if (total_light_ < 0.0) total_light_ = sum_of(light_);
  Image difference(changed.width(), changed.height(), 3);
  for (int y = changed.y0; y < changed.y1; ++y) {
    const float* now = light.radiance.row(y).data() + std::ptrdiff_t{3} * changed.x0;
    float* before = light_.row(y).data() + std::ptrdiff_t{3} * changed.x0;
    float* out = difference.row(y - changed.y0).data();
    for (int i = 0; i < 3 * changed.width(); ++i) {
      if (now[i] == before[i]) continue;
      out[i] = now[i] - before[i];
      moved_light_ += std::abs(now[i]) + std::abs(before[i]);
      total_light_ += std::abs(now[i]) - std::abs(before[i]);
      before[i] = now[i];
    }
  }
  return difference;
}

const Image& TileRelighter::update(const LightMap& light, const Box& changed) {
  require_domain(light, domain_);
  if (!changed.inside(domain_.width, domain_.height))
    throw InputError("the changed part of the light reaches outside the light map");
  for (int y = changed.y0; y < changed.y1; ++y)
    if (!are_finite(
            light.radiance.row(y).subspan(std::size_t{3} * changed.x0, std::size_t{3} * changed.width())))
      refuse_light();
  if (light_.empty() || ++updates_ >= refresh_period || !smooth_.weighs_texels_alone()) return relight(light);
  Image difference = take_change(light, changed);
  if (moved_light_ > max_moved_light * total_light_) return relight(light);
  if (smooth_.weighs()) smooth_.weigh(difference, changed);
  changed_texels_.build(difference);
  if (blocks_.empty())
    std::visit([&](const auto& transfer) { blocks_ = KernelBlocks(transfer); }, *transfer_);
  const LightChange change{changed, changed_texels_, tabulate(difference),
                           smooth_.project(difference, changed)};
  std::visit([&](const auto& transfer) { add_change(transfer, blocks_, change, target()); }, *transfer_);
  return image_;
}

}  // namespace refield
