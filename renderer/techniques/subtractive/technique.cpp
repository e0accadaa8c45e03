// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/technique.h"

#include <algorithm>
#include <cmath>

#include "request/environment_map.h"
#include "technique/plan_context.h"
#include "techniques/subtractive/light.h"
#include "techniques/subtractive/map_light.h"
#include "techniques/subtractive/request_fields.h"
#include "techniques/subtractive/samples.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/split_lights.h"

namespace gobo {

namespace {

using Asked = v1::EnvironmentSettings::Subtractive;

/// Why the path tracer keeps the map; null: it does not.
const char* declined(PlanContext& c) {
  if (c.kinds().extended || c.kinds().translucent || c.kinds().clear) return "the scene has coats, sheen, anisotropy, films or transmission";
  if (c.cameraInVolume()) return "the camera is inside a volume";
  const Scene& scene = *c.scene();
  const bool transmits = std::any_of(scene.instances.begin(), scene.instances.end(), [&](const Instance& in) {
    return scene.materials[size_t(scene.meshes[size_t(in.mesh)]->material)].bsdf.transmission > 0.0f;
  });
  return transmits ? "the scene has transmission" : nullptr;
}

/// In the world, at nominal power. Null: as many as there may be, for a bound.
std::vector<subtractive::DistantLightSample> fewLights(const TermPtr& list, uint32_t most, float rotation, const Vec3& nominal) {
  std::vector<subtractive::DistantLightSample> out(list ? size_t(list->extent().width) : size_t(most));
  if (!list) return out;
  const float cosR = std::cos(rotation), sinR = std::sin(rotation);
  const auto direction = list->floats("direction"), irradiance = list->floats("irradiance");
  for (size_t i = 0; i < out.size(); ++i) {
    const float* d = direction.data() + 3 * i;
    out[i].direction = Vec3(d[0] * cosR + d[2] * sinR, d[1], d[2] * cosR - d[0] * sinR);
    out[i].irradiance = nominal * Vec3(irradiance[3 * i], irradiance[3 * i + 1], irradiance[3 * i + 2]);
  }
  return out;
}

class SubtractiveShadows final : public Technique {
 public:
  const char* name() const override { return "subtractive"; }

  Status claim(PlanContext& c) const override {
    const v1::EnvironmentSettings& sky = c.request().environment();
    if (!sky.has_subtractive()) return {};
    const int map = environmentLight(*c.scene());
    if (map < 0 || !c.scene()->environment) {
      c.warn("environment.subtractive: the scene has no environment and the request brings none: nothing to do");
      return {};
    }
    const std::pair<const char*, bool> others[] = {
        {"area_lights", sky.area_lights() > 0}, {"extract_lights", sky.extract_lights() > 0}, {"transfer", sky.has_transfer()}};
    for (const auto& [field, asked] : others)
      if (asked)
        return invalidArgument(std::string("request.environment.subtractive: ") + field + " stands for the map too: ask for one",
                               "request.environment.subtractive");
    if (const char* why = declined(c)) {
      c.warn(std::string("environment.subtractive: ") + why + ": the map is path traced");
      return {};
    }
    return c.cover().claim(map, PathSet::Direct, name());
  }

  Status plan(PlanContext& c) const override {
    const int map = environmentLight(*c.scene());
    if (map < 0 || c.cover().claimedBy(map, name()) == PathSet::None) return {};
    const v1::EnvironmentSettings& sky = c.request().environment();
    const Asked& asked = sky.subtractive();
    GOBO_TRY(c.cover().bring(map, PathSet::Direct, name()));  // nothing passes surfaces here
    const EnvironmentPtr environment = c.scene()->environment;
    const int group = c.groups().groupOf[size_t(map)];
    const Vec3 nominal = c.groups().nominal[size_t(map)];
    const auto source = [&](NodePtr node, std::vector<NodeId> inputs, const char* label) {
      return c.source(std::move(node), std::move(inputs), {}, label, c.scene());
    };

    const NodeId split =
        source(transfer::makeEnvironmentSplitNode(environment, subtractive::kBands, int(asked.bright_lights()), asked.bright_share()), {}, "environment:split");
    TermPtr bright;
    if (asked.bright_lights() > 0) { GOBO_ASSIGN(bright, c.expand(split)); }
    const NodeId list = source(subtractive::makeResidualLightsNode(environment, int(asked.lights()), extractBy(sky)), {split}, "subtractive:lights");
    GOBO_ASSIGN(const TermPtr found, c.expand(list));

    const subtractive::Resampling resampling = subtractive::resamplingOf(asked);
    subtractive::SamplesSettings samples{c.view(), resampling, fewLights(found, asked.lights(), environment->rotation, nominal)};
    const NodeId traced = source(subtractive::makeSamplesNode(samples), {c.gbuffer(), c.surface()}, "subtractive:samples");
    std::vector<NodeId> inputs{c.gbuffer(), c.surface(), split};
    const bool shines = !c.kinds().lambert;
    if (shines) inputs.push_back(source(transfer::makeGlossLevelsNode(environment), {split}, "environment:gloss"));
    const NodeId full =
        c.filter(subtractive::makeUnshadowedMapNode(c.view(), environment, environment->rotation, nominal, shines), inputs, "subtractive:unshadowed");

    GraphNode n{subtractive::makeLightNode({c.view(), resampling, subtractive::formOf(asked), int(samples.lights.size())}),
                {c.gbuffer(), c.surface(), traced, full},
                {},
                "subtractive:light"};
    n.approximate = "unshadowed light of the map with the shadows of " + std::to_string(samples.lights.size()) + " lights at 1/" +
                    std::to_string(asked.resolution()) + " of the resolution" + (bright ? transfer::apartText(*bright) : "");
    const NodeId light = c.graph().add(std::move(n));
    c.add({light, "diffuse", c.groupGain(group), PathSet::FrontDiffuse, group});
    if (shines) c.add({light, "specular", c.groupGain(group), PathSet::FrontSpecular, group});
    c.addNegative({light, "negative", c.groupGain(group), PathSet::Front, group});
    return transfer::planSplitLights(c, bright, map, int(asked.bright_lights()), c.lobes());
  }
};

}  // namespace

const Technique& subtractiveShadows() {
  static const SubtractiveShadows technique;
  return technique;
}

}  // namespace gobo
