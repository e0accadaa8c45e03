// SPDX-License-Identifier: Apache-2.0
// The median against sorting, on every device, and in a picture: lamps by one shadow ray a view sample, with the median and without, against many rays.
#include "render/examples/median_of_visibility/median_of_visibility.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "base/sobol.h"
#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"
#include "filters/composite.h"
#include "plan/disk_store.h"
#include "plan/executor.h"
#include "plan/planner.h"
#include "support/engines.h"
#include "technique/plan_context.h"
#include "techniques/direct_visibility/visibility.h"
#include "techniques/path_traced/technique.h"
#include "trace/accel.h"

namespace gobo::testing {
namespace {

struct Inputs {
  Extent extent{41, 23, 2};
  std::shared_ptr<Term> v = std::make_shared<Term>("visibility", Domain::ViewSample, extent);
  std::shared_ptr<Term> gbuffer = std::make_shared<Term>("gbuffer", Domain::ViewSample, extent);
  Inputs() {
    const auto values = v->addPlane<float>("V");
    const auto instance = gbuffer->addPlane<uint32_t>("instance");
    for (size_t e = 0; e < values.size(); ++e) {
      values[e] = float(hash64(7, e) >> 40) / float(1 << 24);
      instance[e] = uint32_t(e % size_t(extent.width) / 5 % 3);  // stripes
    }
  }
  TermPtr run(std::shared_ptr<ComputeDevice> device = nullptr) const {
    TaskArena arena(2);
    RunContext ctx;
    ctx.arena = &arena;
    ctx.inputs = {v, gbuffer};
    const auto made = runNode(*makeMedianNode(extent, std::move(device)), ctx);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return made.ok() ? *made : nullptr;
  }
};

TEST(MedianOfVisibility, IsTheFifthOfNineSorted) {
  const Inputs in;
  const TermPtr made = in.run();
  ASSERT_TRUE(made);
  const auto v = in.v->floats("V"), out = made->floats("V");
  const auto instance = in.gbuffer->plane<uint32_t>("instance");
  const Extent& e = in.extent;
  const auto index = [&](int x, int y, int layer) { return size_t((layer * e.height + y) * e.width + x); };
  for (int layer = 0; layer < e.layers; ++layer)
    for (int y = 0; y < e.height; ++y)
      for (int x = 0; x < e.width; ++x) {
        std::vector<float> nine;
        for (int k = 0; k < 9; ++k) {
          const int nx = x + k % 3 - 1, ny = y + k / 3 - 1;
          const bool inside = nx >= 0 && nx < e.width && ny >= 0 && ny < e.height;
          const size_t other = inside ? index(nx, ny, layer) : index(x, y, layer);
          nine.push_back(v[instance[other] == instance[index(x, y, layer)] ? other : index(x, y, layer)]);
        }
        std::sort(nine.begin(), nine.end());
        ASSERT_EQ(out[index(x, y, layer)], nine[4]) << x << "," << y << "," << layer;
      }
}

TEST(MedianOfVisibility, DevicesGiveTheSameBits) {
  const Inputs in;
  const TermPtr cpu = in.run();
  const auto vulkan = VulkanDevice::shared();
  const auto egl = EglDevice::shared();
  int ran = 0;
  for (const std::shared_ptr<ComputeDevice>& device :
       {vulkan.ok() ? std::shared_ptr<ComputeDevice>(*vulkan) : nullptr, egl.ok() ? std::shared_ptr<ComputeDevice>(*egl) : nullptr}) {
    if (!device) continue;
    ++ran;
    const TermPtr made = in.run(device);
    ASSERT_TRUE(made);
    EXPECT_EQ(made->content(), cpu->content()) << device->name();
  }
  EXPECT_GT(ran, 0) << "deploy/install-deps brings lavapipe and llvmpipe, which need no GPU";
}

TEST(MedianOfVisibility, SaysWhatItReads) {
  const Inputs in;
  const std::array<TermShape, 2> right{shapeOf(*in.v), shapeOf(*in.gbuffer)}, swapped{right[1], right[0]};
  EXPECT_TRUE(makeMedianNode(in.extent)->infer(right).ok());
  EXPECT_EQ(makeMedianNode(in.extent)->infer(swapped).status().message(), "median_of_visibility reads a plane V that input 0 (gbuffer) has not");
  EXPECT_FALSE(makeMedianNode({41, 23, 1})->infer(right).ok());
}

/// Front light of the lamp by `rays` shadow rays a view sample, then the median of them or not.
class LampBy final : public Technique {
 public:
  LampBy(uint32_t rays, bool median) : median_(median) { shadow_.mutable_ray_traced()->set_samples(rays); }
  const char* name() const override { return "lamp_by"; }
  Status claim(PlanContext& c) const override { return c.cover().claim(c.scene()->findLight("lamp"), PathSet::Front, name()); }
  Status plan(PlanContext& c) const override {
    const int lamp = c.scene()->findLight("lamp"), group = c.groups().groupOf[size_t(lamp)];
    GOBO_TRY(c.cover().bring(lamp, PathSet::Front, name()));
    const GBufferSettings& view = c.view();
    const NodeId light = planUnoccluded(c, lamp, c.scene(), c.groups().nominal[size_t(lamp)]);
    GOBO_ASSIGN(NodeId visible, planVisibility(c, lamp, c.scene(), shadow_));
    if (median_) visible = c.filter(makeMedianNode(view.extent()), {visible, c.gbuffer()}, "median:lamp");
    c.add({c.filter(makeShadeNode(view.width, view.height, view.viewSamples), {light, visible}, "direct:lamp"), "rgb", c.groupGain(group), PathSet::Front,
           group});
    return {};
  }

 private:
  v1::ShadowTechnique shadow_;
  bool median_;
};

TEST(MedianOfVisibility, TakesNoiseFromAPenumbra) {
  const auto engine = makeEngine(256ull << 20, {}, 2);
  v1::RenderRequest r = smallRequest("spheres", 64, 48, 1);
  for (const char* a : {"lights.lamp.kind=RECT", "lights.lamp.position=1,3,1", "lights.lamp.direction=-0.3,-1,-0.3", "lights.lamp.intensity=6",
                        "integrator.indirect=false", "outputs=beauty"})
    set(r, a);
  const auto request = engine->resolve(r);
  ASSERT_TRUE(request.ok() && engine->inspectScene("spheres").ok());
  const auto picture = [&](const LampBy& lamp) {
    TaskArena arena(2);
    TermStore store{256ull << 20};
    ExtensionIndex extensions;
    AccelCache accels;
    const std::array<const Technique*, 2> both{&pathTraced(), &lamp};
    PlannerServices services;
    services.techniques = both;
    services.expand = [&](const Graph& graph, NodeId node) { return Executor(graph, {&store, &extensions, &accels, &arena}, {}).evaluate(node); };
    const auto plan = makePlan(*engine->scene("spheres"), *request, 1, services);
    EXPECT_TRUE(plan.ok()) << plan.status().toString();
    const auto made = Executor((*plan)->graph, {&store, &extensions, &accels, &arena}, {}).evaluate((*plan)->outputs.at(0).node);
    EXPECT_TRUE(made.ok()) << made.status().toString();
    return *made;
  };
  const TermPtr truth = picture({256, false}), noisy = picture({1, false}), filtered = picture({1, true});
  const auto error = [&](const Term& t) {
    double sum = 0;
    for (size_t i = 0; i < t.floats("rgb").size(); ++i) sum += std::pow(double(t.floats("rgb")[i]) - truth->floats("rgb")[i], 2);
    return std::sqrt(sum / double(t.floats("rgb").size()));
  };
  std::cout << "rmse of one ray a sample " << error(*noisy) << ", with the median " << error(*filtered) << std::endl;
  EXPECT_GT(error(*noisy), 0.0);
  EXPECT_LT(error(*filtered), 0.9 * error(*noisy));
}

}  // namespace
}  // namespace gobo::testing
