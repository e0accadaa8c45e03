// SPDX-License-Identifier: Apache-2.0
// The published axis-aligned filter taken apart, by the names of filters/axis_aligned/literal.h: rays, time and error of each difference.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "filters/axis_aligned/literal.h"
#include "measure/report.h"
#include "shadow/options.h"
#include "shadow/techniques.h"
#include "terms/surface_samples.h"

namespace gobo::shadowbench {
namespace {

constexpr int kRays = 16;

struct BestBlur {
  float width = 0;  // pixels
  double rmse = 0, penumbra = 0, ms = 0;
};
struct ModeRow {
  std::string name, words;
  AxisAlignedModes modes;
};

/// At 16 rays everywhere, what the source's digest expects in this order of error behind the blurred hard shadow; then, at 16 rays in the mean,
/// one word at a time, the source and its code as a whole.
std::vector<ModeRow> orderRows() {
  AxisAlignedModes base;
  base.uniform = kRays;
  std::vector<ModeRow> rows(5, ModeRow{"", "", base});
  rows[0].name = "rays";
  rows[0].modes.radiusPx = 0;
  rows[1].name = "k=2";
  rows[1].modes.k = 2;
  rows[2].name = "k=sqrt(6)";
  rows[2].modes.k = std::sqrt(6.0f);
  rows[3].name = "k=3";
  rows[4].name = "k=3, mu=(n/9)^1/4";
  rows[4].modes.mu = std::pow(float(kRays) / 9.0f, 0.25f);
  return rows;
}
std::vector<ModeRow> wordRows() {
  AxisAlignedModes base;
  base.meanSamples = kRays;
  std::vector<ModeRow> rows{{"none: report_corrected, capped, scale_free, ours, separable, uniform, ratio", "", base}};
  for (const char* word : {"beta=code", "n=eq3.5", "thresholds=report", "thresholds=code", "distance=light_plane", "distance=world", "filter=full2d",
                           "light=gaussian", "light=gaussian_truncated", "shade=centre"})
    rows.push_back({word, word, base});
  rows.push_back({"report", "n=eq3.5,thresholds=report,distance=light_plane,light=gaussian_truncated,shade=centre", base});
  rows.push_back({"code", "beta=code,thresholds=code,distance=light_plane,light=gaussian_truncated,shade=centre", base});
  rows.back().modes.radiusPx = 10;
  return rows;
}

class Modes {
 public:
  Modes(const Options& o, Runner& r, Truth t) : o_(o), r_(r), truth_(std::move(t)) {}

  /// Visibility by many rays of the light that the modes mean.
  Result<const std::vector<float>*> truthOf(const AxisAlignedModes& modes) {
    const std::pair<int, bool> key(modes.profile.shape, modes.profile.flat);
    if (const auto at = truths_.find(key); at != truths_.end()) return &at->second;
    AxisAlignedModes m;
    m.profile = modes.profile;
    m.uniform = uint32_t(o_.truth);
    m.radiusPx = 0;
    const int repeat = r_.repeat();
    r_.setRepeat(1);
    auto V = r_.measure(Runner::Plan([&](Graph& g, const ShadowInput& i) { return planAxisAlignedModes(g, i, m); }), 0x7247);
    r_.setRepeat(repeat);
    GOBO_TRY(V.status());
    return &(truths_[key] = std::move(V->V));
  }

  /// Error of the light itself, by the mean of the unshadowed: visibility times what the light sends from its centre, or from all of it.
  Result<double> lightError(const AxisAlignedModes& modes, const std::vector<float>& V) {
    if (modes.profile.shape != ShadowLightProfile::Uniform) return std::nan("");
    GOBO_ASSIGN(const std::vector<float>* seen, truthOf({}));
    const std::vector<float>& W = truth_.centre.weight;
    double sum = 0, mean = 0, count = 0;
    for (size_t p = 0; p < V.size(); ++p) {
      if (!truth_.mask[p]) continue;
      const double r = modes.profile.flat ? centre()[p] : W[p];
      sum += sqr(float(V[p] * r - double((*seen)[p]) * W[p]));
      mean += W[p];
      ++count;
    }
    return std::sqrt(sum / count) / (mean / count);
  }

  /// RMSE of the hard shadow from the light's centre under the Gaussian of one width in pixels that errs least.
  Result<BestBlur> blurred() {
    GOBO_ASSIGN(const std::vector<float>* seen, truthOf({}));
    const TermPtr g = r_.gbuffer(r_.camera());
    const Extent e = g->extent();
    centre();
    BestBlur best;
    for (const float width : {1.0f, 2.0f, 3.0f, 4.0f, 6.0f, 8.0f, 12.0f, 16.0f}) {
      auto omega = std::make_shared<Term>("width", Domain::ViewSample, e), hard = std::make_shared<Term>("visibility", Domain::ViewSample, e);
      const auto o = omega->addPlane<float>("Omega"), v = hard->addPlane<float>("V");
      for (size_t p = 0; p < hard_.size(); ++p) {
        o[p] = 1.0f / (3.0f * width * g->floats("footprint")[p]);
        v[p] = hard_[p];
      }
      AxisAlignedFilterSettings s;
      s.light = shadowLightFrame(r_.scene()->lights[size_t(r_.light())].shape);
      s.radiusPx = kAxisAlignedMaxRadius;
      s.betaThreshold = 1.0f;
      RunContext ctx;
      ctx.inputs = {hard, g, omega};
      ctx.arena = &r_.arena();
      const double begin = r_.now();
      GOBO_ASSIGN(const TermPtr out, runNode(*makeAxisAlignedFilter(s), ctx));
      const double ms = r_.now() - begin;
      const auto V = out->floats("V");
      const std::vector<float> filtered(V.begin(), V.end());
      const double error = rmse(truth_.mask, filtered, *seen);
      if (best.width == 0 || error < best.rmse) best = {width, error, rmse(truth_.band, filtered, *seen), ms};
    }
    return best;
  }

  Status add(Table& table, const std::string& scene, const ModeRow& row, double* error) {
    GOBO_ASSIGN(const AxisAlignedModes modes, axisAlignedModes(row.words, row.modes));
    GOBO_ASSIGN(const std::vector<float>* seen, truthOf(modes));
    double rays = 0, squares = 0, penumbra = 0, light = 0;
    std::vector<double> times;
    const std::vector<uint64_t> seeds = o_.quick ? std::vector<uint64_t>{11} : std::vector<uint64_t>{11, 12, 13};
    for (const uint64_t seed : seeds) {
      GOBO_ASSIGN(const Measured m, r_.measure(Runner::Plan([&](Graph& g, const ShadowInput& i) { return planAxisAlignedModes(g, i, modes); }), seed));
      rays += m.rays / double(seeds.size());
      squares += sqr(float(rmse(truth_.mask, m.V, *seen))) / double(seeds.size());
      penumbra += sqr(float(rmse(truth_.band, m.V, *seen))) / double(seeds.size());
      GOBO_ASSIGN(const double l, lightError(modes, m.V));
      light += l / double(seeds.size());
      times.push_back(m.ms.total());
    }
    table.add({scene, row.name, rays, median(times), std::sqrt(squares), std::sqrt(penumbra), light});
    if (error) *error = std::sqrt(squares);
    return {};
  }

 private:
  /// Unshadowed weight from the light's centre, and whether it is seen from there.
  const std::vector<float>& centre() {
    if (!centre_.empty()) return centre_;
    const std::vector<int> subset{r_.light()};
    const SceneView view(*r_.scene(), Facet::All, subset);
    const LightPoints points(view, r_.light());
    const AccelPtr accel = r_.accels().get(view, r_.arena());
    const TermPtr g = r_.gbuffer(r_.camera());
    const SurfaceSamples surface(*g);
    centre_.assign(r_.pixels(), 0.0f);
    hard_.assign(r_.pixels(), 1.0f);
    for (size_t p = 0; p < r_.pixels(); ++p) {
      LightPoint q;
      if (!surface.hit(p) || !points.sample(surface.position(p), surface.normal(p), surface.geometricNormal(p), Vec2(0.5f), q)) continue;
      centre_[p] = q.weight;
      hard_[p] = !q.belowSurface && !accel->occluded(shadowRay(surface.reach(p, *accel), surface.position(p), surface.geometricNormal(p), q));
    }
    return centre_;
  }

  const Options& o_;
  Runner& r_;
  Truth truth_;
  std::map<std::pair<int, bool>, std::vector<float>> truths_;
  std::vector<float> centre_, hard_;
};

}  // namespace

int modes(Options o) {
  if (!o.width) o.width = o.height = 256;
  if (!o.truth) o.truth = 1024;
  Table table("the published filter taken apart, " + std::to_string(kRays) + " rays", {"scene", "mode", "rays/px", "ms", "rmse", "penumbra", "light"});
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("truth, rays a pixel", std::to_string(o.truth) + ", of the light that the mode means");
  table.note("light", "error of visibility times unshadowed light by the mean of the latter");
  std::string order;
  for (const SceneEntry& entry : sceneEntries()) {
    if (o.only.empty() ? entry.scene != "grids" && entry.scene != "fence" && entry.scene != "sponza" : entry.scene.find(o.only) == std::string::npos) continue;
    o.scene = entry.scene;
    o.light = entry.soft;
    o.camera = entry.camera;
    const Status done = [&]() -> Status {
      GOBO_ASSIGN(const auto runner, makeRunner(o, true));
      runner->setRepeat(o.repeat);
      GOBO_ASSIGN(Truth truth, makeTruth(*runner, baseName(o) + "-soft", 256, o.out + "/truth"));
      Modes m(o, *runner, std::move(truth));
      GOBO_ASSIGN(const BestBlur blur, m.blurred());
      table.add({o.scene, "blurred hard shadow, " + std::to_string(int(blur.width)) + " px", 1.0, blur.ms, blur.rmse, blur.penumbra, std::nan("")});
      std::vector<double> errors{blur.rmse};
      for (const ModeRow& row : orderRows()) {
        double error = 0;
        GOBO_TRY(m.add(table, o.scene, row, &error));
        errors.push_back(error);
      }
      order += o.scene + ": ";
      const char* names[] = {"blurred", "rays", "k=2", "k=sqrt(6)", "k=3", "k=3 mu"};
      bool holds = true;
      for (size_t i = 0; i < errors.size(); ++i) {
        char text[64];
        std::snprintf(text, sizeof text, "%s%s %.4f", i == 0 ? "" : errors[i] <= errors[i - 1] ? " > " : " < ", names[i], errors[i]);
        order += text;
        holds = holds && (i == 0 || errors[i] <= errors[i - 1]);
      }
      order += holds ? ": as expected\n" : ": not as expected\n";
      for (const ModeRow& row : wordRows()) GOBO_TRY(m.add(table, o.scene, row, nullptr));
      return {};
    }();
    if (!done.ok()) {
      std::fprintf(stderr, "%s: %s\n", entry.scene.c_str(), done.toString().c_str());
      return 1;
    }
  }
  std::printf("%s\nExpected: blurred > rays > k=2 > k=sqrt(6) > k=3 >= k=3 mu\n%s", table.text().c_str(), order.c_str());
  return 0;
}

}  // namespace gobo::shadowbench
