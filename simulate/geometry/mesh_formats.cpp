// SPDX-License-Identifier: Apache-2.0
#include "simulate/geometry/mesh_formats.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <map>
#include <span>
#include <sstream>
#include <utility>

#include "core/base/number_text.h"

namespace refield::prt {

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
      throw MeshFault("line ", number, ": ", fault.what());
    }
    joined.clear();
  }
}

std::string text_of(double number) {
  std::ostringstream text;
  text << std::setprecision(12) << number;
  return text.str();
}

std::uint32_t index_of(double index, std::size_t count) {
  if (index >= 0.0 && index < static_cast<double>(count) && index == std::floor(index))
    return static_cast<std::uint32_t>(index);
  throw MeshFault("a face names vertex ", text_of(index), " of ", count,
                  ": the index is out of range; export the file again");
}

void require_room(std::string_view bytes, const char* what, double count, double least_bytes) {
  if (count >= 0.0 && count * least_bytes <= static_cast<double>(bytes.size())) return;
  throw MeshFault("it promises ", text_of(count), ' ', what, ", but a file of ", bytes.size(),
                  " bytes cannot hold that many; it is damaged or cut off");
}

/// Divides colours by what they count to: bytes by 255; longer integers and floats may count to 1, 255 or
/// 65535.
void scale_colours(std::vector<Colour>& colours, bool are_bytes = false) {
  float largest = 0.0f;
  for (const Colour& colour : colours) largest = std::max(largest, colour.maxCoeff());
  if (largest > 65535.0f) throw MeshFault("its colours exceed 65535; export them as bytes");
  const float full = largest > 255.0f ? 65535.0f : largest > 2.0f || are_bytes ? 255.0f : 1.0f;
  for (Colour& colour : colours) colour /= full;
}

/// Where a file gives others a colour; white in the end.
Colour uncoloured() {
  return Colour::Constant(-1.0f);
}

void whiten(std::vector<Colour>& colours) {
  for (Colour& colour : colours)
    if (colour[0] < 0.0f) colour = Colour::Ones();
}

constexpr double no_index = -1e300;

struct Corner {
  double position, place = no_index, normal = no_index;  ///< as the file has them, from 0
};

/// What files hold: values, and faces whose corners have an index of each.
struct Faces {
  void append(std::span<const Corner> polygon, std::uint32_t material = 0) {
    corners.insert(corners.end(), polygon.begin(), polygon.end());
    sizes.push_back(polygon.size());
    materials.push_back(material);
  }
  /// A face of vertices that have all values.
  void append(std::span<const double> vertices) {
    std::vector<Corner> polygon;
    for (const double v : vertices)
      polygon.push_back({v, places.empty() ? no_index : v, normals.empty() ? no_index : v});
    append(polygon);
  }

  std::vector<Eigen::Vector3f> positions, normals;
  std::vector<Colour> colours;  ///< [positions], or empty
  std::vector<Eigen::Vector2f> places;
  std::vector<Corner> corners;
  std::vector<std::size_t> sizes;        ///< [faces]
  std::vector<std::uint32_t> materials;  ///< [faces]
  std::vector<Colour> face_colours;      ///< [faces], or empty
};

/// Adds the faces to a mesh without vertices. Each corner has its own, unless all values have the same index.
ImportedMesh assemble(const Faces& faces, ImportedMesh mesh) {
  const bool own = !faces.face_colours.empty() || mesh.materials.size() > 1 ||
                   std::ranges::any_of(faces.corners, [](const Corner& c) {
                     return (c.place != no_index && c.place != c.position) ||
                            (c.normal != no_index && c.normal != c.position);
                   });
  const bool normals = !faces.normals.empty() && std::ranges::none_of(faces.corners, [](const Corner& c) {
    return c.normal == no_index;
  });
  const auto append_vertex = [&](const Corner& c, std::size_t face) {
    const std::uint32_t position = index_of(c.position, faces.positions.size());
    mesh.positions.push_back(faces.positions[position]);
    if (normals) mesh.normals.push_back(faces.normals[index_of(c.normal, faces.normals.size())]);
    if (!faces.face_colours.empty())
      mesh.colours.push_back(faces.face_colours[face]);
    else if (!faces.colours.empty())
      mesh.colours.push_back(faces.colours[position]);
    if (!faces.places.empty())
      mesh.texture_places.push_back(c.place == no_index
                                        ? Eigen::Vector2f(0.0f, 0.0f)
                                        : faces.places[index_of(c.place, faces.places.size())]);
    mesh.material.push_back(own ? faces.materials[face] : 0);
  };
  for (std::size_t v = 0; !own && v < faces.positions.size(); ++v) {
    const auto index = static_cast<double>(v);
    append_vertex({index, index < static_cast<double>(faces.places.size()) ? index : no_index, index}, 0);
  }
  for (std::size_t face = 0, first = 0; face < faces.sizes.size(); first += faces.sizes[face++]) {
    std::vector<std::uint32_t> polygon;
    for (const Corner& corner : std::span(faces.corners).subspan(first, faces.sizes[face])) {
      polygon.push_back(own ? static_cast<std::uint32_t>(mesh.positions.size())
                            : index_of(corner.position, faces.positions.size()));
      if (own) append_vertex(corner, face);
    }
    append_polygon(std::move(polygon), mesh);
  }
  if (mesh.materials.empty()) mesh.materials.emplace_back();
  return mesh;
}

// ---- PLY

/// Values that are read, under up to three names: x y z, normal, colour, u v; then lists.
constexpr std::size_t ply_normal = 3, ply_colour = 6, ply_place = 9, ply_corners = 11, ply_places = 12,
                      ply_slots = 13;

std::size_t ply_slot(std::string_view name) {
  using Names = std::array<std::string_view, ply_slots>;
  static constexpr std::array<Names, 3> names = {
      Names{"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "u", "v", "vertex_indices", "texcoord"},
      Names{"", "", "", "", "", "", "diffuse_red", "diffuse_green", "diffuse_blue", "s", "t", "vertex_index"},
      Names{"", "", "", "", "", "", "r", "g", "b", "texture_u", "texture_v"}};
  for (const Names& alternative : names)
    if (const auto found = std::ranges::find(alternative, name); found != alternative.end())
      return static_cast<std::size_t>(found - alternative.begin());
  return ply_slots;
}

/// Signed and unsigned integers b B h H i I, floats f d.
char ply_type(std::string_view name) {
  static const std::map<std::string_view, char> types = {
      {"char", 'b'},   {"int8", 'b'},    {"uchar", 'B'},  {"uint8", 'B'},  {"short", 'h'}, {"int16", 'h'},
      {"ushort", 'H'}, {"uint16", 'H'},  {"int", 'i'},    {"int32", 'i'},  {"uint", 'I'},  {"uint32", 'I'},
      {"float", 'f'},  {"float32", 'f'}, {"double", 'd'}, {"float64", 'd'}};
  const auto type = types.find(name);
  if (type == types.end())
    throw MeshFault("its header has a property of an unknown type; export the file again");
  return type->second;
}

struct PlyProperty {
  char type, count;  ///< count: 0 where it is no list
  std::size_t slot;
};

struct PlyElement {
  /// Whether it has these values, or this list.
  bool has(std::size_t slot, std::size_t values) const {
    std::size_t found = 0;
    for (const PlyProperty& property : properties)
      found += property.slot >= slot && property.slot < slot + values &&
               (property.count != 0) == (slot >= ply_corners);
    return found >= values;
  }
  std::string name;
  double rows;
  std::vector<PlyProperty> properties{};
};

class Ply {
 public:
  explicit Ply(std::string_view bytes) : rest_(bytes) {
    if (rest_.starts_with("\xEF\xBB\xBF")) rest_.remove_prefix(3);
    if (!rest_.starts_with("ply")) throw MeshFault("it does not begin with 'ply'; it is no PLY file");
    // The body of a binary file may begin with any byte, so lines end as the first one does.
    const std::string_view line_end = rest_.substr(3, rest_.substr(3).starts_with("\r\n") ? 2 : 1);
    for (bool ends = false; !ends;) {
      const std::size_t end = line_end.empty() ? std::string_view::npos : rest_.find(line_end);
      Words line(rest_.substr(0, end));
      ends = line.rest() == "end_header";
      if (end == std::string_view::npos && !ends)
        throw MeshFault("its header does not end; it is damaged or no PLY file");
      rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + line_end.size());
      read_header(line, bytes);
    }
    words_ = Words(rest_);
    room_ = static_cast<double>(rest_.size());
  }

  ImportedMesh read(const fs::path& path) {
    for (const PlyElement& element : elements_) read_element(element);
    // A row that was misread leaves something over.
    constexpr std::string_view blank(" \t\r\n\0", 5);
    if (is_text_ ? !words_.next().empty() : rest_.find_first_not_of(blank) != std::string_view::npos)
      throw MeshFault("it holds more than its header promises; it is damaged");
    ImportedMesh mesh;
    mesh.notes = notes_;
    if (!texture_.empty()) {
      ImportedMaterial& material = mesh.materials.emplace_back();
      material.is_of_the_file = 1;
      material.texture = texture_beside(path, texture_, mesh);
      if (material.texture < 0) material.ignored |= ignored_texture;
    }
    return assemble(faces_, std::move(mesh));
  }

 private:
  void read_header(Words line, std::string_view bytes) {
    const std::string_view key = line.next();
    if (key == "comment" && line.next() == "TextureFile") {
      if (!texture_.empty() && texture_ != line.rest())
        throw MeshFault("it has several textures (TextureFile); join them, or export it as OBJ or glTF");
      texture_ = line.rest();
    }
    if (key == "format") {
      const std::string_view format = line.next();
      is_text_ = format == "ascii";
      big_ = format == "binary_big_endian";
      if (!is_text_ && !big_ && format != "binary_little_endian")
        throw MeshFault("its format is none of ascii, binary_little_endian and binary_big_endian");
    }
    if (key == "element") {
      const std::string name(line.next());
      elements_.push_back({name, number_of(line.next())});
      const bool vertices = name == "vertex";
      require_room(bytes, vertices ? "vertices" : "elements", elements_.back().rows, vertices ? 3 : 1);
    }
    if (key != "property") return;
    if (elements_.empty()) throw MeshFault("its header has a property before the first element");
    std::string_view type = line.next();
    const char count = type == "list" ? ply_type(line.next()) : '\0';
    if (count != 0) type = line.next();
    const std::string name = lower_case(std::string(line.next()));
    const std::size_t slot = ply_slot(name);
    elements_.back().properties.push_back({ply_type(type), count, slot});
    const auto has = [&](std::string_view word) { return name.find(word) != std::string::npos; };
    if (slot == ply_slots && (has("red") || has("rgb") || has("gray") || has("grey") || has("colo")))
      notes_ += "its property '" + name + "' is ignored; name colours red, green and blue\n";
  }

  template <class Value>
  double binary() {
    if (rest_.size() < sizeof(Value))
      throw MeshFault("it holds less than its header promises; it is cut off");
    std::array<char, sizeof(Value)> bytes;
    std::copy_n(rest_.data(), bytes.size(), bytes.begin());
    if (big_) std::ranges::reverse(bytes);
    rest_.remove_prefix(bytes.size());
    return static_cast<double>(std::bit_cast<Value>(bytes));
  }

  double next(char type) {
    if (is_text_) return number_of(words_.next());
    switch (type) {
      case 'b':
        return binary<std::int8_t>();
      case 'B':
        return binary<std::uint8_t>();
      case 'h':
        return binary<std::int16_t>();
      case 'H':
        return binary<std::uint16_t>();
      case 'i':
        return binary<std::int32_t>();
      case 'I':
        return binary<std::uint32_t>();
      case 'f':
        return binary<float>();
      default:
        return binary<double>();
    }
  }

  void read_row(const PlyElement& element) {
    for (const PlyProperty& property : element.properties) {
      if (property.count == 0) {
        value_[property.slot] = static_cast<float>(next(property.type));
        continue;
      }
      std::vector<double>& list = lists_[property.slot];
      const double count = next(property.count);
      if (!(count >= 0.0 && count <= room_))
        throw MeshFault("a list promises more values than the file can hold; it is damaged");
      list.resize(static_cast<std::size_t>(count));
      for (double& number : list) number = next(property.type);
    }
  }

  void read_element(const PlyElement& element) {
    const bool vertices = element.name == "vertex", fans = element.name == "trifans";
    const bool strips = fans || element.name == "tristrips", faces = element.name == "face";
    const bool normals = element.has(ply_normal, 3), colours = element.has(ply_colour, 3);
    const bool places = element.has(vertices ? ply_place : ply_places, vertices ? 2 : 1);
    if (vertices && !element.has(0, 3)) throw MeshFault("its vertices have no properties x, y and z");
    if ((faces || strips) && !element.has(ply_corners, 1))
      throw MeshFault("its faces have no list vertex_indices; export the file again");
    std::vector<Colour>& own_colours = vertices ? faces_.colours : faces_.face_colours;
    const auto three = [&](std::size_t slot) {
      return Eigen::Vector3f(value_[slot], value_[slot + 1], value_[slot + 2]);
    };
    for (double row = 0.0; row < element.rows; ++row) {
      read_row(element);
      if (vertices) faces_.positions.push_back(three(0));
      if (vertices && normals) faces_.normals.push_back(three(ply_normal));
      if (vertices && places) faces_.places.emplace_back(value_[ply_place], value_[ply_place + 1]);
      if ((vertices || faces) && colours) own_colours.emplace_back(three(ply_colour));
      if (faces) append_face(places);
      if (strips) append_strips(fans);
    }
    const auto red = std::ranges::find(element.properties, ply_colour, &PlyProperty::slot);
    if (vertices || faces) scale_colours(own_colours, red != element.properties.end() && red->type == 'B');
  }

  void append_face(bool places) {
    const std::vector<double>&corners = lists_[ply_corners], &coordinates = lists_[ply_places];
    if (!places) return faces_.append(corners);
    if (coordinates.size() != 2 * corners.size())
      throw MeshFault("a face has other numbers of vertices and texture coordinates; export the file again");
    std::vector<Corner> polygon;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      polygon.push_back({corners[i], static_cast<double>(faces_.places.size()),
                         faces_.normals.empty() ? no_index : corners[i]});
      faces_.places.emplace_back(coordinates[2 * i], coordinates[2 * i + 1]);
    }
    faces_.append(polygon);
  }

  /// Strips (a negative index begins another) and fans as triangles.
  void append_strips(bool fans) {
    const std::vector<double>& corners = lists_[ply_corners];
    for (std::size_t first = 0, i = 0; i < corners.size(); ++i) {
      if (corners[i] < 0.0) first = i + 1;
      if (i < first + 2) continue;
      const double a = corners[fans ? first : i - 2], b = corners[i - 1], c = corners[i];
      if (a == b || b == c || a == c) continue;  // joins strips
      const bool odd = !fans && (i - first) % 2 == 1;
      faces_.append(std::array{odd ? b : a, odd ? a : b, c});
    }
  }

  std::string_view rest_;
  Words words_{{}};
  double room_ = 0.0;
  bool is_text_ = false, big_ = false;
  std::string texture_, notes_;
  std::vector<PlyElement> elements_;
  Faces faces_;
  std::array<float, ply_slots + 1> value_{};
  std::array<std::vector<double>, ply_slots + 1> lists_;
};

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
    if (!mtl.index.try_emplace(name, static_cast<std::uint32_t>(mtl.materials.size())).second)
      mesh.notes += "of materials of one name in its MTL files, the first counts\n";
    mtl.materials.push_back(finish(*material));
    mtl.placements.push_back(material->placement);
  };
  for_lines(content_of(file), true, [&](std::string_view line) {
    Words words(line);
    const std::string key = lower_case(std::string(words.next()));
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
    if (key == "v") read_vertex(numbers_of(words));
    if (key == "#MRGB") read_polypaint(words.rest());
    if (key == "vt" || key == "vn") {
      std::vector<double> values = numbers_of(words);
      values.resize(3);
      const Eigen::Vector3f value = Eigen::Vector3d(values[0], values[1], values[2]).cast<float>();
      if (key == "vt") faces_.places.emplace_back(value.head<2>());
      if (key == "vn") faces_.normals.push_back(value);
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
    for (std::uint32_t& material : faces_.materials) material = materials[material];
    if (painted_ != 0 && painted_ != faces_.positions.size())
      throw MeshFault("it has colours (#MRGB) of ", painted_, " of its ", faces_.positions.size(),
                      " vertices; export it with the colours of all, or of none");
    if (is_coloured_)
      scale_colours(faces_.colours);
    else
      faces_.colours.clear();
    whiten(faces_.colours);
    mtl_.materials[0].base_colour = {0.8f, 0.8f, 0.8f};
    mesh_.materials = std::move(mtl_.materials);
    ImportedMesh mesh = assemble(faces_, std::move(mesh_));
    for (std::size_t v = 0; v < mesh.texture_places.size(); ++v) {
      const TexturePlacement& placement = mtl_.placements[mesh.material[v]];
      mesh.texture_places[v] = (placement.turn * mesh.texture_places[v] + placement.offset).eval();
    }
    return mesh;
  }

 private:
  void read_vertex(const std::vector<double>& values) {
    if (values.size() != 3 && values.size() != 4 && values.size() != 6)
      throw MeshFault("a vertex has ", values.size(), " numbers; give x y z, x y z w or x y z r g b");
    const double w = values.size() == 4 && values[3] != 0.0 ? values[3] : 1.0;
    faces_.positions.push_back((Eigen::Vector3d(values[0], values[1], values[2]) / w).cast<float>());
    const bool coloured = values.size() == 6;
    is_coloured_ = is_coloured_ || coloured;
    faces_.colours.push_back(coloured ? Eigen::Array3d(values[3], values[4], values[5]).cast<float>()
                                      : uncoloured());
  }

  /// ZBrush writes MMRRGGBB (mask and colour) in hexadecimal for each vertex, in comments.
  void read_polypaint(std::string_view digits) {
    constexpr std::size_t length = 8;
    for (; digits.size() >= length && painted_ < faces_.colours.size();
         digits.remove_prefix(length), ++painted_) {
      std::uint32_t value = 0;
      const auto [end, error] = std::from_chars(digits.data(), digits.data() + length, value, 16);
      if (error != std::errc() || end != digits.data() + length) break;
      faces_.colours[painted_] = Colour(value >> 16 & 255, value >> 8 & 255, value & 255) / 255.0f;
    }
    if (!digits.empty()) throw MeshFault("its colours (#MRGB) are not 8 hexadecimal digits for each vertex");
    is_coloured_ = true;
  }

  void read_face(Words words) {
    const std::array counts = {faces_.positions.size(), faces_.places.size(), faces_.normals.size()};
    std::vector<Corner> corners;
    for (std::string_view word = words.next(); !word.empty() && word[0] != '#'; word = words.next()) {
      std::array index = {no_index, no_index, no_index};
      for (std::size_t part = 0; part < 3 && !word.empty(); ++part) {
        const std::string_view number = word.substr(0, word.find('/'));
        word.remove_prefix(std::min(number.size() + 1, word.size()));
        if (number.empty()) continue;
        index[part] = number_of(number);
        // Negative ones count from the last.
        index[part] += index[part] < 0.0 ? static_cast<double>(counts[part]) : -1.0;
      }
      corners.push_back({index[0], index[1], index[2]});
    }
    // Less are a point or a line.
    if (corners.size() > 2) faces_.append(corners, static_cast<std::uint32_t>(used_.size() - 1));
  }

  void read_library(Words words) {
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
          throw MeshFault("it refers to ", refused, "; put all that belongs to the mesh into one folder");
      }
      return false;
    };
    // One name with blanks in it, or several names.
    if (found(std::string(words.rest()))) return;
    for (std::string_view word = words.next(); !word.empty(); word = words.next())
      lacks_ = !found(std::string(word)) || lacks_;
  }

  fs::path path_;
  ImportedMesh mesh_;
  Mtl mtl_;
  Faces faces_;
  std::vector<std::string> used_{""};  ///< names of materials, in the order of their use
  std::size_t painted_ = 0;            ///< vertices
  bool is_coloured_ = false, lacks_ = false;
};

// ---- OFF

class Off {
 public:
  explicit Off(std::string_view bytes) : bytes_(bytes) {}

  void read_line(std::string_view line) {
    Words words(line.substr(0, line.find('#')));
    if (words.rest().empty()) return;
    if (!std::exchange(begun_, true) && words.rest().find("OFF") != std::string_view::npos) {
      const std::string_view key = words.next();
      if (key.find_first_of("4n") != std::string_view::npos || words.rest() == "BINARY")
        throw MeshFault("it is a binary or four-dimensional OFF; export it as text with x, y and z");
      places_ = key.starts_with("ST");
      colours_ = key.find('C') != std::string_view::npos;
      normals_ = key.find('N') != std::string_view::npos;
      if (words.rest().empty()) return;
    }
    if (vertices_ < 0.0) {
      require_room(bytes_, "vertices", vertices_ = number_of(words.next()), 6);  // "0 0 0\n"
      require_room(bytes_, "faces", face_count_ = number_of(words.next()), 4);
    } else if (static_cast<double>(faces_.positions.size()) < vertices_) {
      read_vertex(numbers_of(words));
    } else {
      read_face(words, line);
    }
  }

  ImportedMesh finish() {
    if (vertices_ < 0.0)
      throw MeshFault("it holds no counts of vertices and faces; it is empty or no OFF file");
    if (static_cast<double>(faces_.positions.size()) < vertices_ ||
        static_cast<double>(faces_.sizes.size()) != face_count_)
      throw MeshFault("it holds fewer or more faces than it promises; it is damaged or cut off");
    scale_colours(faces_.colours);
    if (!faces_.face_colours.empty()) faces_.face_colours.resize(faces_.sizes.size(), uncoloured());
    scale_colours(faces_.face_colours);
    whiten(faces_.face_colours);
    return assemble(faces_, std::move(mesh_));
  }

 private:
  void read_vertex(const std::vector<double>& v) {
    const std::size_t plain = 3 + (normals_ ? 3 : 0) + (places_ ? 2 : 0),
                      expected = plain + (colours_ ? 4 : 0);
    if (v.size() != expected && !(colours_ && v.size() == plain + 3))
      throw MeshFault("a vertex has ", v.size(), " numbers where the first line of the file promises ",
                      expected,
                      "; put each vertex on a line, and name the file's variant (COFF, NOFF, STOFF)");
    const auto three = [&](std::size_t i) {
      return Eigen::Vector3d(v[i], v[i + 1], v[i + 2]).cast<float>().eval();
    };
    faces_.positions.push_back(three(0));
    if (normals_) faces_.normals.push_back(three(3));
    if (colours_) faces_.colours.emplace_back(three(normals_ ? 6 : 3));
    if (places_) faces_.places.emplace_back(v[v.size() - 2], v[v.size() - 1]);
  }

  void read_face(Words words, std::string_view line) {
    const double count = number_of(words.next());
    require_room(line, "corners of a face", count, 1);
    std::vector<double> corners;
    for (double i = 0.0; i < count; ++i) corners.push_back(number_of(words.next()));
    const std::vector<double> colour = numbers_of(words);
    if (colour.size() >= 3) {
      faces_.face_colours.resize(faces_.sizes.size(), uncoloured());
      faces_.face_colours.push_back(Eigen::Array3d(colour[0], colour[1], colour[2]).cast<float>());
    } else if (!colour.empty()) {
      mesh_.notes = "colours of faces that are indices of a colour map are ignored\n";
    }
    faces_.append(corners);
  }

  std::string_view bytes_;
  ImportedMesh mesh_;
  Faces faces_;
  double vertices_ = -1.0, face_count_ = 0.0;
  bool begun_ = false, normals_ = false, colours_ = false, places_ = false;
};

}  // namespace

void note_excess(ImportedMaterial& material) {
  const auto exceeds = [](float factor) { return !(factor >= 0.0f && factor <= 1.0f); };
  std::array<float, 3>& base = material.base_colour;
  // Exporters that let the texture say everything write black.
  if (material.texture >= 0 && base == std::array{0.0f, 0.0f, 0.0f}) {
    base = {1.0f, 1.0f, 1.0f};
    material.ignored |= ignored_black;
  }
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
  return Ply(bytes).read(path);
}

ImportedMesh read_off(std::string_view bytes) {
  Off off(bytes);
  for_lines(bytes, false, [&](std::string_view line) { off.read_line(line); });
  return off.finish();
}

ImportedMesh read_obj(std::string_view bytes, const fs::path& path) {
  Obj obj(path);
  for_lines(bytes, true, [&](std::string_view line) { obj.read_line(line); });
  return obj.finish();
}

}  // namespace refield::prt
