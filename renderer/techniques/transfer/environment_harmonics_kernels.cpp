// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/environment_harmonics_kernels.h"

#include <algorithm>

namespace gobo::transfer {

namespace {

constexpr size_t kPiece = 64, kWide = 8;
typedef float Lanes __attribute__((vector_size(kWide * sizeof(float)), aligned(sizeof(float)), may_alias));  // of any address

Lanes at(const float* p) { return *reinterpret_cast<const Lanes*>(p); }

}  // namespace

void addRow(const float* texel, size_t width, const float* wave, size_t orders, double* out) {
  alignas(32) float channel[3][kPiece];
  for (size_t from = 0; from < width; from += kPiece) {
    const size_t many = std::min(kPiece, width - from), whole = many / kWide * kWide;
    for (size_t x = 0; x < many; ++x)
      for (size_t c = 0; c < 3; ++c) channel[c][x] = texel[3 * (from + x) + c];
    for (size_t o = 0; o < orders; ++o) {
      const float* w = wave + o * width + from;
      Lanes red{}, green{}, blue{};
      for (size_t x = 0; x < whole; x += kWide) {
        const Lanes weight = at(w + x);
        red += at(channel[0] + x) * weight;
        green += at(channel[1] + x) * weight;
        blue += at(channel[2] + x) * weight;
      }
      double sum[3] = {};
      for (size_t x = whole; x < many; ++x)
        for (size_t c = 0; c < 3; ++c) sum[c] += double(channel[c][x]) * double(w[x]);
      for (size_t k = 0; k < kWide; ++k) {
        sum[0] += double(red[k]);
        sum[1] += double(green[k]);
        sum[2] += double(blue[k]);
      }
      for (size_t c = 0; c < 3; ++c) out[o * 3 + c] += sum[c];
    }
  }
}

}  // namespace gobo::transfer
