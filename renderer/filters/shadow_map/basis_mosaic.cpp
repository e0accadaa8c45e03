// SPDX-License-Identifier: Apache-2.0
// Filter: the images of a shadow map side by side, for people to look at.
#include <cmath>

#include "filters/shadow_map/shadow_map.h"

namespace gobo {
inline namespace filters {
namespace {

class BasisMosaicNode : public Node {
 public:
  BasisMosaicNode(int resolution, int channels, int faces)
      : resolution_(resolution), images_(channels * faces), columns_(int(std::ceil(std::sqrt(double(images_))))) {}
  std::string type() const override { return "shadow_basis_mosaic"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(resolution_).add(images_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    const bool depth = w.input(0).find("z");
    if (depth) w.reads<float>(0, "z");
    else readsBasis(w, 0, w.channels(0, "B"));
    w.over(0, {resolution_, resolution_, w.input(0).extent.layers})
        .require(w.channels(0, depth ? "z" : "B") * w.input(0).extent.layers == images_, "its images");
    return w.gives({"pixels", Domain::Pixel, {columns_ * resolution_, rows() * resolution_, 1}, {plane<float>("image")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& map = *ctx.inputs.at(0);
    const bool depth = map.hasPlane("z");
    const Plane* plane = nullptr;
    for (const Plane& p : map.planes())
      if (p.name == (depth ? "z" : "B")) plane = &p;
    GOBO_CHECK(plane != nullptr);
    const int side = map.extent().width, C = plane->channels;
    GOBO_CHECK(side == resolution_ && map.extent().height == side && C * map.extent().layers == images_);
    const auto& term = ctx.result;
    const auto out = term->writable<float>("image");
    const float* floats = plane->format == Format::F32 ? reinterpret_cast<const float*>(plane->bytes.data()) : nullptr;
    const size_t square = size_t(side) * size_t(side), stride = size_t(columns_) * size_t(side);
    const bool done = ctx.arena->parallelFor(
        size_t(images_) * size_t(side), 64,
        [&](size_t begin, size_t end) {
          for (size_t r = begin; r < end; ++r) {
            const size_t image = r / size_t(side), y = r % size_t(side), face = image / size_t(C), c = image % size_t(C);
            float* to = &out[((image / size_t(columns_)) * size_t(side) + y) * stride + (image % size_t(columns_)) * size_t(side)];
            const size_t at = (face * square + y * size_t(side)) * size_t(C) + c;
            for (size_t x = 0; x < size_t(side); ++x) {
              // Byte images show as they are stored, floats of bases in [-1, 1] as their middle grey and around.
              const float v = floats ? floats[at + x * size_t(C)] : (float(plane->bytes[at + x * size_t(C)]) - 127.0f) / 127.0f;
              to[x] = depth ? v : 0.5f + 0.5f * v;
            }
          }
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "shadow_basis_mosaic stopped");
    return TermPtr(term);
  }

 private:
  int rows() const { return (images_ + columns_ - 1) / columns_; }
  int resolution_, images_, columns_;
};

}  // namespace

NodePtr makeBasisMosaicNode(int resolution, int channels, int faces) { return std::make_shared<BasisMosaicNode>(resolution, channels, faces); }

}  // namespace filters
}  // namespace gobo
