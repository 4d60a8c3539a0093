// SPDX-License-Identifier: Apache-2.0
#include "simulate/dynamic/glossy_sums.h"

// Highway compiles the part between BEFORE and AFTER once for each instruction set and picks one at run time.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "simulate/dynamic/glossy_sums.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace refield::dynamic::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void add_ray_shares_vectorised(const std::uint32_t* HWY_RESTRICT seen, const RayShare* HWY_RESTRICT shares,
                               std::size_t count, const float* HWY_RESTRICT sent, const float* HWY_RESTRICT h,
                               std::size_t width, float* HWY_RESTRICT sums) {
  const hn::CappedTag<float, 16> d;
  for (std::size_t block = 0; block < width; block += hn::Lanes(d)) {
    auto red = hn::LoadU(d, sums + block), green = hn::LoadU(d, sums + width + block),
         blue = hn::LoadU(d, sums + 2 * width + block);
    for (std::size_t i = 0; i < count; ++i) {
      const float weight = static_cast<float>(shares[i].weight);
      const float* HWY_RESTRICT light = sent + std::size_t{4} * seen[i];
      const auto values =
          hn::Mul(hn::Set(d, weight), hn::LoadU(d, h + std::size_t{shares[i].place} * width + block));
      red = hn::MulAdd(hn::Set(d, light[0]), values, red);
      green = hn::MulAdd(hn::Set(d, light[1]), values, green);
      blue = hn::MulAdd(hn::Set(d, light[2]), values, blue);
    }
    hn::StoreU(red, d, sums + block);
    hn::StoreU(green, d, sums + width + block);
    hn::StoreU(blue, d, sums + 2 * width + block);
  }
}

}  // namespace refield::dynamic::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace refield::dynamic {

HWY_EXPORT(add_ray_shares_vectorised);

void add_ray_shares(const std::uint32_t* seen, const RayShare* shares, std::size_t count, const float* sent,
                    const float* h, std::size_t width, float* sums) {
  HWY_DYNAMIC_DISPATCH(add_ray_shares_vectorised)(seen, shares, count, sent, h, width, sums);
}

}  // namespace refield::dynamic
#endif
