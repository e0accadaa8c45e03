// SPDX-License-Identifier: Apache-2.0
// Loops of the separable Gaussian over rows of interleaved values; sums in the order of the taps, as on the devices.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gobo {
inline namespace filters {

/// out[x] = sum_k weights[k] padded[x + k * step], k ascending; `padded` has n + (taps - 1) step values.
void filterRow(const float* padded, const float* weights, int taps, size_t step, float* out, size_t n);
/// out[x] = sum_k weights[k] rows[k][x], k ascending.
void filterColumns(const float* const* rows, const float* weights, int taps, float* out, size_t n);
/// The same on ln of sums: out = top + ln(sum_k w_k e^{c (x_k - top)}) / c, top the largest x_k. Any c.
void filterRowLogarithmic(const float* padded, const float* weights, int taps, float c, float* out, size_t n);
void filterColumnsLogarithmic(const float* const* rows, const float* weights, int taps, float c, float* out, size_t n);
/// Bytes of values in [-1,1] (csmToByte).
void toBytes(const float* values, uint8_t* out, size_t n);

}  // namespace filters
}  // namespace gobo
