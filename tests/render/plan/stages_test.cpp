// SPDX-License-Identifier: Apache-2.0
// Stages of what a request asks for, looked at by themselves: a term after some of its filters, and the distance that a style's transfer reads.
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "support/engines.h"

namespace gobo::testing {
namespace stages_test {

v1::RenderRequest filtered(std::initializer_list<const char*> more) {
  v1::RenderRequest r = smallRequest("cornell", 24, 20, 2);
  for (const char* a : {"filters[0].gaussian.sigma_px=1.5", "filters[1].gaussian.sigma_px=1", "filters[1].term=indirect", "filters[2].sharpen.amount=0.7",
                        "filters[3].median.radius_px=1"})
    set(r, a);
  for (const char* a : more) set(r, a);
  return r;
}

std::vector<float> picture(const RenderResult& r, size_t k = 0) {
  const auto pixels = r.images.at(k).pixels();
  return {pixels.begin(), pixels.end()};
}

/// Stage N is to the bit what the request without the later filters of its term makes, and costs nothing that the whole has not run.
TEST(FilteredStages, AreWhatTheShorterChainMakes) {
  const auto warm = makeEngine();
  const auto whole = mustRender(*warm, filtered({"outputs=beauty"}));
  std::set<std::vector<float>> different{picture(whole)};
  for (const int last : {0, 2, 3}) {
    v1::RenderRequest shorter = filtered({"outputs=beauty"});
    while (shorter.filters_size() > std::max(last + 1, 2)) shorter.mutable_filters()->RemoveLast();  // filters[1] is of a part of the light, before its sum
    const std::string stage = "outputs=filtered:" + std::to_string(last);
    const auto seen = mustRender(*warm, filtered({stage.c_str()}));
    EXPECT_EQ(picture(seen), picture(mustRender(*makeEngine(), shorter))) << last;
    different.insert(picture(seen));
    for (const auto& n : seen.reply.plan()) EXPECT_NE(n.state(), v1::NodeReport::RUN) << stage << " runs " << n.node();
  }
  EXPECT_EQ(different.size(), 3u) << "after the last filter it is the beauty";
  EXPECT_EQ(picture(mustRender(*warm, filtered({"outputs=filtered:1"}))), picture(mustRender(*makeEngine(), filtered({"outputs=indirect"}))))
      << "of its own term";
}

TEST(FilteredStages, ThatAreNoneAreRefusedByName) {
  const auto engine = makeEngine(0);
  const auto refused = [&](const char* output, const char* text) {
    const auto made = engine->render(filtered({output, "filters[4].gaussian.sigma_px=1", "filters[4].term=visibility:light", "shadows.ray_traced.samples=1"}));
    ASSERT_FALSE(made.ok()) << output;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), "request.outputs");
    EXPECT_NE(made.status().message().find(text), std::string::npos) << made.status().toString();
  };
  for (const char* output : {"outputs=filtered:5", "outputs=filtered:-1", "outputs=filtered:1x", "outputs=filtered:", "outputs=filtered:99999999999"})
    refused(output, "elements 0 to 4");
  refused("outputs=filtered", "no output 'filtered'");
  refused("outputs=filtered:4", "visibility:light");
  const auto none = engine->render([] {
    v1::RenderRequest r = smallRequest("cornell", 8, 8, 1);
    set(r, "outputs=filtered:0");
    return r;
  }());
  ASSERT_FALSE(none.ok());
  EXPECT_NE(none.status().message().find("no element"), std::string::npos) << none.status().toString();
}

/// A filter of what a filter makes would go round in a circle: terms are what light is made of.
TEST(FilteredStages, AreNoTermsToBeFiltered) {
  for (const char* term : {"filters[0].term=filtered:1", "filters[0].term=filtered:0", "filters[0].term=shadow_distance:light"}) {
    const auto made = makeEngine(0)->render(filtered({term}));
    ASSERT_FALSE(made.ok()) << term;
    EXPECT_EQ(made.status().code(), Code::InvalidArgument);
    EXPECT_EQ(made.status().location(), "request.filters[0].term");
    EXPECT_NE(made.status().message().find(std::string(term).substr(16)), std::string::npos) << made.status().toString();
  }
}

v1::RenderRequest styled(std::initializer_list<const char*> more) {
  v1::RenderRequest r = smallRequest("cornell", 32, 26, 1);
  for (const char* a : {"lights.lamp.kind=SPOT", "lights.lamp.position=0.2,1.6,0.4", "lights.lamp.direction=0,-1,-0.2", "lights.lamp.intensity=3",
                        "shadows.ray_traced.samples=1", "shadows.style.softness=0", "view_samples=1", "outputs=shadow_distance:lamp,visibility:lamp,alpha"})
    set(r, a);
  for (const char* a : more) set(r, a);
  return r;
}

TEST(ShadowDistance, IsNegativeWhereTheShadowIsAndWhatTheTransferReads) {
  const auto engine = makeEngine();
  const auto plain = mustRender(*engine, styled({}));
  const std::vector<float> D = picture(plain, 0), V = picture(plain, 1), hit = picture(plain, 2);
  size_t dark = 0;
  for (size_t i = 0; i < D.size(); ++i) {
    if (hit[i] == 0.0f) continue;
    ASSERT_EQ(D[i] < 0.0f, V[i] < 0.5f) << i;
    dark += D[i] < 0.0f;
  }
  EXPECT_GT(dark, 20u);
  // Inflated, a neutral transfer is light where the distance exceeds the inflation.
  const auto inflated = mustRender(*engine, styled({"shadows.style.inflation=0.07", "shadows.style.abstraction=0.03"}));
  const std::vector<float> blurred = picture(inflated, 0), W = picture(inflated, 1);
  EXPECT_NE(blurred, D) << "abstraction and all";
  for (size_t i = 0; i < D.size(); ++i) {
    if (hit[i] == 0.0f) continue;
    ASSERT_EQ(W[i], blurred[i] > 0.07f ? 1.0f : 0.0f) << i << " " << blurred[i];
  }
  // A pattern and levels stand before the transfer; a window is cut out.
  EXPECT_EQ(picture(mustRender(*engine, styled({"shadows.style.pattern=HATCHING"}))), D);
  EXPECT_EQ(picture(mustRender(*engine, styled({"shadows.style.levels=3"}))), D) << "of hard visibility every level has the same contour";
  const auto window = mustRender(*engine, styled({"window.x=5", "window.y=4", "window.width=9", "window.height=7"}));
  const std::vector<float> part = picture(window, 0);
  ASSERT_EQ(part.size(), 63u);
  for (size_t y = 0; y < 7; ++y)
    for (size_t x = 0; x < 9; ++x) ASSERT_EQ(part[y * 9 + x], D[(y + 4) * 32 + x + 5]) << x << " " << y;
}

TEST(ShadowDistance, NeedsAStyle) {
  v1::RenderRequest r = styled({"outputs=shadow_distance:lamp"});
  r.mutable_shadows()->clear_style();
  const auto made = makeEngine(0)->render(r);
  ASSERT_FALSE(made.ok());
  EXPECT_EQ(made.status().code(), Code::InvalidArgument);
  EXPECT_EQ(made.status().location(), "request.outputs");
  EXPECT_NE(made.status().message().find("shadows.style"), std::string::npos) << made.status().toString();
}

}  // namespace stages_test
}  // namespace gobo::testing
