// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "refield/light_map.h"

/// A reflectance field: B = T L (Matusik et al. 2004, equations 1 to 4), the linear map from incident light
/// to a picture, and the .rfield file (docs/reference/reflectance-field-format.md).
namespace refield {
inline namespace v0_2 {

/// One entry of a pixel's row of the transfer.
struct PixelKernel {
  std::optional<std::uint32_t> hat;  ///< its number; nothing: a rectangle
  Box support;
  std::array<float, 3> weight{};  ///< multiplies the sum of texel values under the kernel
  double energy_share = 0.0;      ///< of the pixel's energy (|weight| × area, all channels), 0 to 1
};

/// A reflectance field. Immutable, but that it lays itself out when that first pays; copies share it. From
/// several threads at a time.
class REFIELD_API Field {
 public:
  /// Reads a .rfield file and checks all of it. Throws FormatError for another kind of file, another version
  /// or damaged content.
  explicit Field(const std::filesystem::path& file, const RunContext& run = {});
  /// Writes one file (.rfield), atomically. Equal fields give equal bytes. Throws InputError for another
  /// extension, or where another process writes the same file, and DeviceError where the disk refuses.
  void write(const std::filesystem::path& file) const;

  int width() const;  ///< of a picture, pixels; of fields over meshes, that of their standard camera
  int height() const;
  LightDomain light_domain() const;  ///< of the lights that it is relit with
  /// Where the monitor stood, one placement for each window of the light map; empty where that is not known.
  std::vector<MonitorPlacement> monitors() const;
  ColourSpace colour_space() const;  ///< of pictures
  bool has_mesh() const;             ///< whether it holds vertices of a mesh, not a camera's pixels
  int bits() const;                  ///< of a weight: 32, or 16 or 8 of packed fields
  /// JSON text: inputs, options, version of the program that made it.
  const std::string& provenance() const;

  /// The scene under a light, [height × width × 3]. Fields of meshes are shown to their standard camera.
  /// Throws InputError when the light does not fit light_domain(), has values that are not finite, or is too
  /// bright for 32-bit floats.
  Image relight(const LightMapView& light, const RunContext& run = {}) const;
  /// A picture per light into `pictures` [lights × height × width × 3]: up to eleven lights by the plain
  /// product T L, more by a Relighter with weights of 16 bits.
  void relight(std::span<const LightMapView> lights, std::span<float> pictures,
               const RunContext& run = {}) const;
  /// A PNG file that shows the scene under white light, at most 640 pixels wide and high.
  std::vector<std::uint8_t> thumbnail() const;

  /// The reflectance function of a pixel: what each texel of the light adds to it, [light's height × width ×
  /// 3]. Throws InputError for a pixel outside the picture and for fields of meshes.
  Image transport(int x, int y) const;
  /// What a pixel takes light from, most energy first.
  std::vector<PixelKernel> kernels(int x, int y) const;

  /// Maps of relative RMSE [height × width × 1], empty where they are not known: over the training images; to
  /// be expected on new photographs; the part of that which is the photographs' noise. NaN where nothing is
  /// predicted.
  Image training_error() const;
  Image predicted_error() const;
  Image photograph_noise() const;
  /// predicted_error() of photographs under one light.
  Image predicted_error(const LightMapView& light) const;

  /// For the library itself.
  struct Data;
  explicit Field(std::shared_ptr<const Data> data) : data_(std::move(data)) {}
  const Data& internal() const { return *data_; }

 private:
  std::shared_ptr<const Data> data_;
};

/// Rounds weights to 8 or 16 bits and leaves out small ones, so that relit pictures stay within `max_error`,
/// a relative RMSE; 0: nothing is left out. Throws InputError for a field that is packed already.
REFIELD_API Field pack(const Field& field, double max_error, const RunContext& run = {});

}  // namespace v0_2
}  // namespace refield
