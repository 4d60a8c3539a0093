// SPDX-License-Identifier: Apache-2.0
#include "simulate/rig/light_maps.h"

#include <cmath>

#include "core/base/rng.h"
#include "core/base/units.h"
#include "simulate/tabletop/scene.h"
#include "simulate/tabletop/surface.h"

namespace refield {

namespace {

constexpr double pi = std::numbers::pi;
constexpr int leaf_palette_size = 8;

Rgb pixel(const Image& image, int x, int y) {
  return {image.at(x, y, 0), image.at(x, y, 1), image.at(x, y, 2)};
}
void set_pixel(Image& image, int x, int y, const Rgb& colour) {
  for (int c = 0; c < 3; ++c) image.at(x, y, c) = colour[c];
}
float real(Rng& rng, double low, double high) {
  return static_cast<float>(rng.uniform(low, high));
}
Rgb mix(const Rgb& a, const Rgb& b, float share) {
  return (1.0f - share) * a + share * b;
}

// A reflectance-like colour: log-normal brightness and a random, sometimes strong tint.
Rgb random_colour(Rng& rng, double brightness, double tint) {
  const auto level = static_cast<float>(brightness * std::exp(0.6 * rng.normal()));
  Rgb colour;
  for (int c = 0; c < 3; ++c) colour[c] = level * static_cast<float>(std::exp(tint * rng.normal()));
  return colour;
}

struct Style {
  bool outdoors;
  Rgb zenith, horizon, ground;
  float clouds;        // share of the sky
  float buildings;     // number of them
  float leaf_cover;    // mean number of leaves over a point of the lower part
  float leaves_above;  // the same for the sky or ceiling, as a share
  float area_lights;   // number of small lights
  Rgb area_light_colour;
  float sun;  // radiance; 0: hidden
};

const std::array styles{
    // Day in a city.
    Style{true, Rgb(0.16f, 0.32f, 0.75f), Rgb(0.6f, 0.7f, 0.8f), Rgb(0.18f, 0.17f, 0.16f), 0.5f, 90, 0.70f,
          0.35f, 10, Rgb(1, 1, 1), 300},
    // Evening.
    Style{true, Rgb(0.10f, 0.12f, 0.35f), Rgb(0.95f, 0.42f, 0.16f), Rgb(0.09f, 0.07f, 0.07f), 0.7f, 60, 0.65f,
          0.35f, 60, Rgb(2.5f, 1.6f, 0.7f), 90},
    // Wood or garden.
    Style{true, Rgb(0.35f, 0.5f, 0.7f), Rgb(0.7f, 0.75f, 0.7f), Rgb(0.10f, 0.16f, 0.05f), 0.4f, 6, 2.20f,
          0.8f, 0, Rgb(1, 1, 1), 200},
    // Room with windows and area lights.
    Style{false, Rgb(0.30f, 0.28f, 0.25f), Rgb(0.28f, 0.25f, 0.2f), Rgb(0.16f, 0.10f, 0.06f), 0.0f, 40, 1.10f,
          0.6f, 40, Rgb(3.0f, 2.3f, 1.4f), 0},
    // Town at night, signs and neon.
    Style{true, Rgb(0.01f, 0.012f, 0.03f), Rgb(0.09f, 0.05f, 0.08f), Rgb(0.03f, 0.03f, 0.04f), 0.2f, 160,
          0.80f, 0.3f, 260, Rgb(1.6f, 1.6f, 1.6f), 0},
};

Style random_style(Rng& rng) {
  Style s = styles[rng.below(styles.size())];
  const auto vary = [&](Rgb& colour) {
    for (int c = 0; c < 3; ++c) colour[c] *= static_cast<float>(std::exp(0.25 * rng.normal()));
  };
  vary(s.zenith);
  vary(s.horizon);
  vary(s.ground);
  return s;
}

void paint_background(Image& image, const Style& style, Rng& rng) {
  const int w = image.width, h = image.height;
  const Eigen::Vector3f offset(real(rng, 0, 99), real(rng, 0, 99), real(rng, 0, 99));
  const float sun_azimuth = real(rng, 0, 2 * pi), sun_height = real(rng, 0.08, 0.9);
  const Eigen::Vector3f sun(std::cos(sun_height) * std::cos(sun_azimuth), std::sin(sun_height),
                            std::cos(sun_height) * std::sin(sun_azimuth));
  const std::uint64_t grain_seed = rng.next();
  const Rgb cloud_colour = mix(Rgb::Constant(1.0f), style.horizon / style.horizon.maxCoeff(), 0.4f);
  for (int y = 0; y < h; ++y)
    for (int x = 0; x < w; ++x) {
      const Eigen::Vector3f d = lat_long_direction(x + 0.5, y + 0.5, w, h).cast<float>();
      Rgb colour;
      if (d.y() >= 0.0f) {
        colour = mix(style.horizon, style.zenith, std::pow(d.y(), 0.6f));
        if (style.outdoors && style.clouds > 0.0f) {
          // Clouds lie on a plane overhead.
          const Eigen::Vector3f p = d / (d.y() + 0.15f);
          const float n = fractal_noise(Eigen::Vector3f(1.3f * p.x(), 0.0f, 1.3f * p.z()) + offset, 6);
          const float cover = std::clamp((n - (1.0f - 0.8f * style.clouds)) * 6.0f + 0.5f, 0.0f, 1.0f);
          colour = mix(colour, cloud_colour * style.horizon.mean() * 1.5f * (0.5f + n), cover);
        }
        if (style.sun > 0.0f) {
          const float away = std::acos(std::clamp(d.dot(sun), -1.0f, 1.0f));
          const float disc = away < 0.02f ? style.sun : 0.0f;
          colour += cloud_colour * (disc + 1.2f * std::exp(-away / 0.12f));
        }
      } else {
        const Eigen::Vector3f p = d / (0.12f - d.y());
        const float n = fractal_noise(Eigen::Vector3f(3.0f * p.x(), 0.0f, 3.0f * p.z()) + offset, 5);
        const auto grain = static_cast<float>(Rng(grain_seed, x, y).uniform());
        colour = style.ground * (0.3f + 1.6f * n) * (0.7f + 0.6f * grain);
      }
      set_pixel(image, x, y, colour);
    }
}

// Upright rectangles on the horizon with grids of windows; indoors they are pieces of furniture, doors and
// pictures.
void paint_buildings(Image& image, const Style& style, Rng& rng) {
  const int w = image.width, h = image.height;
  for (int k = 0; k < static_cast<int>(style.buildings); ++k) {
    const double angular_width = 0.03 * std::exp(0.8 * rng.normal());
    const int width = std::max(2, static_cast<int>(angular_width * w));
    const int height = std::max(2, static_cast<int>(h * std::min(0.4, 0.09 * std::exp(0.7 * rng.normal()))));
    const int left = static_cast<int>(rng.below(w));
    const int foot = h / 2 + static_cast<int>(h * (style.outdoors ? 0.03 : 0.25) * rng.uniform(-0.2, 1.0));
    const Rgb wall = random_colour(rng, style.ground.mean() * 1.5 + 0.04, 0.25);
    const Rgb pane = wall * real(rng, 0.1, 0.6);
    const int pitch_x = std::max(2, static_cast<int>(width / (2.0 + 9.0 * rng.uniform())));
    const int pitch_y = std::max(2, static_cast<int>(pitch_x * rng.uniform(0.8, 2.2)));
    const double frame = rng.uniform(0.2, 0.6), lit = rng.uniform(0.0, 0.45);
    const float shade = real(rng, 0.5, 1.5);  // from one side to the other
    const std::uint64_t windows = rng.next();
    for (int dy = 0; dy < height; ++dy) {
      const int y = foot - dy;
      if (y < 0 || y >= h) continue;
      for (int dx = 0; dx < width; ++dx) {
        const bool in_pane = dx % pitch_x > frame * pitch_x && dy % pitch_y > frame * pitch_y;
        Rgb colour = wall * (1.0f + (shade - 1.0f) * static_cast<float>(dx) / static_cast<float>(width));
        if (in_pane) {
          Rng window(windows, dx / pitch_x, dy / pitch_y);
          colour = window.uniform() < lit ? (style.area_light_colour * real(window, 0.2, 0.9)).eval() : pane;
        }
        set_pixel(image, (left + dx) % w, y, colour);
      }
    }
  }
}

struct Leaf {
  float x, y, radius, aspect, turn = 0.0f;
  int shape;  // 0 ellipse, 1 rectangle, 2 triangle
  Rgb colour;
  float gradient_x = 0.0f, gradient_y = 0.0f, stripe_pitch = 0.0f, grain = 0.0f;
};

bool inside_shape(int shape, float u, float v) {
  switch (shape) {
    case 0:
      return u * u + v * v < 1.0f;
    case 1:
      return std::abs(u) < 0.9f && std::abs(v) < 0.9f;
    default:
      return v > -0.6f && v < 1.2f - 2.0f * std::abs(u);
  }
}

void paint_leaf(Image& image, const Leaf& leaf, std::uint64_t grain_seed) {
  const int w = image.width, h = image.height;
  const float reach = leaf.radius * std::max(leaf.aspect, 1.0f / leaf.aspect) * 1.45f;
  const float cosine = std::cos(leaf.turn), sine = std::sin(leaf.turn);
  const int y0 = std::max(0, static_cast<int>(leaf.y - reach)),
            y1 = std::min(h - 1, static_cast<int>(leaf.y + reach));
  const int x0 = static_cast<int>(std::floor(leaf.x - reach)), x1 = static_cast<int>(leaf.x + reach);
  for (int y = y0; y <= y1; ++y)
    for (int x = x0; x <= x1; ++x) {
      const float dx = static_cast<float>(x) + 0.5f - leaf.x, dy = static_cast<float>(y) + 0.5f - leaf.y;
      const float u = (cosine * dx + sine * dy) / (leaf.radius * leaf.aspect);
      const float v = (cosine * dy - sine * dx) * leaf.aspect / leaf.radius;
      if (!inside_shape(leaf.shape, u, v)) continue;
      float level = std::max(0.1f, 1.0f + leaf.gradient_x * u + leaf.gradient_y * v);
      if (leaf.stripe_pitch > 0.0f && static_cast<int>(std::floor(u * leaf.stripe_pitch)) & 1) level *= 0.4f;
      const auto grain = static_cast<float>(Rng(grain_seed, x, y).uniform());
      level *= 1.0f + leaf.grain * (grain - 0.5f);
      set_pixel(image, ((x % w) + w) % w, y, leaf.colour * level);
    }
}

void paint_leaves(Image& image, const Style& style, Rng& rng) {
  const int w = image.width, h = image.height;
  const double smallest = 0.7, largest = w / 24.0;
  // Mean area under p(r) ∝ r^-3 between the two sizes: 2π s² ln(l/s) / (1 − (s/l)²).
  const double ratio = largest / smallest;
  const double mean_area = 2.0 * pi * smallest * smallest * std::log(ratio) / (1.0 - 1.0 / (ratio * ratio));
  const auto count = static_cast<std::uint64_t>(style.leaf_cover * w * h / mean_area);
  std::array<Rgb, leaf_palette_size> palette;
  for (Rgb& colour : palette) colour = random_colour(rng, style.horizon.mean() * 0.55 + 0.03, 0.32);
  for (std::uint64_t k = 0; k < count; ++k) {
    Leaf leaf;
    leaf.x = real(rng, 0, w);
    // Uniform over the sphere in height, so that the poles are not crowded.
    const double height = rng.uniform(-1.0, 1.0);
    leaf.y = static_cast<float>(std::acos(height) / pi * h);
    const double u = rng.uniform();
    leaf.radius = static_cast<float>(smallest / std::sqrt(1.0 - u * (1.0 - 1.0 / (ratio * ratio))));
    leaf.aspect = std::exp(real(rng, -0.5, 0.5));
    leaf.turn = rng.uniform() < 0.5 ? real(rng, -0.08, 0.08) : real(rng, 0, 2 * pi);
    leaf.shape = static_cast<int>(rng.below(3));
    const Rgb tint =
        palette[rng.below(leaf_palette_size)] * static_cast<float>(std::exp(0.45 * rng.normal()));
    const float brightness = real(rng, 0.25, 1.0);
    leaf.gradient_x = static_cast<float>(0.25 * rng.normal());
    leaf.gradient_y = static_cast<float>(0.25 * rng.normal());
    leaf.stripe_pitch = rng.uniform() < 0.15 ? real(rng, 2, 9) : 0.0f;
    leaf.grain = real(rng, 0, 0.7);
    const std::uint64_t grain_seed = rng.next();
    if (height > 0.05 && rng.uniform() > style.leaves_above) continue;
    const int y = std::clamp(static_cast<int>(leaf.y), 0, h - 1);
    const Rgb behind = pixel(image, static_cast<int>(leaf.x) % w, y).min(1.0f);
    leaf.colour = mix(behind, tint, brightness);
    paint_leaf(image, leaf, grain_seed);
  }
}

void paint_area_lights(Image& image, const Style& style, Rng& rng) {
  for (int k = 0; k < static_cast<int>(style.area_lights); ++k) {
    Leaf area_light;
    area_light.x = real(rng, 0, image.width);
    area_light.y =
        static_cast<float>(image.height * (0.5 - 0.16 * rng.normal() - (style.outdoors ? 0.0 : 0.05)));
    area_light.radius = static_cast<float>(std::max(0.8, image.width / 700.0 * std::exp(0.9 * rng.normal())));
    area_light.aspect = std::exp(real(rng, -0.6, 0.6));
    area_light.shape = static_cast<int>(rng.below(2));
    area_light.colour = style.area_light_colour * random_colour(rng, 1.2, 0.5);
    paint_leaf(image, area_light, 0);
  }
  if (style.outdoors) return;
  for (int k = 0; k < 4; ++k) {  // windows: bright, with crossbars
    Leaf window;
    window.x = real(rng, 0, image.width);
    window.y = static_cast<float>(image.height * rng.uniform(0.36, 0.5));
    window.radius = static_cast<float>(image.width * rng.uniform(0.015, 0.05));
    window.aspect = std::exp(real(rng, -0.4, 0.2));
    window.shape = 1;
    window.colour = Rgb(0.9f, 1.0f, 1.15f) * real(rng, 1.0, 3.5);
    window.gradient_y = -0.3f;
    window.grain = 0.3f;
    paint_leaf(image, window, rng.next());
    Leaf bar = window;
    bar.colour = Rgb::Constant(0.05f);
    bar.aspect = 0.2f;
    bar.radius *= 0.22f;
    paint_leaf(image, bar, 0);
    bar.aspect = 5.0f;
    paint_leaf(image, bar, 0);
  }
}

}  // namespace

Image make_panorama(std::uint64_t seed, std::uint64_t index, int width) {
  Image image(width, width / 2, 3);
  Rng rng(seed, 0x70616eu, index);
  const Style style = random_style(rng);
  paint_background(image, style, rng);
  paint_buildings(image, style, rng);
  paint_leaves(image, style, rng);
  paint_area_lights(image, style, rng);
  return image;
}

Image view_of_panorama(const Image& panorama, const PanoramaView& view, int width, int height) {
  const Eigen::Matrix3d turn = rotation_of(view.turn);
  const double step = 2.0 * std::tan(radians_from_degrees(view.horizontal_fov_degrees) / 2.0) / width;
  const auto at = [&](int x, int y) {
    return pixel(panorama, (x % panorama.width + panorama.width) % panorama.width,
                 std::clamp(y, 0, panorama.height - 1));
  };
  Image image(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      Rgb sum = Rgb::Zero();
      for (int s = 0; s < 4; ++s) {
        const double px = x + 0.25 + 0.5 * (s & 1), py = y + 0.25 + 0.5 * (s >> 1);

        const Eigen::Vector3d d =
            turn * Eigen::Vector3d((px - width / 2.0) * step, (height / 2.0 - py) * step, 1.0).normalized();
        const Eigen::Vector2d p = lat_long_position(d, panorama.width, panorama.height).array() - 0.5;
        const double fx = std::floor(p.x()), fy = std::floor(p.y());
        const auto tx = static_cast<float>(p.x() - fx), ty = static_cast<float>(p.y() - fy);
        const int ix = static_cast<int>(fx), iy = static_cast<int>(fy);
        sum += mix(mix(at(ix, iy), at(ix + 1, iy), tx), mix(at(ix, iy + 1), at(ix + 1, iy + 1), tx), ty);
      }
      set_pixel(image, x, y, 0.25f * sum);
    }
  return image;
}

}  // namespace refield
