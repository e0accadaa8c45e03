// SPDX-License-Identifier: Apache-2.0
#include "filters/picture/convolution.h"

namespace gobo {
inline namespace filters {

namespace {

constexpr size_t kSummedTogether = 1024;  // values of a row that are summed together: their rows stay in the cache

/// One row, mirrored beyond its ends by `radius` pixels.
void mirroredLine(std::span<const float> in, int width, int channels, int radius, std::vector<double>& out) {
  out.resize(size_t(width + 2 * radius) * size_t(channels));
  for (int x = -radius; x < width + radius; ++x)
    for (int c = 0; c < channels; ++c) out[size_t(x + radius) * size_t(channels) + size_t(c)] = in[size_t(mirrored(x, width)) * size_t(channels) + size_t(c)];
}

}  // namespace

std::vector<double> gaussianKernel(double sigma) {
  const int radius = int(std::ceil(4.0 * sigma));
  std::vector<double> half{1.0};
  double sum = 1.0;
  for (int k = 1; k <= radius; ++k) {
    half.push_back(std::exp(-0.5 * k * k / (sigma * sigma)));
    sum += 2.0 * half.back();
  }
  for (double& w : half) w /= sum;
  return half;
}

size_t convolutionBytes(const PictureShape& shape) { return shape.values() * sizeof(float); }
double convolutionNs(size_t kernel) { return 4.0 + 0.9 * double(kernel); }

Status convolve(std::span<const float> in, std::span<float> out, const PictureShape& shape, std::span<const double> kernel, const RunContext& ctx) {
  const size_t row = shape.row();
  const int radius = int(kernel.size()) - 1, width = shape.extent.width, height = shape.extent.height, channels = shape.channels;
  std::vector<float> across(shape.values());
  const bool rows = ctx.arena->parallelFor(
      shape.rows(), 4,
      [&](size_t b, size_t e) {
        std::vector<double> line, sum(row);
        for (size_t y = b; y < e && !ctx.stop.stopRequested(); ++y) {
          mirroredLine(in.subspan(y * row, row), width, channels, radius, line);
          const double* middle = line.data() + size_t(radius) * size_t(channels);
          for (size_t j = 0; j < row; ++j) sum[j] = kernel[0] * middle[j];
          for (int k = 1; k <= radius; ++k) {
            const double w = kernel[size_t(k)];
            const double *left = middle - k * channels, *right = middle + k * channels;
            for (size_t j = 0; j < row; ++j) sum[j] += w * (left[j] + right[j]);
          }
          for (size_t j = 0; j < row; ++j) across[y * row + j] = finite(sum[j]);
        }
      },
      ctx.stop);
  if (!rows || ctx.stop.stopRequested()) return pictureStopped();
  const bool columns = ctx.arena->parallelFor(
      shape.rows(), 4,
      [&](size_t b, size_t e) {
        std::vector<double> sum(std::min(row, kSummedTogether));
        for (size_t from = 0; from < row; from += kSummedTogether) {
          const size_t n = std::min(kSummedTogether, row - from);
          for (size_t y = b; y < e && !ctx.stop.stopRequested(); ++y) {
            const int at = int(y % size_t(height));
            const float* layer = across.data() + (y - size_t(at)) * row + from;
            const auto line = [&](int i) { return layer + size_t(mirrored(i, height)) * row; };
            for (size_t j = 0; j < n; ++j) sum[j] = kernel[0] * double(line(at)[j]);
            for (int k = 1; k <= radius; ++k) {
              const double w = kernel[size_t(k)];
              const float *up = line(at - k), *down = line(at + k);
              for (size_t j = 0; j < n; ++j) sum[j] += w * (double(up[j]) + double(down[j]));
            }
            for (size_t j = 0; j < n; ++j) out[y * row + from + j] = finite(sum[j]);
          }
        }
      },
      ctx.stop);
  return columns && !ctx.stop.stopRequested() ? Status() : pictureStopped();
}

}  // namespace filters
}  // namespace gobo
