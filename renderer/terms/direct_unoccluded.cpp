// SPDX-License-Identifier: Apache-2.0
#include "terms/direct_unoccluded.h"

#include "base/check.h"
#include "terms/dropped_samples.h"
#include "terms/light_list.h"
#include "terms/surface.h"
#include "terms/surface_reader.h"
#include "terms/unoccluded_light.h"

namespace gobo {
inline namespace terms {

namespace {

class DirectUnoccludedNode final : public Node {
 public:
  explicit DirectUnoccludedNode(const DirectUnoccludedSettings& s) : s_(s) {}
  std::string type() const override { return "direct_unoccluded"; }
  // 2: every lobe; 3: bilinear environments; 4: specular light below the surface is mirrored back; 5: highlights of squares; 6: facing triangles;
  // 7: diffuse lobes of suns by quadrature, balls cut by the horizon exactly; 8: lights of some size over gloss by quadrature, disks exactly; 9: so are
  // mesh lights of few triangles, and rectangles at infinity over gloss; 10: tangents in the texture's own turn
  int version() const override { return 10; }
  NodeTraits traits() const override {
    NodeTraits t;
    // Geometry and emission are read by mesh lights only, whose digest is part of LightShape (scene.h).
    t.facets = Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission;
    if (s_.extended) t.facets = t.facets | kSurfaceFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashView(h, s_.view);
    h.addPod(s_.nominal).add(s_.samples).add(s_.seed).add(s_.extended);
    if (s_.lobe != LobePart::Both) h.add(s_.lobe);
    s_.view.place.hash(h);
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    Wiring w(type(), in, 2);
    const Extent view = s_.view.extent();
    w.over(0, view).reads<uint32_t>(0, "instance").reads<float>(0, "P", {3}).reads<float>(0, "Ng", {3});
    if (s_.extended) SurfaceReader::reads(w, 0);
    w.over(1, view).reads<float>(1, "N", {3}).reads<float>(1, "albedo", {3}).reads<float>(1, "material", {5}).reads<uint8_t>(1, "flags");
    return w.gives({type(), Domain::ViewSample, view, {unsetPlane<float>("L", 3), mayDrop()}});
  }
  Cost cost(const TermShape&, uint32_t) const override {
    return {0.0, kReceiving * double(s_.view.width) * s_.view.height * s_.view.viewSamples * (20.0 + (s_.ruled ? 6.0 : 15.0) * s_.samples)};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &g = *ctx.inputs[0], &surface = *ctx.inputs[1];
    const auto sampler = LightSampler::build(*ctx.scene, ctx.stop);
    if (!sampler) return Status(Code::Cancelled, "stopped");
    const LightShape& shape = ctx.scene->lightShape(s_.light);
    const UnoccludedLight light(*sampler, shape, s_.light, s_.samples, s_.seed);
    const SceneLight listed{s_.light, Vec3(1.0f)};
    const LightList list(*ctx.scene, *sampler, {&listed, 1}, s_.samples, s_.seed);
    const bool ruled = LightList::hasRules(shape) || !light.facets().empty();
    const auto instance = g.plane<uint32_t>("instance");
    const auto P = g.floats("P"), Ng = g.floats("Ng"), N = surface.floats("N"), albedo = surface.floats("albedo"), material = surface.floats("material");
    const auto flags = surface.plane<uint8_t>("flags");
    std::unique_ptr<const SurfaceReader> reader;
    if (s_.extended) {
      GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
      reader = std::make_unique<const SurfaceReader>(*ctx.scene, accel, g, s_.view.camera);
    }
    const auto& out = ctx.result;
    const auto L = out->writable<float>("L");
    DroppedSamples dropped(*out);
    const FilmElements film(s_.view.extent(), s_.view.place);
    const Vec3 eye(s_.view.camera.toWorld[3]), back(s_.view.camera.toWorld[2]);
    const bool complete = ctx.arena->parallelFor(
        instance.size(), 1 << 11,
        [&](size_t begin, size_t end) {
          LightList::Values values;
          for (size_t i = begin; i < end; ++i) {
            for (int c = 0; c < 3; ++c) L[3 * i + c] = 0.0f;
            if (instance[i] == ~0u || (flags[i] & kSurfaceUnlit)) continue;
            LitPoint r;
            r.p = Vec3(P[3 * i], P[3 * i + 1], P[3 * i + 2]);
            r.n = Vec3(N[3 * i], N[3 * i + 1], N[3 * i + 2]);
            r.ng = Vec3(Ng[3 * i], Ng[3 * i + 1], Ng[3 * i + 2]);
            r.wo = s_.view.camera.perspective ? glm::normalize(eye - r.p) : back;
            if (flags[i] & kSurfaceExtended) {
              GOBO_CHECK(reader != nullptr);
              Surface full;
              reader->read(i, full);
              r.extended = true;
              r.bsdf = full.bsdf;
              r.hasTangent = full.hasTangent;
              r.tangent = full.tangent;
              r.dispersion = full.material->dispersion;
            } else {
              r.bsdf.albedo = Vec3(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]);
              r.bsdf.metallic = material[5 * i];
              r.bsdf.roughness = material[5 * i + 1];
              r.bsdf.specular = material[5 * i + 2];
              r.bsdf.ior = material[5 * i + 3];
              r.bsdf.transmission = material[5 * i + 4];
              r.bsdf.entering = (flags[i] & kSurfaceEntering) != 0;
              if (!r.lambert() && r.n != r.ng) r.bsdf.facing = r.frame().toLocal(r.ng);
            }
            const Vec3 value = (ruled && !r.lambert() ? partOf(list.only(r, film(i), values), s_.lobe) : light.at(r, film(i), s_.lobe)) * s_.nominal;
            if (!isFinite(value)) {
              dropped.add(i, 1);
              continue;
            }
            for (int c = 0; c < 3; ++c) L[3 * i + c] = value[c];
          }
        },
        ctx.stop);
    if (!complete) return Status(Code::Cancelled, "stopped");
    return TermPtr(out);
  }

 private:
  DirectUnoccludedSettings s_;
};

}  // namespace

NodePtr makeDirectUnoccludedNode(const DirectUnoccludedSettings& settings) { return std::make_shared<DirectUnoccludedNode>(settings); }

}  // namespace terms
}  // namespace gobo
