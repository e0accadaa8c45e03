// SPDX-License-Identifier: Apache-2.0
// Every field of every shadow technique, and of the map that it reads, changed alone: the warm engine gives the new engine's picture.
// A parameter that a node reads and does not hash fails here, whichever technique it is of.
#include <gtest/gtest.h>

#include <algorithm>

#include "filters/shadow_technique.h"
#include "gobo/v1/options.pb.h"
#include "support/engines.h"

namespace gobo::testing {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

/// Sets `field` far from what it is: near the other end of its range, or every other name of an enumeration. False: no such n-th value.
bool change(Message& m, const FieldDescriptor* field, int n) {
  const auto* reflection = m.GetReflection();
  const v1::Number& range = field->options().GetExtension(v1::number);
  const double preset = range.has_default_() ? range.default_() : 1.0;
  // Some times as much, a fraction of it, and a share of the range where the preset is 0.
  const double high = std::min(preset > 0 ? preset * 6 : range.has_max() ? range.max() * 0.3 : 2.0, range.has_max() ? range.max() : 1e9);
  const double low = std::max(preset / 5, range.has_min() ? range.min() : 0.0);
  switch (field->cpp_type()) {
    case FieldDescriptor::CPPTYPE_DOUBLE:
      if (n < 2) reflection->SetDouble(&m, field, n ? low : high);
      return n < 2;
    case FieldDescriptor::CPPTYPE_UINT32:
      if (n < 2) reflection->SetUInt32(&m, field, uint32_t(n ? std::max(low, 1.0) : high));
      return n < 2;
    case FieldDescriptor::CPPTYPE_BOOL: reflection->SetBool(&m, field, !field->options().GetExtension(v1::bool_default)); return n < 1;
    case FieldDescriptor::CPPTYPE_ENUM:
      if (n + 1 >= field->enum_type()->value_count()) return false;
      reflection->SetEnum(&m, field, field->enum_type()->value(n + 1));
      return true;
    default: ADD_FAILURE() << field->full_name() << ": a kind of field that this test does not know"; return false;
  }
}

TEST(TechniqueFields, AChangeOfOneNeverGetsAnothersTerms) {
  int fields = 0, visible = 0, refused = 0;
  for (const ShadowTechniqueEntry& t : shadowTechniques()) {
    const std::string light = t.supports(LightKind::Directional) && !t.suits ? "sun" : "key";  // the sun has no size
    v1::RenderRequest base = smallRequest("fence", 40, 30, 1);
    base.set_view_samples(1);
    base.add_outputs("visibility:" + light);
    v1::ShadowTechnique& technique = *base.mutable_shadows();
    const FieldDescriptor* own = v1::ShadowTechnique::descriptor()->FindFieldByNumber(t.key);
    technique.GetReflection()->MutableMessage(&technique, own);
    technique.mutable_map()->set_resolution(64);
    const auto engine = makeEngine();
    const RenderResult first = mustRender(*engine, base);
    for (const FieldDescriptor* part : {own, v1::ShadowTechnique::descriptor()->FindFieldByName("map")}) {
      for (int i = 0; i < part->message_type()->field_count(); ++i) {
        const FieldDescriptor* field = part->message_type()->field(i);
        if (field->name() == "device") continue;  // another numeric class: ExponentialShadowScene.OnlyWhatChangedIsANewNode
        bool seen = false;
        for (int n = 0;; ++n) {
          v1::RenderRequest r = base;
          Message* message = r.mutable_shadows()->GetReflection()->MutableMessage(r.mutable_shadows(), part);
          if (!change(*message, field, n)) break;
          if (field->name() == "resolution") r.mutable_shadows()->mutable_map()->set_resolution(n ? 24 : 96);
          if (field->name() == "fit") set(r, "camera.yfov_deg=20");
          const auto warm = engine->render(r), cold = makeEngine()->render(r);
          ASSERT_EQ(warm.ok(), cold.ok()) << t.name << " " << field->full_name() << ": " << warm.status().toString() << " / " << cold.status().toString();
          if (!warm.ok()) {
            ++refused;
            continue;
          }
          EXPECT_EQ(firstDifference(*warm, *cold), "") << t.name << ", " << field->full_name() << ", value " << n;
          seen = seen || !firstDifference(*warm, first).empty();
        }
        ++fields;
        visible += seen;
        // What every lookup reads must be seen to change something, or the test would not see that it is not hashed.
        if (field->full_name() == "gobo.v1.ShadowMapSettings.bias" && t.usesMap) { EXPECT_TRUE(seen) << t.name; }
      }
    }
  }
  EXPECT_GT(fields, 100);
  EXPECT_GT(visible, fields / 3);
  std::cout << fields << " fields, " << visible << " of them visible, " << refused << " values refused alike\n";
}

}  // namespace
}  // namespace gobo::testing
