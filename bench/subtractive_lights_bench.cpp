// SPDX-License-Identifier: Apache-2.0
// Subtractive shadows of a scene's lights (shadows.subtractive) against the same number of lights added up: the strongest by their unshadowed light in the
// picture, each with a hard shadow and scaled together to the light of all. Direct light alone, against path-traced halves (direct_light.h). All lights of a
// kind that subtractive shadows do; an environment is taken out. CPU seconds of all forms are fitted by t = t_C + n (t_geom + t_px / r^2) + t_look / r^2.
// Arguments: --scene NAME|FILE --added N (the scene's own lights off, N points of as many colours and strengths anywhere over it instead)
//            --set assignments, separated by spaces --size WxH --lights N,N,... --resolutions R,R,... --forms F,F,... --reference N (samples of each half)
//            --threads N --out PATH --pictures PREFIX
#include <array>
#include <numeric>

#include "base/sobol.h"
#include "direct_light.h"

using namespace gobo;
using namespace gobo::bench;

namespace {

/// The scene without its map; with `added` points over its box, from a quarter of its height to once more of it, instead of its own lights.
ScenePtr litScene(const Scene& loaded, int added) {
  auto out = std::make_shared<Scene>(loaded);
  out->environment = nullptr;
  out->lights.clear();
  if (added == 0)
    for (const Light& l : loaded.lights)
      if (l.shape.kind != LightKind::Environment) out->lights.push_back(l);
  Vec3 lo, hi;
  loaded.bounds(lo, hi);
  for (int i = 0; i < added; ++i) {
    const auto random = [&](uint64_t k) { return toUnit(hash32(hash64(77, uint64_t(i)), k)); };
    Light l;
    l.name = "added" + std::to_string(i);
    l.shape.kind = LightKind::Point;
    l.shape.position = lo + (hi - lo) * Vec3(random(0), 0.25f + 1.75f * random(1), random(2));
    l.power = (Vec3(0.3f) + 0.7f * Vec3(random(3), random(4), random(5))) * (0.2f + 2.0f * random(6) * random(6));
    out->lights.push_back(l);
  }
  if (const Status s = out->seal(); !s.ok()) fail(s);
  return out;
}

/// The first `kept` lights in `order`, with `gain`.
ScenePtr strongest(const Scene& lit, const std::vector<size_t>& order, size_t kept, float gain) {
  auto out = std::make_shared<Scene>(lit);
  out->lights.clear();
  for (size_t k = 0; k < kept; ++k) {
    out->lights.push_back(lit.lights[order[k]]);
    out->lights.back().power *= gain;
  }
  if (const Status s = out->seal(); !s.ok()) fail(s);
  return out;
}

/// Least squares of CPU seconds over the pictures: t = t_C + n (t_geom + t_px / r^2) + t_look / r^2, what a picture takes without its shadows; n rays a sample,
/// whatever the resolution and by traced pixel; what it takes to look at all lights where shadows are traced.
struct TimeModel {
  static constexpr size_t kTerms = 4;
  using Row = std::array<double, kTerms + 1>;
  std::vector<Row> seen;  // 1, n, n / r^2, 1 / r^2; t
  void add(double n, double r, double t) { seen.push_back({1.0, n, n / (r * r), 1.0 / (r * r), t}); }
  struct Fit {
    std::array<double, kTerms> of{};
    double explained = 0;  // share of the variance, R^2
  };
  /// Of the first `terms` terms, by Gauss and Jordan. All 0: too few different n or r.
  Fit fit(size_t terms) const {
    double a[kTerms][kTerms + 1] = {};
    for (const Row& s : seen)
      for (size_t i = 0; i < terms; ++i) {
        for (size_t j = 0; j < terms; ++j) a[i][j] += s[i] * s[j];
        a[i][terms] += s[i] * s[kTerms];
      }
    for (size_t i = 0; i < terms; ++i) {
      size_t pivot = i;
      for (size_t k = i + 1; k < terms; ++k)
        if (std::abs(a[k][i]) > std::abs(a[pivot][i])) pivot = k;
      std::swap(a[i], a[pivot]);
      if (!(std::abs(a[i][i]) > 1e-9)) return {};
      for (size_t k = 0; k < terms; ++k) {
        if (k == i) continue;
        const double f = a[k][i] / a[i][i];
        for (size_t j = i; j <= terms; ++j) a[k][j] -= f * a[i][j];
      }
    }
    Fit out;
    for (size_t i = 0; i < terms; ++i) out.of[i] = a[i][terms] / a[i][i];
    double mean = 0, rest = 0, all = 0;
    for (const Row& s : seen) mean += s[kTerms] / double(seen.size());
    for (const Row& s : seen) {
      double d = s[kTerms];
      for (size_t i = 0; i < terms; ++i) d -= out.of[i] * s[i];
      rest += d * d;
      all += (s[kTerms] - mean) * (s[kTerms] - mean);
    }
    out.explained = all > 0 ? 1.0 - rest / all : 0.0;
    return out;
  }
};

}  // namespace

int main(int argc, char** argv) {
  const std::string scene = argumentOr(argc, argv, "--scene", "lamps"), reference = argumentOr(argc, argv, "--reference", "256");
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "120x90").c_str(), "%dx%d", &width, &height);
  const int added = std::atoi(argumentOr(argc, argv, "--added", "0").c_str());
  if (width < 1 || height < 1 || added < 0 || std::atoi(reference.c_str()) < 1)
    fail(invalidArgument("--size, --added and --reference must be positive (--added: or 0)"));
  v1::RenderRequest request;
  for (const std::string& e : {"scene=" + scene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=direct"),
                               std::string("integrator.max_bounces=0"), std::string("integrator.at_view_samples=true"), std::string("environment.path=none")})
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  for (const std::string& e : partsOf(argumentOr(argc, argv, "--set", ""), ' '))
    if (const Status s = setPath(request, e); !s.ok()) fail(s);
  const int threads = std::atoi(argumentOr(argc, argv, "--threads", "2").c_str());
  const std::string pictures = argumentOr(argc, argv, "--pictures", "");
  const Bench bench(request, threads, pictures);
  const ScenePtr lit = litScene(*bench.scene(), added);
  const size_t count = lit->lights.size();
  const Run a = bench.render({"halt.spp=" + reference, "seed=1001"}, "reference_a", lit),
            b = bench.render({"halt.spp=" + reference, "seed=1002"}, "reference_b", lit);
  const Run albedo = bench.render({"halt.spp=1", "outputs=albedo"}, "albedo", lit);
  const Errors errors(a.image, b.image, albedo.image);

  // Unshadowed light of each in the picture.
  std::vector<double> given(count, 0.0);
  {
    std::vector<std::string> edits{"halt.spp=1"};
    std::string outputs = "outputs=";
    for (const Light& l : lit->lights) outputs += "unoccluded:" + l.name + ",";
    outputs.pop_back();
    edits.push_back(outputs);
    const std::vector<Image> images = bench.images(edits, lit);
    for (size_t i = 0; i < count; ++i)
      for (const float v : images[i].data) given[i] += double(v);
  }
  std::vector<size_t> order(count);
  std::iota(order.begin(), order.end(), size_t(0));
  std::stable_sort(order.begin(), order.end(), [&](size_t x, size_t y) { return given[x] > given[y]; });
  const double sum = std::accumulate(given.begin(), given.end(), 0.0);

  Table table("Subtractive shadows of lights", {"method", "lights", "r", "RMSE / mean", "dark", "displayed", "CPU s", "Mrays"});
  table.note("scene", scene);
  table.note("lights", double(count));
  table.note("pixels", double(width) * height);
  table.note("reference samples a pixel, each of two halves", reference);
  const auto row = [&](const std::string& method, const std::string& n, const std::string& r, const Run& run) {
    table.add({method, n, r, errors.relative(run.image), errors.dark(run.image), errors.displayed(run.image), run.seconds, 1e-6 * run.rays});
  };
  TimeModel times;
  row("all, one ray each", std::to_string(count), "1", bench.render({"halt.spp=1", "shadows.ray_traced.samples=1"}, "all", lit));
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--lights", "15,40,100"), ',')) {
    const size_t kept = std::min(size_t(std::max(std::atoi(n.c_str()), 1)), count);
    double part = 0;
    for (size_t k = 0; k < kept; ++k) part += given[order[k]];
    row("additive", n, "1",
        bench.render({"halt.spp=1", "shadows.ray_traced.samples=1"}, "additive_" + n, strongest(*lit, order, kept, float(part > 0 ? sum / part : 1.0))));
    for (const std::string& r : partsOf(argumentOr(argc, argv, "--resolutions", "1,4,16"), ','))
      for (const std::string& form : partsOf(argumentOr(argc, argv, "--forms", "RATIO,DIFFERENCE"), ',')) {
        const Run run =
            bench.render({"halt.spp=1", "shadows.subtractive.lights=" + n, "shadows.subtractive.resolution=" + r, "shadows.subtractive.form=" + form},
                         form + "_" + n + "_" + r, lit);
        row(form, n, r, run);
        times.add(double(kept), std::atof(r.c_str()), run.seconds);
      }
  }
  const TimeModel::Fit fit = times.fit(4);
  const char* terms[4] = {"t_C of t = t_C + n (t_geom + t_px / r^2) + t_look / r^2, CPU ms", "t_geom, CPU ms a light", "t_px, CPU ms a light",
                          "t_look, CPU ms"};
  for (size_t i = 0; i < 4; ++i) table.note(terms[i], 1e3 * fit.of[i]);
  table.note("R^2", fit.explained);
  table.note("R^2 without t_look", times.fit(3).explained);
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
