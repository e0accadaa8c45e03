// SPDX-License-Identifier: Apache-2.0
#include "terms/direct_unoccluded.h"

#include <numbers>

#include "base/check.h"
#include "base/sobol.h"
#include "terms/dropped_samples.h"
#include "terms/surface.h"
#include "terms/surface_reader.h"
#include "trace/bsdf.h"
#include "trace/distant_light.h"
#include "trace/light_sampling.h"

namespace gobo {

namespace {

struct Receiver {
  Vec3 p, n, ng, wo;
  BsdfParams bsdf;
  bool extended = false, hasTangent = false;
  Vec3 tangent{0.0f};
  float dispersion = 0;
  bool lambert() const { return !extended && bsdf.metallic == 0 && bsdf.specular == 0 && bsdf.transmission == 0; }
  Frame frame() const { return hasTangent ? Frame(n, tangent) : Frame(n); }
  /// f cos, with the index of each channel where the material is dispersive.
  BsdfValue value(const Vec3& wo, const Vec3& wi) const {
    float pdf;
    return value(wo, wi, pdf);
  }
  /// With the density of BSDF samples.
  BsdfValue value(const Vec3& wo, const Vec3& wi, float& pdf) const {
    BsdfValue all = bsdfEvalPdf(bsdf, wo, wi, pdf);
    if (!(dispersion > 0.0f)) return all;
    BsdfParams p = bsdf;
    for (int c = 0; c < 3; ++c) {
      p.ior = dispersedIor(bsdf.ior, dispersion, c);
      const BsdfValue f = bsdfEval(p, wo, wi);
      all.diffuse[c] = f.diffuse[c];
      all.specular[c] = f.specular[c];
    }
    return all;
  }
};

class DirectUnoccludedNode final : public Node {
 public:
  explicit DirectUnoccludedNode(const DirectUnoccludedSettings& s) : s_(s) {}
  std::string type() const override { return "direct_unoccluded"; }
  // 2: every lobe; 3: bilinear environments; 4: specular light below the surface is mirrored back; 5: highlights of squares; 6: facing triangles;
  // 7: diffuse lobes of suns by quadrature, balls cut by the horizon exactly
  int version() const override { return 7; }
  NodeTraits traits() const override {
    NodeTraits t;
    // Geometry and emission are read by mesh lights only, whose digest is part of LightShape (scene.h).
    t.facets = Facet::LightShape | Facet::Topology | Facet::Pose | Facet::Shading | Facet::Coverage | Facet::Emission;
    if (s_.extended) t.facets = t.facets | kSurfaceFacets;
    t.tileable = true;
    return t;
  }
  void hashParameters(Hasher& h) const override {
    hashCamera(h, s_.view.camera);
    h.add(s_.view.width).add(s_.view.height).add(s_.view.viewSamples).addPod(s_.nominal).add(s_.samples).add(s_.seed).add(s_.extended);
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
    return {0.0, kReceiving * double(s_.view.width) * s_.view.height * s_.view.viewSamples * (20.0 + 15.0 * s_.samples)};
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const Term &g = *ctx.inputs[0], &surface = *ctx.inputs[1];
    const auto sampler = LightSampler::build(*ctx.scene, ctx.stop);
    if (!sampler) return Status(Code::Cancelled, "stopped");
    const LightShape shape = ctx.scene->lightShape(s_.light);
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
          for (size_t i = begin; i < end; ++i) {
            for (int c = 0; c < 3; ++c) L[3 * i + c] = 0.0f;
            if (instance[i] == ~0u || (flags[i] & kSurfaceUnlit)) continue;
            Receiver r;
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
            if (bsdfIsDelta(r.bsdf)) continue;
            Vec3 value(0.0f);
            if (!closedForm(shape, r, value)) value = sampled(*sampler, shape, r, film(i));
            value *= s_.nominal;
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
  static Vec3 part(const BsdfValue& f, LobePart lobe) { return lobe == LobePart::Both ? f.sum() : lobe == LobePart::Diffuse ? f.diffuse : f.specular; }
  Vec3 part(const BsdfValue& f) const { return part(f, s_.lobe); }

  /// The part of the light above the surface is the same by both normals. above: cosine of the light's centre to the geometric one; sine: of its half angle.
  static bool sameHorizon(const Receiver& r, double above, double sine) { return r.n == r.ng || above >= sine; }

  /// Exact for Lambert receivers of rectangles and spheres whose visible part is the same by both normals.
  bool closedForm(const LightShape& s, const Receiver& r, Vec3& value) const {
    if (!r.lambert()) return false;
    if (s_.lobe == LobePart::Specular) {
      value = Vec3(0.0f);
      return true;
    }
    const DVec3 p(r.p), n(r.n);
    if (s.kind == LightKind::Rect) {
      const DVec3 u(s.u), v(s.v), corner = DVec3(s.position) - u - v;
      if (!s.twoSided && glm::dot(p - DVec3(s.position), DVec3(s.axis)) <= 0) {
        value = Vec3(0.0f);
        return true;
      }
      if (r.n != r.ng)  // the tracer also wants light above the geometric horizon; where the light crosses it, sample
        for (int k = 0; k < 4; ++k)
          if (glm::dot(corner + u * double(2 * (k & 1)) + v * double(k & 2) - p, DVec3(r.ng)) <= 0) return false;
      value = r.bsdf.albedo * float(rectFormFactor(p, n, corner, 2.0 * u, 2.0 * v));
      return true;
    }
    if (s.kind == LightKind::Sphere) {
      const DVec3 d = DVec3(s.position) - p;
      const double distance = glm::length(d);
      if (!(distance > double(s.radius)) || !sameHorizon(r, glm::dot(d, DVec3(r.ng)) / distance, double(s.radius) / distance)) return false;
      value = r.bsdf.albedo * float(sphereFormFactor(p, n, DVec3(s.position), double(s.radius)));
      return true;
    }
    return false;
  }

  /// The diffuse lobe under a sun of some size, whose visible part is the same by both normals. What a plane gets of it is exact: it falls with the cosine
  /// of its centre, as of a ball. A lobe below an interface is a smooth function of the light's cosine times it: of a disk that is whole above the horizon
  /// four places (two of them at one cosine) on the circle whose mean is the disk's, exact for what is linear in the cosine and to the third order of the
  /// disk's angle otherwise; of one that is cut by it, five parallels.
  bool sunlit(const LightShape& s, const Receiver& r, Vec3& value) const {
    value = Vec3(0.0f);
    if (r.extended) return false;
    const double sine = std::sin(0.5 * double(s.angularSize)), up = -glm::dot(DVec3(r.n), DVec3(s.axis)), above = -glm::dot(DVec3(r.ng), DVec3(s.axis));
    if (up <= -sine || above <= -sine) return true;
    if (!sameHorizon(r, above, sine)) return false;
    if (r.lambert()) {
      value = r.bsdf.albedo * float((up >= sine ? up : capFormFactor(up, sine) / (sine * sine)) / std::numbers::pi);
      return true;
    }
    const double cosine = std::sqrt(1.0 - sine * sine), out = std::sqrt(std::max(1.0 - up * up, 0.0));
    const Vec3 wo = r.frame().toLocal(r.wo);
    if (up >= sine) {
      // Mean cosine to the centre is (1 + cos a) / 2 for half angle a; the disk's solid angle over its irradiance is the reciprocal.
      const double mean = 0.5 * (1.0 + cosine), across = std::sqrt(1.0 - mean * mean) * out;
      const float cosines[3] = {float(mean * up), float(mean * up + across), float(std::max(mean * up - across, 1e-9))};
      Vec3 f[3];
      bsdfDiffuse(r.bsdf, wo, cosines, f);
      value = (0.5f * f[0] + 0.25f * (f[1] + f[2])) * float(1.0 / mean);
      return true;
    }
    // By Gauss's rule in t: cosines are middle + half sin t from the horizon to the highest, where the parallel's arc within the disk ends like a root.
    const double middle = up * cosine, half = out * sine, from = std::asin(std::clamp(-middle / half, -1.0, 1.0)), to = 0.5 * std::numbers::pi;
    float cosines[kParallels];
    double weights[kParallels];
    for (int k = 0; k < kParallels; ++k) {
      const double t = 0.5 * (from + to) + 0.5 * (to - from) * kGaussNode[k], m = std::max(middle + half * std::sin(t), 1e-9);
      const double arc = 2.0 * std::acos(std::clamp((cosine - m * up) / (std::sqrt(std::max(1.0 - m * m, 1e-30)) * out), -1.0, 1.0));
      cosines[k] = float(m);
      weights[k] = 0.5 * (to - from) * kGaussWeight[k] * half * std::cos(t) * arc;
    }
    Vec3 f[kParallels];
    bsdfDiffuse(r.bsdf, wo, cosines, f);
    DVec3 sum(0.0);
    for (int k = 0; k < kParallels; ++k) sum += weights[k] * DVec3(f[k]);
    value = Vec3(sum / (std::numbers::pi * sine * sine));
    return true;
  }
  static constexpr int kParallels = 5;
  static constexpr double kGaussNode[kParallels] = {-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640};
  static constexpr double kGaussWeight[kParallels] = {0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665, 0.2369268850561891};

  /// As the tracer has it, from the front. What comes through the surface is no part of this term: its shadows are other ones.
  static bool arrives(const Receiver& r, const Vec3& wi) { return glm::dot(wi, r.ng) > 0 && glm::dot(wi, r.n) > 0; }

  Vec3 sampled(const LightSampler& sampler, const LightShape& shape, const Receiver& r, size_t element) const {
    const Frame frame = r.frame();
    const Vec3 wo = frame.toLocal(r.wo);
    const auto reflected = [&](const Vec3& wi) {
      if (!arrives(r, wi)) return Vec3(0.0f);
      return part(r.value(wo, frame.toLocal(wi)));
    };
    LightSample ls;
    if (isWideDirectional(shape)) {
      if (shape.angularSize != 0.0f) {
        Vec3 diffuse;
        if (s_.lobe == LobePart::Specular || !sunlit(shape, r, diffuse)) return distant(shape, r, frame, wo, element, s_.lobe);
        return r.lambert() || s_.lobe == LobePart::Diffuse ? diffuse : diffuse + distant(shape, r, frame, wo, element, LobePart::Specular);
      }
      if (r.lambert()) return reflected(-shape.axis);
      Vec3 value(0.0f);
      if (s_.lobe != LobePart::Specular && arrives(r, -shape.axis)) value += r.value(wo, frame.toLocal(-shape.axis)).diffuse;
      if (s_.lobe != LobePart::Diffuse) value += distant(shape, r, frame, wo, element, LobePart::Specular);
      return value;
    }
    if (isDeltaLight(shape)) return sampler.sample(s_.light, r.p, Vec2(0.5f), ls) ? reflected(ls.direction) * ls.radiance : Vec3(0.0f);

    // Light samples and BSDF samples by the balance heuristic; BSDF samples only for lights that a ray can be tested against here.
    const bool both = shape.kind != LightKind::Mesh && !r.lambert();
    const int nLight = both ? (s_.samples + 1) / 2 : s_.samples, nBsdf = s_.samples - nLight;
    DVec3 sum(0.0);
    const uint64_t seed = hash64(hash64(s_.seed, 0x646972u), element);
    for (int k = 0; k < nLight; ++k) {
      SobolSampler u(seed, uint32_t(k));
      if (!sampler.sample(s_.light, r.p, u.next2D(), ls)) continue;
      const float pb = nBsdf ? bsdfPdf(r.bsdf, wo, frame.toLocal(ls.direction)) : 0.0f;
      sum += DVec3(reflected(ls.direction) * ls.radiance) / double(nLight * ls.pdf + nBsdf * pb);
    }
    for (int k = 0; k < nBsdf; ++k) {
      SobolSampler u(hash64(seed, 1), uint32_t(k));
      BsdfSample b;
      const float lobe = u.next1D();
      if (!bsdfSample(r.bsdf, wo, lobe, u.next2D(), b) || b.delta || b.pdf <= 0) continue;
      Ray ray;
      ray.origin = r.p;
      ray.direction = frame.toWorld(b.wi);
      if (!arrives(r, ray.direction)) continue;
      float t = ray.tmax;
      Vec3 normal;
      if (sampler.intersectAreaLights(ray, t, normal) != s_.light) continue;
      const float pl = sampler.pdf(s_.light, r.p, ray.direction, t, 0);
      const Vec3 f = part(r.value(wo, b.wi)) * sampler.emitted(s_.light, ray.direction, 0, 0, 0, normal);
      sum += DVec3(f) / double(nLight * pl + nBsdf * b.pdf);
    }
    return Vec3(sum);
  }

  /// Where the highlight of a glossy surface is, a few samples of either kind are too few: a light at infinity takes a share of the lobe, and one BSDF
  /// sample more or less that falls inside it changes hundreds of times the picture's mean by a quarter. cosine: of the mirror direction to the
  /// light's centre; h: tangent of its larger half angle. Lights in the sky lie in few lobes; wide lobes have no such peaks.
  static constexpr int kHighlightScale = 16;
  static constexpr double kHighlightAlpha = 0.1;
  static bool inHighlight(const Receiver& r, double cosine, double h) {
    double alpha = 1e9;
    for (const float roughness : {r.bsdf.roughness, r.bsdf.clearcoat > 0.0f ? r.bsdf.clearcoatRoughness : 1.0f})
      if (const double a = double(roughness) * roughness; a >= kDeltaAlpha) alpha = std::min(alpha, a);
    return alpha < std::min(8.0 * h, kHighlightAlpha) && std::acos(std::clamp(cosine, -1.0, 1.0)) < 1.5 * h + 4.0 * alpha;
  }

  /// Lobes under a light at infinity of irradiance 1, uniform over its disk or rectangle. Light and BSDF samples, balance heuristic.
  Vec3 distant(const LightShape& shape, const Receiver& r, const Frame& frame, const Vec3& wo, size_t element, LobePart lobes) const {
    const DistantLight light(shape);
    const double h = shape.angularSize != 0.0f ? std::tan(0.5 * double(shape.angularSize)) : 0.5 * std::max(shape.skyRectangle.x, shape.skyRectangle.y);
    const bool highlight = !r.lambert() && inHighlight(r, -glm::dot(shape.axis, frame.toWorld(Vec3(-wo.x, -wo.y, wo.z))), h);
    const int samples = highlight ? kHighlightScale * s_.samples : s_.samples, nLight = r.lambert() ? samples : (samples + 1) / 2, nBsdf = samples - nLight;
    const uint64_t seed = hash64(hash64(s_.seed, 0x676c6fu), element);
    DVec3 sum(0.0);
    for (int k = 0; k < samples; ++k) {
      SobolSampler u(seed, uint32_t(k));
      Vec3 wi, local;
      double pl;
      if (k < nLight) {
        wi = light.sample(u.next2D(), pl);
        local = frame.toLocal(wi);
      } else {
        BsdfSample b;
        const float lobe = u.next1D();
        if (!bsdfSample(r.bsdf, wo, lobe, u.next2D(), b) || b.delta || b.pdf <= 0) continue;
        local = b.wi;
        wi = frame.toWorld(local);
        pl = light.pdf(wi);
      }
      if (!(pl > 0) || !arrives(r, wi)) continue;
      float density;
      const Vec3 f = part(r.value(wo, local, density), lobes);
      sum += DVec3(f) / (nLight * pl + nBsdf * double(density));
    }
    return Vec3(sum / light.irradiance());
  }

  DirectUnoccludedSettings s_;
};

}  // namespace

NodePtr makeDirectUnoccludedNode(const DirectUnoccludedSettings& settings) { return std::make_shared<DirectUnoccludedNode>(settings); }

}  // namespace gobo
