// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"
#include "core/field_io/packed_field.h"
#include "core/image/image.h"
#include "core/light/light_map.h"
#include "refield/relight.h"
#include "relight/environment/environment.h"
#include "relight/tiles/box_sums.h"
#include "relight/tiles/tile_product.h"

namespace refield {

/// Shows one reflectance field under one light after another. Keeps the light and the image between calls,
/// so that a change of part of the light costs only what it touches. Not for several threads at once; its own
/// work runs on all cores. Copies share the field's transfer, so that each thread may have one.
class TileRelighter {
 public:
  /// Lays the field out for speed; `field` is not needed any more after that. Throws InputError for a light
  /// map larger than small_box_limit.
  explicit TileRelighter(const ReflectanceField& field, RelightPrecision precision = RelightPrecision::fast);
  /// Lays out a field whose transfer is not needed elsewhere: its memory is given back on the way, and
  /// both together never take much more than the field alone. All but the transfer stays.
  explicit TileRelighter(ReflectanceField&& field, RelightPrecision precision = RelightPrecision::fast);

  /// Shows a packed field as it stands, with weights and sums of light of its precision.
  explicit TileRelighter(PackedField&& packed);

  const LightDomain& domain() const { return domain_; }

  /// The scene under `light`, [height × width × 3]; valid until the next call. Throws InputError when the
  /// light does not fit domain() or has values that are not finite.
  const Image& relight(const LightMap& light);

  /// Writes the image straight into `out` [height × width × 3]. Throws
  /// InputError for another number of values, too. The next update() computes the whole image.
  void relight_into(const LightMapView& light, std::span<float> out);

  /// Updates the image after `light` changed only inside `changed` since the last call, in less time the less
  /// of it changed. Rounding adds up over such calls: after refresh_period of them, or when as much light
  /// came and went as makes it matter, the image is computed anew. Throws InputError when the light does not
  /// fit domain(), `changed` lies outside it, or values in it are not finite.
  const Image& update(const LightMap& light, const Box& changed);
  static constexpr int refresh_period = 256;

  /// Integrates environments for relight(sums), without a light map, where the field's coefficients are sums
  /// over vector boxes and boxes alone (box_sums_suffice()); else nothing.
  std::optional<BoxProjector> box_projector() const;
  /// The scene under a light whose coefficients are `sums`, as box_projector() has them; valid until the next
  /// call. The next update() computes the whole image. Throws InputError for another number of sums.
  const Image& relight(std::span<const float> sums);
  /// Writes that image straight into `out` [height × width × 3].
  void relight_into(std::span<const float> sums, std::span<float> out);

  const TransferTiles& transfer() const { return *transfer_; }

 private:
  /// Without a transfer yet.
  TileRelighter(const FieldOutline& field, RelightPrecision precision);
  PixelTarget target() { return target(image_.values.data()); }
  PixelTarget target(float* pixels) const {
    return {pixels, image_.width, image_.height, mixes_colours_ ? &output_from_primaries_ : nullptr};
  }
  void list_boxes(const LightBasis& basis);
  /// Throws InputError unless `out` has the values of an image.
  void require_image(std::span<const float> out) const;
  /// The scene under a light, which is copied to light_; throws InputError for values that are not finite.
  void show(const ImageView& light, const PixelTarget& target);
  /// The table of a light, or of a change of it.
  const BoxSumTable& tabulate(const Image& values);
  BoxSumTable& table() {
    return std::visit([](auto& table) -> BoxSumTable& { return table; }, tables_);
  }
  /// The scene under light_.
  void show_light(const PixelTarget& target);
  void show_sums(std::span<const float> sums, const PixelTarget& target);
  /// Takes over the light inside `changed`; the difference to what it was.
  Image take_change(const LightMap& light, const Box& changed);

  LightDomain domain_;
  Eigen::Matrix3f output_from_primaries_;
  bool mixes_colours_;
  SmoothProjector smooth_;
  std::shared_ptr<const TransferTiles> transfer_;
  KernelBlocks blocks_;                 // of transfer_; empty before the first change
  std::vector<SmallBox> common_boxes_;  // of the common kernels that are no hats
  bool sums_suffice_ = false;
  std::vector<VectorBox> summed_vector_boxes_;
  std::vector<SmallBox> summed_boxes_;  // the common ones, then each tile's own
  std::vector<std::uint32_t>
      own_start_;  // [tiles], first of each tile's in summed_boxes_ after the common ones
  std::shared_ptr<const SquareSums> square_sums_;  // where these do
  std::vector<float> sums_;                        // of them
  RelightPrecision precision_;                     // of the weights
  std::variant<FixedPointTable, DoubleTable> tables_;
  ChangedTexels changed_texels_;
  Coefficients common_;
  Image light_;    // as of the last call; empty before
  Image weighed_;  // what its coefficients sum, where that differs
  Image image_;
  int updates_ = 0;
  double moved_light_ = 0.0;  // since the image was last computed as a whole
  double total_light_ = 0.0;
};

}  // namespace refield
