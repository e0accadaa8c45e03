// SPDX-License-Identifier: Apache-2.0
#include <bit>
#include <functional>

#include "filters/picture/fourier.h"
#include "filters/picture/picture_filters.h"

namespace gobo {
inline namespace filters {

namespace {

using fourier::Complex;

constexpr int kDigit = 11;          // bits
constexpr size_t kPiece = 1 << 16;  // coefficients that a thread looks at between polls

class CompressionNode final : public PictureNode {
 public:
  CompressionNode(PictureShape shape, double share) : PictureNode(std::move(shape)), share_(share) {}
  std::string type() const override { return "compression_filter"; }
  NodeTraits traits() const override { return {}; }
  size_t workingBytes() const override { return size_t(shape().extent.width) * size_t(shape().extent.height) * (sizeof(Complex) + 2); }

 protected:
  void hashSettings(Hasher& h) const override { h.add(share_); }
  double nsPerValue() const override { return 350.0; }
  Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const override {
    const PictureShape& s = shape();
    const size_t pixels = size_t(s.extent.width) * size_t(s.extent.height), channels = size_t(s.channels);
    std::vector<Complex> values(pixels);
    const auto over = [&](const std::function<void(size_t)>& body) {
      return ctx.arena->parallelFor(
          pixels, 1 << 15,
          [&](size_t b, size_t e) {
            for (size_t p = b; p < e; ++p) body(p);
          },
          ctx.stop);
    };
    for (size_t layer = 0; layer < size_t(s.extent.layers); ++layer)
      for (size_t c = 0; c < channels; ++c) {
        const size_t from = layer * pixels * channels + c;
        if (!over([&](size_t p) { values[p] = double(in[from + p * channels]); })) return pictureStopped();
        if (!fourier::transform(values, size_t(s.extent.width), size_t(s.extent.height), false, *ctx.arena, ctx.stop)) return pictureStopped();
        GOBO_TRY(keepStrongest(values, ctx));
        if (!fourier::transform(values, size_t(s.extent.width), size_t(s.extent.height), true, *ctx.arena, ctx.stop)) return pictureStopped();
        if (!over([&](size_t p) { out[from + p * channels] = finite(values[p].real()); })) return pictureStopped();
      }
    return {};
  }

 private:
  size_t conjugate(size_t p) const {
    const size_t width = size_t(shape().extent.width), height = size_t(shape().extent.height);
    return (height - p / width) % height * width + (width - p % width) % width;
  }

  /// Pairs of conjugates count as two and stay together; they are ranked by strength, and by the first one's place where that is equal. Selection by digits of
  /// the strengths' bits, whose order is theirs: passes that threads share.
  Status keepStrongest(std::vector<Complex>& values, const RunContext& ctx) const {
    const size_t n = values.size(), pieces = (n + kPiece - 1) / kPiece;
    const auto strength = [&](size_t p) { return std::bit_cast<uint64_t>(std::norm(values[p])); };
    const auto counts = [&](size_t p) { return p < conjugate(p) ? 2u : p == conjugate(p) ? 1u : 0u; };
    size_t left = size_t(std::floor(share_ * double(n) + 0.5));
    uint64_t least = 0;  // strength of the weakest that may stay, digit by digit
    for (int shift = 64 - kDigit; shift > -kDigit; shift -= kDigit) {
      const int low = std::max(shift, 0), above = shift + kDigit;
      std::vector<uint32_t> found(pieces << kDigit);
      const bool complete = ctx.arena->parallelFor(
          pieces, 1,
          [&](size_t b, size_t e) {
            for (size_t piece = b; piece < e; ++piece)
              for (size_t p = piece * kPiece; p < std::min(n, (piece + 1) * kPiece); ++p)
                if (const uint64_t key = strength(p); above >= 64 || key >> above == least >> above)
                  found[(piece << kDigit) + (key >> low & ((1u << (above - low)) - 1))] += counts(p);
          },
          ctx.stop);
      if (!complete) return pictureStopped();
      for (int digit = (1 << (above - low)) - 1; digit >= 0; --digit) {
        size_t sum = 0;
        for (size_t piece = 0; piece < pieces; ++piece) sum += found[(piece << kDigit) + size_t(digit)];
        if (sum > left || digit == 0) {
          least |= uint64_t(digit) << low;
          break;
        }
        left -= sum;
      }
    }
    std::vector<uint8_t> stays(n);
    bool full = false;
    for (size_t p = 0; p < n; ++p) {
      if (p % kPiece == 0 && ctx.stop.stopRequested()) return pictureStopped();
      const uint64_t key = strength(p);
      if (counts(p) == 0 || key < least) continue;
      if (key == least) {  // of equals the first
        full = full || counts(p) > left;
        if (full) continue;
        left -= counts(p);
      }
      stays[p] = 1;
    }
    const bool complete = ctx.arena->parallelFor(
        n, kPiece,
        [&](size_t b, size_t e) {
          for (size_t p = b; p < e; ++p) {
            if (counts(p) == 0) continue;
            if (!stays[p]) values[p] = 0.0;
            if (const size_t other = conjugate(p); other != p) values[other] = std::conj(values[p]);
          }
        },
        ctx.stop);
    return complete ? Status() : pictureStopped();
  }

  double share_;
};

}  // namespace

NodePtr makeCompressionNode(PictureShape shape, double share) { return std::make_shared<CompressionNode>(std::move(shape), share); }

}  // namespace filters
}  // namespace gobo
