// SPDX-License-Identifier: Apache-2.0
#include "terms/ids.h"

#include "trace/accel.h"

namespace gobo {

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
  size_t outputBytes() const override { return size_t(width_) * height_ * 4; }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto instance = ctx.inputs[0]->plane<uint32_t>("instance").first(size_t(width_) * height_);  // layer 0 is view sample 0
    std::vector<float> number;
    if (kind_ == IdKind::Material) {
      for (const Instance& i : ctx.scene->instances()) number.push_back(float(ctx.scene->mesh<Facet::Topology>(i.mesh).material));
    }
    auto out = std::make_shared<Term>("pixels", Domain::Pixel, Extent{width_, height_, 1});
    const auto id = out->addUnsetPlane<float>("id", 1);
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

}  // namespace gobo
