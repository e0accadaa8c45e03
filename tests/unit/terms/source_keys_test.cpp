// SPDX-License-Identifier: Apache-2.0
// Parameters of sources that few requests change: each is in the node's key. A path trace takes over no state that has more than it asks for.
#include <gtest/gtest.h>

#include <map>
#include <optional>
#include <string>

#include "support/tiny_scenes.h"
#include "terms/direct_unoccluded.h"
#include "terms/path_trace.h"
#include "terms/visibility.h"
#include "trace/accel.h"

namespace gobo {
namespace {

std::string key(const NodePtr& node) {
  Hasher h("parameters");
  node->hashParameters(h);
  return h.digest().hex();
}

TEST(SourceKeys, SamplesSeedsAndStreamsAreInThem) {
  DirectUnoccludedSettings d;
  d.view.width = d.view.height = 4;
  DirectUnoccludedSettings more = d, seeded = d;
  more.samples = d.samples + 1;
  seeded.seed = d.seed + 1;
  EXPECT_NE(key(makeDirectUnoccludedNode(d)), key(makeDirectUnoccludedNode(more)));
  EXPECT_NE(key(makeDirectUnoccludedNode(d)), key(makeDirectUnoccludedNode(seeded)));
  VisibilitySettings v, moreRays, seededRays;
  moreRays.samples = v.samples + 1;
  seededRays.seed = v.seed + 1;
  EXPECT_NE(key(makeVisibilityNode(v)), key(makeVisibilityNode(moreRays)));
  EXPECT_NE(key(makeVisibilityNode(v)), key(makeVisibilityNode(seededRays)));
  PathTracerSettings p;
  p.width = p.height = 4;
  EXPECT_NE(key(makePathTraceNode(p, 2)), key(makePathTraceNode(p, 4)));
  EXPECT_NE(key(makePathTraceNode(p, 2)), key(makePathTraceNode(p, 1)));
}

TEST(PathTraceNode, AStateOfMoreBlocksThanAskedForIsNotTakenOver) {
  tests::SceneMaker m;
  m.instance(m.mesh(tests::ground(1.0f), m.material(Vec3(0.5f))));
  LightShape lamp;
  lamp.kind = LightKind::Sphere;
  lamp.position = Vec3(0, 1, 0);
  lamp.radius = 0.3f;
  m.light(lamp, Vec3(3.0f));
  m.camera(Vec3(0, 2, 1), Vec3(0.0f));
  const ScenePtr scene = m.finish();
  PathTracerSettings s;
  s.camera = scene->cameras[0];
  s.width = 8;
  s.height = 6;
  s.groupOf = {0};
  s.nominal = {Vec3(1.0f)};
  const NodePtr node = makePathTraceNode(s);
  AccelCache accels;
  const TaskArena arena(2);
  const std::vector<int> lights{0};
  const SceneView view(*scene, node->traits().facets, lights);
  const auto run = [&](uint32_t blocks, TermPtr previous) {
    RunCounters counters;
    RunContext ctx;
    ctx.scene = &view;
    ctx.arena = &arena;
    ctx.accels = &accels;
    ctx.counters = &counters;
    ctx.targetBlocks = blocks;
    ctx.previous = std::move(previous);
    const auto made = runNode(*node, ctx);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return made.ok() ? *made : nullptr;
  };
  const TermPtr two = run(2, nullptr), four = run(4, nullptr);
  EXPECT_NE(two->content(), four->content());
  EXPECT_EQ(run(4, two)->content(), four->content());
  EXPECT_EQ(run(2, four)->content(), two->content()) << "four blocks were sold as two";
}

}  // namespace
}  // namespace gobo
