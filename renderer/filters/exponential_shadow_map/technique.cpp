// SPDX-License-Identifier: Apache-2.0
#include "filters/exponential_shadow_map/technique.h"

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/exponential_shadow_map/exponential_shadow_map.h"

namespace gobo {

bool exponentialShadowSupports(LightKind kind) {
  return kind == LightKind::Directional || kind == LightKind::Spot || kind == LightKind::Rect || kind == LightKind::Disk;
}

namespace {

Status checkRange(const char* field, double value, double lo, double hi) {
  if (value >= lo && value <= hi) return {};
  return invalidArgument(std::to_string(value) + " is outside [" + std::to_string(lo) + ", " + std::to_string(hi) + "]",
                         std::string("shadows.exponential.") + field);
}

}  // namespace

Result<NodeId> planExponentialShadow(Graph& graph, const ShadowInput& input, const v1::ShadowTechnique& technique) {
  // Defaults as in filters.proto; a resolved request has every field set.
  const v1::ExponentialShadow& e = technique.exponential();
  const uint32_t resolution = e.has_resolution() ? e.resolution() : 1024, blur = e.has_blur() ? e.blur() : 2;
  const double c = e.has_c() ? e.c() : 60.0, bias = e.has_bias() ? e.bias() : 0.001;
  GOBO_TRY(checkRange("resolution", resolution, 1, 8192));
  GOBO_TRY(checkRange("c", c, 1, 80));
  GOBO_TRY(checkRange("blur", blur, 0, 64));
  GOBO_TRY(checkRange("bias", bias, 0, 1));
  const Light& light = input.scene->lights.at(size_t(input.light));
  if (!exponentialShadowSupports(light.shape.kind))
    return Status(Code::Unimplemented, "light '" + light.name + "': exponential shadow maps support directional, spot, rectangle and disk lights");
  ComputeDevicePtr device;
  if (e.device() == v1::ExponentialShadow::VULKAN) {
    GOBO_ASSIGN(device, VulkanDevice::shared());
  } else if (e.device() == v1::ExponentialShadow::EGL) {
    GOBO_ASSIGN(device, EglDevice::shared());
  }
  if (device && uint64_t(resolution) * resolution * 4 > device->maxBufferBytes())
    return Status(Code::ResourceExhausted, std::to_string(resolution) + " texels squared are more than the " + std::to_string(device->maxBufferBytes()) +
                                               " bytes that a buffer of " + device->name() + " may have", "shadows.exponential.resolution");
  Vec3 lo, hi;
  input.scene->bounds(lo, hi);
  GOBO_ASSIGN(const LightFrame frame, fitLightFrame(light.shape, lo, hi, int(resolution), int(blur) + 1));

  GraphNode depth;
  depth.node = makeLightDepthMapNode(frame, int(resolution));
  depth.scene = input.scene;
  depth.label = "light depth map:" + light.name;
  const NodeId depthId = graph.add(std::move(depth));
  GraphNode encode;
  encode.node = makeExponentialShadowEncodeNode(float(c), int(blur), int(resolution), device);
  encode.inputs = {depthId};
  encode.label = "exponential shadow map:" + light.name;
  const NodeId encodeId = graph.add(std::move(encode));
  GraphNode lookup;
  const size_t samples = size_t(input.width) * size_t(input.height) * size_t(input.viewSamples);
  lookup.node = makeExponentialShadowLookupNode({frame, float(c), float(bias)}, samples, device);
  lookup.inputs = {input.gbuffer, encodeId};
  lookup.label = "visibility:" + light.name;
  return graph.add(std::move(lookup));
}

}  // namespace gobo
