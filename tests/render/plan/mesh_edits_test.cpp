// SPDX-License-Identifier: Apache-2.0
// request.meshes: edited objects against scenes whose meshes were edited by hand, who shares a mesh with whom, lights, poses, keys, and what is refused.
#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <set>

#include "request/effective_scene.h"
#include "request/mesh_edits.h"
#include "request/posed_scene.h"
#include "scene/builtin/build.h"
#include "scene/edit.h"
#include "scene/mesh_filters/mesh_filters.h"
#include "support/animated_scene.h"
#include "support/engines.h"
#include "support/stopping.h"

namespace gobo::testing {
namespace mesh_edits_test {

/// A floor, three balls of one mesh (one twice as large), a box that shines, a lamp.
ScenePtr room() {
  builtin::SceneBuilder b("room");
  builtin::MeshBuilder m;
  const int white = b.material("white", Vec3(0.7f)), lamp = b.material("glow", Vec3(0.0f));
  b.at(lamp).emission.radiance = Vec3(2, 1, 0.5f);
  m.quad(Vec3(-3, 0, 3), Vec3(6, 0, 0), Vec3(0, 0, -6), 4, 4);
  b.add("floor", m, white);
  m.sphere(Vec3(0.0f), 0.4f, 24, 12);
  const int ball = b.mesh(m, "ball", white);
  b.instance("ball", ball, builtin::translate(Vec3(-0.9f, 0.4f, 0)));
  b.instance("my ball.001", ball, builtin::translate(Vec3(0.1f, 0.4f, 0)) * builtin::rotateY(1.0f));
  b.instance("large", ball, builtin::translate(Vec3(1.4f, 0.8f, -0.5f)) * builtin::scale(Vec3(2.0f)));
  m.box(Vec3(0, 2.2f, 0), Vec3(0.3f, 0.1f, 0.2f));
  b.add("shine", m, lamp, false);
  b.point("lamp", Vec3(1, 3, 2), Vec3(12.0f));
  b.camera("front", Vec3(0, 1.4f, 5), Vec3(0, 0.8f, 0), 40.0f);
  return *b.finish();
}

v1::RenderRequest edits(std::initializer_list<const char*> assignments) {
  v1::RenderRequest r;
  for (const char* a : assignments) set(r, a);
  return r;
}

ScenePtr edited(const ScenePtr& scene, std::initializer_list<const char*> assignments) {
  const auto made = withMeshEdits(scene, edits(assignments));
  EXPECT_TRUE(made.ok()) << made.status().toString();
  return made.ok() ? *made : scene;
}

MeshPtr meshOf(const ScenePtr& scene, const char* object) { return scene->meshes[size_t(scene->instances[size_t(scene->findInstance(object))].mesh)]; }

/// Scenes of this process by the name of an empty file.
struct HandMade final : SceneLoader {
  std::map<std::string, ScenePtr> scenes;
  Result<LoadedScene> scene(const std::string& path, const StopToken&) override { return LoadedScene{scenes.at(std::filesystem::path(path).filename()), {}}; }
  Result<EnvironmentPtr> environment(const std::string& path, const StopToken&) override { return notFound("none", path); }
};

struct MeshEdits : ::testing::Test {
  std::filesystem::path folder = std::filesystem::temp_directory_path() / ("gobo-mesh-edits-" + std::to_string(::getpid()));
  std::shared_ptr<HandMade> loader = std::make_shared<HandMade>();
  std::unique_ptr<Engine> engine;
  void SetUp() override {
    std::filesystem::create_directories(folder);
    engine = fresh();
    open("room", room());
  }
  void TearDown() override { std::filesystem::remove_all(folder); }
  std::unique_ptr<Engine> fresh() {
    EngineOptions o;
    o.loader = loader;
    o.threads = 2;
    o.storeBytes = 256ull << 20;
    o.anyPath = true;
    return std::move(*Engine::create(o));
  }
  void open(const std::string& name, const ScenePtr& scene) {
    std::ofstream(folder / name).close();
    loader->scenes[name] = scene;
    const auto opened = engine->openScene((folder / name).string(), name);
    ASSERT_TRUE(opened.ok()) << opened.status().toString();
  }
  v1::RenderRequest request(const std::string& scene = "room") const {
    v1::RenderRequest r = smallRequest(scene, 32, 24, 4);
    set(r, "outputs=beauty,normal,object_id,visibility:lamp");
    set(r, "lights.lamp.shadow.ray_traced.samples=1");
    return r;
  }
};

/// A relight of `result` by one assignment.
RenderResult relit(Engine& engine, const RenderResult& result, const std::string& assignment) {
  v1::RelightRequest relight;
  relight.set_render_id(result.reply.render_id());
  set(*relight.mutable_patch(), assignment);
  relight.add_mask(assignment.substr(0, assignment.find('=')));
  const auto request = engine.relightRequest(relight);
  EXPECT_TRUE(request.ok()) << request.status().toString();
  return request.ok() ? mustRender(engine, *request) : RenderResult{};
}

size_t runs(const RenderResult& r) { return nodesBy(r, v1::NodeReport::RUN).size(); }

TEST_F(MeshEdits, EditsOfNothingAreNoEdits) {
  const RenderResult plain = mustRender(*engine, request());
  for (const char* nothing :
       {"meshes.ball.inflate=0", "meshes.ball.cluster=0", "meshes.*.smooth=0", "meshes.*.smooth_step=0.3", "meshes.my ball.001.smoothing=LAPLACIAN"}) {
    v1::RenderRequest r = request();
    set(r, nothing);
    const RenderResult same = mustRender(*engine, r);
    EXPECT_EQ(runs(same), 0u) << nothing << ": the keys are those of no edit";
    EXPECT_EQ(firstDifference(plain, same), "") << nothing;
  }
  const ScenePtr scene = room();
  EXPECT_EQ(edited(scene, {"meshes.ball.smooth=5", "meshes.ball.smooth_step=0"}), scene);
  EXPECT_EQ(edited(scene, {}), scene);
}

TEST_F(MeshEdits, AreTheSceneWithTheMeshEditedByHand) {
  const struct {
    std::initializer_list<const char*> assignments;
    MeshFilter filter;
  } cases[] = {{{"meshes.large.inflate=0.125"}, {0, 0, MeshSmoothing::Taubin, 0.5, 0.125}},
               {{"meshes.large.smooth=6", "meshes.large.smoothing=LAPLACIAN", "meshes.large.smooth_step=0.25"}, {0, 6, MeshSmoothing::Laplacian, 0.25, 0}},
               {{"meshes.large.cluster=0.3", "meshes.large.smooth=2", "meshes.large.inflate=-0.05"}, {0.3, 2, MeshSmoothing::Taubin, 0.5, -0.05}}};
  int k = 0;
  for (const auto& [assignments, filter] : cases) {
    const ScenePtr byHand = *editScene(*room(), [&](Scene& s) -> Status {
      Instance& large = s.instances[size_t(s.findInstance("large"))];
      MeshFilter f = filter;
      f.stretch = stretchOf(large.toWorld);
      s.meshes.push_back(filterMesh(s.meshes[size_t(large.mesh)], f)->mesh);
      large.mesh = int(s.meshes.size()) - 1;
      return {};
    });
    const std::string name = "hand" + std::to_string(k++);
    open(name, byHand);
    v1::RenderRequest r = request();
    for (const char* a : assignments) set(r, a);
    const RenderResult plain = mustRender(*engine, request()), made = mustRender(*engine, r), hand = mustRender(*engine, request(name));
    EXPECT_NE(firstDifference(plain, made), "");
    EXPECT_EQ(firstDifference(made, hand), "");
    EXPECT_EQ(runs(hand), 0u) << "one recipe, so one key";
  }
}

TEST_F(MeshEdits, AreOfTheirObjectAlone) {
  const ScenePtr scene = room();
  const ScenePtr one = edited(scene, {"meshes.my ball.001.inflate=0.1"});
  EXPECT_EQ(meshOf(one, "ball"), meshOf(scene, "ball"));
  EXPECT_EQ(meshOf(one, "large"), meshOf(scene, "large"));
  EXPECT_NE(meshOf(one, "my ball.001"), meshOf(scene, "ball"));
  EXPECT_EQ(meshOf(one, "floor"), meshOf(scene, "floor"));
  EXPECT_EQ(one->meshes.size(), scene->meshes.size() + 1);
  EXPECT_EQ(one->instances.size(), scene->instances.size());

  // Two of one size share the new mesh; that of twice the size has another, since metres are the world's.
  const ScenePtr all = edited(scene, {"meshes.*.inflate=0.1"});
  EXPECT_EQ(meshOf(all, "ball"), meshOf(all, "my ball.001"));
  EXPECT_NE(meshOf(all, "ball"), meshOf(all, "large"));
  EXPECT_NE(meshOf(all, "floor"), meshOf(scene, "floor"));
  EXPECT_NEAR(glm::length(meshOf(all, "large")->positions[30]), 0.45f, 1e-3f);
  EXPECT_NEAR(glm::length(meshOf(all, "ball")->positions[30]), 0.5f, 1e-3f);

  // An entry of its own stands for '*', also an empty one. A mesh that all its objects change is changed in its place.
  const ScenePtr but = edited(scene, {"meshes.*.inflate=0.1", "meshes.floor.inflate=0", "meshes.large.inflate=0.2"});
  EXPECT_EQ(meshOf(but, "floor"), meshOf(scene, "floor"));
  EXPECT_EQ(meshOf(but, "ball"), meshOf(but, "my ball.001"));
  EXPECT_NEAR(glm::length(meshOf(but, "large")->positions[30]), 0.5f, 1e-3f);
  EXPECT_EQ(edited(scene, {"meshes.floor.inflate=0.1"})->meshes.size(), scene->meshes.size());
  // Facets: inflation is a pose, and simplification other triangles too.
  const auto same = [&](const ScenePtr& a, Facet f) { return a->facetHash(f, {}) == scene->facetHash(f, {}); };
  EXPECT_TRUE(same(edited(scene, {"meshes.floor.inflate=0.1"}), Facet::Topology));
  EXPECT_FALSE(same(edited(scene, {"meshes.floor.inflate=0.1"}), Facet::Pose));
  EXPECT_FALSE(same(edited(scene, {"meshes.floor.cluster=3"}), Facet::Topology));
}

TEST_F(MeshEdits, LightsOfObjectsFollowTheirMesh) {
  v1::RenderRequest r = request();
  for (const char* a : {"meshes.shine.inflate=0.2", "outputs=beauty,direct,emission"}) set(r, a);
  const ScenePtr byHand = *editScene(*room(), [&](Scene& s) -> Status {
    MeshFilter f;
    f.inflate = 0.2;
    const size_t mesh = size_t(s.instances[size_t(s.findInstance("shine"))].mesh);
    s.meshes[mesh] = filterMesh(s.meshes[mesh], f)->mesh;
    return {};
  });
  open("hand", byHand);
  v1::RenderRequest hand = r;
  hand.set_scene("hand");
  hand.clear_meshes();
  const RenderResult made = mustRender(*engine, r);
  EXPECT_EQ(firstDifference(made, mustRender(*engine, hand)), "");
  // Relighting it is a gain, and what a cold engine makes.
  const RenderResult warm = relit(*engine, made, "lights.shine.gain=0,1,2");
  for (const auto& [node, report] : nodesBy(warm, v1::NodeReport::RUN)) EXPECT_EQ(node.find("path"), std::string::npos) << node;
  set(r, "lights.shine.gain=0,1,2");
  engine = fresh();
  open("room", room());
  EXPECT_EQ(firstDifference(warm, mustRender(*engine, r)), "");
}

TEST_F(MeshEdits, AnEditRunsWhatDependsOnShapes) {
  const RenderResult plain = mustRender(*engine, request());
  const size_t everything = runs(plain);
  v1::RenderRequest r = request();
  for (const char* edit : {"meshes.ball.inflate=0.1", "meshes.ball.inflate=0.2", "meshes.ball.cluster=0.1", "meshes.ball.smooth=3",
                           "meshes.ball.smoothing=LAPLACIAN", "meshes.ball.smooth_step=0.6"}) {
    set(r, edit);
    EXPECT_EQ(runs(mustRender(*engine, r)), everything) << edit;
    EXPECT_EQ(runs(mustRender(*engine, r)), 0u) << edit << " again";
  }
  // The same objects by other words have the same keys; a relight that edits meshes, and takes the edit back, is a render of that.
  v1::RenderRequest star = request();
  for (const char* a : {"meshes.*.inflate=0.1", "meshes.floor.inflate=0", "meshes.my ball.001.smooth=0", "meshes.large.cluster=0", "meshes.shine.inflate=0"})
    set(star, a);
  EXPECT_EQ(runs(mustRender(*engine, star)), 0u);
  const RenderResult warm = relit(*engine, plain, "meshes.ball.inflate=0.1");
  EXPECT_EQ(runs(warm), 0u);
  EXPECT_EQ(firstDifference(warm, mustRender(*engine, star)), "");
}

TEST_F(MeshEdits, NumbersHaveCurves) {
  v1::RenderRequest curve = request(), value = request();
  for (const char* a : {"time_s=0.5", "curves.meshes.my ball.001.inflate.time_s=0,1", "curves.meshes.my ball.001.inflate.value=0,0.25"}) set(curve, a);
  for (const char* a : {"time_s=0.5", "meshes.my ball.001.inflate=0.125"}) set(value, a);
  EXPECT_EQ(firstDifference(mustRender(*engine, curve), mustRender(*engine, value)), "");
}

TEST_F(MeshEdits, BadOnesAreRefusedByName) {
  const struct {
    std::initializer_list<const char*> assignments;
    const char *field, *says;
  } cases[] = {
      {{"meshes.bal.inflate=0.1"}, "request.meshes.bal", "did you mean 'ball'"},
      {{"meshes.my ball.002.inflate=0"}, "request.meshes.my ball.002", "did you mean 'my ball.001'"},
      {{"meshes.ball.cluster=5"}, "request.meshes.ball.cluster", "cluster = 5: leaves no triangle of 'ball', which is 0.8"},
      {{"meshes.ball.cluster=nan"}, "request.meshes.ball.cluster", "must be a finite number"},
      {{"meshes.ball.inflate=inf"}, "request.meshes.ball.inflate", "must be a finite number"},
      {{"meshes.ball.cluster=-1"}, "request.meshes.ball.cluster", "must be at least 0"},
      {{"meshes.ball.smooth=1001"}, "request.meshes.ball.smooth", "must be at most 1000"},
      {{"meshes.ball.smooth_step=1.5"}, "request.meshes.ball.smooth_step", "must be at most 1"},
      {{"meshes.*.smooth=1", "meshes.*.smooth_step=0.7"}, "request.meshes.*.smooth_step", "smooth_step = 0.7: must be at most 0.69 for TAUBIN"},
      {{"meshes.ball.smooth=100", "meshes.ball.smooth_step=1", "meshes.ball.smoothing=LAPLACIAN"}, "", ""},  // shrinks, and is still there
      {{"meshes.*.inflate=1e9"}, "request.meshes.*.inflate", "moves a vertex of 'ball' more than 1e9 m"},
  };
  for (const auto& [assignments, field, says] : cases) {
    v1::RenderRequest r = request();
    for (const char* a : assignments) set(r, a);
    const auto result = engine->render(r);
    if (!*field) {
      EXPECT_TRUE(result.ok()) << result.status().toString();
      continue;
    }
    ASSERT_FALSE(result.ok()) << field;
    EXPECT_TRUE(result.status().code() == Code::InvalidArgument || result.status().code() == Code::NotFound) << result.status().toString();
    EXPECT_EQ(result.status().location(), field) << result.status().toString();
    EXPECT_NE(result.status().message().find(says), std::string::npos) << result.status().toString();
  }
}

// What a request may cost before it is admitted has a bound.
TEST_F(MeshEdits, WorkIsBounded) {
  const ScenePtr plain = room(), scene = *editScene(*plain, [&](Scene&s) -> Status {
                                   MeshPtr& shine = s.meshes[size_t(s.instances[size_t(s.findInstance("shine"))].mesh)];
                                   auto fine = std::make_shared<Mesh>(*shine);
                                   std::vector<uint32_t> indices(3 * 1'000'001);
                                   for (size_t i = 0; i < indices.size(); ++i) indices[i] = uint32_t(i % 3);
                                   fine->indices = Array<uint32_t>(std::move(indices));
                                   sealMesh(*fine);
                                   shine = fine;
                                   return {};
                                 });
  const auto refused = withMeshEdits(scene, edits({"meshes.shine.smooth=1000"}));
  EXPECT_EQ(refused.status().location(), "request.meshes.shine.smooth") << refused.status().toString();
  EXPECT_EQ(refused.status().code(), Code::InvalidArgument);
}

/// `objects` of one ball of 20 448 triangles, `unused` vertices more; each larger than the last by `step`.
ScenePtr manyBalls(int objects, double step, size_t unused = 0) {
  builtin::SceneBuilder b("many");
  builtin::MeshBuilder m;
  m.sphere(Vec3(0.0f), 0.4f, 144, 72);
  const int ball = b.mesh(m, "ball", b.material("white", Vec3(0.7f)));
  for (int i = 0; i < objects; ++i)
    b.instance("ball" + std::to_string(i), ball,
               builtin::translate(Vec3(2.0f * float(i % 50), 0, 2.0f * float(i / 50))) * builtin::scale(Vec3(float(1 + step * i))));
  b.point("lamp", Vec3(1, 3, 2), Vec3(12.0f));
  b.camera("front", Vec3(0, 1.4f, 5), Vec3(0, 0.8f, 0), 40.0f);
  const ScenePtr scene = *b.finish();
  if (unused == 0) return scene;
  return *editScene(*scene, [&](Scene& s) -> Status {
    auto wide = std::make_shared<Mesh>(*s.meshes[size_t(ball)]);
    wide->indices = Array<uint32_t>(std::vector<uint32_t>(wide->indices.begin(), wide->indices.begin() + 300));
    wide->positions.resize(wide->positions.size() + unused, Vec3(0.1f));
    wide->normals.resize(wide->positions.size(), Vec3(0, 1, 0));
    for (Array<Vec2>& set : wide->uv)
      if (!set.empty()) set.resize(wide->positions.size());
    sealMesh(*wide);
    s.meshes[size_t(ball)] = wide;
    return {};
  });
}

/// What it takes is counted in looks at the stop token: every mesh that is made looks at it more than ten times.
TEST_F(MeshEdits, ManyScalesOfOneMeshAreRefusedBeforeTheyAreMade) {
  constexpr int kObjects = 3000;
  const auto refused = [&](const ScenePtr& scene, std::initializer_list<const char*> assignments, Code code, const std::string& field, const char* says) {
    SCOPED_TRACE(field);
    const int polls = gobo::tests::pollsOf([&](const StopToken& stop) {
      const Status s = withMeshEdits(scene, edits(assignments), stop).status();
      EXPECT_EQ(s.code(), code) << s.toString();
      EXPECT_EQ(s.location(), "request.meshes." + field) << s.toString();
      EXPECT_NE(s.message().find(says), std::string::npos) << s.toString();
    });
    EXPECT_LE(polls, kObjects / 1000 + 1);
  };
  const ScenePtr scales = manyBalls(kObjects, 1.0 / kObjects);
  ASSERT_GE(scales->meshes[0]->triangles(), 20000u);
  refused(scales, {"meshes.*.inflate=0.01"}, Code::InvalidArgument, "*.inflate", "inflate = 0.01: with it 1223 meshes");
  refused(scales, {"meshes.*.cluster=0.01"}, Code::InvalidArgument, "*.cluster", "cluster = 0.01");
  refused(scales, {"meshes.*.smooth=2"}, Code::InvalidArgument, "*.smooth", "smooth = 2");
  refused(scales, {"meshes.*.smooth=2", "meshes.*.inflate=0.01"}, Code::InvalidArgument, "*.inflate", "inflate = 0.01");
  refused(scales, {"meshes.*.smooth=100", "meshes.*.inflate=0.01"}, Code::InvalidArgument, "*.smooth", "smooth = 100");
  // Few triangles of many vertices: bytes.
  refused(manyBalls(kObjects, 1.0 / kObjects, 50'000), {"meshes.*.inflate=0.01"}, Code::ResourceExhausted, "*.inflate", "MiB; at most 1024 MiB");

  // Of one scale they share one mesh, which is made once.
  const ScenePtr even = manyBalls(kObjects, 0.0);
  const ScenePtr fat = edited(even, {"meshes.*.inflate=0.01", "meshes.ball7.inflate=0"});
  EXPECT_NE(meshOf(fat, "ball0"), meshOf(even, "ball0"));
  EXPECT_EQ(meshOf(fat, "ball0"), meshOf(fat, "ball2999"));
  EXPECT_EQ(meshOf(fat, "ball7"), meshOf(even, "ball7"));
  EXPECT_EQ(fat->meshes.size(), even->meshes.size() + 1);
  // What is not edited, or hidden, costs nothing.
  EXPECT_NE(meshOf(edited(scales, {"meshes.ball7.inflate=0.01"}), "ball7"), meshOf(scales, "ball7"));
  const ScenePtr hidden = *editScene(*scales, [](Scene& s) -> Status {
    for (size_t i = 1; i < s.instances.size(); ++i) s.instances[i].toWorld = builtin::scale(Vec3(1e-10f * float(i)));
    return {};
  });
  EXPECT_NE(meshOf(edited(hidden, {"meshes.*.inflate=0.01"}), "ball0"), meshOf(hidden, "ball0"));
}

// For all objects a side that would leave nothing of the small ones leaves those as they are, and says so.
TEST_F(MeshEdits, WhatWouldVanishWithTheOthersStays) {
  v1::RenderRequest r = request();
  for (const char* a : {"meshes.*.cluster=1.5", "meshes.*.inflate=0.01"}) set(r, a);
  const RenderResult made = mustRender(*engine, r);
  std::string warning;
  for (const std::string& w : made.reply.warnings())
    if (w.find("request.meshes.*.cluster = 1.5") != std::string::npos) warning = w;
  EXPECT_NE(warning.find("ball, my ball.001"), std::string::npos) << warning;
  EXPECT_EQ(warning.find("floor"), std::string::npos) << warning;
  const ScenePtr scene = edited(room(), {"meshes.*.cluster=1.5", "meshes.*.inflate=0.01"});
  EXPECT_EQ(meshOf(scene, "ball")->triangles(), meshOf(room(), "ball")->triangles());
  EXPECT_NEAR(glm::length(meshOf(scene, "ball")->positions[30]), 0.41f, 1e-3f) << "inflated all the same";
}

TEST_F(MeshEdits, ComeAfterThePoseInMetresOfTheWorld) {
  const std::string file = writeAnimatedScene("mesh-edits");
  const ScenePtr loaded = *loadScene(file);
  const auto at = [&](double t, std::initializer_list<const char*> assignments) {
    v1::RenderRequest r = edits(assignments);
    r.set_time_s(t);
    const auto scene = requestedScene(loaded, r);
    EXPECT_TRUE(scene.ok()) << scene.status().toString();
    return *scene;
  };
  // "board" is scaled by 0.3 and slides: its mesh stays the same while it does, and 0.06 m of the world are 0.2 of its own.
  const ScenePtr early = at(0.25, {"meshes.board.inflate=0.06"}), late = at(0.75, {"meshes.board.inflate=0.06"});
  EXPECT_EQ(meshOf(early, "board")->positionsHash, meshOf(late, "board")->positionsHash);
  EXPECT_NE(early->hash(), late->hash());
  EXPECT_NEAR(meshOf(early, "board")->positions[0].y, 0.2f, 1e-5f);
  EXPECT_EQ(meshOf(early, "floor"), loaded->meshes[size_t(loaded->instances[0].mesh)]);

  // What was made for a request is there for the next; edits of nothing are the pose.
  PosedScenes posed;
  v1::RenderRequest a = edits({"meshes.board.inflate=0.06"}), b = edits({"meshes.board.inflate=0.07"});
  const ScenePtr once = *posed.get(loaded, a, {});
  EXPECT_EQ(*posed.get(loaded, a, {}), once);
  EXPECT_NE((*posed.get(loaded, b, {}))->hash(), once->hash());
  EXPECT_EQ(*posed.get(loaded, edits({"meshes.board.inflate=0"}), {}), loaded);
  const long users = loaded.use_count();
  (void)posed.get(loaded, edits({"meshes.board.smooth=0"}), {});
  EXPECT_EQ(loaded.use_count(), users) << "a scene that nobody renders may be unloaded";

  // Motion of an edited object is that of the object.
  engine = makeEngine();
  ASSERT_TRUE(engine->openScene(file, "animated").ok());
  v1::RenderRequest r = smallRequest("animated", 24, 16, 1);
  for (const char* s : {"outputs=motion", "time_s=0.5", "motion_step_s=0.25", "meshes.board.cluster=0.0001"}) set(r, s);
  const RenderResult made = mustRender(*engine, r);
  r.clear_meshes();
  EXPECT_EQ(firstDifference(made, mustRender(*engine, r)), "");
  std::filesystem::remove_all(std::filesystem::path(file).parent_path());
}

// Without a time nothing is posed: what a pose would be refused for is no fault of such a request. An animation's name is looked at.
TEST_F(MeshEdits, PosesNobodyAskedForDoNotMatter) {
  const std::filesystem::path file = writeAnimatedScene("mesh-edits-far");
  {
    std::fstream keys(file.parent_path() / "data.bin", std::ios::binary | std::ios::in | std::ios::out);
    const float far = 2e9f;  // x of the first key of "slide": farther than a scene reaches
    keys.seekp(14 * sizeof(float));
    keys.write(reinterpret_cast<const char*>(&far), sizeof far);
  }
  const ScenePtr loaded = *loadScene(file.string());
  for (const char* assignment : {"variant=red", "animation=slide", "meshes.board.inflate=0.06"}) {
    const auto rest = requestedScene(loaded, edits({assignment}));
    EXPECT_TRUE(rest.ok()) << assignment << ": " << rest.status().toString();
    v1::RenderRequest posed = edits({assignment});
    posed.set_time_s(0.0);
    const Status far = requestedScene(loaded, posed).status();
    EXPECT_EQ(far.code(), Code::InvalidArgument) << assignment;
    EXPECT_EQ(far.location(), "request.time_s") << far.toString();
    posed.set_time_s(1.0);
    EXPECT_TRUE(requestedScene(loaded, posed).ok()) << assignment;
  }
  EXPECT_EQ(*requestedScene(loaded, edits({"animation=slide"})), loaded);
  for (const bool timed : {false, true}) {
    v1::RenderRequest unknown = edits({"animation=jump"});
    if (timed) unknown.set_time_s(1.0);
    const Status none = requestedScene(loaded, unknown).status();
    EXPECT_EQ(none.code(), Code::NotFound);
    EXPECT_EQ(none.location(), "request.animation");
    EXPECT_NE(none.message().find("slide"), std::string::npos) << none.toString();
  }
  std::filesystem::remove_all(file.parent_path());
}

// Animations hide objects by scaling them to nothing: what they hide does not come back by inflation, nor is it an error to simplify it.
TEST_F(MeshEdits, HiddenObjectsStayHidden) {
  const ScenePtr hidden = *editScene(*room(), [](Scene& s) -> Status {
    s.instances[size_t(s.findInstance("ball"))].toWorld = builtin::scale(Vec3(1e-9f));
    return {};
  });
  EXPECT_EQ(meshOf(edited(hidden, {"meshes.ball.inflate=0.1", "meshes.ball.cluster=0.1"}), "ball"), meshOf(hidden, "ball"));
}

TEST_F(MeshEdits, StopAnywhere) {
  const ScenePtr scene = room();
  const v1::RenderRequest r = edits({"meshes.*.inflate=0.1", "meshes.*.cluster=0.05", "meshes.*.smooth=3"});
  const int polls = gobo::tests::pollsOf([&](const StopToken& s) { ASSERT_TRUE(withMeshEdits(scene, r, s).ok()); });
  EXPECT_GE(polls, 50);
  for (int k = 1; k <= polls; k += 1 + polls / 20) EXPECT_EQ(withMeshEdits(scene, r, gobo::tests::stopAt(k)).status().code(), Code::Cancelled) << k;
}

}  // namespace mesh_edits_test
}  // namespace gobo::testing
