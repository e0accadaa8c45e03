// SPDX-License-Identifier: Apache-2.0
#include "trace/photon_tracer.h"

#include <algorithm>

#include "base/check.h"
#include "base/disk.h"
#include "trace/camera_media.h"
#include "trace/path_media.h"
#include "trace/photon_emission.h"
#include "trace/reach.h"
#include "trace/straight.h"

namespace gobo {
inline namespace trace {

namespace {

constexpr double kAlpha = 2.0 / 3.0;
constexpr size_t kPhotonsPerTask = 4096;
constexpr float kSameSurface = 0.8f;  // cosine between normals of one surface within a radius

/// One path from either end: a ray, the volumes around it (lane 0 of PathMedia), and what it carries.
struct Walker {
  Vec3 origin, direction;
  Vec3 throughput{1.0f};
  Vec3 specularPart{0.0f};  // share of the first event's specular lobe in it
  int events = 0, free = 0;
  bool fromCamera = false;             // nothing but straight on since the camera
  float reach = CameraOptics::kNoEnd;  // of such a ray: how far it sees from where it is
  PathMedia media;
  Hit hit;

  void start(const std::vector<Interior>& interiors, const MediumStack& around, const Vec3& o, const Vec3& d) {
    media.interiors = &interiors;
    media.walking = 0;
    media.stack[0] = around;
    media.hero[0] = -1;
    origin = o;
    direction = d;
  }
  /// Rays beyond a boundary that changes nothing. Index and dispersion where it does change something. True: passed.
  bool boundary(Surface& s, uint64_t draw) {
    const int volume = s.material->interior;
    if (volume < 0) return false;
    if (media.passes(0, volume, s.front)) {
      origin = s.origin(-s.facing());
      media.cross(0, volume, s.front);
      ++free;
      return true;
    }
    if (s.material->dispersion > 0.0f) {
      if (media.hero[0] < 0) {
        const int c = int(draw % 3);
        media.hero[0] = int8_t(c);
        Vec3 one(0.0f);
        one[c] = 3.0f * throughput[c];
        throughput = one;
      }
      s.bsdf.ior = dispersedIor(s.bsdf.ior, s.material->dispersion, media.hero[0]);
    }
    s.bsdf.ior = media.relativeIor(0, volume, s.bsdf.ior, s.front);
    return false;
  }
  /// Continues along a BSDF sample. False: it would leave on the wrong side.
  bool leave(const Surface& s, const Frame& frame, const BsdfSample& bs) {
    const Vec3 facing = s.facing();
    Vec3 wi = frame.toWorld(bs.wi);
    wi *= 1.0f / std::sqrt(glm::dot(wi, wi));
    const float side = glm::dot(wi, facing);
    if (bs.transmitted ? !(side < 0.0f) : !(side > 0.0f)) return false;
    origin = s.origin(side > 0.0f ? facing : -facing);
    direction = wi;
    return true;
  }
};

}  // namespace

void CausticSettings::hash(Hasher& h) const {
  path.hash(h);
  h.add(photons).add(radius).add(byLobe);
}

float causticRadius(float first, uint32_t pass) {
  double r2 = double(first) * first;
  for (uint32_t i = 1; i <= pass; ++i) r2 *= (double(i) + kAlpha) / (double(i) + 1.0);
  return float(std::sqrt(r2));
}

struct CausticTracer::Impl {
  CausticSettings settings;
  std::shared_ptr<const PathTracer> tracer;  // camera, surfaces, volumes
  struct Source {
    PhotonEmitter emitter;
    MediumStack around;
    Vec3 nominal;
    int group;
    uint64_t key;
  };
  std::vector<Source> sources;
  int maxEvents = 1;

  const PathTracer::Impl& path() const { return tracer->impl(); }
  bool next(Walker& w, uint64_t& rays) const;  ///< Walker::fromCamera: through what the camera passes
  void photon(const Source& source, uint32_t index, uint32_t pass, std::vector<Photon>& out, uint64_t& rays) const;
  void sample(int x, int y, uint64_t seed, uint32_t index, uint32_t turn, const PhotonMap& map, double* out, uint64_t& rays) const;
  bool scatter(Walker& w, uint64_t key, uint64_t& rays) const;
  void gather(const Walker& w, const Surface& s, const Frame& frame, const BsdfView& view, const PhotonMap& map, double* out) const;
};

CausticTracer::CausticTracer() : impl_(std::make_unique<Impl>()) {}
CausticTracer::~CausticTracer() = default;

std::shared_ptr<const CausticTracer> CausticTracer::create(const SceneView& view, AccelPtr accel, const CausticSettings& settings, const StopToken& stop) {
  GOBO_CHECK(settings.radius > 0.0f);
  auto tracer = std::shared_ptr<CausticTracer>(new CausticTracer());
  Impl& m = *tracer->impl_;
  m.settings = settings;
  m.tracer = PathTracer::create(view, std::move(accel), settings.path, stop);
  if (!m.tracer) return nullptr;
  m.maxEvents = settings.path.maxBounces + 1;
  const SurfaceTable& surfaces = m.path().surfaces;
  const std::vector<Sphere> targets = specularTargets(view, surfaces);
  const Sphere scene = sceneSphere(view);
  const std::vector<int>& subset = view.lightSubset();
  for (size_t k = 0; k < subset.size(); ++k) {
    const LightShape& shape = view.lightShape(subset[k]);
    const Vec3& nominal = settings.path.nominal[k];
    if (!photonReaches(shape, Receiver::Surface, Passage::Specular) || !(maxComponent(nominal) > 0.0f) || targets.empty()) continue;
    MediumStack around;
    around.clear();
    if (shape.kind != LightKind::Directional && !surfaces.interiors().empty())
      for (int material : volumesAround(view, shape.position, stop)) around.enter(surfaces.interiorOf(material));
    m.sources.push_back(
        {PhotonEmitter(shape, targets, scene, view.lightProfile(subset[k])), around, nominal, settings.path.groupOf[k], hash64(0x70686f746f6eu, k)});
    if (stop.stopRequested()) return nullptr;
  }
  return tracer;
}

/// The next surface of a path, with what the volume on the way left. False: none.
bool CausticTracer::Impl::next(Walker& w, uint64_t& rays) const {
  Ray ray;
  ray.origin = w.origin;
  ray.direction = w.direction;
  if (w.fromCamera) ray.tmax = w.reach;
  w.hit = {};
  ++rays;
  if (!path().accel->intersect(ray, w.hit, w.fromCamera ? &path().passed : nullptr)) return false;
  if (path().clips) w.reach = std::max(w.reach - w.hit.t, 0.0f);
  return true;
}

void CausticTracer::Impl::photon(const Source& source, uint32_t index, uint32_t pass, std::vector<Photon>& out, uint64_t& rays) const {
  const uint64_t seed = hash64(hash64(settings.path.seed, source.key), pass);
  SobolSampler draw(seed, index);
  const float target = draw.next1D();
  PhotonStart start;
  if (!source.emitter.emit(target, draw.next2D(), start)) return;
  Walker w;
  w.start(path().surfaces.interiors(), source.around, start.origin, start.direction);
  w.throughput = source.nominal * start.tint * float(double(start.power) / double(settings.photons));
  float length = 0;
  bool turned = false;  // light that came straight on is the path tracer's: its shadow rays see it
  const bool straightSeen = path().surfaces.anyStraight();
  while (w.events + w.free <= maxEvents + kMostFree) {
    if (!next(w, rays)) return;
    length += w.hit.t;
    w.throughput *= w.media.through(0, w.hit.t);  // of what does not scatter
    Surface s;
    path().surfaces.interact(w.hit.instance, w.hit.primitive, w.hit.u, w.hit.v, w.hit.Ng, w.direction, s);
    if (s.material->unlit || !(maxComponent(w.throughput) > 0.0f)) return;
    if (w.boundary(s, hash64(seed, index))) {
      if (w.free > kMostFree) return;
      continue;
    }
    const Frame frame = s.frame();
    const Vec3 wo = frame.toLocal(-w.direction);
    const BsdfView view(s.bsdf, wo);
    if (!view.isDelta() && (turned || (w.free > 0 && !straightSeen)) && w.events + 1 <= maxEvents) {
      const float left = source.emitter.window(length);
      if (left > 0.0f) out.push_back({s.p, -w.direction, s.Ng, w.throughput * left, source.group, w.events});
    }
    const bool mayPass = straightSeen && bendsAlike(*s.material);
    const bool last = w.events + 2 > maxEvents;  // nothing but straight on, then
    if (last && !(mayPass && s.material->transmissive)) return;
    BsdfSample bs;
    const float lobe = draw.next1D();
    if (!view.sample(lobe, draw.next2D(), bs) || !bs.delta) return;  // any other lobe ends the chain: the photon has landed
    const Vec3 arrived = -w.direction;
    if (!w.leave(s, frame, bs)) return;
    // Of a folded direction the cosine before the fold counts. Folded photons follow the normal of their own direction, not the camera's: where
    // mirrors are tilted beyond the horizon the two ways to trace a path differ (docs/materials.md).
    const float leaving = bs.folded ? bs.wi.z - 2.0f * glm::dot(bs.wi, s.bsdf.facing) * s.bsdf.facing.z : bs.wi.z;
    const float adjoint = std::fabs(wo.z * glm::dot(w.direction, s.Ng)) / std::fabs(glm::dot(arrived, s.Ng) * leaving);
    w.throughput *= bs.weight * (bsdfFluxScale(s.bsdf, bs) * adjoint);
    if (!isFinite(w.throughput)) return;
    if (s.material->interior >= 0 && bs.transmitted) w.media.cross(0, s.material->interior, s.front);
    if (mayPass && bs.straight) {
      if (++w.free > kMostFree) return;
    } else if (last) {
      return;
    } else {
      ++w.events;
      turned = true;
    }
  }
}

std::shared_ptr<const PhotonMap> CausticTracer::emitPass(uint32_t pass, const TaskArena& arena, uint64_t& rays, const StopToken& stop) const {
  const Impl& m = *impl_;
  const size_t each = (size_t(m.settings.photons) + kPhotonsPerTask - 1) / kPhotonsPerTask, tasks = each * m.sources.size();
  std::vector<std::vector<Photon>> parts(tasks);
  std::vector<uint64_t> counts(tasks, 0);
  const bool complete = arena.parallelFor(
      tasks, 1,
      [&](size_t begin, size_t end) {
        for (size_t t = begin; t < end; ++t) {
          const uint32_t first = uint32_t(t % each * kPhotonsPerTask), last = uint32_t(std::min<size_t>(m.settings.photons, first + kPhotonsPerTask));
          for (uint32_t i = first; i < last; ++i) m.photon(m.sources[t / each], i, pass, parts[t], counts[t]);
        }
      },
      stop);
  for (uint64_t c : counts) rays += c;
  if (!complete || stop.stopRequested()) return nullptr;
  size_t total = 0;
  for (const auto& p : parts) total += p.size();
  std::vector<Photon> all;
  all.reserve(total);
  for (auto& p : parts) {  // by light, then number: the same order for any threads
    all.insert(all.end(), p.begin(), p.end());
    std::vector<Photon>().swap(p);
  }
  return std::make_shared<const PhotonMap>(std::move(all), causticRadius(m.settings.radius, pass));
}

void CausticTracer::Impl::gather(const Walker& w, const Surface& s, const Frame& frame, const BsdfView& view, const PhotonMap& map, double* out) const {
  if (map.size() == 0) return;
  const double area = M_PI * double(map.radius()) * map.radius();
  const Vec3 facing = s.facing();
  const bool through = s.material->transmissive;
  map.around(s.p, [&](const Photon& ph) {
    if (w.events + 1 + ph.events > maxEvents || glm::dot(ph.n, s.Ng) < kSameSurface) return;
    const float side = glm::dot(ph.toLight, facing), cosine = glm::dot(ph.toLight, s.n);
    if (!(cosine * side > 0.0f) || (cosine < 0.0f && !through)) return;  // as the path tracer treats light samples
    BsdfValue f;
    float density;
    if (s.lambert) f.diffuse = s.bsdf.albedo * (kInvPi * cosine);
    else f = view.evalPdf(frame.toLocal(ph.toLight), density);
    const Vec3 arriving = w.throughput * ph.flux, value = arriving * f.sum();
    const double scale = 1.0 / (area * std::fabs(double(side)));
    if (!settings.byLobe) {
      for (int c = 0; c < 3; ++c) out[3 * ph.slot + c] += double(value[c]) * scale;
      return;
    }
    const Vec3 gloss = w.events == 0 ? arriving * f.specular : value * w.specularPart;
    for (int c = 0; c < 3; ++c) {
      out[6 * ph.slot + c] += double(value[c] - gloss[c]) * scale;
      out[6 * ph.slot + 3 + c] += double(gloss[c]) * scale;
    }
  });
}

/// Through the scattering volume that the path is in, from its ray with its hit to the last segment's. False: it ended.
bool CausticTracer::Impl::scatter(Walker& w, uint64_t key, uint64_t& rays) const {
  RTCRayHit16 rh = {};
  rh.ray.org_x[0] = w.origin.x;
  rh.ray.org_y[0] = w.origin.y;
  rh.ray.org_z[0] = w.origin.z;
  rh.ray.dir_x[0] = w.direction.x;
  rh.ray.dir_y[0] = w.direction.y;
  rh.ray.dir_z[0] = w.direction.z;
  rh.ray.tfar[0] = w.hit.t;
  rh.hit.geomID[0] = RTC_INVALID_GEOMETRY_ID;  // stays so if no event moves the ray
  Lane3 throughput;
  throughput.set(0, w.throughput);
  bool scattered = false;
  w.media.walking = 1;
  const bool on = w.media.walk(
      0, rh, path().scene, throughput, key, rays, scattered, [](const Vec3&, const Vec3&, float) {},
      [](const Vec3&, const Vec3&, const Vec3&, const Vec3&, uint64_t) {});
  w.throughput = throughput.get(0);
  if (scattered && w.events == 0) w.events = 1;  // a walk that nothing came before is the first event
  if (!on) return false;
  if (!scattered) return true;
  w.fromCamera = false;
  if (rh.hit.geomID[0] == RTC_INVALID_GEOMETRY_ID) return false;
  w.origin = Vec3(rh.ray.org_x[0], rh.ray.org_y[0], rh.ray.org_z[0]);
  w.direction = Vec3(rh.ray.dir_x[0], rh.ray.dir_y[0], rh.ray.dir_z[0]);
  w.hit.t = rh.ray.tfar[0];
  w.hit.instance = rh.hit.instID[0][0] == RTC_INVALID_GEOMETRY_ID ? rh.hit.geomID[0] : rh.hit.instID[0][0];
  w.hit.primitive = rh.hit.primID[0];
  w.hit.u = rh.hit.u[0];
  w.hit.v = rh.hit.v[0];
  w.hit.Ng = path().accel->impl().worldNormal(w.hit.instance, Vec3(rh.hit.Ng_x[0], rh.hit.Ng_y[0], rh.hit.Ng_z[0]));
  return true;
}

void CausticTracer::Impl::sample(int x, int y, uint64_t seed, uint32_t index, uint32_t turn, const PhotonMap& map, double* out, uint64_t& rays) const {
  const PathTracer::Impl& m = path();
  SobolSampler draw(seed, index);
  Vec2 film = draw.next2D();
  if (!m.viewSamples.empty()) film = m.viewSamples[(index + turn) % m.viewSamples.size()];
  const float fx = float(x) + film.x, fy = float(y) + film.y;
  Walker w;
  Vec3 o, d;
  Vec2 onLens(0.0f);
  if (m.lens) onLens = m.viewSamples.empty() ? concentricDisk(SobolSampler(hash64(seed, 0x6c656e73u), index).next2D()) : m.lensOfViewSample(x, y, index + turn);
  m.startAtFilm(fx, fy, onLens, o, d, w.reach);
  w.start(m.surfaces.interiors(), m.cameraMedia, o, d);
  w.fromCamera = true;
  while (w.events + 1 <= maxEvents && w.free <= kMostFree) {
    if (!next(w, rays)) return;
    const Interior* inside = w.media.around(0);
    w.media.walking = 0;
    if (inside && inside->scatters && !scatter(w, hash64(hash64(seed, index), uint64_t(w.events + w.free)), rays)) return;
    w.throughput *= w.media.through(0, w.hit.t);
    Surface s;
    m.surfaces.interact(w.hit.instance, w.hit.primitive, w.hit.u, w.hit.v, w.hit.Ng, w.direction, s);
    if (s.material->unlit) return;
    if (w.boundary(s, index + channelTurn(index, m.viewSamples.size()) + hash64(seed, 0x64697370u) % 3)) continue;
    const Frame frame = s.frame();
    const Vec3 wo = frame.toLocal(-w.direction);
    const BsdfView view(s.bsdf, wo);
    if (!view.isDelta()) gather(w, s, frame, view, map, out);
    BsdfSample bs;
    const float lobe = draw.next1D();
    const Vec2 u = draw.next2D();
    const float roulette = draw.next1D();
    BsdfValue f;
    if (!view.sample(lobe, u, bs, f)) return;
    if (settings.byLobe && w.events == 0) {
      w.specularPart = Vec3(bs.delta ? 1.0f : 0.0f);
      if (!bs.delta) {
        const Vec3 all = f.sum();
        for (int c = 0; c < 3; ++c)
          if (all[c] > 0.0f) w.specularPart[c] = f.specular[c] / all[c];
      }
    }
    w.throughput *= bs.weight;
    const float most = maxComponent(w.throughput);
    if (!(most > 0.0f) || !isFinite(w.throughput)) return;
    if (w.events + 1 >= settings.path.rouletteStart) {
      const float survive = std::min(0.95f, most);
      if (roulette >= survive) return;
      w.throughput *= 1.0f / survive;
    }
    if (!w.leave(s, frame, bs)) return;
    const int volume = s.material->interior;
    bool uncounted = w.events > 0 && bs.straight && m.surfaces.anyStraight() && bendsAlike(*s.material);  // as the path tracer: no event
    if (volume >= 0) {
      uncounted = uncounted || (w.events > 0 && !bs.transmitted && !s.front && inside && inside->scatters && w.media.stack[0].top() == volume);
      if (bs.transmitted) w.media.cross(0, volume, s.front);
    }
    if (!bs.straight) w.fromCamera = false;
    if (uncounted) ++w.free;
    else ++w.events;
  }
}

void CausticTracer::traceSamples(int x, int y, const SampleRun& run, const PhotonMap& map, double* out, uint64_t& rays, uint64_t& dropped,
                                 uint32_t turn) const {
  const Impl& m = *impl_;
  if (map.size() == 0) return;
  const PathTracerSettings& s = m.settings.path;
  const uint64_t pixel = uint64_t(uint32_t(y)) << 32 | uint32_t(x);
  const uint64_t seed = hash64(hash64(hash64(s.seed, 0x63617573u), pixel), run.stream);  // "caus": never the path tracer's own
  const size_t n = 3 * size_t(m.settings.slots());
  std::vector<double> one(n);
  for (uint32_t i = 0; i < run.count; ++i) {
    std::fill(one.begin(), one.end(), 0.0);
    m.sample(x, y, seed, run.first + i, turn, map, one.data(), rays);
    bool finite = true;
    for (double v : one) finite = finite && std::isfinite(v);
    if (!finite) {
      ++dropped;
      continue;
    }
    for (size_t k = 0; k < n; ++k) out[k] += one[k];
  }
}

}  // namespace trace
}  // namespace gobo
