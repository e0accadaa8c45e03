// SPDX-License-Identifier: Apache-2.0
// IES LM-63 files: what is read of good ones, at which line broken ones are refused; and how a glTF names them and pictures for spots.
#include "import/ies.h"

#include <gtest/gtest.h>

#include <map>
#include <numbers>

#include "import/load.h"
#include "scene/light_axes.h"
#include "support/gltf_base.h"

namespace gobo {
namespace ies_test {

using testing::Json;
constexpr double kDegree = std::numbers::pi / 180;

std::string iesText(const std::string& vertical, const std::string& horizontal, const std::string& candela, const std::string& counts,
                    const std::string& head = "IESNA:LM-63-2002\n[TEST] none\n", const std::string& multiplier = "1") {
  return head + "TILT=NONE\n1 1000 " + multiplier + " " + counts + " 1 2 0.1 0.2 0\n1 1 50\n" + vertical + "\n" + horizontal + "\n" + candela + "\n";
}
Result<IesPhotometry> read(const std::string& text) { return readIes(text, "lamp.ies"); }
double valueAt(const IesPhotometry& p, double vertical, double horizontal) {
  return double(photometryAt(*p.profile, vertical * kDegree, horizontal * kDegree).x);
}

TEST(Ies, OneHorizontalAngleIsTheSameAllRound) {
  const auto p = read(iesText("0 45 90", "0", "200 100 0", "3 1"));
  ASSERT_TRUE(p.ok()) << p.status().toString();
  EXPECT_EQ(p->candela, 200.0);
  EXPECT_EQ(p->profile->name, "lamp.ies");
  for (const double h : {0.0, 77.0, 300.0}) {
    EXPECT_NEAR(valueAt(*p, 0, h), 1.0, 1e-6);
    EXPECT_NEAR(valueAt(*p, 45, h), 0.5, 1e-6);
    EXPECT_NEAR(valueAt(*p, 60, h), 0.5 * 30 / 45, 1e-6);
    EXPECT_EQ(valueAt(*p, 91, h), 0.0);
  }
}

TEST(Ies, SymmetriesAreMirrored) {
  const auto quadrant = read(iesText("0 90", "0 30 90", "1 1, 1 3, 1 5", "2 3"));
  ASSERT_TRUE(quadrant.ok()) << quadrant.status().toString();
  for (const double h : {30.0, 150.0, 210.0, 330.0}) EXPECT_NEAR(valueAt(*quadrant, 90, h) * 5, 3.0, 1e-5) << h;
  for (const double h : {90.0, 270.0}) EXPECT_NEAR(valueAt(*quadrant, 90, h) * 5, 5.0, 1e-5) << h;
  EXPECT_NEAR(valueAt(*quadrant, 90, 345) * 5, 2.0, 1e-5);
  const auto half = read(iesText("0 90", "0 90 180", "1 1 1 3 1 5", "2 3"));
  ASSERT_TRUE(half.ok()) << half.status().toString();
  EXPECT_NEAR(valueAt(*half, 90, 270) * 5, 3.0, 1e-5);
  EXPECT_NEAR(valueAt(*half, 90, 225) * 5, 4.0, 1e-5);
  const auto whole = read(iesText("0 90", "0 90 180 270", "1 1 1 2 1 3 1 4", "2 4"));  // the seam left out
  ASSERT_TRUE(whole.ok()) << whole.status().toString();
  EXPECT_NEAR(valueAt(*whole, 90, 270) * 4, 4.0, 1e-5);
  EXPECT_NEAR(valueAt(*whole, 90, 315) * 4, 2.5, 1e-5);
  const auto closed = read(iesText("0 90", "0 180 360", "1 1 1 2 1 1", "2 3"));
  ASSERT_TRUE(closed.ok()) << closed.status().toString();
  EXPECT_NEAR(valueAt(*closed, 90, 270) * 2, 1.5, 1e-5);
  for (const char* angles : {"90 180 270", "90 170 270"}) {  // LM-63-1995: halves on either side of the plane through 90; with and without its middle
    const auto late = read(iesText("0 90", angles, "1 1 1 2 1 3", "2 3"));
    ASSERT_TRUE(late.ok()) << late.status().toString();
    EXPECT_NEAR(valueAt(*late, 90, 90) * 3, 1.0, 1e-5) << angles;
    EXPECT_NEAR(valueAt(*late, 90, 270) * 3, 3.0, 1e-5);
    for (const double h : {100.0, 140.0, 200.0, 260.0}) EXPECT_NEAR(valueAt(*late, 90, h), valueAt(*late, 90, 180 - h), 1e-5) << angles << " " << h;
  }
}

TEST(Ies, EveryVersionsHeadAndFactors) {
  for (const char* head : {"", "A LAMP\nMADE BY NOBODY\n", "IESNA91\n[TEST] 1\n[MORE] 2\n", "IESNA:LM-63-1995\r\n[TEST] 1\r\n", "IES:LM-63-2019\n"}) {
    const auto p = read(iesText("0 90", "0", "10 20", "2 1", head, "2.5"));
    ASSERT_TRUE(p.ok()) << head << p.status().toString();
    EXPECT_EQ(p->candela, 50.0);
  }
  const auto factors = read("TILT=NONE\n1 -1 2 2 1 1 2 0 0 0\n0.9 0.5 50\n0 90 0 1e2 +50\n");
  ASSERT_TRUE(factors.ok()) << factors.status().toString();
  EXPECT_NEAR(factors->candela, 90.0, 1e-9);
  // The second number of that line: a factor until 2002, from 2019 on a code of how the file came about.
  for (const auto& [head, most] :
       std::map<std::string, double>{{"IESNA:LM-63-2002\n", 49.5}, {"IESNA91\n", 49.5}, {"", 49.5}, {"IES:LM-63-2019\r\n[TEST] 1\r\n", 45.0}})
    for (const char* code : {"1.10000", "1.1"}) {
      const auto p = read(head + "TILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n0.9 " + code + " 50\n0 90\n0\n50 20\n");
      ASSERT_TRUE(p.ok()) << head << p.status().toString();
      EXPECT_NEAR(p->candela, most, 1e-9) << head;
    }
  const auto unsaid = read("IES:LM-63-2019\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1.00001 50\n0 90\n0\n50 20\n");
  ASSERT_TRUE(unsaid.ok()) << unsaid.status().toString();
  EXPECT_EQ(unsaid->candela, 50.0);
  const auto tilted = read("TILT=INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8\n1 1000 1 2 1 1 2 0 0 0\n1 1 50\n0 90\n0\n10 5\n");
  ASSERT_TRUE(tilted.ok()) << tilted.status().toString();
  EXPECT_EQ(tilted->candela, 10.0);
  const auto black = read(iesText("0 90", "0", "0 0", "2 1"));
  ASSERT_TRUE(black.ok());
  EXPECT_EQ(black->candela, 0.0);
}

TEST(Ies, BrokenFilesNameLineAndValue) {
  const auto refused = [](const std::string& text, const char* what) {
    const auto p = read(text);
    ASSERT_FALSE(p.ok()) << what;
    EXPECT_EQ(p.status().code(), Code::InvalidArgument);
    EXPECT_NE(p.status().toString().find(what), std::string::npos) << p.status().toString();
  };
  refused("", "no line TILT=");
  refused("IESNA:LM-63-2002\nhello\n", "no line TILT=");
  refused("TILT=lamp.tlt\n1 2 3", "TILT=lamp.tlt");
  refused("TILT=NONE\n1 1000", "line 2: candela multiplier: is missing");
  refused("TILT=NONE\n1 1000 -2 2 1 1", "candela multiplier: -2");
  refused(iesText("0 45 90", "0", "200 100 x", "3 1"), "line 8: candela value: \"x\" is not a finite number");
  refused(iesText("0 45 90", "0", "200 100 -3", "3 1"), "candela value: -3");
  refused(iesText("0 45 90", "0", "200 100 nan", "3 1"), "\"nan\"");
  refused(iesText("0 45 90", "0", "200 100 1e999", "3 1"), "\"1e999\"");
  refused(iesText("0 45 90", "0", "200 100", "3 1"), "candela value: is missing");
  refused(iesText("0 45 30", "0", "1 2 3", "3 1"), "vertical angle 2: 30 is not above");
  refused(iesText("0 190", "0", "1 2", "2 1"), "vertical angle 1: 190");
  refused(iesText("0 90", "10", "1 2", "2 1"), "horizontal angle 0: 10");
  refused(iesText("0 90", "0 45", "1 2 3 4", "2 2"), "from 0 to 45");
  refused(iesText("0", "0", "1", "1 1"), "number of vertical angles: 1");
  refused(iesText("0 90", "0", "1 2", "2 0"), "number of horizontal angles: 0");
  refused(iesText("0 90", "0", "1 2", "2.5 1"), "number of vertical angles: 2.5");
  refused(iesText("0 90", "0", "1 2", "1000000 1000000"), "number of vertical angles: 1e+06");
  refused("TILT=NONE\n1 1000 1 2 1 2 2 0 0 0\n1 1 50\n0 90\n0\n1 2\n", "photometric type: 2 (B)");
  refused("TILT=NONE\n1 1000 1 2 1 3 2 0 0 0\n1 1 50\n0 90\n0\n1 2\n", "photometric type: 3 (A)");
}

struct ProfileFiles : ::testing::Test {
  Json doc = Json::parse(R"({"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual"],"scenes":[{"nodes":[0]}],
    "nodes":[{"name":"lamp","rotation":[0.5,0.5,0.5,0.5],"translation":[1,2,3],"extensions":{"KHR_lights_punctual":{"light":0}}}],
    "extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","intensity":7,"spot":{"outerConeAngle":0.5}}]}},
    "textures":[{"source":0}],"images":[{"name":"leaves"}]})");
  void SetUp() override {
    const std::string png = smallPng(200, 40, 90);
    doc["images"][0]["uri"] = "data:image/png;base64," + base64(png.data(), png.size());
  }
  Json& light() { return doc["extensions"]["KHR_lights_punctual"]["lights"][0]; }
  Result<ScenePtr> load() const {
    testing::MemoryFile file(doc.dump());
    LoadOptions options;
    options.files = &file;
    return loadGltf("scene.gltf", options);
  }
  void refused(const char* place, const char* what) const {
    const auto s = load();
    ASSERT_FALSE(s.ok()) << place;
    EXPECT_NE(s.status().toString().find(place), std::string::npos) << s.status().toString();
    EXPECT_NE(s.status().toString().find(what), std::string::npos) << s.status().toString();
  }
};

TEST_F(ProfileFiles, AGoboIsItsTextureInLinearColourAndTurnsWithItsNode) {
  light()["extras"]["gobo_light"] = {{"gobo", {{"index", 0}}}, {"rotation", 0.25}};
  const auto s = load();
  ASSERT_TRUE(s.ok()) << s.status().toString();
  const LightShape& shape = (*s)->lights[0].shape;
  ASSERT_EQ((*s)->profiles.size(), 1u);
  ASSERT_EQ(shape.profile, 0);
  EXPECT_EQ(shape.profileRotation, 0.25f);
  EXPECT_TRUE((*s)->textures.empty()) << "no material looks at it";
  EXPECT_NEAR((*s)->profiles[0]->values[0].x, std::pow((200 / 255.0 + 0.055) / 1.055, 2.4), 1e-6);
  // The node turns x to y, y to z, z to x: right is +Y, the axis -X.
  EXPECT_NEAR(glm::length(shape.axis - Vec3(-1, 0, 0)), 0, 1e-6);
  LightShape unturned = shape;
  unturned.profileRotation = 0;
  EXPECT_NEAR(glm::length(profileFrame(unturned).x - Vec3(0, 1, 0)), 0, 1e-6);
  EXPECT_EQ((*s)->lights[0].power, Vec3(7.0f)) << "intensity is that of white";
  light()["type"] = "point";
  refused("/lights/0/extras/gobo_light/gobo", "spot");
}

TEST_F(ProfileFiles, ALampWithoutItsPictureIsWarnedOf) {
  light()["extras"]["gobo_light"]["gobo"]["index"] = 0;
  doc["images"][0]["uri"] = "data:image/png;base64,AAAA";
  const auto s = load();
  ASSERT_TRUE(s.ok()) << s.status().toString();
  EXPECT_EQ((*s)->lights[0].shape.profile, -1);
  bool said = false;
  for (const std::string& w : (*s)->warnings) said = said || w.find("without its gobo") != std::string::npos;
  EXPECT_TRUE(said);
  light()["extras"]["gobo_light"]["gobo"]["index"] = 3;
  refused("/extras/gobo_light/gobo/index", "3");
  light()["extras"]["gobo_light"]["gobo"] = Json::object();
  refused("/extras/gobo_light/gobo/index", "missing");
}

TEST_F(ProfileFiles, IesInExtrasIsRelativeAndInTheExtensionAbsolute) {
  const std::string text = iesText("0 45 90", "0", "200 100 0", "3 1");
  light()["type"] = "point";
  light()["extras"]["gobo_light"]["ies"]["text"] = text;
  auto s = load();
  ASSERT_TRUE(s.ok()) << s.status().toString();
  EXPECT_EQ((*s)->lights[0].power, Vec3(7.0f));
  EXPECT_EQ((*s)->profiles[size_t((*s)->lights[0].shape.profile)]->values[0], Vec3(1.0f));
  doc["extensionsUsed"].push_back("EXT_lights_ies");
  doc["extensionsRequired"] = {"EXT_lights_ies"};
  doc["extensions"]["EXT_lights_ies"]["lights"][0]["uri"] = "data:application/x-ies-lm-63;base64," + base64(text.data(), text.size());
  doc["nodes"].push_back({{"name", "measured"}, {"extensions", {{"EXT_lights_ies", {{"light", 0}, {"multiplier", 2}, {"color", {1, 0.5, 0.25}}}}}}});
  doc["scenes"][0]["nodes"].push_back(1);
  s = load();
  ASSERT_TRUE(s.ok()) << s.status().toString();
  const int i = (*s)->findLight("measured");
  ASSERT_GE(i, 0);
  EXPECT_EQ((*s)->lights[size_t(i)].shape.kind, LightKind::Point);
  EXPECT_EQ((*s)->lights[size_t(i)].power, Vec3(400, 200, 100));
  EXPECT_EQ((*s)->lights[size_t(i)].shape.axis, Vec3(0, 0, -1));
  doc["extensions"]["EXT_lights_ies"]["lights"][0]["uri"] = "data:,nothing";
  refused("/extensions/EXT_lights_ies/lights/0/uri", "TILT=");
  doc["extensions"]["EXT_lights_ies"]["lights"][0]["uri"] = "lamp.ies";
  refused("/extensions/EXT_lights_ies/lights/0/uri", "lamp.ies");
}

TEST_F(ProfileFiles, WhatCannotBeIsRefusedWithItsPlace) {
  light()["extras"]["gobo_light"]["ies"]["text"] = "TILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 50\n0 90\n0\n1 -2\n";
  refused("/extras/gobo_light/ies/text", "line 6: candela value: -2");
  light()["extras"]["gobo_light"]["ies"] = Json::object();
  refused("/extras/gobo_light/ies", "one of uri, bufferView and text");
  light()["extras"]["gobo_light"]["ies"] = {{"uri", "../lamp.ies"}};
  refused("/extras/gobo_light/ies/uri", "..");
  light()["extras"]["gobo_light"]["ies"] = {{"text", iesText("0 90", "0", "1 1", "2 1")}};
  light()["extras"]["gobo_light"]["gobo"] = {{"index", 0}};
  refused("/extras/gobo_light/ies", "gobo as well");
  light()["extras"]["gobo_light"].erase("gobo");
  light()["type"] = "directional";
  refused("/extras/gobo_light/ies", "point and spot");
}

}  // namespace ies_test
}  // namespace gobo
