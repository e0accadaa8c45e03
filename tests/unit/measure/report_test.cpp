// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <limits>

#include "base/image_io.h"
#include "measure/font.h"
#include "measure/plot.h"
#include "measure/report.h"

namespace gobo {
namespace {

Table sample() {
  Table t("speed, \"error\"", {"what", "ms", "note"});
  t.note("seeds", 3.0);
  t.add({std::string("esm, k=80"), 1.25, std::string("a \"quoted\"\nline")});
  t.add({std::string("pt"), std::numeric_limits<double>::quiet_NaN(), std::string()});
  return t;
}

TEST(Report, Text) {
  EXPECT_EQ(sample().text().substr(0, 56), "speed, \"error\"\n  seeds: 3\nwhat         ms  note\nesm, k=8");
  EXPECT_NE(sample().text().find("pt            -\n"), std::string::npos);
}
TEST(Report, Csv) { EXPECT_EQ(sample().csv(), "what,ms,note\r\n\"esm, k=80\",1.25,\"a \"\"quoted\"\"\nline\"\r\npt,,\r\n"); }
TEST(Report, Json) {
  EXPECT_EQ(sample().json(),
            "{\"name\": \"speed, \\\"error\\\"\",\n \"notes\": {\"seeds\": 3},\n \"columns\": [\"what\", \"ms\", \"note\"],\n \"rows\": [\n"
            "  {\"what\": \"esm, k=80\", \"ms\": 1.25, \"note\": \"a \\\"quoted\\\"\\nline\"},\n  {\"what\": \"pt\", \"ms\": null, \"note\": \"\"}\n ]}\n");
}
TEST(Report, Markdown) {
  Table t("t", {"a", "b"});
  t.add({std::string("x"), 0.5});
  EXPECT_EQ(t.markdown(), "| a | b |\n|---|---:|\n| x | 0.5 |\n");
}
TEST(Report, ArgumentOr) {
  const char* argv[] = {"bench", "--seeds", "7", "--out"};
  EXPECT_EQ(argumentOr(4, const_cast<char**>(argv), "--seeds", "1"), "7");
  EXPECT_EQ(argumentOr(4, const_cast<char**>(argv), "--out", "none"), "none");
}

TEST(Plot, TicksAreRoundNumbersInside) {
  EXPECT_EQ(axisTicks(0.5, 20000, true), (std::vector<double>{1, 10, 100, 1000, 10000}));
  EXPECT_EQ(axisTicks(0.9, 60, true).size(), 6u);  // 1 2 5 10 20 50
  const auto narrow = axisTicks(3.0, 4.0, true);
  EXPECT_GE(narrow.size(), 4u);
  for (const auto& ticks : {axisTicks(-3, 17, false), axisTicks(1e-9, 3e-9, false), narrow}) {
    EXPECT_GE(ticks.size(), 3u);
    EXPECT_LE(ticks.size(), 12u);
  }
}

Plot speedAgainstError() {
  Plot plot{"Speed against error, {test} 100 %", "median time [ms]", "RMSE", true, true, 960, 600, {}};
  plot.series.push_back({"ExponentialShadowMap", {{0.5, 0.09}, {1, 0.06}, {2, 0.05}, {8, 0.045}}});
  plot.series.push_back({"path tracing", {{1, 0.9, 0.8, 1.0}, {10, 0.3, 0.27, 0.33}, {100, 0.09, 0.08, 0.1}, {1000, 0.03, 0.02, 0.04}, {0, 1}, {5, -1}}});
  plot.series.push_back({"axis-aligned filter", {{3, 0.02}, {12, 0.01}, {50, 0.004}}, true, true});
  plot.series.push_back({"only marks", {{200, 0.5}, {300, 0.004}}, false, true});
  return plot;
}

/// A series' colour shows at the pixel of its point and nowhere in a plot without it; bad points draw nothing.
TEST(Plot, PointsLandOnTheAxes) {
  Plot plot{"", "", "", true, true, 480, 320, {}};
  const auto differing = [&](const Plot& a, const Plot& b) {
    const Image p = drawPlot(a), q = drawPlot(b);
    double x = 0, y = 0, n = 0;
    for (int j = 0; j < p.height; ++j)
      for (int i = 0; i < p.width; ++i)
        if (p.rgb(i, j) != q.rgb(i, j)) x += i, y += j, ++n;
    return Vec3(float(x / n), float(y / n), float(n));
  };
  Plot base = plot;
  base.series.push_back({"", {{1, 1}, {100, 100}}, false, false});  // fixes the ranges, draws nothing
  Plot middle = base, corner = base, bad = base;
  middle.series.push_back({"", {{10, 10}}, false, true});
  corner.series.push_back({"", {{100, 1}}, false, true});
  bad.series.push_back({"", {{-1, 10}, {0, 10}, {10, std::numeric_limits<double>::quiet_NaN()}, {10, 1e300}, {1e308, 10}, {1e-308, 10}}, true, true});
  const auto marksOnly = [&](const Plot& with) {
    Plot without = base;
    without.series.push_back({"", {}, false, true});
    return differing(with, without);
  };
  const Vec3 m = marksOnly(middle), c = marksOnly(corner);
  EXPECT_GT(m.z, 30);
  EXPECT_GT(c.x, m.x + 80);
  EXPECT_GT(c.y, m.y + 80);
  Plot empty = base;
  empty.series.push_back({"", {}, true, true});
  EXPECT_EQ(drawPlot(bad).data, drawPlot(empty).data);
}

TEST(Plot, WritesAReadablePng) {
  const std::string path = (std::filesystem::temp_directory_path() / ("gobo_plot_test_" + std::to_string(::getpid()) + ".png")).string();
  const Plot plot = speedAgainstError();
  ASSERT_TRUE(writePlot(plot, path).ok());
  const auto read = readImage(path);
  ASSERT_TRUE(read.ok()) << read.status().toString();
  EXPECT_EQ(read->width, 960);
  EXPECT_EQ(read->height, 600);
  EXPECT_GT(read->at(2, 2)[0], 0.99f);
  size_t ink = 0;
  for (float v : read->data) ink += v < 0.5f;
  EXPECT_GT(ink, 5000u);
  if (!std::getenv("GOBO_KEEP_PLOT")) std::filesystem::remove(path);
  else std::filesystem::rename(path, std::getenv("GOBO_KEEP_PLOT"));
  EXPECT_FALSE(writePlot(plot, "/nonexistent/folder/plot.png").ok());
}

TEST(Plot, NoPointsAndTinyRanges) {
  EXPECT_EQ(drawPlot(Plot{"t", "x", "y", true, true, 320, 240, {}}).width, 320);
  Plot flat{"t", "x", "y", false, false, 320, 240, {{"s", {{5, 3}, {5, 3}}}}};
  for (float v : drawPlot(flat).data) ASSERT_TRUE(v >= 0 && v <= 1);
  flat.logX = flat.logY = true;
  for (float v : drawPlot(flat).data) ASSERT_TRUE(v >= 0 && v <= 1);
}

TEST(Font, EveryPrintableGlyphIsDrawnAndDistinct) {
  for (char a = '!'; a <= '~'; ++a)
    for (char b = '!'; b < a; ++b) EXPECT_FALSE(std::equal(glyphRows(a), glyphRows(a) + kGlyphHeight, glyphRows(b))) << a << b;
  EXPECT_EQ(glyphRows('\xe9')[0], 31);
}

}  // namespace
}  // namespace gobo
