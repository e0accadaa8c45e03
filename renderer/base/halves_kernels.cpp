// SPDX-License-Identifier: Apache-2.0
#include <immintrin.h>

#include <cfloat>
#include <cmath>
#include <cstring>

#include "base/halves.h"

namespace gobo {
inline namespace base {

namespace {

constexpr size_t kLane = 8;

/// The second operand is what a comparison with NaN gives.
__m128i halvesOf(__m256 v, bool infinite) {
  const __m256 most = _mm256_set1_ps(kLargestHalf), least = _mm256_set1_ps(-kLargestHalf);
  const __m256 within = _mm256_min_ps(most, _mm256_max_ps(least, v));
  if (!infinite) return _mm256_cvtps_ph(within, _MM_FROUND_TO_NEAREST_INT);
  const __m256 size = _mm256_andnot_ps(_mm256_set1_ps(-0.0f), v), isInfinite = _mm256_cmp_ps(size, _mm256_set1_ps(HUGE_VALF), _CMP_EQ_OQ);
  return _mm256_cvtps_ph(_mm256_blendv_ps(within, v, isInfinite), _MM_FROUND_TO_NEAREST_INT);
}

}  // namespace

void toHalves(std::span<const float> values, uint16_t* out, bool infinite) {
  size_t i = 0;
  for (; i + kLane <= values.size(); i += kLane) _mm_storeu_si128(reinterpret_cast<__m128i*>(out + i), halvesOf(_mm256_loadu_ps(&values[i]), infinite));
  if (i == values.size()) return;
  float last[kLane] = {};
  uint16_t halves[kLane];
  std::memcpy(last, &values[i], (values.size() - i) * sizeof(float));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(halves), halvesOf(_mm256_loadu_ps(last), infinite));
  std::memcpy(out + i, halves, (values.size() - i) * sizeof(uint16_t));
}

size_t beyondHalves(std::span<const float> values) {
  size_t count = 0;
  for (const float v : values) count += std::fabs(v) > kLargestHalf && std::fabs(v) <= FLT_MAX;
  return count;
}

}  // namespace base
}  // namespace gobo
