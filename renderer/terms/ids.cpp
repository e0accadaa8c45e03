// SPDX-License-Identifier: Apache-2.0
#include "terms/ids.h"

#include "trace/accel.h"

namespace gobo {
inline namespace terms {

namespace {

class IdNode final : public Node {
 public:
  IdNode(IdKind kind, int width, int height) : kind_(kind), width_(width), height_(height) {}
  std::string type() const override { return kind_ == IdKind::Object ? "object_id" : "material_id"; }
  NodeTraits traits() const override {
    NodeTraits t;
    if (kind_ == IdKind::Material) t.facets = Facet::Topology | Facet::Pose;  // instances; objects need nothing but the G-buffer
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(width_).add(height_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, {width_, height_, w.input(0).extent.layers}).reads<uint32_t>(0, "instance");
    return w.gives({"pixels", Domain::Pixel, {width_, height_, 1}, {unsetPlane<float>("id")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance").first(size_t(width_) * height_);  // layer 0 is view sample 0
    std::vector<float> number;
    if (kind_ == IdKind::Material) {
      for (const Instance& i : ctx.scene->instances()) number.push_back(float(ctx.scene->mesh<Facet::Topology>(i.mesh).material));
    }
    const auto& out = ctx.result;
    const auto id = out->writable<float>("id");
    const bool complete = ctx.arena->parallelFor(
        id.size(), 1 << 15,
        [&](size_t begin, size_t end) {
          for (size_t p = begin; p < end; ++p) id[p] = instance[p] == kNoHit ? -1.0f : kind_ == IdKind::Object ? float(instance[p]) : number[instance[p]];
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  IdKind kind_;
  int width_, height_;
};

}  // namespace

NodePtr makeIdNode(IdKind kind, int width, int height) { return std::make_shared<IdNode>(kind, width, height); }

}  // namespace terms
}  // namespace gobo
