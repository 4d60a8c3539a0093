// SPDX-License-Identifier: Apache-2.0
#include "bench/studies/peers/peer_model.h"

namespace refield::peers {

namespace {

double bytes_of(const ReflectanceField& field) {
  const SparseTransfer& transfer = field.transfer;
  return static_cast<double>(transfer.entries() * (sizeof(std::uint32_t) + 3 * sizeof(float)) +
                             transfer.row_start.size() * sizeof(std::uint64_t) +
                             field.basis.boxes.size() * sizeof(Box)) /
         (static_cast<double>(field.width) * field.height);
}

double functions_of(const ReflectanceField& field) {
  return static_cast<double>(field.transfer.entries()) / (static_cast<double>(field.width) * field.height);
}
double functions_of(const HaarModel& model) {
  return static_cast<double>(model.transfer.entries()) / (static_cast<double>(model.width) * model.height);
}
double functions_of(const DualModel& model) {
  return static_cast<double>(model.alpha.rows());
}
double functions_of(const CellModel& model) {
  return static_cast<double>(model.cells.size());
}

}  // namespace

Image relight(const Model& model, const LightMap& light) {
  return std::visit([&](const auto& held) { return held.relight(light); }, model);
}

double bytes_per_pixel(const Model& model) {
  if (const auto* field = std::get_if<ReflectanceField>(&model)) return bytes_of(*field);
  return std::visit(
      [](const auto& held) {
        if constexpr (requires { held.bytes_per_pixel(); })
          return held.bytes_per_pixel();
        else
          return 0.0;
      },
      model);
}

double functions_per_pixel(const Model& model) {
  return std::visit([](const auto& held) { return functions_of(held); }, model);
}

}  // namespace refield::peers
