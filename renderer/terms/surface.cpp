// SPDX-License-Identifier: Apache-2.0
#include "terms/surface.h"

#include "terms/surface_reader.h"

namespace gobo {

namespace {

class SurfaceNode final : public Node {
 public:
  explicit SurfaceNode(const GBufferSettings& s) : s_(s) {}
  std::string type() const override { return "surface"; }
  int version() const override { return 2; }  // 2: flags, every texture
  NodeTraits traits() const override {
    NodeTraits t;
    t.facets = kSurfaceFacets;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.camera);
    h.add(s_.width).add(s_.height).add(s_.viewSamples);
  }
  size_t outputBytes() const override { return size_t(s_.width) * s_.height * s_.viewSamples * 45; }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term& g = *ctx.inputs[0];
    GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
    const SurfaceReader reader(*ctx.scene, accel, g, s_.camera);
    auto out = std::make_shared<Term>("surface", Domain::ViewSample, g.extent());
    const auto albedo = out->addUnsetPlane<float>("albedo", 3), material = out->addUnsetPlane<float>("material", 5), N = out->addUnsetPlane<float>("N", 3);
    const auto flags = out->addUnsetPlane<uint8_t>("flags", 1);
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

}  // namespace gobo
