// SPDX-License-Identifier: Apache-2.0
#include "base/sobol.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/point_rays.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface_reader.h"

namespace gobo::transfer {

namespace {

constexpr uint32_t kLooks = 32;  // rays that ask whether a point is inside of something or in a gap
// A point most of whose rays end within its own cell is in a gap that the points beside it know nothing of (a rail behind a picket): it would darken what is
// open between two of its kind. In the corner of three walls three quarters do so.
constexpr uint32_t kMostNear = 28;

class TransferPointsNode final : public Node {
 public:
  explicit TransferPointsNode(const TransferSettings& s) : s_(s) {}
  std::string type() const override { return "transfer_points"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kAccelFacets | ReceiverMesh::kFacets;
    t.persist = true;
    return t;
  }
  // 2: triangles in strips, dense meshes thinned, gaps; 3: normals of tiny instances; 4: backs of single-sided meshes that are not closed; 6: rays begin as
  // near as the point's instance allows
  int version() const override { return 6; }
  void hashParameters(Hasher& h) const override { h.add(s_.points).add(s_.seed); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0)
        .gives({type(),
                Domain::List,
                s_.extent(),
                {unsetPlane<float>("position", 3), unsetPlane<float>("normal", 3), unsetPlane<float>("cell"), unsetPlane<uint32_t>("instance"),
                 unsetPlane<uint8_t>("usable")}});
  }
  size_t workingBytes() const override { return size_t(s_.size) * 64; }
  Cost cost(const TermShape&, uint32_t) const override { return {double(s_.size) * kLooks, 150.0 * s_.size * kLooks}; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const auto mesh = receiverMesh(*ctx.scene, s_.points);
    GOBO_CHECK_EQ(mesh->size(), size_t(s_.size));
    const ReceiverMesh::Points points = mesh->points(*ctx.scene);
    const auto position = ctx.result->writable<float>("position"), normal = ctx.result->writable<float>("normal"), cell = ctx.result->writable<float>("cell");
    const auto instance = ctx.result->writable<uint32_t>("instance");
    const auto usable = ctx.result->writable<uint8_t>("usable");
    const bool complete = ctx.arena->parallelFor(
        s_.size, 64,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            for (size_t k = 0; k < 3; ++k) {
              position[3 * i + k] = points.position[i][int(k)];
              normal[3 * i + k] = points.normal[i][int(k)];
            }
            cell[i] = points.cell[i];
            instance[i] = points.instance[i];
            const PointRays rays(points.position[i], points.normal[i], points.cell[i], accel->reach(points.instance[i]), hash64(s_.seed ^ 0x1ff5, i));
            uint32_t behind = 0, near = 0;
            for (uint32_t from = 0; from < kLooks; from += kLanes) {
              Ray ray[kLanes];
              Hit hit[kLanes];
              for (uint32_t k = 0; k < kLanes; ++k) ray[k] = rays.at(from + k);
              accel->intersect16(ray, kLanes, hit);
              for (int k = 0; k < kLanes; ++k) {
                if (!hit[k].valid()) continue;
                behind += glm::dot(hit[k].Ng, ray[k].direction) > 0.0f;
                near += hit[k].t < points.cell[i];
              }
            }
            ctx.counters->rays += kLooks;
            usable[i] = 2 * behind <= kLooks && near <= kMostNear;
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
};

class PointAlbedoNode final : public Node {
 public:
  explicit PointAlbedoNode(const TransferSettings& s) : s_(s) {}
  std::string type() const override { return "point_albedo"; }
  int version() const override { return 2; }  // 2: without what passes diffusely
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kSurfaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override { h.add(s_.points); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, s_.extent()).reads<float>(0, "normal", {3});
    return w.gives({type(), Domain::List, s_.extent(), {unsetPlane<float>("rgb", 3)}});
  }
  size_t workingBytes() const override { return size_t(s_.size) * 64; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const ReceiverMesh::Points points = receiverMesh(*ctx.scene, s_.points)->points(*ctx.scene);
    SurfaceTable surfaces;
    surfaces.build(*ctx.scene, *accel);
    const auto rgb = ctx.result->writable<float>("rgb");
    const bool complete = ctx.arena->parallelFor(
        s_.size, 1024,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            Surface s;
            surfaces.interact(points.instance[i], points.primitive[i], points.bary[i].x, points.bary[i].y, points.normal[i], -points.normal[i], s);
            const float r = (s.bsdf.ior - 1.0f) / (s.bsdf.ior + 1.0f), f0 = minOf(r * r * s.bsdf.specular, 1.0f);
            const float stays = 1.0f - clamp01(s.bsdf.diffuseTransmission);
            for (int k = 0; k < 3; ++k) {
              const float a = s.bsdf.albedo[k], dielectric = f0 + (1.0f - f0) * (1.0f - s.bsdf.transmission) * stays * a;
              rgb[3 * i + size_t(k)] = s.material->unlit ? 0.0f : clamp01(s.bsdf.metallic * a + (1.0f - s.bsdf.metallic) * dielectric);
            }
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(ctx.result);
  }

 private:
  TransferSettings s_;
};

}  // namespace

NodePtr makeTransferPointsNode(const TransferSettings& settings) { return std::make_shared<TransferPointsNode>(settings); }
NodePtr makePointAlbedoNode(const TransferSettings& settings) { return std::make_shared<PointAlbedoNode>(settings); }

}  // namespace gobo::transfer
