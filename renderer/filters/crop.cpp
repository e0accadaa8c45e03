// SPDX-License-Identifier: Apache-2.0
#include "filters/crop.h"

#include <cstring>

namespace gobo {
inline namespace filters {

namespace {

class CropNode final : public Node {
 public:
  CropNode(const Extent& around, int x, int y, int width, int height) : around_(around), x_(x), y_(y), width_(width), height_(height) {}
  std::string type() const override { return "crop"; }
  NodeTraits traits() const override { return {}; }
  void hashParameters(Hasher& h) const override { h.add(around_.width).add(around_.height).add(x_).add(y_).add(width_).add(height_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    const Extent& e = around_;
    w.over(0, e).require(x_ >= 0 && y_ >= 0 && x_ + width_ <= e.width && y_ + height_ <= e.height, "a picture around its window");
    TermShape out = w.input(0);
    out.extent = {width_, height_, e.layers};
    for (PlaneShape& p : out.planes)
      if (p.fill != PlaneShape::Fill::Absent) p.fill = PlaneShape::Fill::Unset;
    return w.gives(std::move(out));
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& from = *ctx.inputs[0];
    for (const Plane& p : from.planes()) {
      const size_t pixel = formatSize(p.format) * size_t(p.channels), row = pixel * size_t(width_), pitch = pixel * size_t(from.extent().width);
      if (!ctx.result->hasPlane(p.name)) ctx.result->addRaw(p.name, p.format, p.channels, /*zeroed=*/false);
      uint8_t* const to = ctx.result->bytesOf(p.name);
      for (int layer = 0; layer < around_.layers; ++layer)
        for (int y = 0; y < height_; ++y) {
          if (y % 64 == 0 && ctx.stop.stopRequested()) return Status(Code::Cancelled, "crop: stopped");
          const size_t line = size_t(layer) * size_t(height_) + size_t(y), of = size_t(layer) * size_t(around_.height) + size_t(y + y_);
          std::memcpy(to + line * row, p.bytes.data() + of * pitch + size_t(x_) * pixel, row);
        }
    }
    return TermPtr(ctx.result);
  }

 private:
  Extent around_;
  int x_, y_, width_, height_;
};

}  // namespace

NodePtr makeCropNode(const Extent& around, int x, int y, int width, int height) { return std::make_shared<CropNode>(around, x, y, width, height); }

}  // namespace filters
}  // namespace gobo
