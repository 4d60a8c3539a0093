// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_formats.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <span>
#include <utility>

#include "simulate/geometry/mesh_library.h"

namespace refield::prt {

namespace fs = std::filesystem;

namespace {

using Colour = Eigen::Array3f;

/// The words of a line.
class Words {
 public:
  explicit Words(std::string_view line) : rest_(line) {}

  /// Empty at the end.
  std::string_view next() {
    rest();
    const std::string_view word = rest_.substr(0, rest_.find_first_of(blanks));
    rest_.remove_prefix(word.size());
    return word;
  }
  /// What is left, without blanks around it.
  std::string_view rest() {
    rest_.remove_prefix(std::min(rest_.find_first_not_of(blanks), rest_.size()));
    while (!rest_.empty() && blanks.find(rest_.back()) != std::string_view::npos) rest_.remove_suffix(1);
    return rest_;
  }

 private:
  static constexpr std::string_view blanks = " \t\r\n\f\v";
  std::string_view rest_;
};

std::optional<double> number_in(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0.0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error == std::errc::result_out_of_range) return std::strtod(std::string(word).c_str(), nullptr);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

double number_of(std::string_view word) {
  if (const auto value = number_in(word)) return *value;
  throw MeshFault(word.empty() ? "a number is missing; the file is damaged or cut off"
                  : word.find(',') != std::string_view::npos
                      ? "a number has a comma; export the file with decimal points"
                      : "a word stands where a number is expected; export the file again");
}

/// Up to a comment.
std::vector<double> numbers_of(Words words) {
  std::vector<double> numbers;
  for (std::string_view word = words.next(); !word.empty() && !word.starts_with('#'); word = words.next())
    numbers.push_back(number_of(word));
  return numbers;
}

/// Calls `read` with each line; what it throws then names the line. Lines end as on Unix, Windows or Mac OS
/// 9, and, if `continued`, go on after a backslash.
void for_lines(std::string_view text, bool continued, const std::function<void(std::string_view)>& read) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);  // byte order mark
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF"))
    throw MeshFault("it is encoded in UTF-16; save it as UTF-8 or ASCII");
  std::string joined;
  for (std::size_t number = 1, begin = 0; begin < text.size(); ++number) {
    const std::size_t end = std::min(text.find_first_of("\r\n", begin), text.size());
    joined += text.substr(begin, end - begin);
    begin = end + (text.substr(end).starts_with("\r\n") ? 2 : 1);
    if (continued && joined.ends_with('\\') && begin < text.size()) {
      joined.back() = ' ';
      continue;
    }
    try {
      read(joined);
    } catch (const MeshFault& fault) {
      throw MeshFault("line " + std::to_string(number) + ": " + fault.what());
    }
    joined.clear();
  }
}

std::uint32_t index_of(double index, std::size_t count) {
  if (index >= 0.0 && index < static_cast<double>(count) && index == std::floor(index))
    return static_cast<std::uint32_t>(index);
  char text[32];
  std::snprintf(text, sizeof text, "%.10g", index);
  throw MeshFault(std::string("a face names vertex ") + text + " of " + std::to_string(count) +
                  ": the index is out of range; export the file again");
}

void require_room(std::string_view bytes, const char* what, double count, std::uint64_t least_bytes) {
  if (count >= 0.0 && count * static_cast<double>(least_bytes) <= static_cast<double>(bytes.size())) return;
  char text[32];
  std::snprintf(text, sizeof text, "%.12g ", count);
  throw MeshFault(std::string("it promises ") + text + what + ", but a file of " +
                  std::to_string(bytes.size()) + " bytes cannot hold that many; it is damaged or cut off");
}

/// Divides colours by what they count to: bytes by 255; longer integers and floats may count to 1, 255 or
/// 65535.
void scale_colours(std::vector<Colour>& colours, bool are_bytes) {
  float largest = 0.0f;
  for (const Colour& colour : colours) largest = std::max(largest, colour.maxCoeff());
  if (largest > 65535.0f) throw MeshFault("its colours exceed 65535; export them as bytes");
  const float full = largest > 255.0f ? 65535.0f : largest > 2.0f || are_bytes ? 255.0f : 1.0f;
  for (Colour& colour : colours) colour /= full;
}

/// Polygons over vertices, which may have colours and texture coordinates of their own.
struct Faces {
  void append(std::span<const double> polygon) {
    corners.insert(corners.end(), polygon.begin(), polygon.end());
    sizes.push_back(polygon.size());
  }
  std::vector<double> corners;     ///< indices as the file has them
  std::vector<std::size_t> sizes;  ///< [faces]
  std::vector<Colour> colours;     ///< [faces], or empty
  std::vector<double> places;      ///< u, v of each corner, or empty
};

/// Where faces have values of their own, each gets vertices of its own.
void append_faces(const Faces& faces, ImportedMesh& mesh) {
  const ImportedMesh vertices = mesh;
  const bool own = !faces.places.empty() || !faces.colours.empty();
  if (own) mesh.positions.clear(), mesh.normals.clear(), mesh.colours.clear(), mesh.texture_places.clear();
  for (std::size_t f = 0, first = 0; f < faces.sizes.size(); first += faces.sizes[f++]) {
    std::vector<std::uint32_t> polygon;
    for (std::size_t i = first; i < first + faces.sizes[f]; ++i) {
      polygon.push_back(index_of(faces.corners[i], vertices.positions.size()));
      if (!own) continue;
      const std::uint32_t vertex =
          std::exchange(polygon.back(), static_cast<std::uint32_t>(mesh.positions.size()));
      mesh.positions.push_back(vertices.positions[vertex]);
      if (!vertices.normals.empty()) mesh.normals.push_back(vertices.normals[vertex]);
      if (!faces.colours.empty())
        mesh.colours.push_back(faces.colours[f]);
      else if (!vertices.colours.empty())
        mesh.colours.push_back(vertices.colours[vertex]);
      if (!faces.places.empty())
        mesh.texture_places.emplace_back(faces.places[2 * i], faces.places[2 * i + 1]);
      else if (!vertices.texture_places.empty())
        mesh.texture_places.push_back(vertices.texture_places[vertex]);
    }
    append_polygon(std::move(polygon), mesh);
  }
  mesh.material.assign(mesh.positions.size(), 0);
  if (mesh.materials.empty()) mesh.materials.emplace_back();
}

// ---- PLY

struct PlyType {
  char kind;  ///< integers i, u; floats f
  std::size_t bytes;
};

struct PlyProperty {
  std::string name;
  PlyType type;
  std::optional<PlyType> count;  ///< of a list
};

struct PlyElement {
  std::string name;
  double count;
  std::vector<PlyProperty> properties;
};

struct PlyHeader {
  std::string format;
  std::string texture;
  std::vector<PlyElement> elements;
  std::string_view body;
};

PlyType ply_type(std::string_view name) {
  static const std::map<std::string_view, PlyType> types = {
      {"char", {'i', 1}},  {"int8", {'i', 1}},    {"uchar", {'u', 1}},  {"uint8", {'u', 1}},
      {"short", {'i', 2}}, {"int16", {'i', 2}},   {"ushort", {'u', 2}}, {"uint16", {'u', 2}},
      {"int", {'i', 4}},   {"int32", {'i', 4}},   {"uint", {'u', 4}},   {"uint32", {'u', 4}},
      {"float", {'f', 4}}, {"float32", {'f', 4}}, {"double", {'f', 8}}, {"float64", {'f', 8}}};
  const auto type = types.find(name);
  if (type == types.end())
    throw MeshFault("its header has a property of an unknown type; export the file again");
  return type->second;
}

PlyHeader read_ply_header(std::string_view bytes) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  if (!bytes.starts_with("ply")) throw MeshFault("it does not begin with 'ply'; it is no PLY file");
  // The body of a binary file may begin with any byte, so lines end as the first one does.
  const std::string_view line_end = bytes.substr(3, 2) == "\r\n" ? "\r\n"
                                    : bytes.substr(3, 1) == "\r" ? "\r"
                                                                 : "\n";
  PlyHeader header;
  for (std::size_t begin = 0;;) {
    const std::size_t end = bytes.find(line_end, begin);
    if (end == std::string_view::npos && !bytes.substr(begin).starts_with("end_header"))
      throw MeshFault("its header does not end; it is damaged or no PLY file");
    Words words(bytes.substr(begin, end - begin));
    begin = end == std::string_view::npos ? bytes.size() : end + line_end.size();
    const std::string_view word = words.next();
    if (word == "end_header") {
      header.body = bytes.substr(begin);
      return header;
    }
    if (word == "format") header.format = words.next();
    if (word == "comment" && words.next() == "TextureFile") header.texture = words.rest();
    if (word == "element") {
      const std::string name(words.next());
      const double count = number_of(words.next());
      const bool vertices = name == "vertex";
      require_room(bytes, vertices ? "vertices" : "elements", count, vertices ? 3 : 1);
      header.elements.push_back({name, count, {}});
    }
    if (word != "property") continue;
    if (header.elements.empty()) throw MeshFault("its header has a property before the first element");
    PlyProperty property;
    const std::string_view type = words.next();
    if (type == "list") property.count = ply_type(words.next());
    property.type = ply_type(type == "list" ? words.next() : type);
    property.name = words.next();
    header.elements.back().properties.push_back(property);
  }
}

class PlyBody {
 public:
  explicit PlyBody(const PlyHeader& header)
      : rest_(header.body),
        words_(rest_),
        is_text_(header.format == "ascii"),
        big_(header.format == "binary_big_endian") {
    if (!is_text_ && !big_ && header.format != "binary_little_endian")
      throw MeshFault("its format is none of ascii, binary_little_endian and binary_big_endian");
  }

  double next(PlyType type) {
    if (is_text_) return number_of(words_.next());
    if (rest_.size() < type.bytes) throw MeshFault("it holds less than its header promises; it is cut off");
    std::array<char, 8> bytes{};
    std::copy_n(rest_.data(), type.bytes, bytes.begin());
    rest_.remove_prefix(type.bytes);
    if (big_) std::reverse(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(type.bytes));
    const auto as = [&]<class Value>(Value value) {
      std::memcpy(&value, bytes.data(), sizeof value);
      return static_cast<double>(value);
    };
    if (type.kind == 'f') return type.bytes == 4 ? as(0.0f) : as(0.0);
    if (type.kind == 'u')
      return type.bytes == 1   ? as(std::uint8_t{})
             : type.bytes == 2 ? as(std::uint16_t{})
                               : as(std::uint32_t{});
    return type.bytes == 1 ? as(std::int8_t{}) : type.bytes == 2 ? as(std::int16_t{}) : as(std::int32_t{});
  }

  void require_room(double count) const {
    if (!(count >= 0.0 && count <= static_cast<double>(room_)))
      throw MeshFault("a list promises more values than the file can hold; it is damaged");
  }

  /// A row that was misread leaves something over.
  void require_end() {
    if (is_text_ ? words_.next().empty()
                 : rest_.find_first_not_of(std::string_view(" \t\r\n\0", 5)) == std::string_view::npos)
      return;
    throw MeshFault("it holds more than its header promises; it is damaged");
  }

 private:
  std::string_view rest_;
  Words words_;
  std::size_t room_ = rest_.size();
  bool is_text_, big_;
};

/// Values of a vertex or of a face that are read: x y z, normal, colour, u v; under up to three names.
constexpr std::size_t ply_normal = 3, ply_colour = 6, ply_place = 9, ply_slots = 11;

std::size_t ply_slot(std::string_view name) {
  using Names = std::array<std::string_view, ply_slots>;
  static constexpr std::array<Names, 3> names = {
      Names{"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "u", "v"},
      Names{"x", "y", "z", "nx", "ny", "nz", "diffuse_red", "diffuse_green", "diffuse_blue", "s", "t"},
      Names{"x", "y", "z", "nx", "ny", "nz", "r", "g", "b", "texture_u", "texture_v"}};
  for (const Names& alternative : names)
    if (const auto found = std::ranges::find(alternative, name); found != alternative.end())
      return static_cast<std::size_t>(found - alternative.begin());
  return ply_slots;
}

/// An element's rows, one after the other.
class PlyRows {
 public:
  PlyRows(const PlyElement& element, PlyBody& body) : body_(body) {
    for (const PlyProperty& property : element.properties) {
      const bool is_list = property.count.has_value();
      const std::size_t slot = is_list ? ply_slots : ply_slot(property.name);
      columns_.push_back({property, slot, nullptr});
      has_[slot] = true;
      if (slot == ply_colour) are_bytes_ = property.type.kind == 'u' && property.type.bytes == 1;
      if (is_list && (property.name == "vertex_indices" || property.name == "vertex_index"))
        columns_.back().list = &corners;
      if (is_list && property.name == "texcoord") columns_.back().list = &places;
      has_corners = has_corners || columns_.back().list == &corners;
      has_places = has_places || columns_.back().list == &places;
    }
  }

  void next() {
    for (const Column& column : columns_) {
      if (!column.property.count) {
        value[column.slot] = static_cast<float>(body_.next(column.property.type));
        continue;
      }
      std::vector<double>& list = column.list ? *column.list : ignored_;
      const double count = body_.next(*column.property.count);
      body_.require_room(count);
      list.resize(static_cast<std::size_t>(count));
      for (double& number : list) number = body_.next(column.property.type);
    }
  }
  bool has(std::size_t first, std::size_t count) const {
    return std::all_of(&has_[first], &has_[first] + count, std::identity());
  }
  Eigen::Vector3f three(std::size_t first) const {
    return {value[first], value[first + 1], value[first + 2]};
  }
  void scale(std::vector<Colour>& colours) const { scale_colours(colours, are_bytes_); }

  std::array<float, ply_slots + 1> value{};
  std::vector<double> corners, places;
  bool has_corners = false, has_places = false;

 private:
  struct Column {
    PlyProperty property;
    std::size_t slot;
    std::vector<double>* list;
  };
  PlyBody& body_;
  std::vector<Column> columns_;
  std::vector<double> ignored_;
  std::array<bool, ply_slots + 1> has_{};
  bool are_bytes_ = false;
};

/// Strips (a negative index begins another) and fans as triangles.
void append_strips(const std::vector<double>& corners, bool fan, Faces& faces) {
  for (std::size_t first = 0, i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0.0) first = i + 1;
    if (i < first + 2) continue;
    const double a = corners[fan ? first : i - 2], b = corners[i - 1], c = corners[i];
    if (a == b || b == c || a == c) continue;  // joins strips
    const bool odd = !fan && (i - first) % 2 == 1;
    faces.append(std::array{odd ? b : a, odd ? a : b, c});
  }
}

void read_vertices(const PlyElement& element, PlyBody& body, ImportedMesh& mesh) {
  PlyRows row(element, body);
  if (!row.has(0, 3)) throw MeshFault("its vertices have no properties x, y and z");
  for (double i = 0.0; i < element.count; ++i) {
    row.next();
    mesh.positions.push_back(row.three(0));
    if (row.has(ply_normal, 3)) mesh.normals.push_back(row.three(ply_normal));
    if (row.has(ply_colour, 3)) mesh.colours.emplace_back(row.three(ply_colour));
    if (row.has(ply_place, 2))
      mesh.texture_places.emplace_back(row.value[ply_place], row.value[ply_place + 1]);
  }
  row.scale(mesh.colours);
}

void read_faces(const PlyElement& element, PlyBody& body, Faces& faces) {
  PlyRows row(element, body);
  if (!row.has_corners) throw MeshFault("its faces have no list vertex_indices; export the file again");
  for (double i = 0.0; i < element.count; ++i) {
    row.next();
    if (element.name != "face") {
      append_strips(row.corners, element.name == "trifans", faces);
      continue;
    }
    faces.append(row.corners);
    if (row.has(ply_colour, 3)) faces.colours.emplace_back(row.three(ply_colour));
    if (!row.has_places) continue;
    if (row.places.size() != 2 * row.corners.size())
      throw MeshFault("a face has other numbers of vertices and texture coordinates; export the file again");
    faces.places.insert(faces.places.end(), row.places.begin(), row.places.end());
  }
  row.scale(faces.colours);
}

// ---- MTL

struct Mtl {
  std::vector<ImportedMaterial> materials{1};  ///< the first: none, white as where a file has no materials
  std::vector<TexturePlacement> placements{1};
  std::map<std::string, std::uint32_t, std::less<>> index;
};

/// RGB of Kd, Ks and Ke: one value stands for all three. Nothing for a spectrum or CIE XYZ.
std::optional<std::array<float, 3>> mtl_colour(Words words, ImportedMesh& mesh) {
  if (!number_in(Words(words).next())) {
    mesh.notes += "colours of its materials that are given as spectra or CIE XYZ are ignored\n";
    return std::nullopt;
  }
  const std::vector<double> values = numbers_of(words);
  std::array<float, 3> colour{};
  for (std::size_t c = 0; c < 3; ++c) colour[c] = static_cast<float>(values[c < values.size() ? c : 0]);
  return colour;
}

/// "-s 2 2 1 -clamp on name of the file.png".
std::int32_t mtl_texture(Words words, const fs::path& path, TexturePlacement& placement,
                         ImportedMaterial& material, ImportedMesh& mesh) {
  while (words.rest().starts_with('-')) {
    const std::string_view option = words.next();
    std::string_view word;
    std::vector<float> given;
    const bool has_word = option == "-imfchan" || option == "-type";
    for (Words ahead = words; word = ahead.next(),
               number_in(word) || word == "on" || word == "off" || (has_word && given.empty());) {
      words = ahead;
      given.push_back(static_cast<float>(number_in(word).value_or(word == "on" ? 1.0 : 0.0)));
    }
    given.resize(3, option == "-s" ? 1.0f : 0.0f);
    if (option == "-s") placement.turn.diagonal() = Eigen::Vector2f(given[0], given[1]);
    if (option == "-o") placement.offset = Eigen::Vector2f(given[0], given[1]);
    if (option == "-mm" || option == "-t" || option == "-imfchan" || (option == "-clamp" && given[0] > 0.0f))
      mesh.notes += "of its textures, the options -clamp, -imfchan, -mm and -t are ignored\n";
  }
  const std::int32_t texture = texture_beside(path, std::string(words.rest()), mesh);
  if (texture < 0) material.ignored |= ignored_texture;
  return texture;
}

/// A material of the file as its lines are read.
struct MtlMaterial {
  ImportedMaterial result{.is_of_the_file = 1};
  TexturePlacement placement, other;
  std::optional<std::array<float, 3>> diffuse, specular;
  float exponent = 0.0f, illumination = 2.0f;
  bool metallic_roughness = false, rough = false;
};

void read_mtl_line(const std::string& key, Words words, const fs::path& path, MtlMaterial& m,
                   ImportedMesh& mesh) {
  ImportedMaterial& result = m.result;
  const auto number = [&] { return static_cast<float>(number_of(Words(words).next())); };
  const auto ignore = [&](std::uint32_t part, bool when) {
    if (when) result.ignored |= part;
  };
  const auto shines = [&] {
    const auto colour = mtl_colour(words, mesh);
    return colour && (*colour)[0] + (*colour)[1] + (*colour)[2] > 0.0f;
  };
  if (key == "kd") m.diffuse = mtl_colour(words, mesh);
  if (key == "ks") m.specular = mtl_colour(words, mesh);
  if (key == "ns") m.exponent = number();
  if (key == "illum") m.illumination = number();
  if (key == "pm") result.metallic = number(), m.metallic_roughness = true;
  if (key == "pr") result.roughness = number(), m.metallic_roughness = m.rough = true;
  if (key == "map_kd") result.texture = mtl_texture(words, path, m.placement, result, mesh);
  if (key == "map_pm") result.metallic_texture = mtl_texture(words, path, m.other, result, mesh);
  if (key == "map_pr") result.roughness_texture = mtl_texture(words, path, m.other, result, mesh);
  ignore(ignored_layers, key == "map_ks" || key == "map_ns" || key == "refl" ||
                             ((key == "pc" || key == "ps") && number() > 0.0f));
  ignore(ignored_relief,
         key == "map_bump" || key == "bump" || key == "norm" || key == "disp" || key == "map_norm");
  ignore(ignored_emission, key == "map_ke" || (key == "ke" && shines()));
  ignore(ignored_transparency, key == "map_d" || key == "map_tr" || (key == "tr" && number() > 0.0f));
  if (key == "d") {
    const std::vector<double> values =
        numbers_of(Words(words.rest().starts_with("-halo") ? words.rest().substr(5) : words.rest()));
    ignore(ignored_transparency, !values.empty() && values[0] < 1.0);
  }
}

/// Highlights are those of Ks, the reflectance beside Kd, and of Ns, the exponent n of Blinn's half-vector
/// lobe, as wide as a GGX lobe of α² = 2/(n + 2) (Walter et al. 2007, section 5.2). The illumination models 0
/// and 1 have none.
const ImportedMaterial& finish(MtlMaterial& m) {
  ImportedMaterial& result = m.result;
  const bool textured = result.texture >= 0;
  result.base_colour =
      m.diffuse.value_or(textured ? std::array{1.0f, 1.0f, 1.0f} : std::array{0.8f, 0.8f, 0.8f});
  if (!m.rough) result.roughness = std::pow(2.0f / (std::max(m.exponent, 0.0f) + 2.0f), 0.25f);
  if (m.specular && m.illumination >= 2.0f && !m.metallic_roughness) result.specular = *m.specular;
  note_excess(result);
  if (m.metallic_roughness) {
    result.specular.fill(dielectric_reflectance);
  } else {
    // Kd and Ks add up, where the diffuse part of metallic-roughness is multiplied by what is left.
    for (std::size_t c = 0; c < 3; ++c)
      result.base_colour[c] /= std::clamp(1.0f - result.specular[c], 1e-3f, 1.0f);
  }
  if (!textured) m.placement = m.other;
  if (!(m.placement == m.other) && (result.metallic_texture >= 0 || result.roughness_texture >= 0))
    result.ignored |= ignored_texture;
  return result;
}

std::string content_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

void read_mtl(const fs::path& file, const fs::path& path, Mtl& mtl, ImportedMesh& mesh) {
  std::optional<MtlMaterial> material;
  std::string name;
  const auto close = [&] {
    if (!material) return;
    mtl.index.try_emplace(name, static_cast<std::uint32_t>(mtl.materials.size()));
    mtl.materials.push_back(finish(*material));
    mtl.placements.push_back(material->placement);
  };
  for_lines(content_of(file), true, [&](std::string_view line) {
    Words words(line);
    std::string key(words.next());
    std::ranges::transform(key, key.begin(),
                           [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (key == "newmtl") {
      close();
      material.emplace();
      name = words.rest();
    } else if (material) {
      read_mtl_line(key, words, path, *material, mesh);
    }
  });
  close();
}

// ---- OBJ

class Obj {
 public:
  explicit Obj(const fs::path& path) : path_(path) {}

  void read_line(std::string_view line) {
    Words words(line);
    const std::string_view key = words.next();
    if (key == "v") return read_vertex(numbers_of(words));
    if (key == "vt" || key == "vn") {
      std::vector<double> values = numbers_of(words);
      values.resize(3);
      (key == "vt" ? places_ : normals_).emplace_back(values[0], values[1], values[2]);
    }
    if (key == "f" || key == "fo") read_face(words);
    if (key == "usemtl") used_.emplace_back(words.rest());
    if (key == "mtllib") read_library(words);
    if (key == "surf" || key == "curv" || key == "call")
      mesh_.notes += "free-form curves and surfaces, and files that it includes, are ignored\n";
  }

  ImportedMesh finish() {
    std::vector<std::uint32_t> materials;
    for (const std::string& name : used_) {
      const auto material = mtl_.index.find(name);
      materials.push_back(material == mtl_.index.end() ? 0 : material->second);
      lacks_ = lacks_ || (materials.back() == 0 && !name.empty());
    }
    if (lacks_)
      mesh_.notes +=
          "it has not all the materials that it names; parts without are white (reflectance 0.8)\n";
    mtl_.materials[0].base_colour = {0.8f, 0.8f, 0.8f};
    scale_colours(colours_, false);
    const auto all = [&](std::size_t part) {
      return std::ranges::none_of(corners_, [&](const Corner& c) { return c.index[part] == none; });
    };
    const bool normals = all(2), places = !places_.empty();
    for (const Corner& corner : corners_) {
      mesh_.positions.push_back(at(positions_, corner.index[0]).cast<float>());
      if (normals) mesh_.normals.push_back(at(normals_, corner.index[2]).cast<float>());
      if (is_coloured_) mesh_.colours.push_back(colours_[static_cast<std::size_t>(corner.index[0])]);
      mesh_.material.push_back(materials[corner.material]);
      if (!places) continue;
      const Eigen::Vector3d place =
          corner.index[1] == none ? Eigen::Vector3d(0, 0, 0) : at(places_, corner.index[1]);
      const TexturePlacement& placement = mtl_.placements[mesh_.material.back()];
      mesh_.texture_places.push_back(placement.turn * place.head<2>().cast<float>() + placement.offset);
    }
    std::uint32_t vertex = 0;
    for (const std::uint32_t size : sizes_) {
      std::vector<std::uint32_t> polygon(size);
      for (std::uint32_t& corner : polygon) corner = vertex++;
      append_polygon(std::move(polygon), mesh_);
    }
    mesh_.materials = std::move(mtl_.materials);
    return std::move(mesh_);
  }

 private:
  static constexpr double none = -1e300;
  struct Corner {
    std::array<double, 3> index;  ///< position, texture coordinates, normal; from 0
    std::uint32_t material;       ///< index in used_
  };

  static const Eigen::Vector3d& at(const std::vector<Eigen::Vector3d>& values, double index) {
    return values[index_of(index, values.size())];
  }

  void read_vertex(const std::vector<double>& values) {
    if (values.size() != 3 && values.size() != 4 && values.size() != 6)
      throw MeshFault("a vertex has " + std::to_string(values.size()) +
                      " numbers; give x y z, x y z w or x y z r g b");
    const double w = values.size() == 4 && values[3] != 0.0 ? values[3] : 1.0;
    positions_.emplace_back(values[0] / w, values[1] / w, values[2] / w);
    const bool coloured = values.size() == 6;
    is_coloured_ = is_coloured_ || coloured;
    colours_.push_back(coloured ? Eigen::Array3d(values[3], values[4], values[5]).cast<float>()
                                : Colour(Colour::Ones()));
  }

  void read_face(Words words) {
    const std::array counts = {positions_.size(), places_.size(), normals_.size()};
    std::uint32_t size = 0;
    std::vector<Corner> corners;
    for (std::string_view word = words.next(); !word.empty() && word[0] != '#'; word = words.next(), ++size) {
      Corner corner{{none, none, none}, static_cast<std::uint32_t>(used_.size() - 1)};
      for (std::size_t part = 0; part < 3 && !word.empty(); ++part) {
        const std::string_view number = word.substr(0, word.find('/'));
        word.remove_prefix(std::min(number.size() + 1, word.size()));
        if (number.empty()) continue;
        const double index = number_of(number);
        // Negative ones count from the last.
        corner.index[part] = index < 0.0 ? static_cast<double>(counts[part]) + index : index - 1.0;
      }
      corners.push_back(corner);
    }
    if (size < 3) return;  // a point or a line
    corners_.insert(corners_.end(), corners.begin(), corners.end());
    sizes_.push_back(size);
  }

  void read_library(Words words) {
    std::vector<std::string> names{std::string(words.rest())};
    const auto found = [&](std::string name) {
      std::ranges::replace(name, '\\', '/');
      std::string refused;
      for (const fs::path& file :
           {path_.parent_path() / name, path_.parent_path() / fs::path(name).filename()}) {
        if (may_be_read_for(path_, file, &refused)) {
          read_mtl(file, path_, mtl_, mesh_);
          return true;
        }
        if (!refused.empty())
          throw MeshFault("it refers to " + refused + "; put all that belongs to the mesh into one folder");
      }
      return false;
    };
    // One name with blanks in it, or several names.
    if (found(names[0])) return;
    for (std::string_view word = words.next(); !word.empty(); word = words.next())
      lacks_ = !found(std::string(word)) || lacks_;
  }

  fs::path path_;
  ImportedMesh mesh_;
  Mtl mtl_;
  std::vector<Eigen::Vector3d> positions_, places_, normals_;
  std::vector<Colour> colours_;
  std::vector<Corner> corners_;
  std::vector<std::uint32_t> sizes_;
  std::vector<std::string> used_{""};  ///< names of materials, in the order of their use
  bool is_coloured_ = false, lacks_ = false;
};

}  // namespace

void note_excess(ImportedMaterial& material) {
  const auto exceeds = [](float factor) { return !(factor >= 0.0f && factor <= 1.0f); };
  std::array<float, 3>& base = material.base_colour;
  // Exporters that let the texture say everything write black.
  if (material.texture >= 0 && base == std::array{0.0f, 0.0f, 0.0f}) base = {1.0f, 1.0f, 1.0f};
  if (std::ranges::any_of(base, exceeds) || std::ranges::any_of(material.specular, exceeds) ||
      exceeds(material.metallic) || exceeds(material.roughness))
    material.ignored |= ignored_excess;
}

std::int32_t texture_beside(const fs::path& path, std::string name, ImportedMesh& mesh) {
  std::ranges::replace(name, '\\', '/');  // of Windows
  fs::path file = path.parent_path() / name;
  // Exporters write where the image was on their own machine.
  if (!may_be_read_for(path, file)) file = path.parent_path() / fs::path(name).filename();
  if (name.empty() || !may_be_read_for(path, file)) return -1;
  const auto known = std::ranges::find(mesh.textures, file.string(), &ImportedTexture::file);
  const auto index = static_cast<std::int32_t>(known - mesh.textures.begin());
  if (known == mesh.textures.end()) mesh.textures.push_back({file.string(), {}});
  return index;
}

void append_polygon(std::vector<std::uint32_t> corners, ImportedMesh& mesh) {
  constexpr std::size_t max_corners = 4096;  // of which ears are searched in a fraction of a second
  for (const std::uint32_t corner : corners) index_of(corner, mesh.positions.size());
  if (corners.size() < 3) return;
  if (corners.size() > max_corners) throw MeshFault("a polygon has over 4096 corners; triangulate the mesh");
  const auto at = [&](std::size_t i) -> Eigen::Vector3d {
    return mesh.positions[corners[i % corners.size()]].cast<double>();
  };
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) normal += (at(i) - at(0)).cross(at(i + 1) - at(0));
  const auto left = [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
    return (b - a).cross(c - a).dot(normal);
  };
  const auto is_ear = [&](std::size_t i) {
    const Eigen::Vector3d a = at(i + corners.size() - 1), b = at(i), c = at(i + 1);
    if (!(left(a, b, c) > 0.0)) return false;
    for (std::size_t j = 0; j < corners.size(); ++j)
      if (const Eigen::Vector3d p = at(j);
          p != a && p != b && p != c && left(a, b, p) >= 0.0 && left(b, c, p) >= 0.0 && left(c, a, p) >= 0.0)
        return false;
    return true;
  };
  while (corners.size() > 3) {
    std::size_t ear = 1;
    while (ear < corners.size() && !is_ear(ear)) ++ear;
    if (ear == corners.size() && !is_ear(0)) ear = 1;  // it crosses itself or has no area
    ear %= corners.size();
    const std::size_t before = (ear + corners.size() - 1) % corners.size(),
                      after = (ear + 1) % corners.size();
    mesh.triangles.push_back({corners[before], corners[ear], corners[after]});
    corners.erase(corners.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  mesh.triangles.push_back({corners[0], corners[1], corners[2]});
}

ImportedMesh read_ply(std::string_view bytes, const fs::path& path) {
  const PlyHeader header = read_ply_header(bytes);
  PlyBody body(header);
  ImportedMesh mesh;
  Faces faces;
  for (const PlyElement& element : header.elements) {
    if (element.name == "vertex")
      read_vertices(element, body, mesh);
    else if (element.name == "face" || element.name == "tristrips" || element.name == "trifans")
      read_faces(element, body, faces);
    else
      for (auto [row, i] = std::pair(PlyRows(element, body), 0.0); i < element.count; ++i) row.next();
  }
  body.require_end();
  if (!header.texture.empty()) {
    ImportedMaterial& material = mesh.materials.emplace_back();
    material.is_of_the_file = 1;
    material.texture = texture_beside(path, header.texture, mesh);
    if (material.texture < 0) material.ignored |= ignored_texture;
  }
  append_faces(faces, mesh);
  return mesh;
}

ImportedMesh read_off(std::string_view bytes) {
  ImportedMesh mesh;
  Faces faces;
  std::optional<double> vertices, face_count;
  bool normals = false, colours = false, places = false, begun = false;
  const auto read_line = [&](std::string_view line) {
    Words words(line.substr(0, line.find('#')));
    if (words.rest().empty()) return;
    if (!std::exchange(begun, true) && words.rest().find("OFF") != std::string_view::npos) {
      const std::string_view key = words.next();
      if (key.find_first_of("4n") != std::string_view::npos || words.rest() == "BINARY")
        throw MeshFault("it is a binary or four-dimensional OFF; export it as text with x, y and z");
      places = key.starts_with("ST");
      colours = key.find('C') != std::string_view::npos;
      normals = key.find('N') != std::string_view::npos;
      if (words.rest().empty()) return;
    }
    if (!vertices) {
      vertices = number_of(words.next());
      face_count = number_of(words.next());
      require_room(bytes, "vertices", *vertices, 6);  // "0 0 0\n"
      require_room(bytes, "faces", *face_count, 4);
      return;
    }
    if (static_cast<double>(mesh.positions.size()) < *vertices) {
      const std::vector<double> v = numbers_of(words);
      const std::size_t plain = 3 + (normals ? 3 : 0) + (places ? 2 : 0),
                        expected = plain + (colours ? 4 : 0);
      if (v.size() != expected && !(colours && v.size() == plain + 3))
        throw MeshFault("a vertex has " + std::to_string(v.size()) +
                        " numbers where the first line of the file promises " + std::to_string(expected) +
                        "; put each vertex on a line, and name the file's variant (COFF, NOFF, STOFF)");
      const auto part = [&](std::size_t i) {
        return Eigen::Vector3d(v[i], v[i + 1], v[i + 2]).cast<float>().eval();
      };
      mesh.positions.push_back(part(0));
      if (normals) mesh.normals.push_back(part(3));
      if (colours) mesh.colours.push_back(part(normals ? 6 : 3).array());
      if (places) mesh.texture_places.emplace_back(v[v.size() - 2], v[v.size() - 1]);
      return;
    }
    if (static_cast<double>(faces.sizes.size()) >= *face_count)
      throw MeshFault("it holds more faces than it promises; it is damaged");
    const double count = number_of(words.next());
    require_room(line, "corners of a face", count, 1);
    std::vector<double> corners;
    for (double i = 0.0; i < count; ++i) corners.push_back(number_of(words.next()));
    faces.append(corners);
    const std::vector<double> colour = numbers_of(words);
    if (colour.size() >= 3) {
      faces.colours.resize(faces.sizes.size() - 1, Colour::Constant(-1.0f));
      faces.colours.push_back(Eigen::Array3d(colour[0], colour[1], colour[2]).cast<float>());
    } else if (colour.size() == 1) {
      mesh.notes = "colours of faces that are indices of a colour map are ignored\n";
    }
  };
  for_lines(bytes, false, read_line);
  if (!vertices) throw MeshFault("it holds no counts of vertices and faces; it is empty or no OFF file");
  if (static_cast<double>(mesh.positions.size()) < *vertices ||
      static_cast<double>(faces.sizes.size()) < *face_count)
    throw MeshFault("it holds less than it promises; it is damaged or cut off");
  scale_colours(mesh.colours, false);
  if (!faces.colours.empty()) {
    faces.colours.resize(faces.sizes.size(), Colour::Constant(-1.0f));
    scale_colours(faces.colours, false);
    for (Colour& colour : faces.colours)
      if ((colour < 0.0f).any()) colour = Colour::Ones();
  }
  append_faces(faces, mesh);
  return mesh;
}

ImportedMesh read_obj(std::string_view bytes, const fs::path& path) {
  Obj obj(path);
  for_lines(bytes, true, [&](std::string_view line) { obj.read_line(line); });
  return obj.finish();
}

}  // namespace refield::prt
