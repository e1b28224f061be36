#pragma once

/// \file
/// The numbers of base/elementary.hpp. Written by tools/elementary.py, which derives them: do not edit.

#include <array>
#include <cstdint>

namespace elliptude::elementary::detail {

// clang-format off
/// Parts of ln 2 and π/2, coefficients, and what atan2 adds to the reduced angle, by format.
template <typename Real>
struct Constants;

template <>
struct Constants<double> {
  static constexpr double per_ln2 = 0x1.71547652b82fep+0;
  static constexpr double ln2_high = 0x1.62e42fefa38p-1;
  static constexpr double ln2_low = 0x1.ef35793c7673p-45;
  static constexpr double per_quarter = 0x1.45f306dc9c883p-1;
  static constexpr double quarter_first = 0x1.921fb54442p+0;
  static constexpr double quarter_second = 0x1.a308d31318p-41;
  static constexpr double quarter_third = 0x1.8a2e03707344ap-81;
  static constexpr double quarter = 0x1.921fb54442d18p+0;
  static constexpr double quarter_head = 0x1.921fb58p+0;
  static constexpr double quarter_tail = -0x1.dde973dcb3b3ap-27;
  static constexpr double root_half = 0x1.6a09e667f3bcdp-1;
  static constexpr std::array<double, 11> exp{0x1p-1, 0x1.5555555555557p-3, 0x1.5555555555556p-5, 0x1.11111111100dap-7,
      0x1.6c16c16c162d3p-10, 0x1.a01a01abe89b8p-13, 0x1.a01a01a6d8e3bp-16, 0x1.71de022fa2b45p-19, 0x1.27e4db634dd1cp-22,
      0x1.af4ded8bc133cp-26, 0x1.1f73059b2800fp-29};
  static constexpr std::array<double, 7> log{0x1.5555555555558p-1, 0x1.99999999952e2p-2, 0x1.2492492df14bfp-2,
      0x1.c71c62e57c0cfp-3, 0x1.7462b4ac51915p-3, 0x1.39fe603f8739ep-3, 0x1.2b584c80de001p-3};
  static constexpr std::array<double, 6> sin{-0x1.5555555555555p-3, 0x1.1111111110bb2p-7, -0x1.a01a019e83a2ap-13,
      0x1.71de37967f5p-19, -0x1.ae600af782557p-26, 0x1.5e0b15efa0e9ap-33};
  static constexpr std::array<double, 6> cos{0x1.5555555555555p-5, -0x1.6c16c16c16967p-10, 0x1.a01a019f4eabep-16,
      -0x1.27e4fa17d4a89p-22, 0x1.1eeb68e3a023bp-29, -0x1.907d9f5d98f0dp-37};
  static constexpr std::array<double, 10> atan{0x1.5555555555555p-2, -0x1.9999999999861p-3, 0x1.24924924786acp-3,
      -0x1.c71c71ac8201fp-4, 0x1.745d104f09c17p-4, -0x1.3b12a441f343dp-4, 0x1.10f83b39f6bbep-4, -0x1.df04a430611dap-5,
      0x1.95260ae2a975cp-5, -0x1.fb19a61b705b1p-6};
  static constexpr std::array<double, 12> base_high{0x0p+0, 0x1.dac670561bb4fp-2, 0x1.921fb54442d18p-1,
      0x1.921fb54442d18p+1, 0x1.56c6e7397f5aep+1, 0x1.2d97c7f3321d2p+1, 0x1.921fb54442d18p+0, 0x1.1b6e192ebbe44p+0,
      0x1.921fb54442d18p-1, 0x1.921fb54442d18p+0, 0x1.0468a8ace4df6p+1, 0x1.2d97c7f3321d2p+1};
  static constexpr std::array<double, 12> base_low{0x0p+0, 0x1.a2b7f222f65e2p-56, 0x1.1a62633145c07p-55,
      0x1.1a62633145c07p-53, 0x1.660b64ece6f4bp-53, 0x1.a79394c9e8a0ap-54, 0x1.1a62633145c07p-54, 0x1.b1b466a88828ep-54,
      0x1.1a62633145c07p-55, 0x1.1a62633145c07p-54, 0x1.0620bf7406affp-55, 0x1.a79394c9e8a0ap-54};
};

template <>
struct Constants<float> {
  static constexpr float per_ln2 = 0x1.715476p+0F;
  static constexpr float ln2_high = 0x1.62e4p-1F;
  static constexpr float ln2_low = 0x1.7f7d1cp-20F;
  static constexpr float per_quarter = 0x1.45f306p-1F;
  static constexpr float quarter_first = 0x1.921fcp+0F;
  static constexpr float quarter_second = -0x1.5778p-21F;
  static constexpr float quarter_third = 0x1.68c234p-39F;
  static constexpr float quarter = 0x1.921fb6p+0F;
  static constexpr float quarter_head = 0x1.922p+0F;
  static constexpr float quarter_tail = -0x1.2aeef4p-18F;
  static constexpr float root_half = 0x1.6a09e6p-1F;
  static constexpr std::array<float, 6> exp{0x1p-1F, 0x1.555556p-3F, 0x1.5554eap-5F, 0x1.1110ep-7F, 0x1.6d432ap-10F,
      0x1.a124f6p-13F};
  static constexpr std::array<float, 3> log{0x1.55555cp-1F, 0x1.997c3p-2F, 0x1.2ee61p-2F};
  static constexpr std::array<float, 3> sin{-0x1.555552p-3F, 0x1.110c28p-7F, -0x1.9ac9aap-13F};
  static constexpr std::array<float, 3> cos{0x1.555554p-5F, -0x1.6c12d2p-10F, 0x1.9bd896p-16F};
  static constexpr std::array<float, 4> atan{0x1.555552p-2F, -0x1.99901ep-3F, 0x1.22a61ap-3F, -0x1.85e454p-4F};
  static constexpr std::array<float, 12> base_high{0x0p+0F, 0x1.dac67p-2F, 0x1.921fb6p-1F, 0x1.921fb6p+1F,
      0x1.56c6e8p+1F, 0x1.2d97c8p+1F, 0x1.921fb6p+0F, 0x1.1b6e1ap+0F, 0x1.921fb6p-1F, 0x1.921fb6p+0F, 0x1.0468a8p+1F,
      0x1.2d97c8p+1F};
  static constexpr std::array<float, 12> base_low{0x0p+0F, 0x1.586ed4p-28F, -0x1.777a5cp-26F, -0x1.777a5cp-24F,
      -0x1.8d014ap-24F, -0x1.99bc5cp-28F, -0x1.777a5cp-25F, -0x1.a28838p-25F, -0x1.777a5cp-26F, -0x1.777a5cp-25F,
      0x1.59c9bep-24F, -0x1.99bc5cp-28F};
};

/// 64 zero bits, and then those of 2/π.
inline constexpr std::array<std::uint32_t, 40> two_over_pi{0x00000000, 0x00000000, 0xa2f9836e, 0x4e441529, 0xfc2757d1,
    0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab, 0xdebbc561, 0xb7246e3a, 0x424dd2e0, 0x06492eea, 0x09d1921c,
    0xfe1deb1c, 0xb129a73e, 0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41, 0x3991d639, 0x835339f4, 0x9c845f8b,
    0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf, 0x27cb09b7, 0x4f463f66, 0x9e5fea2d,
    0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1, 0x1f8d5d08, 0x56033046, 0xfc7b6bab};
// clang-format on

}  // namespace elliptude::elementary::detail
