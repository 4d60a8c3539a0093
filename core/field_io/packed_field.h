// SPDX-License-Identifier: Apache-2.0
#pragma once
#include "core/field/reflectance_field.h"
#include "core/field/transfer_tiles.h"
#include "core/field_io/hdf5_reader.h"

namespace refield {

/// A reflectance field whose transfer stands in tiles, with weights of 8 or 16 bits: a fourth or half of the
/// bytes of rows, and ready to be shown.
struct PackedField {
  /// Its basis holds the common kernels alone, in the order of TiledTransfer::common; those that one tile has
  /// for itself stand in that tile.
  FieldOutline outline;
  TransferTiles tiles;

  int bits() const { return tiles.index() == 0 ? 8 : 16; }
};

/// Says what keeps the tiles from being used; empty where nothing does. Looks at every length, number, box
/// and scale, so that tiles of any origin may be given. Their bands must be as many as the picture needs,
/// each with a start for every tile of it, rising from 0 to the size of the memory by whole cache lines.
std::string fault_of_tiles(const PackedField& packed);

/// The field with rows again: the weights as they were rounded, those that became zero left out.
ReflectanceField expand(PackedField&& packed);

/// Gives a basis function's number for the box of a kernel that one tile has for itself.
using NumberOfBox = std::function<std::uint32_t(const Box&)>;

/// The pixels of rows [first, last) of tiles, with those numbers and, for common kernels,
/// TiledTransfer::common.
SparseTransfer expand_tiles(const TransferTiles& tiles, RowRange tile_rows, const NumberOfBox& number_of);

/// Writes a packed field (.rfield), atomically. Equal fields give equal bytes. Throws DeviceError where the
/// disk refuses.
void write_packed_field(const fs::path& path, const PackedField& packed);

/// Reads a packed field from an open file and checks all of it; throws FormatError. read_either_field() opens
/// files of both kinds.
PackedField read_packed(const Hdf5Values& values);

}  // namespace refield
