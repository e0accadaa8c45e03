// SPDX-License-Identifier: Apache-2.0
// Table 5.1 of the thesis of 2007 on hybrid environment light, in its format: mean and standard deviation of the absolute difference of luminance from a
// path-traced reference, for harmonics alone, the hybrid as it was published (lights beside the harmonics of the whole map, hard shadows by rays) and ours
// (environment.transfer, its lights by 16 rays); with --blend also the published hybrid, and its residual form, with hard shadows blended by an occlusion
// factor (techniques/transfer/published/occlusion_factor.h), by the hemisphere and towards each light. Direct diffuse light of a scene under each map alone;
// linear, and displayed by 1 - exp(-c x) with the c that takes the reference's mean luminance to a half. Near the reference's shadow edges (where it changes by
// a third of itself within two pixels) and elsewhere apart. Units: the reference's mean luminance (linear), the display's range (displayed). The reference's
// own noise is the first row of each map. Maps: --env FILE,FILE,..., and five of known content: a sky of 1 with a lamp of 1 degree that is 500 to 200 000 times
// as bright, a softbox, 40 equal lamps, and an overcast sky with a bright side. Arguments: --scene NAME --env FILES --size WxH --spp N (each half of the
// reference) --threads N
//            --blend --out PATH
//            --haar K,K,... --haar-side N --haar-drop X: also direct transfer of the same points in wavelets over cubes of N x N cells a face (32;
//            techniques/transfer/published/haar_transfer.h), under the K largest terms of each map, by luminance and by what they can give at most; terms of
//            transfer below X of a point's norm (0.001) are dropped. Bytes of transfer that is kept, and milliseconds of light at all points, one thread, are
//            in the last columns for these and, by the same hand, for harmonics.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "import/load.h"
#include "measure/luminance_difference.h"
#include "measure/report.h"
#include "nodes_by_hand.h"
#include "plan/engine.h"
#include "request/request.h"
#include "scene/edit.h"
#include "techniques/transfer/environment_split.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/published/haar_transfer.h"
#include "techniques/transfer/published/occlusion_factor.h"
#include "techniques/transfer/published/published_split.h"
#include "techniques/transfer/receiver_mesh.h"
#include "terms/surface.h"
#include "trace/bsdf.h"

using namespace gobo;

namespace {

[[noreturn]] void fail(const Status& status) {
  std::fprintf(stderr, "transfer_table_bench: %s\n", status.toString().c_str());
  std::exit(1);
}
void edit(v1::RenderRequest& r, const std::string& text) {
  if (const Status s = setPath(r, text); !s.ok()) fail(s);
}

/// Radiance by direction, 1024 x 512.
template <typename Radiance>
EnvironmentPtr mapOf(const std::string& name, const Radiance& radiance) {
  constexpr int kWidth = 1024, kHeight = 512;
  Image image(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double theta = (y + 0.5) * std::numbers::pi / kHeight, phi = (x + 0.5) * 2 * std::numbers::pi / kWidth - std::numbers::pi;
      const float v = float(radiance(DVec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi))));
      for (size_t c = 0; c < 3; ++c) image.data[3 * size_t(y * kWidth + x) + c] = v;
    }
  return makeEnvironment(name, std::move(image));
}
std::vector<EnvironmentPtr> knownMaps() {
  const auto within = [](const DVec3& d, const DVec3& towards, double degrees) {
    return glm::dot(d, glm::normalize(towards)) > std::cos(degrees * std::numbers::pi / 180);
  };
  const DVec3 high(0.5, 0.8, 0.35);
  std::vector<EnvironmentPtr> out;
  for (const double contrast : {500.0, 2e5}) {
    char name[32];
    std::snprintf(name, sizeof name, "lamp %.0f:1", contrast);
    out.push_back(mapOf(name, [&](const DVec3& d) { return within(d, high, 0.7) ? contrast : 1.0; }));
  }
  out.push_back(mapOf("softbox", [&](const DVec3& d) { return within(d, high, 14) ? 40.0 : 0.3; }));
  out.push_back(mapOf("40 equal lamps", [&](const DVec3& d) {
    for (int i = 0; i < 40; ++i) {
      const double y = 1 - 2 * (i + 0.5) / 40, r = std::sqrt(1 - y * y), phi = i * 2.399963;
      if (within(d, DVec3(r * std::cos(phi), y, r * std::sin(phi)), 1.5)) return 200.0;
    }
    return 0.1;
  }));
  out.push_back(mapOf("overcast", [&](const DVec3& d) { return 0.5 + std::max(d.y, 0.0) + 1.5 * std::exp(4 * (glm::dot(d, glm::normalize(high)) - 1)); }));
  return out;
}

/// Pictures of the published split by hand: no request renders it.
class ByHand {
 public:
  ByHand(ScenePtr scene, int threads, int width, int height) : run_(std::move(scene), threads) {
    GBufferSettings view;
    view.camera = run_.scene().cameras[0];
    view.width = width;
    view.height = height;
    view.viewSamples = 1;
    g_ = run_(makeGBufferNode(view), {});
    surface_ = run_(makeSurfaceNode(view), {g_});
    transfer::TransferSettings s;
    s.points = 30000;
    s.bands = kBands;
    s.size = uint32_t(transfer::receiverMesh(run_.view(transfer::ReceiverMesh::kFacets), s.points)->size());
    const TermPtr points = points_ = run_(transfer::makeTransferPointsNode(s), {});
    for (uint32_t b = 0; b < 16; ++b) direct_ = run_(transfer::makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct_});
    places_ = run_(transfer::makeTransferPlacesNode(s, view), {g_, points});
    reflect(view.camera);
  }
  /// Transfer in wavelets of the same points.
  void prepareHaar(Table& table, int side, double drop) {
    auto cells = transfer::published::HaarCells::of(side);
    if (!cells.ok()) fail(cells.status());
    const auto begin = std::chrono::steady_clock::now();
    auto made = transfer::published::HaarTransfer::of(*cells, *points_, *run_.accel(), drop, run_.arena());
    if (!made.ok()) fail(made.status());
    table.note("Haar: seconds of precompute", milliseconds(begin) / 1000);
    table.note("Haar: rays", double(made->rays()));
    table.note("Haar: terms kept a point", double(made->kept()) / double(made->points()));
    cells_ = std::make_unique<transfer::published::HaarCells>(std::move(*cells));
    haar_ = std::make_unique<transfer::published::HaarTransfer>(std::move(*made));
  }
  struct Timed {
    std::vector<double> picture;
    double megabytes = 0, ms = 0;
  };
  /// The `count` first terms of a map.
  Timed haarPicture(const std::vector<transfer::published::HaarTerm>& terms, size_t count) {
    Timed out;
    const auto begin = std::chrono::steady_clock::now();
    const std::vector<DVec3> light = haar_->irradiance(std::span(terms).first(std::min(count, terms.size())));
    out.ms = milliseconds(begin);
    out.megabytes = double(haar_->bytes()) / 1e6;
    out.picture = shown(light);
    return out;
  }
  /// Harmonics alone, of the same points.
  Timed harmonicsPicture(const Environment& map) {
    transfer::published::PublishedSettings settings;
    const std::vector<double> c = transfer::published::publishedSplit(map, settings, run_.arena()).full;
    Timed out;
    const auto begin = std::chrono::steady_clock::now();
    const auto transfer = direct_->floats("transfer");
    constexpr size_t n = size_t(kBands * kBands);
    std::vector<DVec3> light(transfer.size() / n, DVec3(0.0));
    for (size_t p = 0; p < light.size(); ++p)
      for (size_t h = 0; h < n; ++h) light[p] += double(transfer[p * n + h]) * DVec3(c[3 * h], c[3 * h + 1], c[3 * h + 2]);
    out.ms = milliseconds(begin);
    out.megabytes = 4 * double(transfer.size()) / 1e6;
    out.picture = shown(light);
    return out;
  }
  const transfer::published::HaarCells& haarCells() const { return *cells_; }
  static double milliseconds(std::chrono::steady_clock::time_point since) {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - since).count();
  }
  std::vector<double> picture(const transfer::published::PublishedSplit& split, transfer::published::ShadowBlend blend) {
    const auto light =
        transfer::published::publishedIrradiance(split.used, split.lights, {*g_, *surface_, *places_, *direct_, kBands}, *run_.accel(), blend, run_.arena());
    std::vector<double> out;
    for (size_t i = 0; i < light.size(); ++i) out.push_back(transfer::luminanceOf(reflected_[i] * light[i]));
    return out;
  }
  const TaskArena& arena() const { return run_.arena(); }

 private:
  static constexpr int kBands = 5;
  /// Of irradiance at points, not below 0 once all terms are added.
  std::vector<double> shown(const std::vector<DVec3>& light) const {
    const auto point = places_->plane<uint32_t>("point");
    const auto weight = places_->floats("weight");
    std::vector<double> out;
    for (size_t i = 0; i < reflected_.size(); ++i) {
      DVec3 sum(0.0);
      for (size_t k = 0; k < transfer::kCorners; ++k)
        sum += double(weight[transfer::kCorners * i + k]) * glm::max(light[point[transfer::kCorners * i + k]], DVec3(0.0));
      out.push_back(transfer::luminanceOf(reflected_[i] * sum));
    }
    return out;
  }
  /// What the diffuse lobe sends to the camera of irradiance: as transferred_surface.
  void reflect(const Camera& camera) {
    const auto instance = g_->plane<uint32_t>("instance");
    const auto flags = surface_->plane<uint8_t>("flags");
    const auto albedo = surface_->floats("albedo"), material = surface_->floats("material"), N = surface_->floats("N"), P = g_->floats("P");
    reflected_.assign(instance.size(), DVec3(0.0));
    for (size_t i = 0; i < instance.size(); ++i) {
      if (instance[i] == kNoHit || (flags[i] & kSurfaceUnlit)) continue;
      double share = double((1 - material[5 * i]) * (1 - material[5 * i + 4])) / std::numbers::pi;
      if (material[5 * i + 2] > 0 && share > 0) {
        BsdfParams b;
        b.albedo = Vec3(1.0f);
        b.roughness = material[5 * i + 1];
        b.specular = material[5 * i + 2];
        b.ior = material[5 * i + 3];
        const Vec3 out = glm::normalize(Vec3(camera.toWorld[3]) - Vec3(P[3 * i], P[3 * i + 1], P[3 * i + 2]));
        share *= double(bsdfLobeAlbedos(b, clamp01(glm::dot(Vec3(N[3 * i], N[3 * i + 1], N[3 * i + 2]), out))).diffuse.x);
      }
      reflected_[i] = share * DVec3(albedo[3 * i], albedo[3 * i + 1], albedo[3 * i + 2]);
    }
  }
  NodesByHand run_;
  TermPtr g_, surface_, places_, points_, direct_;
  std::unique_ptr<transfer::published::HaarCells> cells_;
  std::unique_ptr<transfer::published::HaarTransfer> haar_;
  std::vector<DVec3> reflected_;
};

class Bench {
 public:
  Bench(const std::string& scene, int width, int height, int threads, int spp, bool blend, std::vector<size_t> haar)
      : width_(width), height_(height), spp_(spp), blend_(blend), haar_(std::move(haar)) {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = threads;
    options.anyPath = true;
    auto engine = Engine::create(options);
    if (!engine.ok()) fail(engine.status());
    engine_ = std::move(*engine);
    auto loaded = engine_->loadScene(scene, true);
    if (!loaded.ok()) fail(loaded.status());
    scene_ = *loaded;
    for (const std::string& e : {"scene=" + scene, "width=" + std::to_string(width), "height=" + std::to_string(height), std::string("outputs=direct_diffuse"),
                                 std::string("view_samples=1"), std::string("integrator.max_bounces=0"), std::string("integrator.at_view_samples=true")})
      edit(request_, e);
    if (blend || !haar_.empty()) hand_ = std::make_unique<ByHand>(scene_, threads, width, height);
  }

  void prepareHaar(Table& table, int side, double drop) {
    if (!haar_.empty()) hand_->prepareHaar(table, side, drop);
  }
  void row(Table& table, const EnvironmentPtr& map) {
    const std::vector<double> a = traced(map, 1001), b = traced(map, 1002);
    truth_.resize(a.size());
    double sum = 0;
    size_t lit = 0;
    for (size_t i = 0; i < a.size(); ++i) {
      truth_[i] = 0.5 * (a[i] + b[i]);
      sum += truth_[i];
      lit += truth_[i] > 0;
    }
    if (!(sum > 0)) return;
    mean_ = sum / double(lit);
    edge_ = edgeMask(truth_, width_, height_);
    std::vector<double> noise(a.size());
    for (size_t i = 0; i < a.size(); ++i) noise[i] = truth_[i] + 0.5 * (a[i] - b[i]);
    add(table, map->name, "reference's noise", noise);
    const std::vector<double> harmonics = transferred(map, 0);
    add(table, map->name, "harmonics", harmonics);
    std::vector<double> published = harmonics;
    const std::vector<double> lights = litBy(map);
    for (size_t i = 0; i < lights.size(); ++i) published[i] += lights[i];
    add(table, map->name, "published hybrid", published);
    add(table, map->name, "ours", transferred(map, 16));
    if (!haar_.empty()) {
      using transfer::published::HaarOrder;
      const ByHand::Timed plain = hand_->harmonicsPicture(*map);
      add(table, map->name, "harmonics by hand", plain.picture, plain.megabytes, plain.ms);
      for (const auto& [order, text] : {std::pair(HaarOrder::Largest, "largest"), std::pair(HaarOrder::ByArea, "by area")}) {
        const auto terms = transfer::published::haarLight(hand_->haarCells(), *map, order, hand_->arena());
        for (const size_t count : haar_) {
          const ByHand::Timed made = hand_->haarPicture(terms, count);
          add(table, map->name, "Haar, " + std::to_string(count) + " " + text, made.picture, made.megabytes, made.ms);
        }
      }
    }
    if (!blend_) return;
    using transfer::published::Power, transfer::published::ShadowBlend;
    for (const auto& [power, name] : {std::pair(Power::Published, "published"), std::pair(Power::Residual, "residual")}) {
      transfer::published::PublishedSettings settings;
      settings.power = power;
      const auto split = transfer::published::publishedSplit(*map, settings, hand_->arena());
      for (const auto& [how, text] : {std::pair(ShadowBlend::Hard, ", hard"), std::pair(ShadowBlend::Hemisphere, ", blended by the hemisphere"),
                                      std::pair(ShadowBlend::Towards, ", blended towards the light")})
        add(table, map->name, std::string(name) + text, hand_->picture(split, how));
    }
  }

 private:
  std::vector<double> render(const v1::RenderRequest& r, const ScenePtr& scene) const {
    RenderControl control;
    control.scene = scene;
    const auto result = engine_->render(r, control);
    if (!result.ok()) fail(result.status());
    return luminancesOf(result->images[0].image());
  }
  ScenePtr under(const EnvironmentPtr& map, const std::vector<Light>& lights = {}) const {
    auto made = editScene(*scene_, [&](Scene& s) -> Status {
      s.environment = map;
      s.lights.clear();
      if (map) {
        Light sky;
        sky.name = "environment";
        sky.shape.kind = LightKind::Environment;
        sky.power = Vec3(1.0f);
        sky.cameraVisible = false;
        s.lights.push_back(sky);
      }
      s.lights.insert(s.lights.end(), lights.begin(), lights.end());
      return {};
    });
    if (!made.ok()) fail(made.status());
    return *made;
  }
  std::vector<double> traced(const EnvironmentPtr& map, int seed) const {
    v1::RenderRequest r = request_;
    r.mutable_shadows()->mutable_path_traced();
    edit(r, "halt.spp=" + std::to_string(spp_));
    edit(r, "seed=" + std::to_string(seed));
    return render(r, under(map));
  }
  std::vector<double> transferred(const EnvironmentPtr& map, int lights) const {
    v1::RenderRequest r = request_;
    for (const std::string& e : {"environment.transfer.lights=" + std::to_string(lights), std::string("environment.transfer.samples=1024"),
                                 std::string("shadows.ray_traced.samples=16"), std::string("halt.spp=1")})
      edit(r, e);
    return render(r, under(map));
  }
  /// Of the published lights alone.
  std::vector<double> litBy(const EnvironmentPtr& map) const {
    transfer::published::PublishedSettings settings;
    const auto split = transfer::published::publishedSplit(*map, settings, TaskArena(engine_->threads()));
    std::vector<Light> lights;
    for (const auto& found : split.lights) {
      Light light;
      light.name = "light" + std::to_string(lights.size());
      light.shape.kind = LightKind::Directional;
      light.shape.axis = -Vec3(glm::normalize(found.direction));
      light.power = Vec3(found.irradiance);
      lights.push_back(light);
    }
    if (lights.empty()) return std::vector<double>(truth_.size(), 0.0);
    v1::RenderRequest r = request_;
    edit(r, "shadows.ray_traced.samples=1");
    edit(r, "halt.spp=1");
    return render(r, under(nullptr, lights));
  }

  void add(Table& table, const std::string& map, const std::string& method, const std::vector<double>& picture, double megabytes = std::nan(""),
           double ms = std::nan("")) const {
    std::vector<uint8_t> seen(truth_.size()), edges(truth_.size()), open(truth_.size());
    for (size_t i = 0; i < truth_.size(); ++i) {
      seen[i] = truth_[i] > 0 || picture[i] > 0;  // elsewhere is no surface
      edges[i] = seen[i] && edge_[i];
      open[i] = seen[i] && !edge_[i];
    }
    const auto of = [&](const std::vector<uint8_t>& mask) {
      const auto d = luminanceDifference(picture, truth_, exposureOfHalf(mean_), mask);
      if (!d.ok()) fail(d.status());
      return *d;
    };
    const LuminanceDifference all = of(seen), near = of(edges), elsewhere = of(open);
    if (all.nonFinite > 0) fail(Status(Code::Internal, method + " of " + map + " is not finite"));
    table.add({map, method, all.mean / mean_, all.deviation / mean_, all.shownMean, all.shownDeviation, near.mean / mean_, elsewhere.mean / mean_,
               double(near.pixels) / std::max(double(all.pixels), 1.0), megabytes, ms});
  }

  std::shared_ptr<Engine> engine_;
  std::unique_ptr<ByHand> hand_;
  ScenePtr scene_;
  v1::RenderRequest request_;
  int width_, height_, spp_;
  bool blend_;
  std::vector<size_t> haar_;  // how many terms
  std::vector<double> truth_;
  std::vector<uint8_t> edge_;
  double mean_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "240x180").c_str(), "%dx%d", &width, &height);
  const int spp = std::atoi(argumentOr(argc, argv, "--spp", "1024").c_str());
  if (width < 1 || height < 1 || spp < 1) fail(invalidArgument("--size and --spp must be positive"));
  const std::string scene = argumentOr(argc, argv, "--scene", "fence");
  bool blend = false;
  for (int i = 1; i < argc; ++i) blend |= std::string(argv[i]) == "--blend";
  std::vector<size_t> haar;
  for (const std::string& k : partsOf(argumentOr(argc, argv, "--haar", ""), ',')) haar.push_back(size_t(std::atoll(k.c_str())));
  Bench bench(scene, width, height, std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()), spp, blend, haar);
  Table table("Absolute difference of luminance from the reference (Table 5.1)",
              {"map", "method", "mean", "deviation", "displayed mean", "deviation of it", "near edges", "elsewhere", "share of edges", "MB", "ms of light"});
  table.note("scene", scene);
  table.note("pixels", double(width) * height);
  table.note("reference samples a pixel, each of two halves", double(spp));
  bench.prepareHaar(table, std::atoi(argumentOr(argc, argv, "--haar-side", "32").c_str()), std::atof(argumentOr(argc, argv, "--haar-drop", "0.001").c_str()));
  std::vector<EnvironmentPtr> maps = knownMaps();
  for (const std::string& file : partsOf(argumentOr(argc, argv, "--env", ""), ',')) {
    auto map = loadEnvironment(file);
    if (!map.ok()) fail(map.status());
    maps.push_back(*map);
  }
  for (const EnvironmentPtr& map : maps) bench.row(table, map);
  std::printf("%s", table.text().c_str());
  const std::string out = argumentOr(argc, argv, "--out", "");
  if (out.empty()) return 0;
  if (const Status s = table.write(out); !s.ok()) fail(s);
  return 0;
}
