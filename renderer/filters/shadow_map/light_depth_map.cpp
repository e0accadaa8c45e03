// SPDX-License-Identifier: Apache-2.0
// Source: linear depth seen from a light: by Embree rays, one per texel in packets of 4x4 texels, or by scan conversion.
#include <algorithm>
#include <vector>

#include "filters/shadow_map/depth_raster.h"
#include "filters/shadow_map/shadow_map.h"
#include "formulas/shadow_map.glsl.h"
#include "trace/accel_impl.h"
#include "trace/solid_scene.h"

namespace gobo {
inline namespace filters {
namespace {

constexpr int kLanes = 16;

/// Depth of up to 16 texels, by one packet of rays.
void traceTexels(const SolidScene& scene, const LightFrame& f, int resolution, const uint32_t* texels, int count, float* z) {
  const float scale = 1.0f / (f.far - f.near), texel = 1.0f / float(resolution);
  Ray ray[kLanes];
  Hit hit[kLanes];
  float start[kLanes] = {}, cosine[kLanes] = {};
  for (int i = 0; i < count; ++i)
    ray[i] = f.ray((float(texels[i] % uint32_t(resolution)) + 0.5f) * texel, (float(texels[i] / uint32_t(resolution)) + 0.5f) * texel, start[i], cosine[i]);
  scene.intersect16(ray, count, hit);
  for (int i = 0; i < count; ++i) z[texels[i]] = hit[i].valid() ? formulas::shadowDepth((start[i] + hit[i].t * cosine[i] - f.near) * scale) : 1.0f;
}

class LightDepthMapNode : public Node {
 public:
  LightDepthMapNode(const LightFrames& frames, int resolution, DepthMethod method, bool clear)
      : frames_(frames), resolution_(resolution), method_(method), clear_(clear) {
    GOBO_CHECK(resolution >= 1);
  }
  std::string type() const override { return "light_depth_map"; }
  int version() const override { return 3; }
  NodeTraits traits() const override { return {.facets = clear_ ? kAccelFacets | Facet::Bsdf : kAccelFacets}; }
  void hashParameters(Hasher& h) const override {
    frames_.hash(h);
    h.add(resolution_).add(int(method_));
    if (clear_) h.add("clear");
  }
  Result<TermShape> infer(std::span<const TermShape> in) const override {
    return Wiring(type(), in, 0).gives({type(), Domain::LightTexel, {resolution_, resolution_, frames_.count}, {unsetPlane<float>("z")}});
  }

  Result<TermPtr> run(const RunContext& ctx) const override {
    const auto& term = ctx.result;
    const std::span<float> z = term->writable<float>("z");
    const size_t square = size_t(resolution_) * size_t(resolution_);
    std::unique_ptr<const SolidScene> solid;
    for (int face = 0; face < frames_.count; ++face) {
      const LightFrame& frame = frames_.face[size_t(face)];
      float* const to = &z[size_t(face) * square];
      bool done = true;
      if (!frame.sees) {
        std::fill(to, to + square, 1.0f);
      } else {
        if (!solid) {
          GOBO_ASSIGN(AccelPtr accel, ctx.accel());
          solid = std::make_unique<const SolidScene>(*ctx.scene, std::move(accel), clear_);
        }
        done = raster(*ctx.scene) ? scanFace(ctx, *solid, frame, to) : traceFace(ctx, *solid, frame, to);
      }
      if (!done) return Status(Code::Cancelled, "light_depth_map stopped");
    }
    return TermPtr(term);
  }

 private:
  static constexpr int kTile = 4;

  // By bench/shadow_depth_bench.cpp, in nanoseconds a texel at r triangles a texel: rays 23 + 75 sqrt(r), scan conversion 1 + 32 sqrt(r) + 25 r; they
  // meet at r = 4.5. Texels behind alpha surfaces need their ray besides: those triangles weigh as much as makes the built-in trees, which are leaves
  // for the most part, meet where they do (r = 0.12). A pure function of the recipe, as the method must be.
  static constexpr double kTrianglesPerTexel = 4.5, kAlphaWeight = 36.0;
  bool raster(const SceneView& scene) const {
    if (method_ != DepthMethod::Automatic) return method_ == DepthMethod::Raster;
    double triangles = 0.0;
    for (const Instance& i : scene.instances()) {
      const auto mesh = scene.mesh<Facet::Topology>(i.mesh);
      triangles += double(mesh.triangles()) * (scene.coverage(mesh.material).mode == AlphaMode::Opaque ? 1.0 : kAlphaWeight);
    }
    return triangles <= kTrianglesPerTexel * double(resolution_) * double(resolution_);
  }

  bool traceFace(const RunContext& ctx, const SolidScene& solid, const LightFrame& f, float* z) const {
    const int rows = (resolution_ + kTile - 1) / kTile;
    return ctx.arena->parallelFor(
        size_t(rows), 1,
        [&](size_t begin, size_t end) {
          for (size_t r = begin; r < end; ++r) {
            const int y0 = int(r) * kTile, y1 = std::min(y0 + kTile, resolution_);
            for (int x0 = 0; x0 < resolution_; x0 += kTile) {
              uint32_t texels[kLanes];
              int count = 0;
              for (int y = y0; y < y1; ++y)
                for (int x = x0; x < std::min(x0 + kTile, resolution_); ++x) texels[count++] = uint32_t(y) * uint32_t(resolution_) + uint32_t(x);
              traceTexels(solid, f, resolution_, texels, count, z);
            }
            if (ctx.counters) ctx.counters->rays += uint64_t(y1 - y0) * uint64_t(resolution_);
          }
        },
        ctx.stop);
  }

  bool scanFace(const RunContext& ctx, const SolidScene& solid, const LightFrame& f, float* z) const {
    const std::vector<Instance>& instances = ctx.scene->instances();
    std::vector<RasterMesh> parts;
    for (size_t i = 0; i < instances.size(); ++i) {
      const auto mesh = ctx.scene->mesh<Facet::Topology>(instances[i].mesh);
      if (mesh.triangles() == 0 || !solid.solid(uint32_t(i))) continue;
      const InstanceGeometry& g = solid.accel().impl().instances[i];
      parts.push_back(
          {g.indices, g.positions, mesh.triangles(), g.world ? Mat4(1.0f) : g.toWorld, ctx.scene->coverage(mesh.material).mode != AlphaMode::Opaque});
    }
    DepthRaster raster(f, resolution_, parts);
    if (!raster.sort(*ctx.arena, ctx.stop)) return false;
    return ctx.arena->parallelFor(
        size_t(raster.bands()), 1,
        [&](size_t begin, size_t end) {
          std::vector<uint32_t> open;
          for (size_t b = begin; b < end; ++b) {
            raster.band(int(b), z, open);
            for (size_t i = 0; i < open.size(); i += kLanes) traceTexels(solid, f, resolution_, &open[i], int(std::min<size_t>(kLanes, open.size() - i)), z);
            if (ctx.counters) ctx.counters->rays += open.size();
          }
        },
        ctx.stop);
  }

  LightFrames frames_;
  int resolution_;
  DepthMethod method_;
  bool clear_;
};

}  // namespace

NodePtr makeLightDepthMapNode(const LightFrames& frames, int resolution, DepthMethod method, bool clear) {
  return std::make_shared<LightDepthMapNode>(frames, resolution, method, clear);
}

}  // namespace filters
}  // namespace gobo
