// SPDX-License-Identifier: Apache-2.0
#include "acquire/light_probe/mirror_reflectance.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/errors.h"

namespace refield {

namespace {

constexpr int table_size = 1025;

/// Mean of the two polarisations, M. Born and E. Wolf, Principles of Optics, section 14.2, in real numbers.
double conductor_reflectance(double n, double k, double c) {
  const double s2 = 1.0 - c * c;
  const double t = n * n - k * k - s2;
  const double sum = std::sqrt(t * t + 4.0 * n * n * k * k);  // a² + b²
  const double a = std::sqrt(std::max(0.0, 0.5 * (sum + t)));
  const double across = (sum + c * c - 2.0 * a * c) / (sum + c * c + 2.0 * a * c);
  const double along =
      across * (c * c * sum + s2 * s2 - 2.0 * a * c * s2) / (c * c * sum + s2 * s2 + 2.0 * a * c * s2);
  return 0.5 * (across + along);
}

}  // namespace

template <class Reflectance>
MirrorReflectance MirrorReflectance::tabulated(const Reflectance& reflectance) {
  MirrorReflectance result;
  result.table_.resize(table_size);
  for (int i = 0; i < table_size; ++i)
    for (int c = 0; c < 3; ++c)
      result.table_[i][c] = static_cast<float>(reflectance(c, i / (table_size - 1.0)));
  return result;
}

MirrorReflectance MirrorReflectance::conductor(const std::array<double, 3>& n,
                                               const std::array<double, 3>& k) {
  return tabulated([&](int c, double cosine) { return conductor_reflectance(n[c], k[c], cosine); });
}

MirrorReflectance MirrorReflectance::chrome() {
  return conductor({3.09, 3.18, 2.33}, {3.34, 3.33, 3.14});
}

MirrorReflectance MirrorReflectance::silver() {
  return conductor({0.05, 0.06, 0.04}, {4.483, 3.586, 2.657});
}

MirrorReflectance MirrorReflectance::measured(const std::array<double, 3>& at_normal_incidence) {
  for (double value : at_normal_incidence)
    if (!(value > 0.0 && value <= 1.0))
      throw InputError("the mirror's reflectance is " + std::to_string(value) +
                       "; give numbers above 0 and at most 1");
  return tabulated([&](int c, double cosine) {
    const double r = at_normal_incidence[c];
    return r + (1.0 - r) * std::pow(1.0 - cosine, 5.0);
  });
}

MirrorReflectance MirrorReflectance::from_text(const std::string& text) {
  if (text == "chrome") return chrome();
  if (text == "silver") return silver();
  if (text == "perfect") return measured({1.0, 1.0, 1.0});
  return measured(channel_numbers(text, "--reflectance (chrome, silver, perfect or measured)"));
}

std::array<float, 3> MirrorReflectance::at(double cos_incidence) const {
  const double place = std::clamp(cos_incidence, 0.0, 1.0) * (table_size - 1);
  const int below = std::min(static_cast<int>(place), table_size - 2);
  const auto t = static_cast<float>(place - below);
  std::array<float, 3> result;
  for (int c = 0; c < 3; ++c) result[c] = (1.0f - t) * table_[below][c] + t * table_[below + 1][c];
  return result;
}

std::array<double, 3> channel_numbers(const std::string& text, const std::string& option) {
  std::array<double, 3> numbers{};
  const char* at = text.c_str();
  int count = 0;
  bool more = true;
  while (more && count < 3) {
    char* end = nullptr;
    numbers[count] = std::strtod(at, &end);
    if (end == at) break;
    ++count;
    more = *end == ',';
    at = more ? end + 1 : end;
  }
  if ((count != 1 && count != 3) || more || *at != '\0' ||
      !std::ranges::all_of(numbers, [](double number) { return std::isfinite(number); }))
    throw InputError(option + ": '" + text +
                     "' is neither one number nor three separated by commas, red,green,blue");
  if (count == 1) numbers = {numbers[0], numbers[0], numbers[0]};
  return numbers;
}

}  // namespace refield
