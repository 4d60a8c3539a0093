// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "python/binding.h"
#include "refield/relight.h"

namespace refield::python {

/// A field for Python: in rows or packed, what is missing made when it is first needed. From several threads
/// at a time.
class Field {
 public:
  explicit Field(ReflectanceField&& rows);
  explicit Field(PackedField&& packed);
  Field(Field&& other) noexcept
      : rows_(std::move(other.rows_)),
        packed_(std::move(other.packed_)),
        laid_out_(std::move(other.laid_out_)) {}

  const FieldOutline& outline() const;
  std::shared_ptr<const ReflectanceField> rows() const;
  const PackedField* packed() const { return packed_.get(); }
  Relighter relighter(RelightPrecision precision) const;

  /// Of a picture: height, width, 3. Fields of meshes are shown to their standard camera.
  std::vector<py::ssize_t> shape() const;
  /// A picture per light into `out` [lights × shape()]. As `refield relight`: up to eleven lights by the
  /// plain product, more by a Relighter with weights of 16 bits.
  void relight(std::span<const ImageView> lights, float* out, const RunContext& run) const;

 private:
  std::shared_ptr<const Relighter> laid_out() const;

  mutable std::mutex mutex_;
  mutable std::shared_ptr<const ReflectanceField> rows_;
  std::shared_ptr<const PackedField> packed_;
  mutable std::shared_ptr<const Relighter> laid_out_;
};

}  // namespace refield::python
