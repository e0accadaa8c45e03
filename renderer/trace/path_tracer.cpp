// SPDX-License-Identifier: Apache-2.0
#include "trace/path_tracer.h"

#include "base/check.h"
#include "trace/path_kernel.h"
#include "trace/path_sums.h"
#include "trace/reach.h"
#include "trace/view_samples.h"

namespace gobo {
inline namespace trace {

void PathTracerSettings::hash(Hasher& h) const {
  h.addPod(camera.toWorld).add(camera.perspective).add(camera.yfov).add(camera.yheight).add(camera.centre.x).add(camera.centre.y);
  if (camera.cullBackFaces) h.add("cullBackFaces");
  hashOptics(h, camera);
  h.add(width).add(height).add(viewSamples).add(maxBounces).add(rouletteStart).add(blockSize).add(seed).add(behindOnly).add(unlit);
  h.add(cover).add(split).add(selection).add(groups).addArray(groupOf).add(uint64_t(nominal.size()));
  for (const Vec3& n : nominal) h.add(n.x).add(n.y).add(n.z);
  if (sampler != SamplerKind::Sobol) h.add("sampler").add(sampler);                        // terms of before there was a choice keep their keys
  if (viewSamples > 0 && viewSamples % 3 == 0) h.add("channels take turns of their own");  // those of before are of channels tied to view samples
}

int slotsPerGroup(SplitMode split, int maxBounces) {
  switch (split) {
    case SplitMode::Combined: return 1;
    case SplitMode::DirectIndirect: return 3;
    case SplitMode::ByLobe: return kCurvatureSlot;
    case SplitMode::ByLobeAndCurvature: return kCurvatureSlot + 2;
    case SplitMode::ByBounce: return maxBounces + 2;
  }
  return 1;
}

PathTracer::PathTracer() : impl_(std::make_unique<Impl>()) {}
PathTracer::~PathTracer() = default;
int PathTracer::slots() const { return impl_->slotCount; }

std::shared_ptr<const PathTracer> PathTracer::create(const SceneView& view, AccelPtr accel, const PathTracerSettings& settings, const StopToken& stop) {
  GOBO_CHECK_EQ(settings.groupOf.size(), view.lightSubset().size());
  GOBO_CHECK_EQ(settings.nominal.size(), view.lightSubset().size());
  GOBO_CHECK_LT(0, settings.blockSize);
  GOBO_CHECK_LE(settings.blockSize, 4096);
  GOBO_CHECK_LT(0, settings.width);
  GOBO_CHECK_LT(0, settings.height);
  GOBO_CHECK_LE(0, settings.maxBounces);
  for (int g : settings.groupOf) {
    GOBO_CHECK_LE(0, g);
    GOBO_CHECK_LT(g, settings.groups);
  }
  auto tracer = std::shared_ptr<PathTracer>(new PathTracer());
  Impl& m = *tracer->impl_;
  m.settings = settings;
  m.accel = std::move(accel);
  m.scene = m.accel->impl().scene;
  m.surfaces.build(view, *m.accel);
  m.perGroup = slotsPerGroup(settings.split, settings.maxBounces);
  m.slotCount = settings.groups * m.perGroup;
  m.wantEmission = has(settings.cover, PathClass::Emission);
  m.wantDirect = has(settings.cover, PathClass::Direct);
  m.wantIndirect = has(settings.cover, PathClass::Indirect);
  m.maxEvents = m.wantIndirect ? settings.maxBounces + 1 : m.wantDirect ? 1 : 0;
  m.prepareCamera();
  if (settings.camera.cullBackFaces) m.passed = BackFaces(view, *m.accel);
  if (!m.prepareLights(view, stop)) return nullptr;
  m.prepareMedia(view, stop);
  if (stop.stopRequested()) return nullptr;
  for (int s = 0; s < settings.viewSamples; ++s) m.viewSamples.push_back(viewSamplePosition(s, settings.viewSamples));
  return tracer;
}

void PathTracer::Impl::prepareCamera() {
  const Camera& c = settings.camera;
  const float W = float(settings.width), H = float(settings.height);
  const Vec3 right(c.toWorld[0]), up(c.toWorld[1]), back(c.toWorld[2]), position(c.toWorld[3]);
  const float scale = c.windowHeight(), squeeze = c.optics.pixelAspect;
  const Vec3 perX = right * (scale * squeeze / H), perY = up * (-scale / H);  // a square pixel to the right is 1/H of the window's height
  const Vec3 corner = right * ((-0.5f * W / H * squeeze + c.centre.x) * scale) + up * ((0.5f + c.centre.y) * scale);
  if (c.optics.panorama) panorama.emplace(c, settings.width, settings.height);
  if (c.hasLens()) lens.emplace(c);
  clips = c.clips();
  if (c.perspective) {
    cameraOrigin = position;
    cameraDirection = corner - back;
    cameraDirectionX = perX;
    cameraDirectionY = perY;
  } else {
    cameraOrigin = position + corner;
    cameraOriginX = perX;
    cameraOriginY = perY;
    cameraDirection = -back;
  }
}

bool PathTracer::Impl::prepareLights(const SceneView& view, const StopToken& stop) {
  const std::vector<int>& subset = view.lightSubset();
  sampler = LightSampler::build(view, stop, settings.cover != PathClass::Emission);  // emission is looked up where rays from the camera end
  if (!sampler) return false;
  selector.build(view, settings.nominal, settings.selection, stop);
  if (stop.stopRequested()) return false;
  meshLight.assign(view.instances().size(), -1);
  for (size_t k = 0; k < subset.size(); ++k) {
    if (k % 256 == 0 && stop.stopRequested()) return false;
    const LightShape& shape = view.lightShape(subset[k]);
    LightInfo info;
    info.light = subset[k];
    info.slot = settings.groupOf[k] * perGroup;
    info.kind = shape.kind;
    info.nominal = settings.nominal[k];
    info.seenByCamera = rayReaches(shape, view.lightCameraVisible(subset[k]), Receiver::Camera, Passage::Open);
    lights.push_back(info);
    if (!(luminance(info.nominal) > 0.0f)) continue;  // traced as black: nothing to find
    switch (shape.kind) {
      case LightKind::Mesh:
        meshLight[shape.instance] = int(k);
        hittable = true;
        break;
      case LightKind::Directional:
        if (isDeltaLight(shape)) break;
        [[fallthrough]];
      case LightKind::Environment:
        environments.push_back(int(k));
        hittable = true;
        break;
      case LightKind::Rect:
      case LightKind::Disk:
      case LightKind::Sphere: {
        areaLights.push_back(int(k));
        areaShapes.push_back(shape);
        const float r = shape.kind == LightKind::Rect ? glm::length(shape.u) + glm::length(shape.v) : shape.radius;
        areaX.push_back(shape.position.x);
        areaY.push_back(shape.position.y);
        areaZ.push_back(shape.position.z);
        areaRadius2.push_back(r * r * 1.001f);
        hittable = true;
        break;
      }
      default: break;
    }
  }
  std::vector<AreaLightBvh::Entry> entries;
  for (size_t a = 0; a < areaLights.size(); ++a) entries.push_back({areaLights[a], areaShapes[a], lights[areaLights[a]].seenByCamera});
  areaBvh = AreaLightBvh(std::move(entries));
  int only = -1;
  for (size_t k = 0; k < lights.size(); ++k)
    if (luminance(lights[k].nominal) > 0.0f) only = int(k);
  if (selector.count() == 1 && lights[only].kind == LightKind::Mesh) {
    plainLightIndex = only;
    hasPlainLight = plainLight.build(view, view.lightShape(subset[only]));
  }
  return true;
}

void PathTracer::traceBlock(int x, int y, uint32_t block, double* out, uint64_t& rays, uint64_t& dropped) const {
  SumSink sums(impl_->settings.split, impl_->slotCount, out);
  traceInto(x, y, block, sums, rays, dropped);
}

}  // namespace trace
}  // namespace gobo
