// SPDX-License-Identifier: Apache-2.0
#include "filters/crop.h"

#include <cstring>

namespace gobo {

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
    w.over(0, e).require(e.layers == 1 && x_ >= 0 && y_ >= 0 && x_ + width_ <= e.width && y_ + height_ <= e.height, "a picture around its window");
    TermShape out = w.input(0);
    out.extent = {width_, height_, 1};
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
      for (int y = 0; y < height_; ++y) {
        if (y % 64 == 0 && ctx.stop.stopRequested()) return Status(Code::Cancelled, "crop: stopped");
        std::memcpy(to + size_t(y) * row, p.bytes.data() + size_t(y + y_) * pitch + size_t(x_) * pixel, row);
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

}  // namespace gobo
