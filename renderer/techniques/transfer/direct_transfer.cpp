// SPDX-License-Identifier: Apache-2.0
#include <array>

#include "techniques/transfer/nodes.h"
#include "techniques/transfer/point_rays.h"

namespace gobo::transfer {

namespace {

class DirectTransferNode final : public Node {
 public:
  DirectTransferNode(const TransferSettings& s, uint32_t block) : s_(s), block_(block) {}
  std::string type() const override { return "direct_transfer"; }
  int version() const override { return 3; }  // 2, 3: rays begin nearer to the surface
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets;
    t.persist = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.bands).add(block_).add(s_.seed); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, block_ > 0 ? 2 : 1);
    RaysOfPoints::reads(w.over(0, s_.extent()), 0);
    if (block_ > 0) w.over(1, s_.extent()).reads<float>(1, "transfer", {s_.harmonics()});
    return w.gives({type(), Domain::List, s_.extent(), {unsetPlane<float>("transfer", s_.harmonics())}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = double(s_.size) * kDirections;
    return {rays, (120.0 + 4.0 * s_.harmonics()) * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const RaysOfPoints points(*ctx.inputs[0], *accel);
    const std::span<const float> before = block_ > 0 ? ctx.inputs[1]->floats("transfer") : std::span<const float>();
    const auto out = ctx.result->writable<float>("transfer");
    const size_t n = size_t(s_.harmonics());
    const PointProgress progress(ctx, s_.size, block_, s_.blocks);
    const bool complete = ctx.arena->parallelFor(
        s_.size, 32,
        [&](size_t begin, size_t end) {
          std::array<float, kMaxHarmonics * kLanes> Y;
          std::array<double, kMaxHarmonics> sum;
          for (size_t i = begin; i < end; ++i) {
            sum.fill(0.0);
            const PointRays rays = points.of(i, hash64(s_.seed, i));
            for (uint32_t from = 0; from < kDirections; from += kLanes) {
              Ray ray[kLanes];
              alignas(64) float x[kLanes], y[kLanes], z[kLanes], seen[kLanes];
              for (uint32_t k = 0; k < kLanes; ++k) {
                ray[k] = rays.at(block_ * kDirections + from + k);
                x[k] = ray[k].direction.x;
                y[k] = ray[k].direction.y;
                z[k] = ray[k].direction.z;
              }
              const uint32_t blocked = accel->occluded16(ray, kLanes);
              if (blocked == 0xffffu) continue;
              for (int k = 0; k < kLanes; ++k) seen[k] = blocked >> k & 1u ? 0.0f : 1.0f;
              harmonics16(x, y, z, s_.bands, Y.data());
              for (size_t h = 0; h < n; ++h) {
                float part = 0;
                for (size_t k = 0; k < kLanes; ++k) part += Y[h * kLanes + k] * seen[k];
                sum[h] += double(part);
              }
            }
            for (size_t h = 0; h < n; ++h) {
              const double mean = sum[h] * (double(kPi) / kDirections), old = block_ > 0 ? double(before[i * n + h]) : 0.0;
              out[i * n + h] = float(old + (mean - old) / double(block_ + 1));
            }
          }
          ctx.counters->rays += (end - begin) * kDirections;
          progress.done(end - begin);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
  uint32_t block_;
};

}  // namespace

NodePtr makeDirectTransferNode(const TransferSettings& settings, uint32_t block) { return std::make_shared<DirectTransferNode>(settings, block); }

}  // namespace gobo::transfer
