// SPDX-License-Identifier: Apache-2.0
// What filters of pictures have in common: one plane of one term in, the same plane filtered out, each layer by itself. They know pixels and nothing else: no
// geometry, no light. Borders of all of them are mirrored (c b a | a b c | c b a), so that a smoothing kernel loses no light at them; compression alone sees
// a picture that repeats, as its Fourier series does.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <string>

#include "terms/node.h"

namespace gobo {
inline namespace filters {

/// What a filter works on.
struct PictureShape {
  Extent extent;
  Domain domain = Domain::Pixel;
  std::string plane = "rgb";
  int channels = 3;                                                       ///< 1 or 3
  bool share = false;                                                     ///< values are shares (visibility): what leaves 0 .. 1 is brought back
  size_t row() const { return size_t(extent.width) * size_t(channels); }  ///< values in one
  size_t rows() const { return size_t(extent.height) * size_t(extent.layers); }
  size_t values() const { return row() * rows(); }
};

/// Index i of n pixels that go on mirrored beyond both ends.
inline int mirrored(int i, int n) {
  if (i >= 0 && i < n) return i;
  const int period = 2 * n, at = (i % period + period) % period;
  return at < n ? at : period - 1 - at;
}

/// A float of a value that may have outgrown what floats hold.
inline float finite(double v) {
  constexpr double kMost = std::numeric_limits<float>::max();
  return float(std::clamp(v, -kMost, kMost));
}

class PictureNode : public Node {
 public:
  explicit PictureNode(PictureShape shape) : shape_(std::move(shape)) {}
  const PictureShape& shape() const { return shape_; }
  void hashParameters(Hasher& h) const final;
  Result<TermShape> infer(std::span<const TermShape> in) const final;
  Result<TermPtr> run(const RunContext& ctx) const final;
  Cost cost(const TermShape&, uint32_t) const final { return {0.0, nsPerValue() * double(shape_.values())}; }

 protected:
  virtual void hashSettings(Hasher& h) const = 0;
  /// Writes all of `out`. Errors: Cancelled.
  virtual Status apply(std::span<const float> in, std::span<float> out, const RunContext& ctx) const = 0;
  virtual double nsPerValue() const = 0;
  /// Of a filter that is linear and never leaves the range of its input, or of one that may (then shares are brought back, which is not linear).
  NodeTraits linear(bool keepsRange) const;

 private:
  PictureShape shape_;
};

inline Status pictureStopped() { return Status(Code::Cancelled, "stopped"); }

}  // namespace filters
}  // namespace gobo
