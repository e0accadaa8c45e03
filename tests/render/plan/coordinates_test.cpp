// SPDX-License-Identifier: Apache-2.0
// Requests with numbers of any size, in every field that says where or how large something is: a picture of finite numbers or a refusal
// that names the field, by every way of shadowing.
#include <gtest/gtest.h>

#include "support/engines.h"
#include "support/thorough.h"

namespace gobo::testing::coordinates_test {
namespace {

const char* const kVectors[] = {"camera.position",       "camera.look_at",         "camera.up",
                                "lights.other.position", "lights.other.direction", "environment.sky.sun_direction"};
const char* const kLengths[] = {"camera.orthographic_height", "lights.other.width", "lights.other.height", "lights.other.radius"};
const char* const kKinds[] = {"POINT", "SPOT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"};

/// True if a picture came back.
bool pictureOrRefusal(Engine& engine, const v1::RenderRequest& r, const std::string& what) {
  const Result<RenderResult> made = engine.render(r);
  if (!made.ok()) {
    EXPECT_EQ(made.status().code(), Code::InvalidArgument) << what << ": " << made.status().toString();
    return false;
  }
  for (const auto& image : made->images)
    for (const float v : image.image().data) EXPECT_TRUE(std::isfinite(v)) << what;
  return true;
}

TEST(Coordinates, OfAnySizeGiveAPictureOrARefusal) {
  const auto engine = makeEngine();
  int pictures = 0, refusals = 0;
  const auto* techniques = v1::ShadowTechnique::descriptor()->FindOneofByName("technique");
  ASSERT_GT(techniques->field_count(), 10);
  std::vector<std::string> tries;
  for (const char* size : {"1e-30", "1e-9", "1e5", "1e9", "1.1e9", "1e12", "1e18", "1e20", "3e38"}) {
    for (const char* field : kVectors)
      for (const char* pattern : {"%,0,0", "0,-%,0", "%,%,-%"}) {
        std::string v = std::string(field) + "=";
        for (const char* c = pattern; *c; ++c) v += *c == '%' ? std::string(size) : std::string(1, *c);
        tries.push_back(v);
      }
    for (const char* field : kLengths) tries.push_back(std::string(field) + "=" + size);
  }
  for (size_t t = 0; t < tries.size(); ++t)
    for (int k = 0; k < techniques->field_count(); ++k) {  // one after the other, for whom the engine keeps a sky
      const size_t count = size_t(techniques->field_count());
      if (size_t(k) != t % count && !inSweep(size_t(k) + t * count, 3)) continue;  // each number by one at least
      const std::string technique = "shadows." + techniques->field(k)->name() + "=";
      v1::RenderRequest r = smallRequest("cornell", 4, 3, 1);
      r.set_view_samples(1);
      set(r, technique);
      set(r, "shadows.map.resolution=16");
      set(r, std::string("lights.other.kind=") + kKinds[(size_t(k) * tries.size() + t) % 6]);
      set(r, tries[t]);
      (pictureOrRefusal(*engine, r, technique + " " + tries[t]) ? pictures : refusals) += 1;
    }
  EXPECT_GT(pictures, thoroughOr(500, 150));
  EXPECT_GT(refusals, thoroughOr(500, 150));
}

TEST(Coordinates, BeyondTheBoundNameTheirField) {
  const auto engine = makeEngine();
  for (const char* field : {"camera.position", "camera.look_at", "lights.other.position"}) {
    v1::RenderRequest r = smallRequest("cornell", 4, 3, 1);
    set(r, "lights.other.kind=SPHERE");
    set(r, std::string(field) + "=1e20,0,0");
    const Result<RenderResult> made = engine->render(r);
    ASSERT_FALSE(made.ok()) << field;
    EXPECT_EQ(made.status().location(), "request." + std::string(field));
    EXPECT_NE(made.status().message().find("(1e+20, 0, 0): must be within 1e9 m"), std::string::npos) << made.status().toString();
  }
}

// Directions are only directions: any length.
TEST(Coordinates, DirectionsOfAnyLengthAreTheSame) {
  const auto engine = makeEngine();
  RenderResult unit;
  for (const char* length : {"1", "1e-10", "1e18", "3e38"}) {
    v1::RenderRequest r = smallRequest("fence", 8, 6, 1);
    set(r, std::string("lights.sun.direction=0,-") + length + ",0");
    RenderResult made = mustRender(*engine, r);
    if (unit.images.empty()) unit = std::move(made);
    else EXPECT_EQ(firstDifference(unit, made), "") << length;
  }
}

}  // namespace
}  // namespace gobo::testing::coordinates_test
