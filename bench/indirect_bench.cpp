// SPDX-License-Identifier: Apache-2.0
// Rates and widths of axis-aligned filtering of indirect light, as published and as here, on the same samples (docs/noise.md). Figure 4.2 of Wang,
// UCB/EECS-2013-118, and what equation 4.6's rates bring: error against mean samples a pixel of
//   plain        the mean of the samples
//   printed, released   the width of equation 4.4 by the nearest surface of the first 16 samples, as printed and as the authors' code has it, even rates
//   rates        released widths, and as many samples as equation 4.6 asks for, times one factor that makes the mean
//   rates+boost  the same over 1 - the share of neighbours that the filter turns down
//   ours         widths of least predicted error (denoise.axis_aligned), even rates
//   ours, rates  the same, samples in proportion to (V c)^(2/5) / (light^2 + 0.01)^(3/5): least mean relative error where the error of a pixel is
//                (V c / n)^(2/3) (V: variance of a sample, c: bending, from the first four samples, over the 49 pixels around)
// The light that arrives along the first scattered ray, without reflectance (trace/first_hit_sink.h). RMSE and relMSE over pixels that see a surface, against
// --reference samples of another seed, whose own noise is in them. Samples of a pixel are the beginning of its sequence, of 4, 8, 16, 24, 32, 48 ... of them.
// Arguments: --scene NAME,... (built-in, or files) --size WxH --spp N,... --most N (samples of a pixel) --reference N --threads N
// --table41 1: the columns of the source's table 4.1 instead, 640x480 and 64 samples, by requests with denoise.axis_aligned, one and two bounces.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <vector>

#include "filters/denoise/axis_aligned/axis_aligned.h"
#include "formulas/axis_aligned_indirect.glsl.h"
#include "formulas/formulas.h"
#include "import/load.h"
#include "measure/report.h"
#include "plan/engine.h"
#include "request/request.h"
#include "trace/first_hit_sink.h"
#include "trace/path_stages.h"

using namespace gobo;

namespace {

constexpr const char* kCounts = "4,8,16,32";
constexpr int kPilot = 16;  // samples that distances are taken from

/// What the path tracer says of a pixel's samples, and where they are.
class PlacedSink : public FirstHitSink {
 public:
  void start(uint64_t sample, int count) {
    FirstHitSink::start(sample, count);
    std::fill(met_, met_ + kLanes, false);
  }
  void vertex(int lane, const PathVertex& v) {
    FirstHitSink::vertex(lane, v);
    if (met_[lane] || v.kind != VertexKind::Surface) return;
    met_[lane] = true;
    place += DVec3(v.position);
    normal += DVec3(v.normal);
    ++hits;
  }
  DVec3 place{0.0}, normal{0.0};
  int hits = 0;

 private:
  bool met_[kLanes] = {};
};

struct Sampled {
  int width = 0, height = 0, most = 0;
  std::vector<float> light, distance;                               // [pixel][sample] RGB; metres, negative: none
  std::vector<float> position, normal, depth, footprint, coverage;  // of a pixel
  size_t pixels() const { return size_t(width) * size_t(height); }
};

struct Job {
  const Scene* scene = nullptr;
  AccelPtr accel;
  int width = 0, height = 0;
};

Sampled sample(const Job& job, uint64_t seed, int most, bool keep, const TaskArena& arena) {
  PathTracerSettings s;
  s.camera = job.scene->cameras[0];
  s.width = job.width;
  s.height = job.height;
  s.blockSize = kPilot;
  s.seed = seed;
  s.cover = PathClass::Indirect;
  std::vector<int> all(job.scene->lights.size());
  std::iota(all.begin(), all.end(), 0);
  for (const Light& l : job.scene->lights) {
    s.groupOf.push_back(0);
    s.nominal.push_back(l.power);
  }
  const auto tracer = PathTracer::create(SceneView(*job.scene, kPathTracerFacets, all), job.accel, s);
  Sampled out;
  out.width = job.width;
  out.height = job.height;
  out.most = keep ? most : 1;
  const size_t n = out.pixels();
  out.light.assign(n * size_t(out.most) * 3, 0.0f);
  out.distance.assign(n * size_t(out.most), -1.0f);
  for (std::vector<float>* v : {&out.position, &out.normal}) v->assign(3 * n, 0.0f);
  for (std::vector<float>* v : {&out.depth, &out.footprint, &out.coverage}) v->assign(n, 0.0f);
  arena.parallelFor(size_t(job.height), 1, [&](size_t begin, size_t end) {
    uint64_t rays = 0, dropped = 0;
    for (int y = int(begin); y < int(end); ++y)
      for (int x = 0; x < job.width; ++x) {
        const size_t p = size_t(y) * size_t(job.width) + size_t(x);
        DVec3 sum(0.0);
        for (int b = 0; b < most / kPilot; ++b) {
          PlacedSink sink;
          tracer->traceInto(x, y, uint32_t(b), sink, rays, dropped);
          for (const FirstHitSample& r : sink.samples()) {
            const Vec3 light = r.demodulated();
            sum += DVec3(light);
            if (!keep) continue;
            const size_t i = p * size_t(most) + size_t(r.sample);
            for (int c = 0; c < 3; ++c) out.light[3 * i + size_t(c)] = light[c];
            out.distance[i] = r.distance;
          }
          if (b > 0 || sink.hits == 0) continue;
          for (int c = 0; c < 3; ++c) {
            out.position[3 * p + size_t(c)] = float(sink.place[c] / sink.hits);
            out.normal[3 * p + size_t(c)] = float(sink.normal[c] / sink.hits);
          }
          out.depth[p] = float(glm::length(sink.place / double(sink.hits) - DVec3(s.camera.toWorld[3])));
          out.footprint[p] = pixelFootprint(s.camera, s.height, out.depth[p]);
          out.coverage[p] = float(sink.hits) / float(kPilot);
        }
        if (!keep)
          for (int c = 0; c < 3; ++c) out.light[3 * p + size_t(c)] = float(sum[c] / most);
      }
  });
  return out;
}

/// Counts of samples that a pixel may have.
std::vector<int> stepsTo(int most) {
  std::vector<int> steps{4, 8};
  for (int n = 16; n <= most; n *= 2) {
    steps.push_back(n);
    if (n + n / 2 <= most) steps.push_back(n + n / 2);
  }
  return steps;
}
int stepAt(const std::vector<int>& steps, double wanted) {
  for (const int n : steps)
    if (n >= wanted) return n;
  return steps.back();
}
/// As many samples as `wanted` times what makes their mean `mean`.
std::vector<int> countsOf(const std::vector<double>& wanted, const Sampled& s, double mean) {
  const std::vector<int> steps = stepsTo(s.most);
  std::vector<int> counts(wanted.size());
  double low = 1e-12, high = 1e12;
  for (int i = 0; i < 60; ++i) {
    const double factor = std::sqrt(low * high);
    double sum = 0, pixels = 0;
    for (size_t p = 0; p < wanted.size(); ++p) {
      counts[p] = stepAt(steps, factor * wanted[p]);
      if (s.coverage[p] > 0) sum += counts[p], pixels += 1;
    }
    (sum > mean * pixels ? high : low) = factor;
  }
  return counts;
}

struct Estimate {
  std::vector<float> mean, variance, bending;  // RGB; of the mean; light times (d / z)^2
};
Estimate estimate(const Sampled& s, const std::vector<int>& counts) {
  Estimate e;
  e.mean.assign(3 * s.pixels(), 0.0f);
  e.variance = e.mean;
  e.bending.assign(s.pixels(), 0.0f);
  for (size_t p = 0; p < s.pixels(); ++p) {
    double sum[3] = {}, squares[3] = {}, bends = 0;
    for (int k = 0; k < counts[p]; ++k) {
      const size_t i = p * size_t(s.most) + size_t(k);
      const double z = s.distance[i], ratio = z > 0 ? std::min(double(s.footprint[p]) / z, 2.0) : 0.0;
      for (size_t c = 0; c < 3; ++c) {
        sum[c] += s.light[3 * i + c];
        squares[c] += double(s.light[3 * i + c]) * s.light[3 * i + c];
        bends += s.light[3 * i + c] / 3.0 * ratio * ratio;
      }
    }
    const double n = counts[p];
    for (size_t c = 0; c < 3; ++c) {
      e.mean[3 * p + c] = float(sum[c] / n);
      e.variance[3 * p + c] = float(std::max(squares[c] - sum[c] * sum[c] / n, 0.0) / (n - 1) / n);
    }
    e.bending[p] = float(bends / n);
  }
  return e;
}

/// Means over (2 radius + 1)^2 pixels that see a surface.
std::vector<float> smoothed(const Sampled& s, const std::vector<float>& v, int channels, int radius) {
  std::vector<float> out(v.size());
  for (int y = 0; y < s.height; ++y)
    for (int x = 0; x < s.width; ++x)
      for (int c = 0; c < channels; ++c) {
        double sum = 0, n = 0;
        for (int j = std::max(y - radius, 0); j <= std::min(y + radius, s.height - 1); ++j)
          for (int i = std::max(x - radius, 0); i <= std::min(x + radius, s.width - 1); ++i)
            if (const size_t q = size_t(j * s.width + i); s.coverage[q] > 0) sum += v[q * size_t(channels) + size_t(c)], n += 1;
        out[size_t(y * s.width + x) * size_t(channels) + size_t(c)] = float(n > 0 ? sum / n : 0);
      }
  return out;
}

struct Reach {
  std::vector<float> nearest, farthest;  // metres; infinity: the samples left the scene
};
/// Of the first samples: the distances of what the light comes from.
Reach reachOf(const Sampled& s) {
  Reach r;
  r.nearest.assign(s.pixels(), std::numeric_limits<float>::infinity());
  r.farthest.assign(s.pixels(), 0.0f);
  for (size_t p = 0; p < s.pixels(); ++p)
    for (int k = 0; k < kPilot; ++k) {
      const float z = s.distance[p * size_t(s.most) + size_t(k)];
      if (!(z >= 0.0f) || !std::isfinite(z)) continue;
      r.nearest[p] = std::min(r.nearest[p], z);
      r.farthest[p] = std::max(r.farthest[p], z);
    }
  return r;
}

/// The source's filter: rows, then columns, each pixel with its own width; neighbours within 5 degrees and the nearest distance, in the tangent plane. share:
/// of the neighbours that were turned down.
std::vector<float> published(const Sampled& s, const Reach& r, const std::vector<float>& in, bool released, std::vector<double>* share = nullptr) {
  constexpr int kMost = 50;
  std::vector<float> from = in, to = in;
  std::vector<double> taken(s.pixels(), 0.0), asked(s.pixels(), 0.0);
  for (const bool columns : {false, true}) {
    for (int y = 0; y < s.height; ++y)
      for (int x = 0; x < s.width; ++x) {
        const size_t p = size_t(y * s.width + x);
        const float d = s.footprint[p];
        if (!(s.coverage[p] > 0) || !(d > 0)) continue;
        const float near = std::min(r.nearest[p], 1e6f * d);
        const float width =
            released ? formulas::aaIndirectWidthReleased(near, AA_OMEGA_DIFFUSE, d, 0.9f) : formulas::aaIndirectWidthPrinted(near, AA_OMEGA_DIFFUSE, d);
        const int reach = int(std::min(std::ceil(2.5f * width / d), float(kMost)));
        const Vec3 n(s.normal[3 * p], s.normal[3 * p + 1], s.normal[3 * p + 2]), here(s.position[3 * p], s.position[3 * p + 1], s.position[3 * p + 2]);
        double weights = 1, sum[3] = {from[3 * p], from[3 * p + 1], from[3 * p + 2]};
        for (int k = -reach; k <= reach; ++k) {
          const int i = columns ? x : x + k, j = columns ? y + k : y;
          if (k == 0 || i < 0 || j < 0 || i >= s.width || j >= s.height) continue;
          const size_t q = size_t(j * s.width + i);
          asked[p] += 1;
          if (!(s.coverage[q] > 0)) continue;
          const Vec3 m(s.normal[3 * q], s.normal[3 * q + 1], s.normal[3 * q + 2]);
          const Vec3 way = Vec3(s.position[3 * q], s.position[3 * q + 1], s.position[3 * q + 2]) - here;
          if (glm::dot(n, m) < 0.9961947f * glm::length(n) * glm::length(m) || glm::length(way) > std::max(near, 2 * d)) continue;
          taken[p] += 1;
          const Vec3 unit = n / std::max(glm::length(n), 1e-12f), along = way - glm::dot(way, unit) * unit;
          const double w = std::exp(-0.5 * double(glm::dot(along, along)) / (double(width) * width));
          weights += w;
          for (size_t c = 0; c < 3; ++c) sum[c] += w * from[3 * q + c];
        }
        for (size_t c = 0; c < 3; ++c) to[3 * p + c] = float(sum[c] / weights);
      }
    from = to;
  }
  if (share)
    for (size_t p = 0; p < s.pixels(); ++p) (*share)[p] = asked[p] > 0 ? 1 - taken[p] / asked[p] : 0;
  return to;
}

std::vector<float> ours(const Sampled& s, const Estimate& e, const TaskArena& arena) {
  v1::Denoise settings;
  settings.mutable_axis_aligned();
  if (!resolveDefaults(settings).ok()) std::abort();
  const std::vector<float> variance = smoothed(s, e.variance, 3, 3), albedo(3 * s.pixels(), 0.5f);
  denoise::NoisyPicture p;
  p.width = s.width;
  p.height = s.height;
  p.mean = p.a = p.b = e.mean;
  p.variance = variance;
  p.albedo = albedo;
  p.normal = s.normal;
  p.position = s.position;
  p.depth = s.depth;
  p.footprint = s.footprint;
  p.coverage = s.coverage;
  p.curvature = e.bending;
  std::vector<float> out(3 * s.pixels()), unused(3 * s.pixels());
  denoise::makeAxisAligned(settings.axis_aligned())->run(p, out, unused, arena, {});
  return out;
}

void print(const char* scene, const char* what, int spp, const Sampled& s, const std::vector<float>& light, const std::vector<float>& truth,
           double plainSquare) {
  double square = 0, relative = 0, n = 0;
  for (size_t p = 0; p < s.pixels(); ++p)
    if (s.coverage[p] > 0)
      for (size_t i = 3 * p; i < 3 * p + 3; ++i) {
        const double d = double(light[i]) - truth[i];
        square += d * d;
        relative += d * d / (double(truth[i]) * truth[i] + 0.01);
        n += 1;
      }
  std::printf("%-10s %-12s %4d  RMSE %.5f  relMSE %.5f", scene, what, spp, std::sqrt(square / n), relative / n);
  if (plainSquare > 0) std::printf("  worth %.0f plain samples (RMSE)", plainSquare / (square / n));
  std::printf("\n");
  std::fflush(stdout);
}
double squareOf(const Sampled& s, const std::vector<float>& light, const std::vector<float>& truth) {
  double square = 0, n = 0;
  for (size_t p = 0; p < s.pixels(); ++p)
    if (s.coverage[p] > 0)
      for (size_t i = 3 * p; i < 3 * p + 3; ++i) square += std::pow(double(light[i]) - truth[i], 2), n += 1;
  return square / n;
}

/// The source's table 4.1: scene, triangles, samples, bounces, milliseconds of samples, of the filter and of both, pictures a second with it and without.
int table41(const std::vector<std::string>& scenes, int threads) {
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = threads;
  options.storeBytes = 4ull << 30;
  options.anyPath = true;
  auto engine = Engine::create(options);
  if (!engine.ok()) return 1;
  std::printf(
      "| scene | triangles | samples | bounces | sampling ms | filter ms | both ms | pictures/s filtered | unfiltered "
      "|\n|---|---|---|---|---|---|---|---|---|\n");
  for (const std::string& name : scenes)
    for (const int bounces : {1, 2}) {
      v1::RenderRequest r;
      r.set_scene(name);
      r.set_width(640);
      r.set_height(480);
      r.mutable_halt()->set_spp(64);
      r.mutable_integrator()->set_max_bounces(uint32_t(bounces));
      r.add_outputs("indirect");
      r.mutable_denoise()->mutable_axis_aligned();
      const auto loaded = loadScene(name);
      if (!loaded || !(*engine)->openScene(name, name).ok()) return 1;
      double best[2] = {1e30, 1e30};
      for (int repeat = 0; repeat < 3; ++repeat) {
        (*engine)->dropCaches(false, true);
        const auto result = (*engine)->render(r);
        if (!result.ok()) {
          std::fprintf(stderr, "indirect_bench: %s\n", result.status().toString().c_str());
          return 1;
        }
        double ms[2] = {};
        for (const v1::NodeReport& n : result->reply.plan())
          if (n.state() == v1::NodeReport::RUN) ms[n.samples() == 0] += n.ms();
        if (ms[0] + ms[1] < best[0] + best[1]) best[0] = ms[0], best[1] = ms[1];
      }
      std::printf("| %s | %zu | 64 | %d | %.0f | %.0f | %.0f | %.2f | %.2f |\n", name.substr(name.find_last_of('/') + 1).c_str(), (*loaded)->triangleCount(),
                  bounces, best[0], best[1], best[0] + best[1], 1e3 / (best[0] + best[1]), 1e3 / best[0]);
      std::fflush(stdout);
    }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> scenes = partsOf(argumentOr(argc, argv, "--scene", "cornell,atrium"), ',');
  if (argumentOr(argc, argv, "--table41", "0") != "0") return table41(scenes, std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()));
  int width = 0, height = 0;
  std::sscanf(argumentOr(argc, argv, "--size", "160x120").c_str(), "%dx%d", &width, &height);
  const int most = std::atoi(argumentOr(argc, argv, "--most", "128").c_str()), reference = std::atoi(argumentOr(argc, argv, "--reference", "2048").c_str());
  if (most < kPilot || most % kPilot != 0 || reference < kPilot || reference % kPilot != 0) {
    std::fprintf(stderr, "indirect_bench: --most %d, --reference %d: multiples of %d\n", most, reference, kPilot);
    return 1;
  }
  for (const std::string& n : partsOf(argumentOr(argc, argv, "--spp", kCounts), ','))
    if (std::atoi(n.c_str()) < 4 || std::atoi(n.c_str()) > most) {
      std::fprintf(stderr, "indirect_bench: --spp %s: must be between 4 and --most, which is %d\n", n.c_str(), most);
      return 1;
    }
  const TaskArena arena(std::atoi(argumentOr(argc, argv, "--threads", "2").c_str()));
  for (const std::string& name : scenes) {
    auto loaded = loadScene(name);
    if (!loaded) {
      std::fprintf(stderr, "indirect_bench: %s\n", loaded.status().toString().c_str());
      return 1;
    }
    const Job job{loaded->get(), Accel::build(SceneView(**loaded, kPathTracerFacets, {}), arena), width, height};
    const std::string short_ = name.substr(name.find_last_of('/') + 1);
    const char* scene = short_.c_str();
    const Sampled s = sample(job, 1, most, true, arena);
    const std::vector<float> truth = sample(job, 1000, reference, false, arena).light;
    const Reach reach = reachOf(s);
    const std::vector<int> pilot(s.pixels(), 4), all(s.pixels(), most);
    const double perSample = squareOf(s, estimate(s, all).mean, truth) * most;  // what plain samples' squared error is over their number
    const Estimate first = estimate(s, pilot);
    const std::vector<float> light = smoothed(s, first.mean, 3, 3), spread = smoothed(s, first.variance, 3, 3), bends = smoothed(s, first.bending, 1, 3);
    std::vector<double> rejected(s.pixels()), rates(s.pixels()), boosted(s.pixels()), own(s.pixels());
    published(s, reach, first.mean, true, &rejected);
    for (size_t p = 0; p < s.pixels(); ++p) {
      const float d = std::max(s.footprint[p], 1e-12f), near = std::clamp(reach.nearest[p], 0.1f * d, 1e6f * d), far = std::max(reach.farthest[p], near);
      rates[p] = std::min(formulas::aaIndirectSamples(AA_OMEGA_DIFFUSE, d, near, far), 250.0f);
      boosted[p] = rates[p] / std::max(1 - rejected[p], 0.1);
      double v = 0, l = 0;
      for (size_t c = 0; c < 3; ++c) v += 4.0 * spread[3 * p + c] / 3, l += double(light[3 * p + c]) / 3;
      own[p] = std::pow(std::max(v * bends[p], 1e-30), 0.4) / std::pow(l * l + 0.01, 0.6);
    }
    for (const std::string& n : partsOf(argumentOr(argc, argv, "--spp", kCounts), ',')) {
      const int spp = std::stoi(n);
      const Estimate even = estimate(s, std::vector<int>(s.pixels(), spp));
      const auto filtered = [&](const std::vector<double>& wanted) { return estimate(s, countsOf(wanted, s, spp)); };
      print(scene, "plain", spp, s, even.mean, truth, perSample);
      print(scene, "printed", spp, s, published(s, reach, even.mean, false), truth, perSample);
      print(scene, "released", spp, s, published(s, reach, even.mean, true), truth, perSample);
      print(scene, "rates", spp, s, published(s, reach, filtered(rates).mean, true), truth, perSample);
      print(scene, "rates+boost", spp, s, published(s, reach, filtered(boosted).mean, true), truth, perSample);
      print(scene, "ours", spp, s, ours(s, even, arena), truth, perSample);
      print(scene, "ours, rates", spp, s, ours(s, filtered(own), arena), truth, perSample);
    }
  }
  return 0;
}
