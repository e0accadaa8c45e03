// SPDX-License-Identifier: Apache-2.0
#include "terms/surface.h"

#include "terms/surface_reader.h"

namespace gobo {
inline namespace terms {

namespace {

class SurfaceNode final : public Node {
 public:
  explicit SurfaceNode(const GBufferSettings& s) : s_(s) {}
  std::string type() const override { return "surface"; }
  int version() const override { return 3; }  // 2: flags, every texture; 3: tangents in the texture's own turn
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kSurfaceFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override { hashView(h, s_); }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 1);
    w.over(0, s_.extent());
    SurfaceReader::reads(w, 0);
    return w.gives({type(),
                    Domain::ViewSample,
                    s_.extent(),
                    {unsetPlane<float>("albedo", 3), unsetPlane<float>("material", 5), unsetPlane<float>("N", 3), unsetPlane<uint8_t>("flags")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs[0];
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const SurfaceReader reader(*ctx.scene, accel, g, s_.camera);
    const auto& out = ctx.result;
    const auto albedo = out->writable<float>("albedo"), material = out->writable<float>("material"), N = out->writable<float>("N");
    const auto flags = out->writable<uint8_t>("flags");
    const bool complete = ctx.arena->parallelFor(
        reader.size(), 1 << 13,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            if (!reader.hit(i)) {
              for (int c = 0; c < 3; ++c) albedo[3 * i + c] = N[3 * i + c] = 0.0f;
              for (int c = 0; c < 5; ++c) material[5 * i + c] = 0.0f;
              flags[i] = 0;
              continue;
            }
            Surface s;
            reader.read(i, s);
            for (int c = 0; c < 3; ++c) {
              albedo[3 * i + c] = s.bsdf.albedo[c];
              N[3 * i + c] = s.n[c];
            }
            const float m[5] = {s.bsdf.metallic, s.bsdf.roughness, s.bsdf.specular, s.bsdf.ior, s.bsdf.transmission};
            std::copy(m, m + 5, material.begin() + 5 * i);
            flags[i] =
                uint8_t((s.bsdf.entering ? kSurfaceEntering : 0) | (s.material->unlit ? kSurfaceUnlit : 0) | (s.material->extended ? kSurfaceExtended : 0));
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  GBufferSettings s_;
};

}  // namespace

NodePtr makeSurfaceNode(const GBufferSettings& settings) { return std::make_shared<SurfaceNode>(settings); }

}  // namespace terms
}  // namespace gobo
