// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include "techniques/transfer/nodes.h"
#include "techniques/transfer/point_rays.h"
#include "techniques/transfer/receiver_mesh.h"

namespace gobo::transfer {

namespace {

class BouncedTransferNode final : public Node {
 public:
  BouncedTransferNode(const TransferSettings& s, uint32_t bounce, uint32_t directions) : s_(s), bounce_(bounce), directions_(directions) {}
  std::string type() const override { return "bounced_transfer"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | ReceiverMesh::kFacets;
    t.persist = true;
    return t;
  }
  int version() const override { return 4; }  // 2: gaps are dark; 3, 4: rays begin nearer to the surface
  void hashParameters(Hasher& h) const override { h.add(s_.points).add(s_.bands).add(bounce_).add(directions_).add(s_.seed); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 3);
    RaysOfPoints::reads(w.over(0, s_.extent()), 0);
    w.reads<uint8_t>(0, "usable");
    w.over(1, s_.extent()).reads<float>(1, "rgb", {3}).over(2, s_.extent());
    if (bounce_ > 0) w.reads<float>(2, "last", {3 * s_.harmonics()}).reads<float>(2, "sum", {3 * s_.harmonics()});
    else w.reads<float>(2, "transfer", {s_.harmonics()});
    return w.gives({type(), Domain::List, s_.extent(), {unsetPlane<float>("last", 3 * s_.harmonics()), unsetPlane<float>("sum", 3 * s_.harmonics())}});
  }
  size_t workingBytes() const override { return size_t(s_.size) * size_t(3 * s_.harmonics()) * sizeof(float); }
  Cost cost(const TermShape&, uint32_t) const override {
    const double rays = double(s_.size) * directions_;
    return {rays, (200.0 + 3.0 * s_.harmonics()) * rays};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const auto shared = receiverMesh(*ctx.scene, s_.points);
    const ReceiverMesh& mesh = *shared;
    GOBO_CHECK_EQ(mesh.size(), size_t(s_.size));
    const Term &points = *ctx.inputs[0], &before = *ctx.inputs[2];
    const RaysOfPoints raysOf(points, *accel);
    const auto cell = points.floats("cell"), albedo = ctx.inputs[1]->floats("rgb");
    const auto usable = points.plane<uint8_t>("usable");
    const auto last = ctx.result->writable<float>("last"), sum = ctx.result->writable<float>("sum");
    const size_t n = size_t(s_.harmonics()), m = 3 * n;
    // What each point sends out of each harmonic; radiance times pi.
    std::vector<float> leaving(size_t(s_.size) * m);
    const auto source = before.floats(bounce_ > 0 ? "last" : "transfer");
    bool complete = ctx.arena->parallelFor(
        s_.size, 4096,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i)
            for (size_t c = 0; c < 3; ++c)
              for (size_t h = 0; h < n; ++h) leaving[i * m + c * n + h] = albedo[3 * i + c] * (bounce_ > 0 ? source[i * m + c * n + h] : source[i * n + h]);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    const PointProgress progress(ctx, s_.size, bounce_, s_.bounces);
    complete = ctx.arena->parallelFor(
        s_.size, 16,
        [&](size_t begin, size_t end) {
          std::vector<double> total(m);
          std::vector<float> part(m);
          for (size_t i = begin; i < end; ++i) {
            std::fill(total.begin(), total.end(), 0.0);
            const PointRays rays = raysOf.of(i, hash64(s_.seed ^ 0xb0c5, i));
            for (uint32_t from = 0; from < directions_; from += kLanes) {
              Ray ray[kLanes];
              Hit hit[kLanes];
              for (uint32_t k = 0; k < kLanes; ++k) ray[k] = rays.at(from + k);
              accel->intersect16(ray, kLanes, hit);
              std::fill(part.begin(), part.end(), 0.0f);
              for (int k = 0; k < kLanes; ++k) {
                Between at;
                // What stands close about a point in a gap is known by points outside of it, which have light that it has not.
                if (!usable[i] && hit[k].t < cell[i]) continue;
                if (!hit[k].valid() || !mesh.locate(hit[k].instance, hit[k].primitive, hit[k].u, hit[k].v, glm::dot(hit[k].Ng, ray[k].direction) < 0.0f, at))
                  continue;
                leaveUnusable(usable, at);
                for (size_t q = 0; q < kCorners; ++q) {
                  const float w = at.weight[q];
                  if (!(w > 0.0f)) continue;
                  const float* from = leaving.data() + at.point[q] * m;
                  for (size_t h = 0; h < m; ++h) part[h] += w * from[h];
                }
              }
              for (size_t h = 0; h < m; ++h) total[h] += double(part[h]);
            }
            // pi times the mean over directions of radiance, which is what leaves over pi.
            for (size_t h = 0; h < m; ++h) {
              last[i * m + h] = float(total[h] / directions_);
              sum[i * m + h] = last[i * m + h] + (bounce_ > 0 ? before.floats("sum")[i * m + h] : 0.0f);
            }
          }
          ctx.counters->rays += (end - begin) * directions_;
          progress.done(end - begin);
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
  uint32_t bounce_, directions_;
};

}  // namespace

NodePtr makeBouncedTransferNode(const TransferSettings& settings, uint32_t bounce, uint32_t directions) {
  return std::make_shared<BouncedTransferNode>(settings, bounce, directions);
}

}  // namespace gobo::transfer
