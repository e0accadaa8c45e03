// SPDX-License-Identifier: Apache-2.0
#include "denoise/over_time.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "denoise/choose.h"
#include "filters/denoise/noisy_picture.h"
#include "filters/denoise/registry.h"
#include "filters/denoise/temporal/temporal.h"
#include "measure/report.h"
#include "request/request.h"
#include "scene/load.h"
#include "scene/scene.h"

namespace gobo::bench {

namespace {

/// What moves: a field of a light, from one vector to another.
struct Motion {
  const char *scene, *settings, *field;
  Vec3 from, to;
};
constexpr const char* kLampOfCornell =
    "lights.light.enabled=false lights.lamp.kind=RECT lights.lamp.direction=0,-1,0 lights.lamp.width=0.5 lights.lamp.height=0.4 lights.lamp.intensity=20";
const Motion kMotions[] = {{"cornell", kLampOfCornell, "lights.lamp.position", Vec3(-0.6f, 1.98f, 0.0f), Vec3(0.6f, 1.98f, 0.0f)},
                           {"lights8", "", "lights.key.position", Vec3(-1.8f, 2.7f, 1.2f), Vec3(1.2f, 2.7f, 1.2f)},
                           {"atrium", "", "lights.sun.direction", Vec3(-0.8f, -1.0f, -0.28f), Vec3(-0.2f, -1.0f, -0.28f)}};

/// The parts of a filter's name before and behind "temporal"; `engine` alone where there is none.
struct Chain {
  std::string engine;
  bool temporal = false, clamp = false;
  std::string behind;
};
Chain chainOf(const std::string& filter) {
  Chain chain;
  for (const std::string& part : partsOf(filter, '+')) {
    if (part == "temporal" || part == "temporal.clamp") {
      chain.temporal = true;
      chain.clamp = part != "temporal";
    } else {
      std::string& into = chain.temporal ? chain.behind : chain.engine;
      into += (into.empty() ? "" : "+") + part;
    }
  }
  if (chain.engine.empty()) chain.engine = "none";
  return chain;
}

struct Sums {
  double square = 0, relative = 0;
  std::vector<double> errorA, errorB;                // of the frame before, against both halves of the reference
  std::vector<double> stepsA, stepsB, steps, level;  // per channel of a pixel: of changes of the error, their product, and of the reference
};

/// Light that filters see: the beauty without what the camera sees of lamps.
Result<std::vector<float>> lightOf(Engine& engine, const RenderControl& control, v1::RenderRequest r, uint32_t samples, const std::string& filter) {
  r.clear_outputs();
  r.add_outputs("beauty");
  r.add_outputs("emission");
  r.mutable_halt()->set_spp(samples);
  GOBO_TRY(chooseFilter(r, filter));
  auto result = engine.render(r, control);
  if (!result.ok()) return result.status();
  for (const v1::NodeReport& n : result->reply.plan())
    if (n.samples() > samples) return internalError("more samples than asked: halves of " + std::to_string(samples), "--spp");
  const auto beauty = result->images[0].pixels(), emission = result->images[1].pixels();
  const size_t of = size_t(result->images[0].channels()), without = size_t(result->images[1].channels());
  std::vector<float> light(beauty.size() / of * 3);
  for (size_t i = 0; i < light.size(); ++i) light[i] = beauty[i / 3 * of + i % 3] - emission[i / 3 * without + i % 3];
  return light;
}

/// The terms that denoisers read, made from the outputs of a request.
struct Surfaces {
  std::shared_ptr<Term> features;
  std::vector<float> object;
};
Result<Surfaces> surfacesOf(Engine& engine, const RenderControl& control, v1::RenderRequest r, const Camera& camera) {
  r.clear_outputs();
  for (const char* name : {"albedo", "normal", "position", "depth", "alpha", "object_id"}) r.add_outputs(name);
  auto result = engine.render(r, control);
  if (!result.ok()) return result.status();
  const int width = result->images[0].width(), height = result->images[0].height();
  auto t = std::make_shared<Term>("denoise_features", Domain::Pixel, Extent{width, height, 1});
  const auto albedo = t->addPlane<float>("albedo", 3), normal = t->addPlane<float>("normal", 3), position = t->addPlane<float>("position", 3);
  const auto modulation = t->addPlane<float>("modulation", 3);
  const auto depth = t->addPlane<float>("depth"), footprint = t->addPlane<float>("footprint"), coverage = t->addPlane<float>("coverage");
  Surfaces s{t, {}};
  const auto copy = [&](size_t image, std::span<float> to, size_t channels) {
    const auto from = result->images[image].pixels();
    const size_t of = size_t(result->images[image].channels());
    for (size_t i = 0; i < to.size(); ++i) to[i] = from[i / channels * of + i % channels];
  };
  copy(0, albedo, 3);
  copy(1, normal, 3);
  copy(2, position, 3);
  copy(3, depth, 1);
  copy(4, coverage, 1);
  s.object.resize(coverage.size());
  copy(5, s.object, 1);
  for (size_t p = 0; p < coverage.size(); ++p) {
    const bool hit = coverage[p] > 0.0f && std::isfinite(depth[p]);
    if (!hit) depth[p] = coverage[p] = 0.0f;
    footprint[p] = hit ? pixelFootprint(camera, height, depth[p]) : 0.0f;
    for (size_t c = 0; c < 3; ++c) {
      modulation[3 * p + c] = hit ? albedo[3 * p + c] + 0.04f : 1.0f;
      if (!hit) albedo[3 * p + c] = normal[3 * p + c] = position[3 * p + c] = 0.0f;
    }
  }
  return s;
}

std::shared_ptr<Term> pictureTerm(const std::vector<float>& light, Extent extent) {
  auto t = std::make_shared<Term>("picture", Domain::Pixel, extent);
  const auto rgb = t->addPlane<float>("rgb", 3);
  std::copy(light.begin(), light.end(), rgb.begin());
  return t;
}

/// Accumulation with what stands behind it.
class Accumulated {
 public:
  static Result<Accumulated> make(const Chain& chain, float leastShare) {
    Accumulated a(chain, leastShare);
    if (!chain.behind.empty()) {
      v1::RenderRequest r;
      GOBO_TRY(chooseFilter(r, chain.behind));
      GOBO_TRY(resolveDefaults(*r.mutable_denoise()));
      GOBO_ASSIGN(a.behind_, denoise::makeDenoiser(r.denoise()));
    }
    return a;
  }
  /// `half`: the first half of the samples, whose other half it is compared with; empty where `light` was filtered.
  Result<std::vector<float>> next(const Surfaces& s, const std::vector<float>& half, const std::vector<float>& light, uint32_t samples, const Camera& camera,
                                  const TaskArena& arena) {
    const Extent extent = s.features->extent();
    const uint32_t counted = half.empty() ? 1 : samples;
    RunContext run;
    run.arena = &arena;
    run.inputs = {s.features};
    if (!half.empty()) run.inputs.push_back(pictureTerm(half, extent));
    run.inputs.push_back(pictureTerm(light, extent));
    GOBO_ASSIGN(const TermPtr noisy, runNode(*denoise::makeNoisyPictureNode(extent.width, extent.height, counted, counted / 2), run));
    denoise::NoisyPicture p = denoise::noisyPicture(*s.features, *noisy, counted, counted / 2);
    accumulator_.add({p, camera, s.object}, arena);
    std::vector<float> out(accumulator_.light().begin(), accumulator_.light().end()), other(out.size());
    if (behind_) {
      p = accumulator_.picture(p);
      if (!behind_->run(p, out, other, arena, {})) return Status(Code::Cancelled, "stopped");
    }
    const auto modulation = s.features->floats("modulation");
    for (size_t i = 0; i < out.size(); ++i) out[i] *= modulation[i];
    return out;
  }

 private:
  Accumulated(const Chain& chain, float leastShare)
      : accumulator_([&] {
          denoise::TemporalSettings s;
          s.leastShare = leastShare;
          s.clampDeviations = chain.clamp ? 1.0f : 0.0f;
          return s;
        }()) {}
  denoise::TemporalAccumulator accumulator_;
  denoise::DenoiserPtr behind_;
};

void count(Sums& s, const std::vector<float>& x, const std::vector<float>& a, const std::vector<float>& b) {
  const bool first = s.errorA.empty();
  if (first)
    for (auto* v : {&s.errorA, &s.errorB, &s.stepsA, &s.stepsB, &s.steps, &s.level}) v->assign(x.size(), 0.0);
  for (size_t i = 0; i < x.size(); ++i) {
    const double errorA = double(x[i]) - a[i], errorB = double(x[i]) - b[i], mean = 0.5 * (double(a[i]) + b[i]);
    s.square += errorA * errorB;
    s.relative += errorA * errorB / (mean * mean + 1e-2);
    s.level[i] += mean;
    if (!first) {
      const double stepA = errorA - s.errorA[i], stepB = errorB - s.errorB[i];
      s.stepsA[i] += stepA;
      s.stepsB[i] += stepB;
      s.steps[i] += stepA * stepB;
    }
    s.errorA[i] = errorA;
    s.errorB[i] = errorB;
  }
}

void print(const std::string& scene, const std::string& filter, const Sums& s, uint32_t frames) {
  const double all = double(s.level.size()), steps = frames - 1.0;
  double flicker = 0, relative = 0;
  for (size_t i = 0; i < s.level.size(); ++i) {
    const double variance = s.steps[i] / steps - s.stepsA[i] / steps * s.stepsB[i] / steps, level = s.level[i] / frames;
    flicker += variance;
    relative += variance / (level * level + 1e-2);
  }
  const auto root = [](double v) { return std::sqrt(std::max(v, 0.0)); };
  std::printf("%-10s %-27s %9.5f %9.5f %9.5f %9.5f\n", scene.c_str(), filter.c_str(), root(s.square / all / frames), s.relative / all / frames,
              root(0.5 * flicker / all), 0.5 * relative / all);
}

}  // namespace

Status measureOverTime(Engine& engine, const RenderControl& control, const v1::RenderRequest& request, const std::vector<std::string>& filters,
                       const OverTime& how) {
  const auto motion = std::find_if(std::begin(kMotions), std::end(kMotions), [&](const Motion& m) { return request.scene() == m.scene; });
  if (motion == std::end(kMotions)) return invalidArgument("no light moves in this scene: cornell, lights8, atrium", request.scene());
  if (how.frames < 2 || how.samples < 2) return invalidArgument("at least two frames of two samples", "--temporal");
  v1::RenderRequest base = request;
  for (const std::string& a : partsOf(motion->settings, ' ')) GOBO_TRY(setPath(base, a));
  GOBO_ASSIGN(const ScenePtr scene, makeBuiltinScene(request.scene()));
  const Camera& camera = scene->cameras.front();
  GOBO_ASSIGN(const Surfaces surfaces, surfacesOf(engine, control, base, camera));
  const TaskArena arena(engine.threads());
  std::vector<std::optional<Accumulated>> accumulated(filters.size());
  std::vector<Sums> sums(filters.size());
  for (size_t k = 0; k < filters.size(); ++k)
    if (const Chain chain = chainOf(filters[k]); chain.temporal) { GOBO_ASSIGN(accumulated[k], Accumulated::make(chain, float(how.leastShare))); }
  for (uint32_t frame = 0; frame < how.frames; ++frame) {
    v1::RenderRequest r = base;
    const float at = float(0.5 + how.travel * (double(frame) / (how.frames - 1.0) - 0.5));
    const Vec3 v = motion->from + (motion->to - motion->from) * at;
    char text[160];
    std::snprintf(text, sizeof text, "%s=%.6f,%.6f,%.6f", motion->field, double(v.x), double(v.y), double(v.z));
    GOBO_TRY(setPath(r, text));
    std::vector<float> reference[2];
    for (uint32_t k = 0; k < 2; ++k) {  // the same points in every frame: their error hardly moves
      r.set_seed(1000 + k);
      GOBO_ASSIGN(reference[k], lightOf(engine, control, r, how.reference, "none"));
    }
    r.set_seed(1 + frame);
    GOBO_ASSIGN(const std::vector<float> half, lightOf(engine, control, r, how.samples / 2, "none"));
    for (size_t k = 0; k < filters.size(); ++k) {
      const Chain chain = chainOf(filters[k]);
      GOBO_ASSIGN(std::vector<float> light, lightOf(engine, control, r, how.samples, chain.engine));
      if (chain.temporal) {
        GOBO_ASSIGN(light, accumulated[k]->next(surfaces, chain.engine == "none" ? half : std::vector<float>(), light, how.samples, camera, arena));
      }
      count(sums[k], light, reference[0], reference[1]);
    }
    engine.dropCaches(false, true);
  }
  for (size_t k = 0; k < filters.size(); ++k) print(request.scene(), filters[k], sums[k], how.frames);
  std::fflush(stdout);
  return {};
}

}  // namespace gobo::bench
