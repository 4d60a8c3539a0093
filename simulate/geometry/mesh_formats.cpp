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

std::vector<double> numbers_of(Words words) {
  std::vector<double> numbers;
  for (std::string_view word = words.next(); !word.empty(); word = words.next())
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

/// Divides colours by what they count to. Integers of more than 8 bits, and floats, may still count to 255.
void scale_colours(std::vector<Colour>& colours, bool are_integers, bool are_bytes) {
  float largest = 0.0f;
  for (const Colour& colour : colours) largest = std::max(largest, colour.maxCoeff());
  if (largest > 65535.0f) throw MeshFault("its colours exceed 65535; export them as bytes");
  const float full = are_bytes                                 ? 255.0f
                     : largest <= (are_integers ? 0.0f : 2.0f) ? 1.0f
                     : largest <= 255.0f                       ? 255.0f
                                                               : 65535.0f;
  for (Colour& colour : colours) colour /= full;
}

/// Polygons over vertices, which may have colours and texture coordinates of their own.
struct Faces {
  std::vector<std::vector<double>> corners;  ///< indices as the file has them
  std::vector<Colour> colours;               ///< [faces], or empty
  std::vector<std::vector<double>> places;   ///< u, v of each corner, or empty
};

/// Where a face has values of its own, its vertices are its alone.
void append_faces(const Faces& faces, ImportedMesh& mesh) {
  const std::size_t count = mesh.positions.size();
  const ImportedMesh vertices = mesh;
  const bool own_places = !faces.places.empty(), own = own_places || !faces.colours.empty();
  if (own) mesh.positions.clear(), mesh.normals.clear(), mesh.colours.clear(), mesh.texture_places.clear();
  for (std::size_t f = 0; f < faces.corners.size(); ++f) {
    std::vector<std::uint32_t> polygon;
    for (std::size_t i = 0; i < faces.corners[f].size(); ++i) {
      const std::uint32_t vertex = index_of(faces.corners[f][i], count);
      polygon.push_back(own ? static_cast<std::uint32_t>(mesh.positions.size()) : vertex);
      if (!own) continue;
      mesh.positions.push_back(vertices.positions[vertex]);
      if (!vertices.normals.empty()) mesh.normals.push_back(vertices.normals[vertex]);
      if (!faces.colours.empty() || !vertices.colours.empty())
        mesh.colours.push_back(faces.colours.empty() ? vertices.colours[vertex] : faces.colours[f]);
      if (own_places) {
        const auto& places = faces.places[f];
        if (places.size() != 2 * faces.corners[f].size())
          throw MeshFault(
              "a face has other numbers of vertices and texture coordinates; export the file again");
        mesh.texture_places.emplace_back(places[2 * i], places[2 * i + 1]);
      } else if (!vertices.texture_places.empty()) {
        mesh.texture_places.push_back(vertices.texture_places[vertex]);
      }
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

  std::vector<double> list(const PlyProperty& property) {
    const double count = property.count ? next(*property.count) : 1.0;
    require_room(rest_, "values in a list", count, 1);
    std::vector<double> values(static_cast<std::size_t>(count));
    for (double& value : values) value = next(property.type);
    return values;
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
  bool is_text_, big_;
};

/// What a property of a vertex or of a face is.
enum PlySlot {
  ply_x,
  ply_y,
  ply_z,
  ply_nx,
  ply_ny,
  ply_nz,
  ply_red,
  ply_green,
  ply_blue,
  ply_u,
  ply_v,
  ply_slots
};

std::size_t ply_slot(std::string_view name) {
  static const std::map<std::string_view, PlySlot> slots = {{"x", ply_x},
                                                            {"y", ply_y},
                                                            {"z", ply_z},
                                                            {"nx", ply_nx},
                                                            {"ny", ply_ny},
                                                            {"nz", ply_nz},
                                                            {"red", ply_red},
                                                            {"green", ply_green},
                                                            {"blue", ply_blue},
                                                            {"r", ply_red},
                                                            {"g", ply_green},
                                                            {"b", ply_blue},
                                                            {"diffuse_red", ply_red},
                                                            {"diffuse_green", ply_green},
                                                            {"diffuse_blue", ply_blue},
                                                            {"u", ply_u},
                                                            {"v", ply_v},
                                                            {"s", ply_u},
                                                            {"t", ply_v},
                                                            {"texture_u", ply_u},
                                                            {"texture_v", ply_v}};
  const auto slot = slots.find(name);
  return slot == slots.end() ? ply_slots : slot->second;
}

struct PlyRow {
  std::array<float, ply_slots + 1> value{};
  std::vector<double> corners, places;
};

PlyRow read_row(const PlyElement& element, PlyBody& body) {
  PlyRow row;
  for (const PlyProperty& property : element.properties) {
    std::vector<double> values = body.list(property);
    if (!property.count)
      row.value[ply_slot(property.name)] = static_cast<float>(values[0]);
    else if (property.name == "vertex_indices" || property.name == "vertex_index")
      row.corners = std::move(values);
    else if (property.name == "texcoord")
      row.places = std::move(values);
  }
  return row;
}

/// Strips (a negative index begins another) and fans as triangles.
void append_strips(const std::vector<double>& corners, bool fan, Faces& faces) {
  for (std::size_t first = 0, i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0.0) first = i + 1;
    if (i < first + 2) continue;
    const double a = corners[fan ? first : i - 2], b = corners[i - 1], c = corners[i];
    if (a == b || b == c || a == c) continue;  // joins strips
    const bool odd = !fan && (i - first) % 2 == 1;
    faces.corners.push_back(odd ? std::vector{b, a, c} : std::vector{a, b, c});
  }
}

struct PlyHas {
  explicit PlyHas(const PlyElement& element) {
    for (const PlyProperty& property : element.properties) {
      const std::size_t slot = ply_slot(property.name);
      if (!property.count) slots[slot] = true;
      if (slot == ply_red) colour = property.type;
      corners = corners || property.name == "vertex_indices" || property.name == "vertex_index";
      places = places || (property.count && property.name == "texcoord");
    }
  }
  bool all(PlySlot first, PlySlot last) const {
    return std::all_of(&slots[first], &slots[last] + 1, std::identity());
  }
  void scale(std::vector<Colour>& colours) const {
    if (!colours.empty()) scale_colours(colours, colour.kind != 'f', colour.kind == 'u' && colour.bytes == 1);
  }
  std::array<bool, ply_slots + 1> slots{};
  PlyType colour{'f', 4};
  bool corners = false, places = false;
};

void read_vertices(const PlyElement& element, PlyBody& body, ImportedMesh& mesh) {
  const PlyHas has(element);
  if (!has.all(ply_x, ply_z)) throw MeshFault("its vertices have no properties x, y and z");
  for (double i = 0.0; i < element.count; ++i) {
    const auto value = read_row(element, body).value;
    mesh.positions.emplace_back(value[ply_x], value[ply_y], value[ply_z]);
    if (has.all(ply_nx, ply_nz)) mesh.normals.emplace_back(value[ply_nx], value[ply_ny], value[ply_nz]);
    if (has.all(ply_red, ply_blue))
      mesh.colours.emplace_back(value[ply_red], value[ply_green], value[ply_blue]);
    if (has.all(ply_u, ply_v)) mesh.texture_places.emplace_back(value[ply_u], value[ply_v]);
  }
  has.scale(mesh.colours);
}

void read_faces(const PlyElement& element, PlyBody& body, Faces& faces) {
  const PlyHas has(element);
  if (!has.corners) throw MeshFault("its faces have no list vertex_indices; export the file again");
  for (double i = 0.0; i < element.count; ++i) {
    PlyRow row = read_row(element, body);
    if (element.name != "face") {
      append_strips(row.corners, element.name == "trifans", faces);
      continue;
    }
    faces.corners.push_back(std::move(row.corners));
    if (has.all(ply_red, ply_blue))
      faces.colours.emplace_back(row.value[ply_red], row.value[ply_green], row.value[ply_blue]);
    if (has.places) faces.places.push_back(std::move(row.places));
  }
  has.scale(faces.colours);
}

// ---- MTL

struct Mtl {
  std::vector<ImportedMaterial> materials{1};  ///< the first: none, white as where a file has no materials
  std::vector<TexturePlacement> placements{1};
  std::map<std::string, std::uint32_t, std::less<>> index;
};

/// RGB of Kd, Ks and Ke: one value stands for all three.
std::optional<std::array<float, 3>> mtl_colour(Words words, ImportedMesh& mesh) {
  const bool xyz = Words(words).next() == "xyz";
  if (xyz || Words(words).next() == "spectral") words.next();
  const auto first = number_in(Words(words).next());
  if (!first) {
    mesh.notes += "colours of its materials that are given as spectra are ignored\n";
    return std::nullopt;
  }
  const std::vector<double> values = numbers_of(words);
  const auto value = [&](std::size_t i) { return i < values.size() ? values[i] : values[0]; };
  Eigen::Vector3d colour(value(0), value(1), value(2));
  // IEC 61966-2-1: CIE XYZ, D65.
  if (xyz)
    colour =
        Eigen::Matrix3d{{3.2406, -1.5372, -0.4986}, {-0.9689, 1.8758, 0.0415}, {0.0557, -0.2040, 1.0570}} *
        colour;
  return std::array{static_cast<float>(colour[0]), static_cast<float>(colour[1]),
                    static_cast<float>(colour[2])};
}

/// "-s 2 2 1 -clamp on name of the file.png".
std::int32_t mtl_texture(Words words, const fs::path& path, TexturePlacement& placement,
                         ImportedMaterial& material, ImportedMesh& mesh) {
  static const std::map<std::string_view, int> values = {
      {"-blendu", 1}, {"-blendv", 1},  {"-bm", 1},  {"-boost", 1}, {"-cc", 1},
      {"-clamp", 1},  {"-imfchan", 1}, {"-mm", 2},  {"-o", 3},     {"-s", 3},
      {"-t", 3},      {"-texres", 1},  {"-type", 1}};
  for (Words after = words;; words = after) {
    const std::string_view option = after.next();
    const auto known = values.find(option);
    if (known == values.end()) break;
    std::array<float, 3> given = {1.0f, 1.0f, 1.0f};
    if (option != "-s") given.fill(0.0f);
    std::string_view word;
    for (int i = 0; i < known->second; ++i) {
      Words ahead = after;
      word = ahead.next();
      const auto number = number_in(word);
      if (known->second == 3 && !number) break;  // the second and third are optional
      given[static_cast<std::size_t>(i)] = static_cast<float>(number.value_or(0.0));
      after = ahead;
    }
    if (option == "-s") placement.turn.diagonal() = Eigen::Vector2f(given[0], given[1]);
    if (option == "-o") placement.offset = Eigen::Vector2f(given[0], given[1]);
    if (option == "-mm" || option == "-t" || option == "-imfchan" || (option == "-clamp" && word == "on"))
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
ImportedMaterial finish(MtlMaterial m) {
  ImportedMaterial& result = m.result;
  const auto exceeds = [](float factor) { return !(factor >= 0.0f && factor <= 1.0f); };
  const bool textured = result.texture >= 0;
  result.base_colour =
      m.diffuse.value_or(textured ? std::array{1.0f, 1.0f, 1.0f} : std::array{0.8f, 0.8f, 0.8f});
  // Exporters that let the texture say everything write black.
  if (textured && result.base_colour == std::array{0.0f, 0.0f, 0.0f}) result.base_colour = {1.0f, 1.0f, 1.0f};
  bool excess = std::ranges::any_of(result.base_colour, exceeds) || exceeds(result.metallic) ||
                exceeds(result.roughness);
  if (!m.rough) result.roughness = std::pow(2.0f / (std::max(m.exponent, 0.0f) + 2.0f), 0.25f);
  if (m.metallic_roughness) {
    result.specular.fill(dielectric_reflectance);
  } else if (m.specular && m.illumination >= 2.0f) {
    result.specular = *m.specular;
    // Kd and Ks add up, where the diffuse part of metallic-roughness is multiplied by what is left.
    for (std::size_t c = 0; c < 3; ++c)
      result.base_colour[c] /= std::clamp(1.0f - result.specular[c], 1e-3f, 1.0f);
    excess = excess || std::ranges::any_of(result.specular, exceeds);
  }
  if (excess) result.ignored |= ignored_excess;
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
    Words words(line.substr(0, line.find('#')));
    const std::string_view key = words.next();
    if (key == "v") return read_vertex(numbers_of(words));
    if (key == "vt" || key == "vn") {
      std::vector<double> values = numbers_of(words);
      values.resize(3);
      (key == "vt" ? places_ : normals_).emplace_back(values[0], values[1], values[2]);
    }
    if (key == "f" || key == "fo") read_face(words);
    if (key == "usemtl") {
      const auto material = mtl_.index.find(words.rest());
      material_ = material == mtl_.index.end() ? 0 : material->second;
      lacks_ = lacks_ || (material_ == 0 && !words.rest().empty());
    }
    if (key == "mtllib") read_library(words);
    if (key == "surf" || key == "curv" || key == "call")
      mesh_.notes += "free-form curves and surfaces, and files that it includes, are ignored\n";
  }

  ImportedMesh finish() {
    if (lacks_)
      mesh_.notes +=
          "it has not all the materials that it names; parts without are white (reflectance 0.8)\n";
    mtl_.materials[0].base_colour = {0.8f, 0.8f, 0.8f};
    scale_colours(colours_, false, false);
    const auto all = [&](std::size_t part) {
      return std::ranges::none_of(corners_, [&](const Corner& c) { return c.index[part] == none; });
    };
    const bool normals = all(2), places = !places_.empty();
    for (const Corner& corner : corners_) {
      mesh_.positions.push_back(at(positions_, corner.index[0]).cast<float>());
      if (normals) mesh_.normals.push_back(at(normals_, corner.index[2]).cast<float>());
      if (is_coloured_) mesh_.colours.push_back(colours_[static_cast<std::size_t>(corner.index[0])]);
      mesh_.material.push_back(corner.material);
      if (!places) continue;
      const Eigen::Vector3d place =
          corner.index[1] == none ? Eigen::Vector3d(0, 0, 0) : at(places_, corner.index[1]);
      const TexturePlacement& placement = mtl_.placements[corner.material];
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
    std::uint32_t material;
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
    for (std::string_view word = words.next(); !word.empty(); word = words.next(), ++size) {
      Corner corner{{none, none, none}, material_};
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
  std::uint32_t material_ = 0;
  bool is_coloured_ = false, lacks_ = false;
};

}  // namespace

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
      for (double i = 0.0; i < element.count; ++i) read_row(element, body);
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
  bool normals = false, colours = false, places = false, begun = false, whole_numbers = true;
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
    if (static_cast<double>(faces.corners.size()) >= *face_count)
      throw MeshFault("it holds more faces than it promises; it is damaged");
    const double count = number_of(words.next());
    require_room(line, "corners of a face", count, 1);
    std::vector<double>& corners = faces.corners.emplace_back();
    for (double i = 0.0; i < count; ++i) corners.push_back(number_of(words.next()));
    whole_numbers = whole_numbers && words.rest().find('.') == std::string_view::npos;
    const std::vector<double> colour = numbers_of(words);
    if (colour.size() >= 3) {
      faces.colours.resize(faces.corners.size() - 1, Colour::Constant(-1.0f));
      faces.colours.push_back(Eigen::Array3d(colour[0], colour[1], colour[2]).cast<float>());
    } else if (colour.size() == 1) {
      mesh.notes = "colours of faces that are indices of a colour map are ignored\n";
    }
  };
  for_lines(bytes, false, read_line);
  if (!vertices) throw MeshFault("it holds no counts of vertices and faces; it is empty or no OFF file");
  if (static_cast<double>(mesh.positions.size()) < *vertices ||
      static_cast<double>(faces.corners.size()) < *face_count)
    throw MeshFault("it holds less than it promises; it is damaged or cut off");
  scale_colours(mesh.colours, false, false);
  if (!faces.colours.empty()) {
    faces.colours.resize(faces.corners.size(), Colour::Constant(-1.0f));
    scale_colours(faces.colours, whole_numbers, false);
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
