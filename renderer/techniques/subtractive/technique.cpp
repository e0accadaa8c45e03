// SPDX-License-Identifier: Apache-2.0
#include "techniques/subtractive/technique.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "request/environment_map.h"
#include "technique/plan_context.h"
#include "techniques/subtractive/cached_map.h"
#include "techniques/subtractive/light.h"
#include "techniques/subtractive/map_light.h"
#include "techniques/subtractive/request_fields.h"
#include "techniques/subtractive/samples.h"
#include "techniques/subtractive/styled_samples.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/split_lights.h"

namespace gobo {
inline namespace techniques {

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

/// In the world, at nominal power. Null: as many as there may be, for a bound; apart from each other, since equal nodes are one.
std::vector<subtractive::DistantLightSample> fewLights(const TermPtr& list, uint32_t most, float rotation, const Vec3& nominal) {
  std::vector<subtractive::DistantLightSample> out(list ? size_t(list->extent().width) : size_t(most));
  if (!list) {
    for (size_t i = 0; i < out.size(); ++i) out[i].direction = Vec3(0.6f * std::cos(float(i)), 0.8f, 0.6f * std::sin(float(i)));
    return out;
  }
  const float cosR = std::cos(rotation), sinR = std::sin(rotation);
  const auto direction = list->floats("direction"), irradiance = list->floats("irradiance");
  for (size_t i = 0; i < out.size(); ++i) {
    const float* d = direction.data() + 3 * i;
    out[i].direction = Vec3(d[0] * cosR + d[2] * sinR, d[1], d[2] * cosR - d[0] * sinR);
    out[i].irradiance = nominal * Vec3(irradiance[3 * i], irradiance[3 * i + 1], irradiance[3 * i + 2]);
  }
  return out;
}

/// What the request names for the light "environment", where it has a style.
std::optional<v1::ShadowTechnique> styleOf(const PlanContext& c) {
  v1::ShadowTechnique t = c.request().shadows();
  const auto edit = c.request().lights().find("environment");
  if (edit != c.request().lights().end() && edit->second.has_shadow()) t = edit->second.shadow();
  return t.has_style() ? std::optional(t) : std::nullopt;
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
    if (sky.subtractive().unshadowed() == Asked::RADIANCE_CACHE && c.view().camera.optics.panorama)
      return invalidArgument(
          "request.environment.subtractive.unshadowed: RADIANCE_CACHE is made for one direction to the camera, which a panorama does not "
          "have: PREFILTERED or HARMONICS",
          "request.environment.subtractive.unshadowed");
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
    const subtractive::SamplesSettings samples{c.view(), resampling, fewLights(found, asked.lights(), environment->rotation, nominal)};
    NodeId traced = -1;
    const std::optional<v1::ShadowTechnique> styled = styleOf(c);
    if (styled) {
      GOBO_ASSIGN(traced, subtractive::planStyledSamples(c, samples, *styled));
    } else traced = source(subtractive::makeSamplesNode(samples), {c.gbuffer(), c.surface()}, "subtractive:samples");
    const bool shines = !c.kinds().lambert;
    const NodeId full = unshadowed(c, environment, split, nominal, shines);

    GraphNode n{subtractive::makeLightNode({c.view(), resampling, subtractive::formOf(asked), int(samples.lights.size())}),
                {c.gbuffer(), c.surface(), traced, full},
                {},
                "subtractive:light"};
    n.approximate = "unshadowed light of the map with the shadows of " + std::to_string(samples.lights.size()) + " lights at 1/" +
                    std::to_string(asked.resolution()) + " of the resolution" + (styled ? ", in a style" : "") + (bright ? transfer::apartText(*bright) : "");
    const NodeId light = c.graph().add(std::move(n));
    c.add({light, "diffuse", c.groupGain(group), PathSet::FrontDiffuse, group});
    if (shines) c.add({light, "specular", c.groupGain(group), PathSet::FrontSpecular, group});
    c.addNegative({light, "negative", c.groupGain(group), PathSet::Front, group});
    return transfer::planSplitLights(c, bright, map, int(asked.bright_lights()), c.lobes());
  }

 private:
  /// Of the map without its peaks, lobe by lobe.
  static NodeId unshadowed(PlanContext& c, const EnvironmentPtr& map, NodeId split, const Vec3& nominal, bool shines) {
    const Asked& asked = c.request().environment().subtractive();
    std::vector<NodeId> inputs{c.gbuffer(), c.surface()};
    if (asked.unshadowed() == Asked::RADIANCE_CACHE) {
      subtractive::RadianceCacheSettings s{map, subtractive::toMapAxes(glm::normalize(Vec3(c.view().camera.toWorld[2])), map->rotation)};
      if (shines) s.roughness = subtractive::cachedRoughnesses(*c.scene());
      inputs.push_back(c.source(subtractive::makeRadianceCacheNode(s), {split}, {}, "environment:cache", c.scene()));
      return c.filter(subtractive::makeCachedMapNode(c.view(), s, map->rotation, nominal), std::move(inputs), "subtractive:unshadowed");
    }
    inputs.push_back(split);
    if (shines) inputs.push_back(c.source(transfer::makeGlossLevelsNode(map), {split}, {}, "environment:gloss", c.scene()));
    const auto by = asked.unshadowed() == Asked::HARMONICS ? subtractive::DiffuseBy::Harmonics : subtractive::DiffuseBy::Table;
    return c.filter(subtractive::makeUnshadowedMapNode(c.view(), map, map->rotation, nominal, shines, by), std::move(inputs), "subtractive:unshadowed");
  }
};

}  // namespace

const Technique& subtractiveShadows() {
  static const SubtractiveShadows technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo
