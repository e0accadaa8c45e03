// SPDX-License-Identifier: Apache-2.0
#include "techniques/transfer/technique.h"

#include <algorithm>

#include "request/environment_map.h"
#include "technique/plan_context.h"
#include "techniques/transfer/nodes.h"
#include "techniques/transfer/receiver_mesh.h"
#include "techniques/transfer/split_lights.h"
#include "trace/surface.h"

namespace gobo {
inline namespace techniques {

namespace {

/// Specular lobes by the prefiltered map: asked for, and every material is one that it holds.
bool prefiltered(const PlanContext& c) {
  if (c.request().environment().transfer().gloss() == v1::EnvironmentSettings::Transfer::TRACED || c.kinds().extended) return false;
  const Scene& scene = *c.scene();
  return std::none_of(scene.instances.begin(), scene.instances.end(),
                      [&](const Instance& in) { return scene.materials[size_t(scene.meshes[size_t(in.mesh)]->material)].bsdf.transmission > 0.0f; });
}

/// No surface has a specular lobe.
bool allDiffuse(const Scene& scene) {
  return std::all_of(scene.instances.begin(), scene.instances.end(), [&](const Instance& in) {
    const Material& m = scene.materials[size_t(scene.meshes[size_t(in.mesh)]->material)];
    const SurfaceMaterial flat = makeSurfaceMaterial(m.albedo, m.bsdf, scene.textures);
    return flat.unlit || flat.lambert;
  });
}

/// Light passes some surface diffusely: what bounces by such ways transfer has not.
bool passesDiffusely(const Scene& scene) {
  return std::any_of(scene.instances.begin(), scene.instances.end(), [&](const Instance& in) {
    const Bsdf& b = scene.materials[size_t(scene.meshes[size_t(in.mesh)]->material)].bsdf;
    return b.diffuseTransmission > 0.0f && !b.unlit;
  });
}

class EnvironmentTransfer final : public Technique {
 public:
  const char* name() const override { return "environment_transfer"; }

  Status claim(PlanContext& c) const override {
    const v1::EnvironmentSettings& sky = c.request().environment();
    if (!sky.has_transfer()) return {};
    const int map = environmentLight(*c.scene());
    if (map < 0 || !c.scene()->environment) return {};
    for (const auto& [field, value] : {std::pair("area_lights", sky.area_lights()), std::pair("extract_lights", sky.extract_lights())})
      if (value > 0)
        return invalidArgument(std::string("request.environment.transfer: ") + field + " " + std::to_string(value) + " stands for the map too: ask for one",
                               "request.environment.transfer");
    if (c.cameraInVolume()) {
      c.warn("environment.transfer: the camera is inside a volume: the map is path traced");
      return {};
    }
    if (c.kinds().clear) {  // its rays take every surface for solid
      c.warn("environment.transfer: light passes some surfaces straight on (clear panes, volumes of index 1): the map is path traced");
      return {};
    }
    const bool lacksBounces = sky.transfer().bounces() > 0 && passesDiffusely(*c.scene());
    const PathSet diffuse = PathSet::FrontDiffuse | (lacksBounces ? PathSet::None : PathSet::IndirectDiffuse);
    const PathSet specular = PathSet::FrontSpecular | PathSet::IndirectSpecular;
    const PathSet none = (allDiffuse(*c.scene()) || prefiltered(c) ? specular : PathSet::None) |
                         (c.kinds().translucent ? PathSet::None : PathSet::Behind);  // there is none of it
    return c.cover().claim(map, c.cover().wanted() & (diffuse | none), name());
  }

  Status plan(PlanContext& c) const override {
    const int map = environmentLight(*c.scene());
    if (map < 0) return {};
    const PathSet claimed = c.cover().claimedBy(map, name());
    if (claimed == PathSet::None) return {};
    GOBO_TRY(c.cover().bring(map, claimed, name()));
    const v1::EnvironmentSettings::Transfer& asked = c.request().environment().transfer();
    const std::vector<int> noLights;
    transfer::TransferSettings s;
    s.points = asked.points();
    s.bands = int(asked.bands());
    s.seed = c.request().seed();
    s.size = uint32_t(transfer::receiverMesh(SceneView(*c.scene(), transfer::ReceiverMesh::kFacets, noLights), s.points)->size());
    if (s.size == 0) return {};  // nothing receives
    if (s.size > 4 * s.points && s.size > 100000)
      c.warn("environment.transfer.points = " + std::to_string(s.points) + ": there are " + std::to_string(s.size) +
             ", since every body has some; the first render takes long");

    const auto source = [&](NodePtr node, std::vector<NodeId> inputs, const std::string& label) {
      return c.source(std::move(node), std::move(inputs), {}, label, c.scene());
    };
    s.blocks = (asked.samples() + transfer::kDirections - 1) / transfer::kDirections;
    s.bounces = std::min(asked.bounces(), c.request().integrator().max_bounces());
    const NodeId points = source(transfer::makeTransferPointsNode(s), {}, "transfer points");
    NodeId direct = -1;
    for (uint32_t b = 0; b < s.blocks; ++b)
      direct = source(transfer::makeDirectTransferNode(s, b), b == 0 ? std::vector{points} : std::vector{points, direct}, "transfer:direct");
    const bool bounces = overlaps(claimed, PathSet::Indirect) && asked.bounces() > 0;
    NodeId bounced = -1;
    if (bounces) {
      const NodeId albedo = source(transfer::makePointAlbedoNode(s), {points}, "transfer:albedo");
      const uint32_t directions =
          std::max(transfer::kDirections, (asked.samples() / 4 + transfer::kDirections - 1) / transfer::kDirections * transfer::kDirections);
      for (uint32_t b = 0; b < s.bounces; ++b)
        bounced = source(transfer::makeBouncedTransferNode(s, b, directions), {points, albedo, b == 0 ? direct : bounced},
                         "transfer:bounce " + std::to_string(b + 1));
    } else if (overlaps(claimed, PathSet::Indirect)) c.prune("transfer:bounces", "environment.transfer.bounces is 0", true);
    else if (c.indirect()) c.prune("transfer:bounces", "light passes surfaces diffusely: what bounces is path traced");

    const NodeId sky =
        source(transfer::makeEnvironmentSplitNode(c.scene()->environment, s.bands, int(asked.lights()), asked.light_share()), {}, "environment:split");
    const int group = c.groups().groupOf[size_t(map)];
    std::vector<NodeId> inputs{sky, direct};
    if (bounces) inputs.push_back(bounced);
    const NodeId light =
        c.filter(transfer::makeTransferredLightNode(s, c.scene()->environment->rotation, c.groups().nominal[size_t(map)], bounces), inputs, "transfer:light");
    const NodeId places = source(transfer::makeTransferPlacesNode(s, c.view()), {c.gbuffer(), points}, "transfer:places");
    TermPtr split;
    if (asked.lights() > 0) { GOBO_ASSIGN(split, c.expand(sky)); }
    const std::string apart = split ? transfer::apartText(*split) : "";
    const auto bring = [&](const char* part, PathSet paths) {
      GraphNode n{transfer::makeTransferredSurfaceNode(s, c.view(), part, c.kinds().extended),
                  {c.gbuffer(), c.surface(), places, light},
                  {},
                  std::string("environment:") + part};
      if (c.kinds().extended) n.scene = c.scene();
      n.approximate = "the map in " + std::to_string(s.bands) + " bands of spherical harmonics, its light interpolated between " + std::to_string(s.size) +
                      " points" + (paths == PathSet::FrontDiffuse ? apart : "");
      c.add({c.graph().add(std::move(n)), "rgb", c.groupGain(group), paths, group});
    };
    bring("direct", PathSet::FrontDiffuse);
    if (bounces) bring("bounced", PathSet::IndirectDiffuse);
    const bool gloss = overlaps(claimed, PathSet::FrontSpecular) && !allDiffuse(*c.scene());
    if (gloss) {
      const NodeId levels = source(transfer::makeGlossLevelsNode(c.scene()->environment), {sky}, "environment:gloss");
      const auto shine = [&](const char* part, PathSet paths) {
        GraphNode n{transfer::makeTransferredGlossNode(s, c.view(), part, c.scene()->environment->rotation, c.groups().nominal[size_t(map)]),
                    {c.gbuffer(), c.surface(), places, points, direct, light, levels},
                    {},
                    std::string("environment:") + part + " gloss"};
        n.approximate = "highlights of the map are those of its prefiltered radiance, and what they show of the scene is its mean";
        c.add({c.graph().add(std::move(n)), "rgb", c.groupGain(group), paths, group});
      };
      shine("direct", PathSet::FrontSpecular);
      if (bounces) shine("bounced", PathSet::IndirectSpecular);
    }
    return transfer::planSplitLights(c, split, map, int(asked.lights()), gloss ? c.lobes() : std::vector{LobePart::Diffuse});
  }
};

}  // namespace

const Technique& environmentTransfer() {
  static const EnvironmentTransfer technique;
  return technique;
}

}  // namespace techniques
}  // namespace gobo
