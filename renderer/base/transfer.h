// SPDX-License-Identifier: Apache-2.0
// Transfer functions between linear light and code values, both 0..1: the only place in Gobo where they are written down.
//   Srgb    IEC 61966-2-1: 12.92 x up to 0.0031308, else 1.055 x^(1/2.4) - 0.055
//   Rec709  the OETF of ITU-R BT.709: 4.5 x below beta, else alpha x^0.45 - (alpha - 1), with the unrounded constants that make it
//           continuous (BT.2020 gives them: alpha 1.0992968, beta 0.0180540; BT.709 prints 1.099 and 0.018, 0.1 of an 8-bit step away)
//   Linear  the identity
// Arguments outside 0..1 are clamped, NaN is 0. Pure; any thread.
#pragma once

#include <cmath>
#include <cstdint>

namespace gobo {
inline namespace base {

enum class Transfer : uint8_t { Linear, Srgb, Rec709 };

inline constexpr double kRec709Alpha = 1.09929682680944, kRec709Beta = 0.018053968510807;

inline double encodeTransfer(Transfer transfer, double linear) {
  if (!(linear > 0.0)) return 0.0;
  if (linear >= 1.0) return 1.0;
  switch (transfer) {
    case Transfer::Linear: return linear;
    case Transfer::Srgb: return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
    case Transfer::Rec709: return linear < kRec709Beta ? 4.5 * linear : kRec709Alpha * std::pow(linear, 0.45) - (kRec709Alpha - 1.0);
  }
  return linear;
}

/// Inverse of encodeTransfer.
inline double decodeTransfer(Transfer transfer, double code) {
  if (!(code > 0.0)) return 0.0;
  if (code >= 1.0) return 1.0;
  switch (transfer) {
    case Transfer::Linear: return code;
    case Transfer::Srgb: return code <= 0.04045 ? code / 12.92 : std::pow((code + 0.055) / 1.055, 2.4);
    case Transfer::Rec709: return code < 4.5 * kRec709Beta ? code / 4.5 : std::pow((code + (kRec709Alpha - 1.0)) / kRec709Alpha, 1.0 / 0.45);
  }
  return code;
}

}  // namespace base
}  // namespace gobo
