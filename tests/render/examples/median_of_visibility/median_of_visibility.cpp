// SPDX-License-Identifier: Apache-2.0
#include "render/examples/median_of_visibility/median_of_visibility.h"

#include "filters/resident_planes.h"
#include "render/examples/median_of_visibility/median.glsl.h"

namespace gobo {
namespace {

constexpr uint32_t kCode[] =
#include "shaders/median_of_visibility.inc"
    ;
constexpr char kText[] =
#include "shaders/median_of_visibility.glsl.inc"
    ;
struct Push {
  int32_t width, height;
  uint32_t count;
};
const ComputeKernel kMedian{"median_of_visibility", kCode, 3, sizeof(Push), kText};

class MedianNode final : public Node {
 public:
  MedianNode(const Extent& extent, ComputeDevicePtr device) : extent_(extent), device_(std::move(device)) {}
  std::string type() const override { return "median_of_visibility"; }
  std::string numericClass() const override { return device_ ? device_->numericClass() : Node::numericClass(); }
  std::string device() const override { return device_ ? std::string(device_->kind()) + ": " + device_->name() : "cpu"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.rangePreserving = t.tileable = true;
    t.halo = 1;
    return t;
  }
  void hashParameters(Hasher&) const override {}
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    w.over(0, extent_).reads<float>(0, "V").over(1, extent_).reads<uint32_t>(1, "instance");
    return w.gives({"visibility", Domain::ViewSample, extent_, {unsetPlane<float>("V")}});
  }
  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto v = ctx.inputs[0]->floats("V");
    const auto instance = ctx.inputs[1]->plane<uint32_t>("instance");
    const auto out = ctx.result->writable<float>("V");
    if (device_) {
      GOBO_TRY(onDevice(ctx.inputs[0], ctx.inputs[1], out));
      return TermPtr(ctx.result);
    }
    const bool done = ctx.arena->parallelFor(
        out.size(), 1 << 14,
        [&](size_t begin, size_t end) {
          for (size_t e = begin; e < end; ++e) out[e] = at(v, instance, e);
        },
        ctx.stop);
    if (!done) return Status(Code::Cancelled, "median_of_visibility stopped");
    return TermPtr(ctx.result);
  }

 private:
  float at(std::span<const float> v, std::span<const uint32_t> instance, size_t e) const {
    const int x = int(e % size_t(extent_.width)), y = int(e / size_t(extent_.width) % size_t(extent_.height));
    const auto neighbour = [&](int dx, int dy) {
      if (x + dx < 0 || x + dx >= extent_.width || y + dy < 0 || y + dy >= extent_.height) return v[e];
      const size_t other = size_t(ptrdiff_t(e) + dy * ptrdiff_t(extent_.width) + dx);
      return instance[other] == instance[e] ? v[other] : v[e];
    };
    return formulas::medianOf9(neighbour(-1, -1), neighbour(0, -1), neighbour(1, -1), neighbour(-1, 0), v[e], neighbour(1, 0), neighbour(-1, 1),
                               neighbour(0, 1), neighbour(1, 1));
  }
  Status onDevice(const TermPtr& visibility, const TermPtr& gbuffer, std::span<float> out) const {
    const Push push{extent_.width, extent_.height, uint32_t(out.size())};
    ResidentPlanes& on = ResidentPlanes::of(device_);
    GOBO_ASSIGN(const ComputeBufferPtr values, on.get(visibility, "V", 0, out.size()));
    GOBO_ASSIGN(const ComputeBufferPtr instances, on.get(gbuffer, "instance", 0, out.size()));
    const auto pass = [&]() -> Status {
      GOBO_ASSIGN(const ComputeBufferPtr result, device_->buffer(out.size_bytes()));
      ComputeDispatch d{&kMedian, {values, instances, result}, {reinterpret_cast<const uint8_t*>(&push), sizeof push}, {}};
      setLinearGroups(d, out.size(), 64);
      GOBO_TRY(device_->run({&d, 1}));
      return device_->download(*result, out.data(), out.size_bytes());
    };
    return on.checked(pass());
  }

  Extent extent_;
  ComputeDevicePtr device_;
};

}  // namespace

NodePtr makeMedianNode(const Extent& extent, ComputeDevicePtr device) { return std::make_shared<MedianNode>(extent, std::move(device)); }

}  // namespace gobo
