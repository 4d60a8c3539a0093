// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/base/floating_point.h"
#include "core/base/run_context.h"
#include "core/field_io/packed_field.h"
#include "refield/field.h"
#include "relight/relighter.h"

namespace refield {

/// Calls `work` with the caller's limit of threads, and with the state of the processor that results are the
/// same in: other libraries of the process may flush denormals.
template <class Work>
auto guarded(const RunContext& run, const Work& work) {
  const ThreadLimit limit(run);
  if constexpr (std::is_void_v<decltype(work())>) {
    with_default_floating_point(work);
  } else {
    std::optional<decltype(work())> result;
    with_default_floating_point([&] { result.emplace(work()); });
    return *std::move(result);
  }
}

/// From as many pictures on, laying the field out for speed takes less time than it saves.
inline constexpr std::size_t min_pictures_for_layout = 12;

/// A field in rows or packed; what is missing is made when it is first needed.
struct v0_2::Field::Data {
  explicit Data(ReflectanceField&& field, std::string field_name = "the field")
      : name(std::move(field_name)), rows_(std::make_shared<const ReflectanceField>(std::move(field))) {}
  explicit Data(PackedField&& field, std::string field_name = "the field")
      : name(std::move(field_name)), packed_(std::make_shared<const PackedField>(std::move(field))) {}

  const std::string name;  ///< for messages: its file, where it has one
  const FieldOutline& outline() const { return packed_ ? packed_->outline : *rows_; }
  const PackedField* packed() const { return packed_.get(); }
  std::shared_ptr<const ReflectanceField> rows() const;
  TileRelighter relighter(RelightPrecision precision) const;
  /// Of 16 bits.
  std::shared_ptr<const TileRelighter> laid_out() const;
  void relight(std::span<const LightMapView> lights, std::span<float> pictures, const RunContext& run) const;

 private:
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const ReflectanceField> rows_;
  std::shared_ptr<const PackedField> packed_;
  mutable std::shared_ptr<const TileRelighter> laid_out_;
};

/// A field for the public interface.
template <class Content>
v0_2::Field public_field(Content&& content) {
  return v0_2::Field(std::make_shared<const v0_2::Field::Data>(std::forward<Content>(content)));
}

/// A copy of a light that stands in memory of the caller's.
inline LightMap copied(const LightMapView& light) {
  return {Image(light.radiance), light.parameterisation};
}

}  // namespace refield
