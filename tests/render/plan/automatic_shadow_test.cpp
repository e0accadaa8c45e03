// SPDX-License-Identifier: Apache-2.0
// shadows.auto through the engine: what it picks follows the budget, the plan says so, and the pick keeps its promise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "support/engines.h"

namespace {

using namespace gobo;
using namespace gobo::testing;

struct Pick {
  std::string text;
  double error = 0, ms = 0;
  int candidates = 0;
};
Pick pickOf(const RenderResult& r) {
  Pick pick;
  for (const v1::NodeReport& n : r.reply.plan()) {
    if (n.node().rfind("auto:", 0) != 0) continue;
    ++pick.candidates;
    if (n.reason().find("auto chose it") == std::string::npos) continue;
    pick.text = n.node().substr(n.node().find(": ") + 2);
    std::sscanf(n.reason().c_str(), "auto chose it: expected error %lf in %lf ms", &pick.error, &pick.ms);
  }
  return pick;
}
v1::RenderRequest request(const std::string& light, const std::string& technique, int width = 96, int height = 72) {
  v1::RenderRequest r = smallRequest("fence", width, height);
  r.set_view_samples(1);
  r.add_outputs("visibility:" + light);
  set(r, "shadows." + technique);
  return r;
}
double rmse(const RenderResult& a, const RenderResult& b) {
  const Image &x = a.images[0].image(), &y = b.images[0].image();
  double sum = 0;
  for (size_t i = 0; i < x.data.size(); ++i) sum += (double(x.data[i]) - y.data[i]) * (double(x.data[i]) - y.data[i]);
  return std::sqrt(sum / double(x.data.size()));
}

TEST(AutomaticShadow, ErrorBudgetsBuyBetterPicturesForMoreTime) {
  auto engine = makeEngine();
  const RenderResult truth = mustRender(*engine, request("key", "ray_traced.samples=1024"));
  double lastError = 1, lastMs = 0;
  for (const char* budget : {"0.3", "0.1", "0.04"}) {
    const RenderResult r = mustRender(*engine, request("key", std::string("auto.error=") + budget));
    const Pick pick = pickOf(r);
    ASSERT_GT(pick.candidates, 4);
    EXPECT_LE(pick.error, std::atof(budget)) << pick.text;
    EXPECT_LE(pick.error, lastError);
    EXPECT_GE(pick.ms, lastMs);
    // A probe of 1200 receivers knows the error to some 20 %; the picture counts pixels that face away as right.
    EXPECT_LT(rmse(r, truth), 1.4 * std::atof(budget)) << pick.text;
    lastError = pick.error;
    lastMs = pick.ms;
  }
}

struct Row {
  double error = 0, ms = 0;
  bool judged = false, chosen = false, map = false, softMap = false, filter = false;
};
std::vector<Row> rowsOf(const RenderResult& r) {
  std::vector<Row> rows;
  for (const v1::NodeReport& n : r.reply.plan()) {
    if (n.node().rfind("auto:", 0) != 0) continue;
    Row row;
    row.chosen = n.reason().find("auto chose it") != std::string::npos;
    row.softMap = n.node().find("percentage_closer_soft") != std::string::npos;
    row.filter = n.node().find("axis_aligned") != std::string::npos;
    row.map = n.node().find("percentage_closer") != std::string::npos;
    row.judged = n.reason().find("expected error") != std::string::npos;
    const char* figures = n.reason().c_str() + n.reason().find(": ") + 2;
    if (row.judged) std::sscanf(figures, "expected error %lf in %lf ms", &row.error, &row.ms);
    else std::sscanf(figures, "%lf ms", &row.ms);
    rows.push_back(row);
  }
  return rows;
}

TEST(AutomaticShadow, TheCheapestThatKeepsTheErrorAndTheBestThatKeepsTheTime) {
  auto engine = makeEngine();
  constexpr double kPrinted = 0.051, kDigits = 0.00006;  // figures of the plan are rounded
  int several = 0;
  for (const char* light : {"key", "sun"})
    for (const char* budget : {"0.3", "0.15", "0.08", "0.04"}) {
      const std::vector<Row> rows = rowsOf(mustRender(*engine, request(light, std::string("auto.error=") + budget)));
      const double error = std::atof(budget);
      const auto chosen = std::find_if(rows.begin(), rows.end(), [](const Row& r) { return r.chosen; });
      ASSERT_NE(chosen, rows.end());
      int keep = 0;
      for (const Row& r : rows) keep += r.judged && r.error <= error - kDigits;
      several += keep > 1;
      if (keep == 0) continue;
      EXPECT_LE(chosen->error, error + kDigits) << light << " " << budget;
      for (const Row& r : rows)
        if (r.judged ? r.error <= error - kDigits : !r.softMap && !r.filter) { EXPECT_LE(chosen->ms, r.ms + kPrinted) << light << " " << budget; }
    }
  EXPECT_GE(several, 3) << "there was something to choose";
  for (const char* budget : {"2", "8", "40"}) {
    const std::vector<Row> rows = rowsOf(mustRender(*engine, request("key", std::string("auto.time_ms=") + budget)));
    const auto chosen = std::find_if(rows.begin(), rows.end(), [](const Row& r) { return r.chosen; });
    ASSERT_NE(chosen, rows.end());
    for (const Row& r : rows)
      if (r.judged && r.ms <= std::atof(budget) - kPrinted) { EXPECT_LE(chosen->error, r.error + kDigits) << budget; }
  }
}

/// How many soft maps were judged, and made.
std::pair<int, int> softMaps(const RenderResult& r) {
  int judged = 0, made = 0;
  for (const Row& row : rowsOf(r)) judged += row.softMap && row.judged;
  for (const v1::NodeReport& n : r.reply.plan()) made += n.node().rfind("light_depth_map:", 0) == 0 && n.state() == v1::NodeReport::RUN;
  return {judged, made};
}

// A soft map is made to be judged, which is lost where it does not win.
TEST(AutomaticShadow, SoftMapsAreMadeWhereTheyMayWin) {
  auto engine = makeEngine();
  const auto grids = [&](const char* budget) {
    v1::RenderRequest r = smallRequest("grids", 320, 240);
    r.set_view_samples(1);
    r.add_outputs("visibility:key");
    set(r, std::string("shadows.auto.error=") + budget);
    return mustRender(*engine, r);
  };
  const RenderResult loose = grids("0.25");
  EXPECT_NE(pickOf(loose).text.find("percentage_closer_soft"), std::string::npos) << pickOf(loose).text;
  EXPECT_EQ(softMaps(loose).second, 1) << "the picture's own was that which was judged";
  // Two layers of bars under a wide light: what its corners see is in no map, and the smallest one says so of all.
  const RenderResult tight = grids("0.02");
  EXPECT_EQ(pickOf(tight).text.find("percentage_closer"), std::string::npos) << pickOf(tight).text;
  const auto [judged, made] = softMaps(tight);
  EXPECT_GE(judged, 1);
  EXPECT_LE(judged, 2);
  EXPECT_EQ(made, 0) << "what the looser budget made is in the store";
}

// Two layers of bars under a wide light: penumbras as wide as filters are, in which they need a quarter of the rays.
TEST(AutomaticShadow, FiltersWinWherePenumbrasAreWide) {
  auto engine = makeEngine();
  v1::RenderRequest r = smallRequest("grids", 320, 240);
  r.set_view_samples(1);
  r.add_outputs("visibility:key");
  v1::RenderRequest part = r, named = r, exact = r;
  set(r, "shadows.auto.error=0.03");
  const RenderResult picked = mustRender(*engine, r);
  ASSERT_EQ(pickOf(picked).text, "axis_aligned, 4 rays");
  EXPECT_LE(pickOf(picked).error, 0.03);
  set(named, "shadows.axis_aligned.mean_samples=4");
  EXPECT_EQ(firstDifference(picked, mustRender(*engine, named)), "");
  set(exact, "shadows.ray_traced.samples=256");  // the error of 256 stratified rays is small beside 0.03
  EXPECT_LT(rmse(picked, mustRender(*engine, exact)), 0.03);
  // A part of the picture is judged by the whole of it.
  part.mutable_window()->set_x(200);
  part.mutable_window()->set_y(40);
  part.mutable_window()->set_width(50);
  part.mutable_window()->set_height(60);
  set(part, "shadows.auto.error=0.03");
  EXPECT_EQ(pickOf(mustRender(*engine, part)).text, pickOf(picked).text);
  EXPECT_EQ(pickOf(mustRender(*engine, part)).error, pickOf(picked).error);
}

// What soft maps read is turned from pixel to pixel: in a part of the picture they are judged by the same turns.
TEST(AutomaticShadow, APartOfThePictureJudgesSoftMapsAsTheWholeDoes) {
  const auto said = [](bool part) {
    v1::RenderRequest r = smallRequest("grids", 320, 240);
    r.set_view_samples(1);
    r.add_outputs("visibility:key");
    set(r, "shadows.auto.error=0.25");
    if (part)
      for (const char* a : {"window.x=200", "window.y=40", "window.width=50", "window.height=60"}) set(r, a);
    const RenderResult reply = mustRender(*makeEngine(), r);
    EXPECT_GT(softMaps(reply).first, 0);
    std::vector<std::string> rows;
    for (const v1::NodeReport& n : reply.reply.plan())
      if (n.node().rfind("auto:", 0) == 0) rows.push_back(n.node() + ": " + n.reason());
    return rows;
  };
  EXPECT_EQ(said(true), said(false));
}

// Penumbras on a twentieth of the picture, the rest sharp: a first look of a hundred pixels sees none of them by some seeds.
TEST(AutomaticShadow, ALookThatSeesNoErrorIsNotTheLast) {
  auto engine = makeEngine();
  for (const uint64_t seed : {1, 5, 6}) {
    v1::RenderRequest r = smallRequest("atrium", 640, 480);
    r.set_view_samples(1);
    r.set_seed(seed);
    r.mutable_camera()->set_name("gallery");
    set(r, "lights.sun.angular_size_deg=1");
    r.add_outputs("visibility:sun");
    v1::RenderRequest exact = r;
    set(r, "shadows.auto.error=0.03");
    set(exact, "shadows.ray_traced.samples=64");  // 0.01 of noise: sqrt(0.03^2 + 0.01^2) is 0.032
    EXPECT_LT(rmse(mustRender(*engine, r), mustRender(*engine, exact)), 0.04) << seed << ": with one ray it is 0.08";
  }
}

// Windows cost what some thousand pixels of a filter do: nothing that a small picture, or little time, could pay for.
TEST(AutomaticShadow, FiltersAreJudgedWhereThatCanPay) {
  auto engine = makeEngine();
  const auto nodes = [&](const char* type, const v1::RenderRequest& r) {
    const RenderResult reply = mustRender(*engine, r);
    int n = 0;
    for (const v1::NodeReport& node : reply.reply.plan()) n += node.node().rfind(type, 0) == 0;
    return n;
  };
  EXPECT_EQ(nodes("probe_windows:", request("key", "auto.error=0.03", 48, 36)), 0);
  EXPECT_EQ(nodes("probe_windows:", request("key", "auto.time_ms=8")), 0);
  const v1::RenderRequest timely = request("key", "auto.time_ms=1000");
  const int windows = nodes("probe_windows:", timely);
  EXPECT_GE(windows, 1);
  EXPECT_GT(nodes("window_errors:", timely), windows) << "one set for all counts of rays";
}

TEST(AutomaticShadow, TimeBudgetsAreKept) {
  auto engine = makeEngine();
  for (const char* light : {"key", "sun"}) {
    const Pick pick = pickOf(mustRender(*engine, request(light, "auto.time_ms=8")));
    EXPECT_LE(pick.ms, 8) << pick.text;
    EXPECT_FALSE(pick.text.empty());
  }
}

TEST(AutomaticShadow, HardShadowsAreRaysWhereRaysWin) {
  auto engine = makeEngine();
  v1::RenderRequest automatic = request("sun", "auto.error=0.08", 48, 36), rays = request("sun", "ray_traced.samples=1", 48, 36);
  automatic.set_view_samples(8);  // a small picture, smooth edges: a map of the same error costs more than all its rays
  rays.set_view_samples(8);
  const RenderResult r = mustRender(*engine, automatic);
  const Pick pick = pickOf(r);
  EXPECT_EQ(pick.text, "ray_traced, 1 ray");
  EXPECT_EQ(firstDifference(r, mustRender(*engine, rays)), "");
  int passedOver = 0;
  for (const Row& row : rowsOf(r))
    if (row.map && row.ms > pick.ms + 0.051) {
      EXPECT_FALSE(row.judged) << row.ms << " ms: no error of it could make it the better one";
      ++passedOver;
    }
  EXPECT_GT(passedOver, 0);
}

TEST(AutomaticShadow, OneViewSampleOfALargePictureIsAMap) {
  auto engine = makeEngine();
  // One ray a pixel leaves the staircase of the pixels, whatever it costs; a filtered map does not.
  const RenderResult r = mustRender(*engine, request("sun", "auto.error=0.05", 640, 480));
  EXPECT_NE(pickOf(r).text.find("percentage_closer"), std::string::npos) << pickOf(r).text;
}

TEST(AutomaticShadow, PicksAreTheSameFromAnyStateOfTheStoreAndForAnyNumberOfThreads) {
  auto one = makeEngine(256ull << 20, {}, 1), many = makeEngine(256ull << 20, {}, 7);
  for (const char* light : {"key", "sun"}) {
    const v1::RenderRequest r = request(light, "auto.error=0.05");
    const RenderResult a = mustRender(*one, r), b = mustRender(*many, r), again = mustRender(*one, r);
    EXPECT_EQ(pickOf(a).text, pickOf(b).text);
    EXPECT_EQ(firstDifference(a, b), "");
    EXPECT_EQ(firstDifference(a, again), "");
  }
}

TEST(AutomaticShadow, ServesLightsThatNothingShinesOnAndEnvironments) {
  auto engine = makeEngine();
  v1::RenderRequest r = request("sun", "auto.error=0.05");
  set(r, "lights.sun.direction=0,1,0");  // from below the floor
  const RenderResult dark = mustRender(*engine, r);
  for (const float v : dark.images[0].image().data) EXPECT_TRUE(v >= 0.0f && v <= 1.0f);
  v1::RenderRequest spheres = smallRequest("spheres", 32, 24);
  set(spheres, "shadows.auto.error=0.1");
  mustRender(*engine, spheres);
}

}  // namespace
