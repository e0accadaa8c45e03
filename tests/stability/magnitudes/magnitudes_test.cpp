// SPDX-License-Identifier: Apache-2.0
// Every way of shadowing on scenes of any size: meshes, cameras, lights and parameters from 1e-12 to 1e12 and at the ends of their ranges, needles, lights
// in the surface they light. Each try is refused with its field's name or gives finite pixels; under the address sanitizer's build (deploy/sanitize asan)
// a conversion of a number that does not fit an integer ends it too.
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <sstream>

#include "base/sobol.h"
#include "support/engines.h"
#include "support/thorough.h"
#include "support/tiny_scenes.h"

namespace gobo::testing::magnitudes_test {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

constexpr std::array<double, 13> kMagnitudes{1,    1,   1,   1,   1e-12, 1e-9, 1e-6,
                                             1e-3, 1e3, 1e6, 1e9, 9.9e8, 1e12};  // 1 often: or little would get beyond its refusal
constexpr std::array<const char*, 6> kKinds{"POINT", "SPOT", "DIRECTIONAL", "RECT", "DISK", "SPHERE"};
const int kTries = thoroughOr(200, 70);  // a technique

/// Choices of one try.
struct Dice {
  uint64_t state;
  uint64_t next() { return state = hash64(state, 0x6d61676e); }
  template <typename List>
  auto of(const List& list) {
    return list[next() % std::size(list)];
  }
  bool coin() { return next() >> 63; }
  double magnitude() { return of(kMagnitudes); }
};

std::string text(double v) {
  std::ostringstream out;
  out.precision(17);
  out << v;
  return out.str();
}
std::string text(const Vec3& v) { return text(v.x) + "," + text(v.y) + "," + text(v.z); }

/// A floor with a box on it, both of size s; or needles; or the floor alone, seen edge on.
Result<ScenePtr> scene(Dice& dice, float s) {
  tests::SceneMaker m;
  const int grey = m.material(Vec3(0.5f));
  m.instance(m.mesh(tests::ground(2 * s), grey));
  switch (dice.next() % 3) {
    case 0: m.instance(m.mesh(tests::box(Vec3(-0.3f * s, 0, -0.3f * s), Vec3(0.3f * s, 0.7f * s, 0.3f * s)), grey)); break;
    case 1: {  // slivers: one as thin as floats go, one whose corners lie on a line
      Mesh needles;
      needles.positions = {Vec3(-s, 0.5f * s, 0), Vec3(s, 0.5f * s, 0), Vec3(s, 0.5f * s, 1e-7f * s),
                           Vec3(-s, 0.2f * s, 0), Vec3(0, 0.2f * s, 0), Vec3(s, 0.2f * s, 0)};
      needles.indices = {0, 1, 2, 3, 4, 5};
      m.instance(m.mesh(needles, grey));
      break;
    }
    default: break;
  }
  m.camera(dice.coin() ? Vec3(0.4f * s, 1.5f * s, 2.5f * s) : Vec3(0, 0, 3 * s), Vec3(0.0f), 0.8f);
  auto sealed = std::make_shared<Scene>(m.scene);
  GOBO_TRY(sealed->seal());
  return ScenePtr(sealed);
}

/// Numbers, switches and choices of a message by reflection: at either end of what the schema says, or left alone.
void fill(Message& m, Dice& dice) {
  const auto& r = *m.GetReflection();
  for (int i = 0; i < m.GetDescriptor()->field_count(); ++i) {
    const FieldDescriptor* f = m.GetDescriptor()->field(i);
    if (f->is_repeated() || f->name() == "device" || dice.next() % 3 == 0) continue;  // a device is not there everywhere
    const v1::Number range = f->options().GetExtension(v1::number);
    const double end = dice.coin() ? range.min() : range.max();
    switch (f->cpp_type()) {
      case FieldDescriptor::CPPTYPE_DOUBLE: r.SetDouble(&m, f, range.exclusive_min() && end == range.min() ? 1e-12 : end); break;
      case FieldDescriptor::CPPTYPE_UINT32: r.SetUInt32(&m, f, uint32_t(std::min(end, 64.0))); break;  // more of a thing costs time and is no other number
      case FieldDescriptor::CPPTYPE_BOOL: r.SetBool(&m, f, dice.coin()); break;
      case FieldDescriptor::CPPTYPE_ENUM: r.SetEnumValue(&m, f, int(dice.next() % uint64_t(f->enum_type()->value_count()))); break;
      default: ADD_FAILURE() << f->full_name() << ": of a kind that this test does not know";
    }
  }
}

v1::RenderRequest request(Dice& dice, double s) {
  const bool one = dice.coin();
  v1::RenderRequest r = smallRequest("by hand", one ? 1 : 17, one ? 1 : 3, 1);
  r.set_view_samples(1);
  if (dice.coin()) set(r, "camera.position=" + text(float(dice.magnitude()) * Vec3(0.3f, 0.6f, 1)));
  if (dice.next() % 4 == 0) set(r, "camera.orthographic_height=" + text(dice.magnitude()));
  set(r, std::string("lights.x.kind=") + dice.of(kKinds));
  // In the floor's plane, in its middle, at the camera, or anywhere.
  const Vec3 places[] = {Vec3(0.2f, 0, 0.1f), Vec3(0.0f), Vec3(0.4f, 1.5f, 2.5f), Vec3(0.1f, 1.2f, 0.2f), Vec3(0.1f, 1.2f, 0.2f)};
  const double at = dice.coin() ? s : dice.magnitude();
  set(r, "lights.x.position=" + text(Vec3(float(at)) * dice.of(places)));
  set(r, "lights.x.direction=" + text(float(dice.magnitude()) * (dice.coin() ? Vec3(0, -1, 0) : Vec3(0.3f, -1, 0.2f))));
  set(r, "lights.x.intensity=" + text(dice.magnitude()));
  for (const char* length : {"width", "height", "radius"}) set(r, std::string("lights.x.") + length + "=" + text(dice.coin() ? 0.1 * s : dice.magnitude()));
  if (dice.next() % 4 == 0) set(r, "lights.x.outer_deg=" + text(dice.coin() ? 1e-12 : 90.0));
  if (dice.next() % 3 == 0) set(r, "lights.x.angular_size_deg=" + text(dice.coin() ? 1e-4 : 90.0));
  return r;
}

TEST(Magnitudes, EveryTechniqueGivesFinitePixelsOrNamesAField) {
  const auto engine = makeEngine();
  const auto* techniques = v1::ShadowTechnique::descriptor()->FindOneofByName("technique");
  ASSERT_GT(techniques->field_count(), 10);
  for (int k = 0; k < techniques->field_count(); ++k) {
    const FieldDescriptor* technique = techniques->field(k);
    int pictures = 0, refusals = 0;
    const auto begun = std::chrono::steady_clock::now();
    for (int i = 0; i < kTries; ++i) {
      Dice dice{hash64(hash64(1, uint64_t(technique->number())), uint64_t(i))};
      const double s = dice.magnitude();
      const Result<ScenePtr> made = scene(dice, float(s));
      if (!made.ok()) {
        EXPECT_NE(made.status().location(), "") << made.status().toString();
        ++refusals;
        continue;
      }
      v1::RenderRequest r = request(dice, s);
      v1::ShadowTechnique& shadow = *r.mutable_shadows();
      fill(*shadow.GetReflection()->MutableMessage(&shadow, technique), dice);
      shadow.mutable_map()->set_resolution(64);  // where the dice leave it
      fill(*shadow.mutable_map(), dice);
      RenderControl control;
      control.scene = *made;
      const Result<RenderResult> result = engine->render(r, control);
      const auto what = [&] { return technique->name() + " try " + std::to_string(i) + ", scene of " + text(s) + " m: " + messageToJson(r, false); };
      if (!result.ok()) {
        EXPECT_EQ(result.status().code(), Code::InvalidArgument) << result.status().toString() << "\n" << what();
        // Those of the shadows' own rules name the field as it is written in either place: shadows.map.lookup.
        const std::string& field = result.status().location();
        EXPECT_TRUE(field.rfind("request.", 0) == 0 || field.rfind("shadows.", 0) == 0) << result.status().toString() << "\n" << what();
        ++refusals;
        continue;
      }
      ++pictures;
      for (const auto& image : result->images)
        for (const float v : image.image().data) ASSERT_TRUE(std::isfinite(v)) << image.output << ", " << what();
    }
    std::printf("%-26s %d pictures, %d refusals, %.1f s\n", technique->name().c_str(), pictures, refusals,
                std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
    EXPECT_GT(pictures, 0) << technique->name();
    EXPECT_GT(refusals, 0) << technique->name();
  }
}

}  // namespace
}  // namespace gobo::testing::magnitudes_test
