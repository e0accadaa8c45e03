// SPDX-License-Identifier: Apache-2.0
#include "terms/surface.h"

#include "trace/surface.h"

namespace gobo {

namespace {

class SurfaceNode final : public Node {
 public:
  explicit SurfaceNode(const GBufferSettings& s) : s_(s) {}
  std::string type() const override { return "surface"; }
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Albedo | Facet::Bsdf;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.camera);
    h.add(s_.width).add(s_.height).add(s_.viewSamples);
  }
  size_t outputBytes() const override { return size_t(s_.width) * s_.height * s_.viewSamples * 44; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs[0];
    const AccelPtr accel = ctx.accels->get(*ctx.scene, *ctx.arena);
    SurfaceTable table;
    table.build(*ctx.scene, *accel);
    const auto instance = g.plane<uint32_t>("instance"), primitive = g.plane<uint32_t>("primitive");
    const auto bary = g.floats("bary"), P = g.floats("P");
    const auto Ng = g.floats("Ng");
    auto out = std::make_shared<Term>("surface", Domain::ViewSample, g.extent());
    const auto albedo = out->addPlane<float>("albedo", 3), material = out->addPlane<float>("material", 5), N = out->addPlane<float>("N", 3);
    const auto entering = out->addPlane<uint8_t>("entering", 1);
    const Vec3 eye(s_.camera.toWorld[3]), forward = -Vec3(s_.camera.toWorld[2]);
    const bool complete = ctx.arena->parallelFor(instance.size(), 1 << 13, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        if (instance[i] == kNoHit) continue;
        const Vec3 p(P[3 * i], P[3 * i + 1], P[3 * i + 2]);
        const Vec3 d = s_.camera.perspective ? glm::normalize(p - eye) : forward;
        // The G-buffer's normal is turned to the viewer; the outside normal decides which side of a dielectric this is.
        const InstanceGeometry& geometry = accel->impl().instances[instance[i]];
        const Vec3 facing(Ng[3 * i], Ng[3 * i + 1], Ng[3 * i + 2]);
        const Vec3 outside = outsideNormal(geometry, primitive[i]);
        Surface s;
        table.interact(instance[i], primitive[i], bary[2 * i], bary[2 * i + 1], glm::dot(outside, facing) < 0 ? -facing : facing, d, s);
        for (int c = 0; c < 3; ++c) { albedo[3 * i + c] = s.bsdf.albedo[c]; N[3 * i + c] = s.n[c]; }
        const float m[5] = {s.bsdf.metallic, s.bsdf.roughness, s.bsdf.specular, s.bsdf.ior, s.bsdf.transmission};
        std::copy(m, m + 5, material.begin() + 5 * i);
        entering[i] = s.bsdf.entering;
      }
    }, ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  static Vec3 outsideNormal(const InstanceGeometry& g, uint32_t primitive) {
    const uint32_t* tri = g.indices + 3 * size_t(primitive);
    const Vec3 n = glm::cross(g.positions[tri[1]] - g.positions[tri[0]], g.positions[tri[2]] - g.positions[tri[0]]);
    return g.world ? (g.mirrored ? -n : n) : g.normalToWorld * n;
  }
  GBufferSettings s_;
};

}  // namespace

NodePtr makeSurfaceNode(const GBufferSettings& settings) { return std::make_shared<SurfaceNode>(settings); }

}  // namespace gobo
