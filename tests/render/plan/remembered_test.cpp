// SPDX-License-Identifier: Apache-2.0
// Render ids: the least recently used one is forgotten first.
#include <gtest/gtest.h>

#include "import/load.h"
#include "plan/engine.h"

namespace gobo {
namespace {

TEST(Remembered, AnIdThatIsRelitFromAgainAndAgainStays) {
  EngineOptions options;
  options.loader = inProcessLoader();
  options.threads = 1;
  options.keepRenders = 3;
  auto engine = Engine::create(options);
  ASSERT_TRUE(engine.ok());
  v1::RenderRequest request;
  request.set_scene("cornell");
  request.set_width(4);
  request.set_height(4);
  request.mutable_halt()->set_spp(1);
  const auto base = (*engine)->render(request);
  ASSERT_TRUE(base.ok()) << base.status().toString();
  request.set_seed(99);
  const auto idle = (*engine)->render(request);
  ASSERT_TRUE(idle.ok());
  v1::RelightRequest relight;
  relight.add_mask("tone_map.exposure");
  for (int k = 0; k < 8; ++k) {  // each leaves an id of its own
    relight.set_render_id(base->reply.render_id());
    relight.mutable_patch()->mutable_tone_map()->set_exposure(0.25 * (k + 1));
    const auto next = (*engine)->relightRequest(relight);
    ASSERT_TRUE(next.ok()) << "relight " << k << ": " << next.status().toString();
    ASSERT_TRUE((*engine)->render(*next).ok());
  }
  relight.set_render_id(idle->reply.render_id());
  EXPECT_EQ((*engine)->relightRequest(relight).status().code(), Code::NotFound);
}

}  // namespace
}  // namespace gobo
