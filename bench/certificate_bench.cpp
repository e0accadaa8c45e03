// SPDX-License-Identifier: Apache-2.0
// Coverage and width of the certificate's interval: docs/certificate.md.
//   certificate_bench [--seeds 1000] [--fraction 0.015625] [--size 512] [--out table.json|.csv|.md|.txt]
//       on synthetic pictures with a known truth
//   certificate_bench --real [--certificates 16] [--size 64] [--truth 1024] [--scenes all|tuned|other|name,name] [--data ../shared/data] [--out table]
//       on rendered pictures, against a truth of other seeds
// Exit status 1 when docs/certificate.md promises what the table does not show.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <sstream>

#include "import/load.h"
#include "measure/report.h"
#include "support/certificate_cases.h"
#include "support/certificate_tries.h"

namespace {

using namespace gobo;
using namespace gobo::testing;

int finish(const Table& table, const std::string& path, bool kept) {
  std::fputs(table.text().c_str(), stdout);
  if (!path.empty())
    if (const Status status = table.write(path); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.toString().c_str());
      return 2;
    }
  return kept ? 0 : 1;
}

int synthetic(int seeds, double fraction, int size, const std::string& path) {
  Table table("certificate", {"picture", "RMSE", "half the error in % of pixels", "holds RMSE", "trimmed holds", "half-width %", "rel: holds", "rel: trimmed",
                              "rel: half-width %", "promised"});
  table.note("seeds", double(seeds));
  table.note("pixels drawn", std::round(fraction * size * size));
  table.note("of", double(size) * size);
  bool kept = true;
  for (const CertificateCase& picture : certificateCases(size)) {
    const gobo::testing::Coverage c = measureCoverage(picture, fraction, seeds);
    const bool whole = picture.kind != Kind::Hidden;
    const bool ok = c.trimmed >= 0.93 && (!whole || c.whole >= 0.93) && (!picture.widthPromised || c.halfWidth <= 0.25);
    kept = kept && ok;
    table.add({picture.name, picture.rmse, 100 * picture.halfErrorArea(), c.whole, c.trimmed, 100 * c.halfWidth, c.relWhole, c.relTrimmed, 100 * c.relHalfWidth,
               std::string(picture.widthPromised ? "93 %, width 25 %"
                           : whole               ? "93 %"
                                                 : "trimmed 93 %") +
                   (ok ? "" : " MISSED")});
  }
  return finish(table, path, kept);
}

constexpr uint32_t kDefaultPixels = 4096, kFewPixels = 512;

struct RealTotals {
  Tally normal, few;
  Halts halts, fewHalts;
  int pictures = 0, dropped = 0;
  void add(const RealTotals& t) {
    normal.add(t.normal), few.add(t.few);
    for (auto [mine, other] : {std::pair(&halts, &t.halts), {&fewHalts, &t.fewHalts}}) mine->stopped += other->stopped, mine->kept += other->kept;
    pictures += t.pictures, dropped += t.dropped;
  }
  double keptShare() const { return halts.stopped + fewHalts.stopped ? double(halts.kept + fewHalts.kept) / (halts.stopped + fewHalts.stopped) : 1; }
};

Image mustRender(Engine& engine, const ScenePtr& scene, const v1::RenderRequest& request) {
  RenderControl control;
  control.scene = scene;
  const Result<RenderResult> r = engine.render(request, control);
  if (!r.ok()) {
    std::fprintf(stderr, "%s\n", r.status().toString().c_str());
    std::exit(2);
  }
  return r->images[0].image();
}

RealTotals tryScene(Table& table, const TriedScene& tried, const ScenePtr& scene, int size, int certificates, int truthSpp) {
  EngineOptions options;
  options.loader = inProcessLoader();
  options.anyPath = true;
  const auto engine = std::move(*Engine::create(options));
  TaskArena arena;
  AccelCache accels;
  const std::vector<TriedPicture> pictures = triedPictures(*scene, size);
  const TriedReference reference = traceReference(scene, pictures[0].request, certificates, truthSpp, accels, arena);
  const std::string use = tried.tuned ? "tuning" : "unseen";
  RealTotals total;
  for (const TriedPicture& p : pictures) {
    const Image image = mustRender(*engine, scene, p.request);
    const MeasuredError error = measureError(image, reference);
    const double doubt = error.standardError / std::max(error.mse, 1e-30) / 2;  // of the RMSE
    const bool usable = error.mse > 0 && doubt <= 0.1;
    ++total.pictures;
    total.dropped += !usable;
    Tally normal, few;
    for (int k = 0; k < certificates && usable; ++k) {
      normal.add(tryCertificate(image, reference, k, kDefaultPixels), error.rmse());
      few.add(tryCertificate(image, reference, k, kFewPixels), error.rmse());
    }
    table.add({tried.name, use, p.name, error.rmse(), 100 * doubt, double(normal.held), double(normal.above), double(normal.below), 100 * normal.halfWidth(),
               double(few.held), double(few.above), double(few.below), 100 * few.halfWidth()});
    total.normal.add(normal), total.few.add(few);
  }
  std::vector<Image> doublings;
  std::vector<MeasuredError> errors;
  for (int spp = 16; spp <= 512; spp *= 2) {
    v1::RenderRequest request = pictures[0].request;
    request.mutable_halt()->set_spp(uint32_t(spp));
    doublings.push_back(mustRender(*engine, scene, request));
    errors.push_back(measureError(doublings.back(), reference));
  }
  for (const double factor : {0.5, 1.0, 1.6}) {  // of the error at 64 samples
    const double asked = factor * errors[2].rmse();
    for (auto [halts, pixels] : {std::pair(&total.halts, kDefaultPixels), {&total.fewHalts, kFewPixels}}) {
      const Halts h = tryHalts(doublings, errors, reference, certificates, asked, pixels);
      halts->stopped += h.stopped, halts->kept += h.kept;
    }
  }
  return total;
}

int real(int certificates, int size, int truthSpp, const std::string& which, const std::string& data, const std::string& path) {
  Table table("certificates of rendered pictures", {"scene", "use", "picture", "RMSE", "truth's error %", "held", "low above", "high below", "half-width %",
                                                    "held (512)", "low above (512)", "high below (512)", "half-width % (512)"});
  Table scenes("by scene", {"scene", "use", "pictures", "left out", "certificates", "held", "half-width %", "held (512)", "half-width % (512)", "halts", "kept",
                            "halts (512)", "kept (512)"});
  const auto addScene = [&](const std::string& name, const std::string& use, const RealTotals& t) {
    scenes.add({name, use, double(t.pictures), double(t.dropped), double(t.normal.tried), t.normal.share(), 100 * t.normal.halfWidth(), t.few.share(),
                100 * t.few.halfWidth(), double(t.halts.stopped), double(t.halts.kept), double(t.fewHalts.stopped), double(t.fewHalts.kept)});
  };
  const auto opener = std::move(*Engine::create([] {
    EngineOptions o;
    o.loader = inProcessLoader();
    o.anyPath = true;
    return o;
  }()));
  RealTotals all, unseen;
  bool kept = true;
  for (const TriedScene& tried : triedScenes()) {
    if (which == "tuned"   ? !tried.tuned
        : which == "other" ? tried.tuned
                           : which != "all" && ("," + which + ",").find("," + tried.name + ",") == std::string::npos)
      continue;
    const Result<ScenePtr> scene = openTried(*opener, tried.name, data);
    if (!scene.ok()) {
      std::fprintf(stderr, "left out: %s\n", scene.status().toString().c_str());
      continue;
    }
    const auto start = std::chrono::steady_clock::now();
    const RealTotals t = tryScene(table, tried, *scene, size, certificates, truthSpp);
    addScene(tried.name, tried.tuned ? "tuning" : "unseen", t);
    std::fprintf(stderr, "%s: %.3f of %d held, %.3f with 512 pixels; %d of %d halts kept; %.0f s\n", tried.name.c_str(), t.normal.share(), t.normal.tried,
                 t.few.share(), t.halts.kept + t.fewHalts.kept, t.halts.stopped + t.fewHalts.stopped,
                 std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    kept = kept && t.normal.share() >= 0.9 && t.few.share() >= 0.9;
    all.add(t);
    if (!tried.tuned) unseen.add(t);
  }
  addScene("unseen", "", unseen);
  addScene("all", "", all);
  kept = kept && all.normal.share() >= 0.93 && all.few.share() >= 0.93 && all.keptShare() >= 0.95;
  std::fputs(scenes.text().c_str(), stdout);
  std::printf("\n");
  if (!path.empty()) (void)scenes.write(path + ".scenes" + path.substr(path.rfind('.')));
  return finish(table, path, kept);
}

}  // namespace

int main(int argc, char** argv) {
  const auto number = [&](const char* name, const char* fallback) { return std::atof(argumentOr(argc, argv, name, fallback).c_str()); };
  const std::string path = argumentOr(argc, argv, "--out", "");
  const bool onReal = std::any_of(argv, argv + argc, [](const char* a) { return !std::strcmp(a, "--real"); });
  const int size = int(number("--size", onReal ? "64" : "512"));
  const int seeds = int(number("--seeds", "1000")), certificates = int(number("--certificates", "16")), truth = int(number("--truth", "1024"));
  const double fraction = number("--fraction", "0.015625");  // 4096 of 512 x 512
  if (seeds < 1 || fraction <= 0 || fraction > 1 || size < 8 || certificates < 1 || truth < 16 || (!path.empty() && path.rfind('.') == std::string::npos)) {
    std::fprintf(
        stderr,
        "certificate_bench: --seeds and --certificates at least 1, --fraction in (0,1], --size at least 8, --truth at least 16, --out with an extension\n");
    return 2;
  }
  if (onReal) return real(certificates, size, truth, argumentOr(argc, argv, "--scenes", "all"), argumentOr(argc, argv, "--data", "../shared/data"), path);
  return synthetic(seeds, fraction, size, path);
}
