// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/samples_node.h"

#include "trace/accel.h"

namespace gobo::subtractive {

namespace {

constexpr double kMostSum = 1e36;

double lobeLuminance(const DVec3& c) { return 0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z; }

/// Which of the lights are seen.
void traceShadows(const Accel& accel, const Vec3& reach, const TracedSample& sample, const Arrivals& arrivals, std::vector<char>& seen, uint64_t& rays) {
  seen.assign(arrivals.lights.size(), 0);
  Ray ray[16];
  size_t of[16];
  int count = 0;
  const auto flush = [&] {
    const uint32_t blocked = count ? accel.occluded16(ray, count) : 0;
    for (int i = 0; i < count; ++i) seen[of[i]] = !(blocked >> i & 1);
    rays += uint64_t(count);
    count = 0;
  };
  for (size_t i = 0; i < arrivals.lights.size(); ++i) {
    const Arrivals::Light& light = arrivals.lights[i];
    if (light.way != Arrivals::Way::Ray) {
      seen[i] = light.way == Arrivals::Way::Open;
      continue;
    }
    ray[count] = shadowRay(reach, sample.point.p, sample.point.ng, light.point);
    of[count++] = i;
    if (count == 16) flush();
  }
  flush();
}

void addRest(const Arrivals& arrivals, SampleSums& sums) {
  double u[2], share[2] = {-1, -1};
  for (int k = 0; k < 2; ++k) {
    u[k] = lobeLuminance(sums.unshadowed[k]);
    if (u[k] > 0) share[k] = lobeLuminance(sums.visible[k]) / u[k];
  }
  for (int k = 0; k < 2; ++k) {
    if (arrivals.rest[k] == DVec3(0.0)) continue;
    const double part = share[k] >= 0 ? share[k] : share[1 - k] >= 0 ? share[1 - k] : 1.0;
    sums.unshadowed[k] += arrivals.rest[k];
    sums.visible[k] += arrivals.rest[k] * part;
    if (!(u[k] > 0)) continue;
    const double scale = (u[k] + lobeLuminance(arrivals.rest[k])) / u[k];
    sums.squares[k] *= scale * scale;
    sums.seen[k] *= scale * scale;
  }
}

}  // namespace

void writeSums(const SampleSums& sums, const SamplePlanes& out, size_t e) {
  float *u = out.unshadowed.data() + 6 * e, *v = out.visible.data() + 6 * e, *moments = out.moments.data() + 4 * e;
  for (int k = 0; k < 2; ++k) {
    for (int c = 0; c < 3; ++c) {
      u[3 * k + c] = float(std::min(sums.unshadowed[k][c], kMostSum));
      v[3 * k + c] = float(std::min(sums.visible[k][c], kMostSum));
    }
    moments[2 * k] = float(std::min(sums.squares[k], kMostSum));
    moments[2 * k + 1] = float(std::min(sums.seen[k], kMostSum));
  }
  out.traced[e] = 1;
}

bool speaksForItself(const Resampling& r, const Receivers& in, size_t e) {
  const size_t width = size_t(in.view.width), p = e % (width * size_t(in.view.height));
  const int x = int(p % width), y = int(p / width);
  if (onGrid(r, in.view, x, y)) return true;
  float sum = 0;
  forNeighbours(r, in, x, y, e, [&](size_t, float weight) { sum += weight; });
  return !(sum >= kLeastWeight);  // NaN: nothing does
}

TracedSample sampleAt(const Receivers& in, size_t e) {
  BsdfParams b = in.bsdf(e);
  for (int c = 0; c < 3; ++c) b.albedo[c] = std::max(b.albedo[c], kLeastAlbedo);
  TracedSample out;
  out.element = e;
  out.point = in.point(e, b);
  out.by = in.divisors(e, out.point.bsdf);
  return out;
}

void addLight(SampleSums& sums, const Vec3 (&lobes)[2], double seen) {
  for (int k = 0; k < 2; ++k) {
    const DVec3 value(lobes[k]);
    const double square = double(luminance(lobes[k])) * double(luminance(lobes[k]));
    sums.unshadowed[k] += value;
    sums.squares[k] += square;
    sums.visible[k] += value * seen;
    sums.seen[k] += square * seen;
  }
}

SampleSums sumsOf(const Arrivals& arrivals, std::span<const char> seen) {
  SampleSums sums;
  for (size_t i = 0; i < arrivals.lights.size(); ++i) addLight(sums, arrivals.lights[i].lobe, seen[i] ? 1.0 : 0.0);
  addRest(arrivals, sums);
  return sums;
}

Vec3 byAlbedo(const Vec3& light, const Vec3& albedo) {
  Vec3 out(0.0f);
  for (int c = 0; c < 3; ++c) out[c] = albedo[c] > 1e-6f ? minOf(light[c] / albedo[c], 1e18f) : 0.0f;
  return out;
}

NodeTraits SamplesNode::traits() const {
  NodeTraits t;
  t.facets = kAccelFacets;
  t.tileable = true;
  t.halo = resampling_.reach();
  return t;
}

void SamplesNode::hashParameters(Hasher& h) const {
  hashView(h, view_);
  view_.place.hash(h);
  resampling_.hash(h);
}

Result<TermShape> SamplesNode::infer(std::span<const TermShape> in) const {
  Wiring w(type(), in, 2);
  Receivers::reads(w, view_);
  return w.gives({type(), Domain::ViewSample, view_.extent(), SamplePlanes::shapes()});
}

Cost SamplesNode::cost(const TermShape& result, uint32_t) const {
  const double traced = kReceiving * double(result.extent.elements()) / (double(resampling_.resolution) * resampling_.resolution);
  return {traced * double(rays()), 20.0 * traced * double(looked()) + 100.0 * double(result.extent.elements())};
}

Result<TermPtr> SamplesNode::run(const RunContext& ctx) const {
  GOBO_ASSIGN(const AccelPtr accel, ctx.accel());
  const Receivers in(*ctx.inputs[0], *ctx.inputs[1], view_);
  const std::unique_ptr<const Lights> from = lights(ctx);
  if (!from) return Status(Code::Cancelled, type() + ": stopped");
  const SamplePlanes out(*ctx.result);
  // Some 4000 lights between looks at `stop`, where all samples are traced.
  const size_t grain = std::clamp<size_t>(4096 / std::max<size_t>(looked(), 1), 8, 256);
  const bool complete = ctx.arena->parallelFor(
      in.instance.size(), grain,
      [&](size_t begin, size_t end) {
        uint64_t rays = 0;
        Arrivals arrivals;
        std::vector<char> seen;
        for (size_t e = begin; e < end; ++e) {
          if (!in.lit(e) || !speaksForItself(resampling_, in, e)) continue;
          const TracedSample sample = sampleAt(in, e);
          arrivals.clear();
          from->at(sample, arrivals);
          traceShadows(*accel, accel->reach(in.instance[e]), sample, arrivals, seen, rays);
          writeSums(sumsOf(arrivals, seen), out, e);
        }
        if (ctx.counters) ctx.counters->rays.fetch_add(rays, std::memory_order_relaxed);
      },
      ctx.stop);
  if (!complete) return Status(Code::Cancelled, type() + ": stopped");
  return TermPtr(ctx.result);
}

}  // namespace gobo::subtractive
