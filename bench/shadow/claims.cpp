// SPDX-License-Identifier: Apache-2.0
// The source's claims (T. Annen 2008; tables and figures as numbered in digest 9) as ratios of one run.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "measure/plot.h"
#include "measure/report.h"
#include "scene/edit.h"
#include "shadow/options.h"
#include "shadow/oracle.h"
#include "shadow/techniques.h"

namespace gobo::shadowbench {
namespace {

using Map = v1::ShadowMapSettings;

class Claims {
 public:
  explicit Claims(Options o) : o_(std::move(o)) {}

  int run() {
    struct Claim {
      const char* name;
      Status (Claims::*make)();
    };
    for (const Claim& c : {Claim{"esm-csm", &Claims::exponentialAgainstConvolution}, Claim{"pcf-taps", &Claims::taps}, Claim{"flagged", &Claims::flagged},
                           Claim{"bleeding", &Claims::bleeding}, Claim{"penumbra", &Claims::penumbra}, Claim{"lights", &Claims::lights}}) {
      if (!o_.only.empty() && o_.only != c.name) continue;
      name_ = c.name;
      const Status s = (this->*c.make)();
      if (!s.ok()) {
        std::fprintf(stderr, "claim %s: %s\n", c.name, s.toString().c_str());
        failed_ = true;
      }
      std::fflush(stdout);
    }
    summary_.note("clock", o_.clock == Runner::Clock::Wall ? "wall" : "cpu of all threads");
    std::printf("\n%s", summary_.text().c_str());
    const std::string path = o_.out + "/shadow_claims";
    std::filesystem::create_directories(o_.out);
    for (const Status& s : {summary_.write(path + ".csv"), summary_.write(path + ".json")})
      if (!s.ok()) {
        std::fprintf(stderr, "%s\n", s.toString().c_str());
        failed_ = true;
      }
    return failed_ ? 1 : 0;
  }

 private:
  Result<std::unique_ptr<Runner>> runner(const std::string& scene, const std::string& light, const std::string& camera, int width, int height,
                                         bool soft = false) const {
    Options o = o_;
    o.scene = scene;
    o.light = light;
    o.camera = camera;
    o.width = o_.width ? o_.width : width;
    o.height = o_.height ? o_.height : height;
    return makeRunner(o, soft);
  }
  void claim(const std::string& what, const std::string& asked, double measured) { summary_.add({name_, what, asked, measured}); }
  void show(const Table& t) const {
    std::printf("\n%s", t.text().c_str());
    (void)t.write(o_.out + "/shadow_claims_" + name_ + ".csv");
  }

  // Table 7.1, Figure 7.8: S = 2048, mip chains, bytes for the convolution map.
  Status exponentialAgainstConvolution() {
    GOBO_ASSIGN(const auto r, runner("trees", "sun", "front", 1024, 768));
    Table t("ESM against CSM(16), trees, S=2048, trilinear",
            {"blur", "map", "depth ms", "encode ms", "filter ms", "lookup ms", "without depth ms", "total ms", "map MiB"});
    for (const int blur : {0, 3}) {
      v1::ShadowTechnique esm = exponential(80, 2048, blur), csm = convolution(16, 2048, blur, true), vsm = variance(2048, blur);
      double ms[2] = {0, 0}, total[2] = {0, 0}, bytes[2] = {0, 0};
      int k = 0;
      for (v1::ShadowTechnique* x : {&esm, &csm, &vsm}) {
        x->mutable_map()->set_lookup(Map::TRILINEAR);
        GOBO_ASSIGN(const Measured m, r->measure(*x));
        const double own = m.ms.total() - m.ms.depth;
        t.add({std::string(blur ? "7x7" : "none"),
               std::string(k == 0   ? "exponential"
                           : k == 1 ? "convolution 16 bytes"
                                    : "variance"),
               m.ms.depth, m.ms.encode, m.ms.filter, m.ms.lookup, own, m.ms.total(), double(m.mapBytes) / (1 << 20)});
        if (k < 2) {
          ms[k] = own;
          total[k] = m.ms.total();
          bytes[k] = double(m.mapBytes);
        }
        ++k;
      }
      const std::string b = blur ? ", 7x7" : ", no convolution";
      claim("time CSM(16) / ESM, whole frame" + b, blur ? "4.5" : "3.0", total[1] / total[0]);
      claim("time CSM(16) / ESM, encode + filter + lookup" + b, blur ? "(4.5)" : "(3.0)", ms[1] / ms[0]);
      if (!blur) claim("bytes CSM(16) / ESM, filtered map with levels", "8", bytes[1] / bytes[0]);
    }
    show(t);
    return {};
  }

  // Figure 7.9: the smooth target is the same kernel, densely compared.
  Status taps() {
    struct View {
      const char *scene, *camera;
    };
    for (const View& v : {View{"fence", "front"}, View{"planes", "front"}, View{"blobs", "front"}}) {
      GOBO_ASSIGN(const auto r, runner(v.scene, "sun", v.camera, 512, 384));
      const int S = 1024, blur = 2;
      GOBO_ASSIGN(const Measured target, r->measure(percentageCloser(S, blur)));
      GOBO_ASSIGN(const Truth truth, makeTruth(*r, std::string(v.scene) + "-sun-" + v.camera + "-hard", o_.truth ? o_.truth : 256, o_.out + "/truth"));
      Table t(std::string("taps for ESM + 5x5 Gauss, ") + v.scene + ", S=1024; error against the same kernel, densely compared",
              {"filter", "rmse", "false lit %", "false dark %", "lookup ms"});
      const auto error = [&](const std::vector<float>& V) { return rmse(truth.mask, V, target.V); };
      const auto row = [&](const std::string& name, const std::vector<float>& V, double ms) {
        double lit = 0, dark = 0, n = 0;
        for (size_t p = 0; p < V.size(); ++p) {
          if (!truth.mask[p]) continue;
          ++n;
          lit += V[p] > target.V[p] + 0.1f;
          dark += V[p] < target.V[p] - 0.1f;
        }
        t.add({name, error(V), 100 * lit / std::max(n, 1.0), 100 * dark / std::max(n, 1.0), ms});
      };
      double esm[3];
      const v1::ShadowTechnique maps[3] = {exponential(80, S, blur), exponential(80, S, blur, true), exponential(500, S, blur, true)};
      const char* names[3] = {"exponential c=80", "exponential c=80 threshold", "exponential log c=500 threshold"};
      for (int k = 0; k < 3; ++k) {
        GOBO_ASSIGN(const Measured m, r->measure(maps[k]));
        esm[k] = error(m.V);
        row(names[k], m.V, m.ms.lookup);
      }
      int needed[3] = {0, 0, 0};
      for (const int n : {1, 4, 9, 16, 25, 36, 49, 64, 100, 144}) {
        double ms = 0;
        GOBO_ASSIGN(const std::vector<float> V, sampledKernel(*r, percentageCloser(S, blur), n, &ms));
        row("percentage closer, " + std::to_string(n) + " taps", V, ms);
        for (int k = 0; k < 3; ++k)
          if (!needed[k] && error(V) <= esm[k]) needed[k] = n;
      }
      show(t);
      for (int k = 0; k < 3; ++k)
        claim(std::string("taps to reach ") + names[k] + " + 5x5, " + v.scene + (needed[k] ? "" : " (more than 144)"), "36..64", needed[k] ? needed[k] : NAN);
    }
    return {};
  }

  // Table 7.2: shares of an 800 x 800 picture, no anti-aliasing of the map beyond its levels.
  Status flagged() {
    const int S = 1024;
    const char* asked[2][4] = {{"3.0", "6.1", "7.9", "9.3"}, {"2.8", "4.9", "6.1", "7.1"}};
    Table t("flagged pixels, 800x800, S=1024, c=80", {"scene", "classification", "convolution", "lookup", "% of the picture", "% of surfaces"});
    for (const std::string scene : {"trees", "two-trees", "fence"}) {
      GOBO_ASSIGN(const auto r, runner(scene, "sun", "front", 800, 800));
      for (const auto lookup : {Map::BILINEAR, Map::TRILINEAR})
        for (int c = 0; c < 3; ++c)
          for (int blur = 0; blur < 4; ++blur) {
            v1::ShadowTechnique e = exponential(80, S, blur);
            e.mutable_exponential()->set_classification(c >= 1 ? v1::ExponentialShadow::THRESHOLD : v1::ExponentialShadow::Z_MAX);
            e.mutable_map()->set_lookup(lookup);
            if (c == 2) e.mutable_map()->set_bias(0);  // the bias alone makes a lit surface e^(c bias) > 1
            GOBO_ASSIGN(const Measured m, r->measure(e));
            const auto flags = m.term->floats("flags");
            const auto instance = r->gbuffer()->plane<uint32_t>("instance");
            double set = 0, hit = 0;
            for (size_t p = 0; p < flags.size(); ++p) {
              set += flags[p] > 0.5f;
              hit += instance[p] != ~0u;
            }
            const std::string kernel = blur ? std::to_string(2 * blur + 1) + "x" + std::to_string(2 * blur + 1) : "none", kind = c == 0   ? "z-max"
                                                                                                                                 : c == 1 ? "threshold"
                                                                                                                                          : "threshold, bias 0";
            t.add({scene, kind, kernel, std::string(lookup == Map::BILINEAR ? "bilinear" : "trilinear"), 100 * set / double(flags.size()),
                   100 * set / std::max(hit, 1.0)});
            if (lookup == Map::BILINEAR && c < 2) claim("flagged %, " + scene + ", " + kind + ", " + kernel, asked[c][blur], 100 * set / double(flags.size()));
          }
    }
    show(t);
    return {};
  }

  // Figure 6.9. Bleeding: light where the whole kernel lies before the receiver, by more than the distance over which a truncated basis
  // leaks at contacts (digest 5.4: lit < 5 % from 0.048 on for M = 16; ln(20) / 80 for c = 80).
  Status bleeding() {
    struct View {
      const char *scene, *light, *camera;
    };
    for (const View& v :
         {View{"fence", "sun", "front"}, View{"pergola", "sun", "front"}, View{"grids", "key", "receiver"}, View{"two-trees", "sun", "close"}}) {
      GOBO_ASSIGN(const auto r, runner(v.scene, v.light, v.camera, 512, 384));
      const int S = 1024, blur = 2;
      GOBO_ASSIGN(const std::vector<float> gap, umbraDepth(*r, percentageCloser(S, blur)));
      Table t(std::string("light in the umbra, ") + v.scene + ", S=1024, 5x5",
              {"map", "% of the deep umbra above 0.1", "above 0.05", "mean there", "% of all umbra above 0.1"});
      v1::ShadowTechnique evsm = shadowMap(S, blur), moment = shadowMap(S, blur);
      evsm.mutable_exponential_variance();
      moment.mutable_moment();
      struct Case {
        std::string name;
        v1::ShadowTechnique t;
      };
      for (const Case& c :
           {Case{"convolution 16", convolution(16, S, blur)}, Case{"variance, no reduction", variance(S, blur, 0)}, Case{"variance", variance(S, blur)},
            Case{"exponential c=80", exponential(80, S, blur)}, Case{"exponential variance", evsm}, Case{"moment", moment}}) {
        GOBO_ASSIGN(const Measured m, r->measure(c.t));
        double deep = 0, lit = 0, faint = 0, sum = 0, umbra = 0, all = 0;
        for (size_t p = 0; p < gap.size(); ++p) {
          if (gap[p] <= 1e-3f) continue;
          ++umbra;
          all += m.V[p] > 0.1f;
          if (gap[p] <= 0.055f) continue;
          ++deep;
          lit += m.V[p] > 0.1f;
          faint += m.V[p] > 0.05f;
          sum += m.V[p];
        }
        t.add(
            {c.name, deep > 0 ? 100 * lit / deep : NAN, deep > 0 ? 100 * faint / deep : NAN, deep > 0 ? sum / deep : NAN, umbra > 0 ? 100 * all / umbra : NAN});
        if (c.name == "convolution 16" || c.name == "variance, no reduction")
          claim("% of the deep umbra lit, " + c.name + ", " + v.scene, c.name[0] == 'c' ? "0" : "> 0", deep > 0 ? 100 * lit / deep : NAN);
      }
      show(t);
    }
    return {};
  }

  // Digest 7.11, curve 8: lookup time over the light's size.
  Status penumbra() {
    struct Case {
      const char* name;
      v1::ShadowTechnique t;
    };
    const int S = 1024;
    const Case cases[] = {{"cssm sat M=4", convolutionSoft(4, S, Map::SUMMED_AREA)},
                          {"cssm mip M=4", convolutionSoft(4, S, Map::TRILINEAR)},
                          {"pcss 32+64", percentageCloserSoft(S, 32, 64)},
                          {"pcss dense", percentageCloserSoft(S, 0, 0)}};
    for (const Case& c : cases)
      if (!findShadowTechnique(c.t.technique_case())) {
        std::printf("\nclaim penumbra: %s is not registered, left out\n", c.name);
        return {};
      }
    for (const std::string scene : {"planes", "fence"}) {
      GOBO_ASSIGN(const ScenePtr base, benchScene(scene));
      const int light = base->findLight("key"), camera = base->findCamera("front");
      Table t("lookup over the light's size, " + scene + ", S=1024",
              {"size", "penumbra % of pixels", "cssm sat ms", "cssm mip ms", "pcss 32+64 ms", "pcss dense ms", "cssm sat ns/px", "cssm mip ns/px",
               "pcss 32+64 ns/px", "pcss dense ns/px", "cssm sat encode+filter ms"});
      t.note("ns/px", "time beyond that of a light of 1/64 of the size, per pixel in the penumbra (dense PCSS between 0 and 1)");
      Plot plot;
      plot.title = "penumbra size, " + scene + ", S=1024";
      plot.xLabel = "light size, relative";
      plot.yLabel = "lookup, ns per pixel in the penumbra";
      for (const Case& c : cases) plot.series.push_back({c.name, {}, true, true});
      std::vector<double> none(4), first(4), last(4), before(4);
      double crossover = NAN, lastSize = 0, low[2] = {1e30, 1e30}, high[2] = {0, 0};
      // Up to where the kernel covers the map.
      for (const double size :
           scene == "planes" ? std::vector<double>{1.0 / 64, 0.25, 0.5, 1.0, 2.0, 4.0} : std::vector<double>{1.0 / 64, 0.125, 0.25, 0.5, 1.0}) {
        GOBO_ASSIGN(const ScenePtr s, withLightSize(*base, light, float(size)));
        Runner r(s, light, s->cameras[size_t(camera)], o_.width ? o_.width : 512, o_.height ? o_.height : 384, o_.repeat, o_.clock);
        double prepare = 0, share = 0;
        std::vector<double> ms(4), each(4);
        for (size_t k = 0; k < 4; ++k) {
          GOBO_ASSIGN(const Measured m, r.measure(cases[k].t));
          ms[k] = m.ms.lookup;
          if (k == 0) prepare = m.ms.encode + m.ms.filter;
          if (k == 3) share = double(std::count_if(m.V.begin(), m.V.end(), [](float v) { return v > 0.0f && v < 1.0f; }));
        }
        if (lastSize == 0) none = ms;
        for (size_t k = 0; k < 4; ++k) {
          each[k] = lastSize > 0 ? 1e6 * std::max(ms[k] - none[k], 0.0) / std::max(share, 1.0) : NAN;
          if (lastSize > 0) plot.series[k].points.push_back({size, each[k]});
        }
        t.add({size, 100 * share / double(r.pixels()), ms[0], ms[1], ms[2], ms[3], each[0], each[1], each[2], each[3], prepare});
        if (lastSize > 0) {
          for (int k = 0; k < 2; ++k) {
            low[k] = std::min(low[k], each[size_t(k)]);
            high[k] = std::max(high[k], each[size_t(k)]);
          }
          if (std::isnan(crossover) && ms[3] > ms[0] && before[3] <= before[0]) {  // log-log between two sizes
            const double a = std::log(before[0] / before[3]), b = std::log(ms[3] / ms[0]);
            crossover = std::exp(std::log(lastSize) + (std::log(size) - std::log(lastSize)) * a / std::max(a + b, 1e-12));
          }
          if (first[3] == 0) first = each;
        }
        before = ms;
        last = each;
        lastSize = size;
      }
      show(t);
      GOBO_TRY(writePlot(plot, o_.out + "/shadow_claims_penumbra_" + scene + ".png"));
      for (int k = 0; k < 2; ++k)
        claim(std::string("CSSM (") + (k ? "mip" : "sat") + ") ns per penumbra pixel, slowest / fastest size, " + scene, "1 (flat)", high[k] / low[k]);
      claim("dense PCSS ns per penumbra pixel, largest / smallest light, " + scene, "grows", last[3] / first[3]);
      claim("light size at which dense PCSS gets slower than CSSM (sat), " + scene +
                (std::isnan(crossover) ? (before[3] > before[0] ? " (at every size)" : " (at none)") : ""),
            "stated", crossover);
    }
    return {};
  }

  // Table 8.1: mip chain against summed-area table over the number of lights, M = 4.
  Status lights() {
    if (!findShadowTechnique(v1::ShadowTechnique::kConvolutionSoft)) {
      std::printf("\nclaim lights: convolution_soft is not registered, left out\n");
      return {};
    }
    GOBO_ASSIGN(const ScenePtr base, benchScene("blobs"));
    const int key = base->findLight("key"), count = o_.quick ? 10 : 40;
    GOBO_ASSIGN(const ScenePtr many, editScene(*base, [&](Scene& s) -> Status {
                  for (int i = 0; i < count; ++i) {
                    Light l = s.lights[size_t(key)];
                    l.name = "key" + std::to_string(i);
                    const float a = 2.39996323f * float(i), up = 0.35f + 0.6f * (float(i) + 0.5f) / float(count), out = std::sqrt(1 - up * up);
                    l.shape.position = 8.0f * Vec3(out * std::cos(a), up, out * std::sin(a));
                    l.shape.axis = -glm::normalize(l.shape.position);
                    const Frame f(l.shape.axis);
                    l.shape.u = f.x * 0.6f;
                    l.shape.v = f.y * 0.6f;
                    s.lights.push_back(l);
                  }
                  return {};
                }));
    Table t("many lights, blobs (409 600 triangles), M=4",
            {"S", "lights", "mip ms", "sat ms", "sat / mip", "mip ms without depth", "sat ms without depth", "sat / mip without depth", "mip MiB", "sat MiB"});
    for (const int S : o_.quick ? std::vector<int>{256} : std::vector<int>{128, 256, 512}) {
      double sum[2] = {0, 0}, own[2] = {0, 0}, bytes[2] = {0, 0};
      for (int i = 0; i < count; ++i) {
        Runner r(many, many->findLight("key" + std::to_string(i)), many->cameras[size_t(many->findCamera("front"))], o_.width ? o_.width : 512,
                 o_.height ? o_.height : 384, 1, o_.clock);
        for (int k = 0; k < 2; ++k) {
          GOBO_ASSIGN(const Measured m, r.measure(convolutionSoft(4, S, k ? Map::SUMMED_AREA : Map::TRILINEAR)));
          sum[k] += m.ms.total();
          own[k] += m.ms.total() - m.ms.depth;
          bytes[k] += double(m.bytes) / (1 << 20);
        }
        const int n = i + 1;
        if (n != 1 && n != 10 && n != 20 && n != 40) continue;
        t.add({double(S), double(n), sum[0], sum[1], sum[1] / sum[0], own[0], own[1], own[1] / own[0], bytes[0], bytes[1]});
        if (S == 256 && n != 40)
          claim("time sat / mip without depth, S=256, " + std::to_string(n) + " lights", n == 1 ? "2.1" : n == 10 ? "3.4" : "3.3", own[1] / own[0]);
        if (S == 256 && n == 40) claim("time sat / mip without depth, S=256, 40 lights", "about 3", own[1] / own[0]);
      }
    }
    show(t);
    return {};
  }

  Options o_;
  std::string name_;
  Table summary_{"shadow_claims", {"claim", "figure", "asked", "measured"}};
  bool failed_ = false;
};

}  // namespace

int claims(Options o) {
  std::filesystem::create_directories(o.out);
  return Claims(std::move(o)).run();
}

}  // namespace gobo::shadowbench
