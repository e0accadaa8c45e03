// SPDX-License-Identifier: Apache-2.0
// Oracle ladder (digest 11): one assumption at a time, so that a filter is not blamed for what its model, its map or its arithmetic does.
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "measure/report.h"
#include "shadow/options.h"
#include "shadow/oracle.h"
#include "shadow/techniques.h"

namespace gobo::shadowbench {
namespace {

class Ladder {
 public:
  Ladder(Options o, bool soft, Table& table) : o_(std::move(o)), soft_(soft), table_(table) {}

  int run() {
    auto runner = makeRunner(o_, soft_);
    if (!runner.ok()) return fail(runner.status());
    r_ = runner->get();
    r_->setRepeat(1);
    const std::string base = baseName(o_) + (soft_ ? "-soft" : "-hard");
    auto truth = makeTruth(*r_, base, o_.truth, o_.out + "/truth");
    if (!truth.ok()) return fail(truth.status());
    truth_ = &*truth;
    const TruthImage &pixel = truth_->pixel, &centre = truth_->centre;
    std::vector<float> area(r_->pixels()), point(r_->pixels()), flat(r_->pixels());
    double radiance = 0, mean = 0, n = 0;
    for (size_t p = 0; p < r_->pixels(); ++p) {
      area[p] = pixel.V(p);
      point[p] = centre.V(p);
      flat[p] = 0.5f * (centre.flatA[p] + centre.flatB[p]);
      if (!truth_->mask[p]) continue;
      // (V_t - V) w: the products of two independent halves, so that noise does not count.
      radiance += double(centre.weight[p]) * centre.weight[p] * (double(centre.flatA[p]) - centre.A[p]) * (double(centre.flatB[p]) - centre.B[p]);
      mean += centre.weight[p];
      ++n;
    }
    row("R0 camera and light, jointly", area, {0, 0, rmseHalves(truth_->mask, pixel.A, pixel.B, centre.A, centre.B), 0});
    row("R0c one view sample, at the centre", point,
        {rmseHalves(truth_->mask, pixel.A, pixel.B, centre.A, centre.B), rmseHalves(truth_->band, pixel.A, pixel.B, centre.A, centre.B), 0,
         rmseHalves(truth_->mask, pixel.A, pixel.B, centre.A, centre.B)});
    const double factored = rmseHalves(truth_->mask, centre.flatA, centre.flatB, centre.A, centre.B);
    row("R1 visibility factored: V_t x unoccluded", flat,
        {factored, rmseHalves(truth_->band, centre.flatA, centre.flatB, centre.A, centre.B), factored,
         rmseHalves(truth_->mask, centre.flatA, centre.flatB, pixel.A, pixel.B)});
    table_.note(base + ": R1 error of radiance / mean unoccluded radiance", mean > 0 ? std::sqrt(std::max(radiance / n, 0.0)) / (mean / n) : 0.0);
    return soft_ ? soft(flat) : hard(flat);
  }

 private:
  struct Figures {
    double added, penumbra, centre, pixel;
  };
  void row(const std::string& name, const std::vector<float>& V, const Figures& f) {
    const Errors e = errorsOf(*truth_, V);
    table_.add({baseName(o_) + (soft_ ? " soft" : " hard"), name, f.added, f.penumbra, f.centre, f.pixel, 100 * e.falseLit, 100 * e.falseDark});
  }
  /// A step whose V has no noise.
  void step(const std::string& name, const std::vector<float>& V, const std::vector<float>& before) {
    const TruthImage &c = truth_->centre, &p = truth_->pixel;
    row(name, V,
        {rmse(truth_->mask, V, before), rmse(truth_->band, V, before), rmseAgainst(truth_->mask, V, c.A, c.B), rmseAgainst(truth_->mask, V, p.A, p.B)});
  }
  /// Between two estimates, each with independent halves: their noise does not count.
  static double rmseHalves(const std::vector<uint8_t>& mask, const std::vector<float>& aA, const std::vector<float>& aB, const std::vector<float>& bA,
                           const std::vector<float>& bB) {
    double sum = 0, n = 0;
    for (size_t p = 0; p < mask.size(); ++p)
      if (mask[p]) {
        sum += (double(aA[p]) - bA[p]) * (double(aB[p]) - bB[p]);
        ++n;
      }
    return n > 0 ? std::sqrt(std::max(sum / n, 0.0)) : 0.0;
  }
  int fail(const Status& s) const {
    std::fprintf(stderr, "ladder %s: %s\n", baseName(o_).c_str(), s.toString().c_str());
    return 1;
  }
  /// Measures t; on failure says so and leaves V as it was.
  bool shipped(const std::string& name, const v1::ShadowTechnique& t, const std::vector<float>& before, std::vector<float>* V = nullptr) {
    if (!r_->supported(t)) {
      std::printf("%s: not registered, left out\n", name.c_str());
      return false;
    }
    auto m = r_->measure(t);
    if (!m.ok()) {
      fail(m.status());
      return false;
    }
    step(name, m->V, before);
    if (V) *V = m->V;
    return true;
  }

  int hard(const std::vector<float>& flat) {
    const int S = o_.map, blur = 1;
    // The same width on the ground: sigma is (2 blur + 1) / 4 texels.
    const double ratio = double(o_.denseMap) / S;
    const int wide = std::clamp(int(std::lround(0.5 * ((2 * blur + 1) * ratio - 1))), 1, 64);
    std::vector<float> dense, target;
    if (!shipped("R2 percentage closer, S=" + std::to_string(o_.denseMap) + " blur=" + std::to_string(wide), percentageCloser(o_.denseMap, wide), flat, &dense))
      return 1;
    if (!shipped("R3 percentage closer, S=" + std::to_string(S) + " blur=1", percentageCloser(S, blur), dense, &target)) return 1;
    struct Basis {
      std::string name;
      v1::ShadowTechnique t;
    };
    for (const Basis& b :
         {Basis{"convolution M=4", convolution(4, S, blur)}, Basis{"convolution M=16", convolution(16, S, blur)},
          Basis{"exponential c=80", exponential(80, S, blur)}, Basis{"exponential c=300", exponential(300, S, blur)}, Basis{"variance", variance(S, blur)}}) {
      auto exact = exactBasis(*r_, b.t);
      if (!exact.ok()) return fail(exact.status());
      step("R4 " + b.name + " in float64", *exact, target);
      std::vector<float> V;
      if (!shipped("R5 " + b.name, b.t, *exact, &V)) return 1;
      if (b.t.has_convolution()) shipped("R5 " + b.name + " in bytes", convolution(int(b.t.convolution().order()), S, blur, true), *exact);
      if (!b.t.has_exponential()) continue;
      v1::ShadowTechnique repaired = b.t, device = b.t;
      repaired.mutable_exponential()->set_classification(v1::ExponentialShadow::THRESHOLD);
      shipped("R5 " + b.name + " threshold", repaired, *exact);
      device.mutable_exponential()->set_device(v1::ExponentialShadow::VULKAN);
      if (b.t.exponential().c() <= 80) shipped("R6 " + b.name + " on Vulkan", device, V);
    }
    v1::ShadowTechnique evsm = shadowMap(S, blur), moment = shadowMap(S, blur);
    evsm.mutable_exponential_variance();
    moment.mutable_moment();
    shipped("R5 exponential variance (against R3)", evsm, target);
    shipped("R5 moment (against R3)", moment, target);
    return 0;
  }

  int soft(const std::vector<float>& flat) {
    const int S = o_.map;
    std::vector<float> dense, target;
    if (!shipped("R2 dense PCSS, S=" + std::to_string(o_.denseMap), percentageCloserSoft(o_.denseMap, 0, 0), flat, &dense)) return 0;
    if (!shipped("R3 dense PCSS, S=" + std::to_string(S), percentageCloserSoft(S, 0, 0), dense, &target)) return 1;
    shipped("R3 PCSS 32 + 64 taps", percentageCloserSoft(S, 32, 64), target);
    for (const int m : {4, 8}) {
      const std::string name = "convolution soft M=" + std::to_string(m);
      auto exact = exactConvolutionSoft(*r_, convolutionSoft(m, S, v1::ShadowMapSettings::SUMMED_AREA), m);
      if (!exact.ok()) {
        fail(exact.status());
        continue;
      }
      step("R4 " + name + " as in the thesis, float64 (against R3)", *exact, target);
      shipped("R5 " + name + " summed area (against R3)", convolutionSoft(m, S, v1::ShadowMapSettings::SUMMED_AREA), target);
      shipped("R5 " + name + " mip (against R3)", convolutionSoft(m, S, v1::ShadowMapSettings::TRILINEAR), target);
    }
    v1::ShadowTechnique vssm = shadowMap(S, 0), evsm = shadowMap(S, 0);
    vssm.mutable_variance_soft();
    evsm.mutable_exponential_variance_soft();
    shipped("R5 variance soft (against R3)", vssm, target);
    shipped("R5 exponential variance soft (against R3)", evsm, target);
    return 0;
  }

  Options o_;
  bool soft_;
  Table& table_;
  Runner* r_ = nullptr;
  const Truth* truth_ = nullptr;
};

}  // namespace

int ladder(Options o) {
  if (!o.width) {
    o.width = 256;
    o.height = 192;
  }
  if (!o.truth) o.truth = 4096;
  Table table("shadow_ladder " + baseName(o), {"scene", "step", "added", "added, penumbra", "rmse centre", "rmse pixel", "false lit %", "false dark %"});
  table.note("map.fit", o.cameraFit ? "CAMERA" : "SCENE");
  table.note("size", std::to_string(o.width) + "x" + std::to_string(o.height));
  table.note("truth", std::to_string(o.truth) + " rays a pixel in two halves; RMSE of visibility over surfaces that the light can shine on");
  int failed = Ladder(o, o.soft, table).run();
  std::fputs(table.text().c_str(), stdout);
  std::filesystem::create_directories(o.out);
  const std::string path = o.out + "/shadow_ladder_" + baseName(o) + (o.soft ? "-soft" : "-hard");
  for (const Status& s : {table.write(path + ".csv"), table.write(path + ".json")})
    if (!s.ok()) {
      std::fprintf(stderr, "%s\n", s.toString().c_str());
      failed = 1;
    }
  return failed;
}

}  // namespace gobo::shadowbench
