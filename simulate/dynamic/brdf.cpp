// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/brdf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "core/base/errors.h"
#include "core/base/files.h"
#include "core/base/number_text.h"

namespace refield::dynamic {

namespace fs = std::filesystem;

namespace {

struct Between {
  std::size_t first;
  float share;  // of the next one
};

/// Where an angle stands among `samples` from 0 to `end`.
Between between(float angle, float end, int samples) {
  const float place = std::clamp(angle / end, 0.0f, 1.0f) * static_cast<float>(samples - 1);
  const int first = std::min(static_cast<int>(place), samples - 2);
  return {static_cast<std::size_t>(first), place - static_cast<float>(first)};
}

bool is_reflectance(float value) {
  return std::isfinite(value) && value >= 0.0f;
}

/// Words of a text, one after another.
class Words {
 public:
  Words(const fs::path& path, std::string text) : path_(path), text_(std::move(text)), rest_(text_) {}

  std::optional<std::string_view> next() {
    for (;;) {
      rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t\r\n"), rest_.size()));
      if (rest_.empty()) return std::nullopt;
      if (rest_.front() != '#') break;
      rest_.remove_prefix(std::min(rest_.find('\n'), rest_.size()));
    }
    const std::string_view word = rest_.substr(0, rest_.find_first_of(" \t\r\n#"));
    rest_.remove_prefix(word.size());
    return word;
  }

  void expect(std::string_view word) {
    const auto found = next();
    if (found != word)
      throw FormatError(path_, "\"" + std::string(found.value_or("")) + "\" where \"" + std::string(word) +
                                   "\" should stand; a table begins with \"refield brdf 1\" and "
                                   "\"theta_in COUNT theta_out COUNT delta_phi COUNT\"");
  }

  int count(const char* name) {
    expect(name);
    const std::string_view word = next().value_or("");
    const auto value = number_from_text<int>(word);
    if (!value || *value < BrdfTable::least || *value > BrdfTable::most)
      throw FormatError(path_,
                        std::string(name) + " \"" + std::string(word) + "\": give a number from 2 to 181");
    return *value;
  }

  float reflectance(std::size_t sample) {
    const auto word = next();
    if (!word)
      throw FormatError(path_, "ends in sample " + std::to_string(sample) + "; it has been cut short");
    const auto value = number_from_text<float>(*word);
    if (!value || !is_reflectance(*value))
      throw FormatError(path_, "sample " + std::to_string(sample) + " has the value \"" + std::string(*word) +
                                   "\"; give finite numbers that are not negative");
    return *value;
  }

 private:
  const fs::path& path_;
  std::string text_;
  std::string_view rest_;
};

}  // namespace

BrdfTable::BrdfTable(int theta_in, int theta_out, int delta_phi, std::vector<Eigen::Array3f> values)
    : theta_in_(theta_in), theta_out_(theta_out), delta_phi_(delta_phi), values_(std::move(values)) {
  for (const int count : {theta_in, theta_out, delta_phi})
    if (count < least || count > most)
      throw InputError("BRDF table: " + std::to_string(count) + " samples of an angle: give from 2 to 181");
  const auto needed = static_cast<std::size_t>(theta_in) * static_cast<std::size_t>(theta_out) *
                      static_cast<std::size_t>(delta_phi);
  if (values_.size() != needed)
    throw InputError("BRDF table: " + std::to_string(values_.size()) + " samples: its counts ask for " +
                     std::to_string(needed));
  for (std::size_t s = 0; s < values_.size(); ++s)
    for (int c = 0; c < 3; ++c)
      if (!is_reflectance(values_[s][c]))
        throw InputError("BRDF table: sample " + std::to_string(s) + " is " + std::to_string(values_[s][c]) +
                         ": give finite numbers that are not negative");
}

Eigen::Array3f BrdfTable::at(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const {
  constexpr float straight = std::numbers::pi_v<float>;
  const auto from_normal = [](const Eigen::Vector3f& d) { return std::atan2(d.head<2>().norm(), d.z()); };
  const float turn = std::atan2(in.x() * out.y() - in.y() * out.x(), in.head<2>().dot(out.head<2>()));
  const std::array place{between(from_normal(in), straight / 2, theta_in_),
                         between(from_normal(out), straight / 2, theta_out_),
                         between(std::abs(turn), straight, delta_phi_)};
  Eigen::Array3f sum = Eigen::Array3f::Zero();
  for (unsigned corner = 0; corner < 8; ++corner) {
    float share = 1.0f;
    std::array<std::size_t, 3> index{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const bool next = (corner >> axis & 1u) != 0;
      share *= next ? place[axis].share : 1.0f - place[axis].share;
      index[axis] = place[axis].first + (next ? 1 : 0);
    }
    sum += share * values_[(index[0] * static_cast<std::size_t>(theta_out_) + index[1]) *
                               static_cast<std::size_t>(delta_phi_) +
                           index[2]];
  }
  return sum;
}

BrdfTable read_brdf_table(const fs::path& path) {
  Words words(path, read_text(path));
  for (const char* word : {"refield", "brdf", "1"}) words.expect(word);
  const int theta_in = words.count("theta_in"), theta_out = words.count("theta_out");
  const int delta_phi = words.count("delta_phi");
  std::vector<Eigen::Array3f> values(static_cast<std::size_t>(theta_in) *
                                     static_cast<std::size_t>(theta_out) *
                                     static_cast<std::size_t>(delta_phi));
  for (std::size_t s = 0; s < values.size(); ++s)
    for (int c = 0; c < 3; ++c) values[s][c] = words.reflectance(s);
  if (words.next())
    throw FormatError(path, "has more numbers than its counts ask for, 3 × " + std::to_string(values.size()));
  return {theta_in, theta_out, delta_phi, std::move(values)};
}

namespace {

constexpr float float_pi = std::numbers::pi_v<float>;
/// Cosines below this count as the horizon: half vectors of two such directions would be lost in float.
constexpr float horizon = 1e-6f;

float phong(float exponent, const Eigen::Vector3f& in, const Eigen::Vector3f& out) {
  const float cosine = in.z() * out.z() - in.x() * out.x() - in.y() * out.y();
  return cosine > 0.0f ? (exponent + 2.0f) / (2.0f * float_pi) * std::pow(std::min(cosine, 1.0f), exponent)
                       : 0.0f;
}

Eigen::Array3f ggx(const Eigen::Array3f& specular, float roughness, const Eigen::Vector3f& in,
                   const Eigen::Vector3f& out) {
  const Eigen::Vector3f half = (in + out).normalized();
  const float squared = roughness * roughness;
  // 1 − z² as the length across: what is left of 1 − z in float would not tell narrow lobes apart.
  const float across = half.head<2>().squaredNorm();
  const float spread = across + squared * half.z() * half.z();
  const float distribution = squared / (float_pi * spread * spread);
  const auto leaving = [squared](float cosine) {
    return std::sqrt(squared + (1.0f - squared) * cosine * cosine);
  };
  const float shadowing_by_cosines =
      0.5f / (out.z() * leaving(in.z()) + in.z() * leaving(out.z()));  // G/(4 cosθ cosθ_o)
  const float grazing = std::pow(1.0f - std::clamp(in.dot(half), 0.0f, 1.0f), 5.0f);
  return (specular + (1.0f - specular) * grazing) * (distribution * shadowing_by_cosines);
}

void require(bool good, const char* name, const std::string& value, const char* remedy) {
  if (!good) throw InputError(std::string("BRDF: ") + name + " " + value + ": " + remedy);
}

}  // namespace

Eigen::Array3f Brdf::operator()(const Eigen::Vector3f& in, const Eigen::Vector3f& out) const {
  if (in.z() <= horizon || out.z() <= horizon) return Eigen::Array3f::Zero();
  Eigen::Array3f matte = diffuse / float_pi;
  switch (lobe) {
    case Lobe::none:
      return matte;
    case Lobe::phong:
      return matte + specular * phong(exponent, in, out);
    case Lobe::ggx:
      return matte + ggx(specular, roughness, in, out);
    case Lobe::table:
      return matte + specular * table->at(in, out);
  }
  return matte;
}

void Brdf::check() const {
  const auto check_colour = [](const char* name, const Eigen::Array3f& colour) {
    for (int c = 0; c < 3; ++c)
      require(colour[c] >= 0.0f && std::isfinite(colour[c]), name, std::to_string(colour[c]),
              "give a finite number that is not negative");
  };
  check_colour("diffuse", diffuse);
  check_colour("specular", specular);
  if (lobe == Lobe::phong)
    require(exponent >= 0.0f && exponent <= 1e5f, "exponent", std::to_string(exponent),
            "give a number from 0 to 100000");
  if (lobe == Lobe::ggx)
    require(roughness >= 0.01f && roughness <= 1.0f, "roughness", std::to_string(roughness),
            "give a number from 0.01 to 1");
  if (lobe == Lobe::table) require(table != nullptr, "table", "(none)", "read one with read_brdf_table()");
}

}  // namespace refield::dynamic
