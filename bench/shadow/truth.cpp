// SPDX-License-Identifier: Apache-2.0
#include "shadow/truth.h"

#include <atomic>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "base/image_io.h"
#include "base/sobol.h"
#include "measure/metrics.h"
#include "terms/gbuffer.h"
#include "terms/light_points.h"
#include "terms/surface_samples.h"

namespace gobo::shadowbench {
namespace {

struct Sums {
  std::vector<double> seen, weight, lit, count;  // of weight x visible, weight, visible, samples that can shine
  std::vector<double> all;                       // samples drawn on surfaces
  explicit Sums(size_t n) : seen(n), weight(n), lit(n), count(n), all(n) {}
};

/// `rays` light samples (indices from `first`) at every sample of a G-buffer.
void addSamples(Runner& r, const Term& gbuffer, const LightPoints& points, const Accel& accel, uint32_t first, uint32_t rays, uint64_t seed, Sums& s) {
  const SurfaceSamples surface(gbuffer);
  r.arena().parallelFor(surface.size(), 256, [&](size_t from, size_t to) {
    for (size_t e = from; e < to; ++e) {
      if (!surface.hit(e)) continue;
      const Vec3 p = surface.position(e), N = surface.normal(e), Ng = surface.geometricNormal(e), reach = surface.reach(e, accel);
      const uint64_t sequence = hash64(seed, e);
      for (uint32_t i = first; i < first + rays; ++i) {
        s.all[e] += 1;
        LightPoint q;
        if (!points.sample(p, N, Ng, points.pointLike() ? Vec2(0.5f) : SobolSampler(sequence, i).next2D(), q) || q.belowSurface) continue;
        s.weight[e] += q.weight;
        s.count[e] += 1;
        if (accel.occluded(shadowRay(reach, p, Ng, q))) continue;
        s.seen[e] += q.weight;
        s.lit[e] += 1;
      }
    }
  });
}

TruthImage trace(Runner& r, bool area, int samples) {
  const std::vector<int> subset{r.light()};
  const SceneView view(*r.scene(), Facet::All, subset);
  const LightPoints points(view, r.light());
  const AccelPtr accel = r.accels().get(view, r.arena());
  TruthImage t;
  t.width = r.width();
  t.height = r.height();
  t.samples = samples;
  const size_t n = r.pixels();
  Sums halves[2] = {Sums(n), Sums(n)};
  const int perHalf = std::max(samples / 2, 1);
  for (int h = 0; h < 2; ++h) {
    const uint64_t seed = 0x7247 + uint64_t(h);
    if (!area) {
      const TermPtr g = r.gbuffer(r.camera());
      addSamples(r, *g, points, *accel, 0, points.pointLike() ? 1 : uint32_t(perHalf), seed, halves[h]);
      continue;
    }
    // Places in the pixel are shared by all pixels; the light's points go on from place to place in one sequence per pixel.
    const int places = points.pointLike() ? perHalf : std::max(1, std::min(perHalf / 8, 256)), each = std::max(perHalf / places, 1);
    for (int k = 0; k < places; ++k) {
      const Vec2 j = SobolSampler(hash64(0xca3e, seed), uint32_t(k)).next2D() - Vec2(0.5f);
      const TermPtr g = r.gbuffer(r.shifted(j.x, j.y));
      addSamples(r, *g, points, *accel, uint32_t(k * each), uint32_t(each), seed, halves[h]);
    }
  }
  for (int h = 0; h < 2; ++h) {
    std::vector<float>& V = h ? t.B : t.A;
    std::vector<float>& flat = h ? t.flatB : t.flatA;
    V.assign(n, 1.0f);
    flat.assign(n, 1.0f);
    for (size_t e = 0; e < n; ++e) {
      if (halves[h].weight[e] > 0) V[e] = float(halves[h].seen[e] / halves[h].weight[e]);
      if (halves[h].count[e] > 0) flat[e] = float(halves[h].lit[e] / halves[h].count[e]);
    }
  }
  t.weight.assign(n, 0.0f);
  for (size_t e = 0; e < n; ++e) {
    const double all = halves[0].all[e] + halves[1].all[e];
    if (all > 0) t.weight[e] = float((halves[0].weight[e] + halves[1].weight[e]) / all);
  }
  return t;
}

std::vector<float>* planesOf(TruthImage& t, int k) {
  std::vector<float>* all[5] = {&t.A, &t.B, &t.flatA, &t.flatB, &t.weight};
  return all[k];
}

bool readTruth(const std::string& path, TruthImage& t) {
  const auto bytes = readFile(path);
  if (!bytes.ok()) return false;
  const char* layers[5] = {"VA", "VB", "flatA", "flatB", "weight"};
  for (int k = 0; k < 5; ++k) {
    const auto image = readExrLayer(bytes->data(), bytes->size(), path, layers[k]);
    if (!image.ok() || image->width != t.width || image->height != t.height || image->channels != 1) return false;
    *planesOf(t, k) = image->data;
  }
  return true;
}

Status writeTruth(const std::string& path, TruthImage& t) {
  const char* layers[5] = {"VA", "VB", "flatA", "flatB", "weight"};
  std::vector<ExrLayer> list;
  for (int k = 0; k < 5; ++k) list.push_back({layers[k], {"Y"}, *planesOf(t, k), true, true});
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, encodeExr(t.width, t.height, list));
  return writeFileAtomic(path, bytes.data(), bytes.size());
}

}  // namespace

Result<Truth> makeTruth(Runner& r, const std::string& name, int samples, const std::string& folder) {
  Truth truth;
  truth.soft = !isDeltaLight(r.scene()->lights[size_t(r.light())].shape);
  if (!folder.empty()) std::filesystem::create_directories(folder);
  for (int area = 0; area < 2; ++area) {
    TruthImage& t = area ? truth.pixel : truth.centre;
    Hasher h("truth 1");  // raise it when the sampling changes
    h.add(r.scene()->hash()).add(r.light()).add(samples).add(area).add(r.width()).add(r.height());
    hashCamera(h, r.camera());
    const std::string path = folder + "/" + name + (area ? "-pixel-" : "-centre-") + std::to_string(r.width()) + "x" + std::to_string(r.height()) + "-" +
                             std::to_string(samples) + "-" + h.digest().hex().substr(0, 12) + ".exr";
    t.width = r.width();
    t.height = r.height();
    t.samples = samples;
    if (!folder.empty() && readTruth(path, t)) continue;
    t = trace(r, area != 0, samples);
    if (!folder.empty()) GOBO_TRY(writeTruth(path, t));
  }
  truth.mask.assign(r.pixels(), 0);
  for (size_t p = 0; p < r.pixels(); ++p) truth.mask[p] = truth.centre.weight[p] > 0.0f;
  Image V(r.width(), r.height(), 1);
  for (size_t p = 0; p < r.pixels(); ++p) V.data[p] = truth.mask[p] ? truth.main().V(p) : 1.0f;
  truth.band = penumbraMask(V);
  for (size_t p = 0; p < r.pixels(); ++p) truth.band[p] = truth.band[p] && truth.mask[p];
  return truth;
}

double rmseAgainst(const std::vector<uint8_t>& mask, const std::vector<float>& V, const std::vector<float>& A, const std::vector<float>& B) {
  double sum = 0, count = 0;
  for (size_t p = 0; p < mask.size(); ++p) {
    if (!mask[p]) continue;
    sum += (double(V[p]) - A[p]) * (double(V[p]) - B[p]);
    ++count;
  }
  return count > 0 ? std::sqrt(std::max(sum / count, 0.0)) : 0.0;
}
double rmse(const std::vector<uint8_t>& mask, const std::vector<float>& a, const std::vector<float>& b) { return rmseAgainst(mask, a, b, b); }

Errors errorsOf(const Truth& truth, const std::vector<float>& V) {
  Errors e;
  const TruthImage &main = truth.main(), &other = truth.other();
  e.rmse = rmseAgainst(truth.mask, V, main.A, main.B);
  e.other = rmseAgainst(truth.mask, V, other.A, other.B);
  e.penumbra = rmseAgainst(truth.band, V, main.A, main.B);
  double count = 0;
  for (size_t p = 0; p < V.size(); ++p) {
    if (!truth.mask[p]) continue;
    ++count;
    e.falseLit += V[p] > main.V(p) + 0.1f;
    e.falseDark += V[p] < main.V(p) - 0.1f;
  }
  if (count > 0) {
    e.falseLit /= count;
    e.falseDark /= count;
  }
  return e;
}

namespace {

class Covariance {
 public:
  explicit Covariance(size_t n) : a_(n), b_(n), ab_(n) {}
  void add(size_t p, double a, double b) {
    a_[p] += a;
    b_[p] += b;
    ab_[p] += a * b;
  }
  double mean(const std::vector<uint8_t>& mask, int n) const {
    double sum = 0, count = 0;
    for (size_t p = 0; p < mask.size(); ++p) {
      if (!mask[p]) continue;
      sum += (ab_[p] - a_[p] * b_[p] / n) / (n - 1);
      ++count;
    }
    return count > 0 ? sum / count : 0.0;
  }

 private:
  std::vector<double> a_, b_, ab_;
};

}  // namespace

Result<double> temporalVariance(Runner& r, const Truth& truth, const v1::ShadowTechnique& t, int count) {
  Covariance c(r.pixels());
  GOBO_TRY(r.jittered(t, count, [&](int, const std::vector<float>& V) {
    for (size_t p = 0; p < V.size(); ++p) c.add(p, V[p], V[p]);
  }));
  return c.mean(truth.mask, count);
}

Result<double> temporalVarianceOfTruth(Runner& r, const Truth& truth, int count, int samples) {
  const std::vector<int> subset{r.light()};
  const SceneView view(*r.scene(), Facet::All, subset);
  const LightPoints points(view, r.light());
  const AccelPtr accel = r.accels().get(view, r.arena());
  Covariance c(r.pixels());
  for (int k = 0; k < count; ++k) {
    const Vec2 j = Runner::jitter(k);
    const TermPtr g = r.gbuffer(r.shifted(j.x, j.y));
    std::vector<double> V[2];
    for (int h = 0; h < (points.pointLike() ? 1 : 2); ++h) {
      Sums s(r.pixels());
      addSamples(r, *g, points, *accel, 0, points.pointLike() ? 1 : uint32_t(samples), hash64(0x7e3, uint64_t(2 * k + h)), s);
      V[h].assign(r.pixels(), 1.0);
      for (size_t p = 0; p < r.pixels(); ++p)
        if (s.weight[p] > 0) V[h][p] = s.seen[p] / s.weight[p];
    }
    if (points.pointLike()) V[1] = V[0];
    for (size_t p = 0; p < r.pixels(); ++p) c.add(p, V[0][p], V[1][p]);
  }
  return c.mean(truth.mask, count);
}

}  // namespace gobo::shadowbench
