// SPDX-License-Identifier: Apache-2.0
// fuzz/request.dict has every name that a request may hold, and none that is no longer one: it cannot go stale.
#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <regex>
#include <set>
#include <string>

#include <google/protobuf/descriptor.h>

#include "gobo/v1/jobs.pb.h"
#include "gobo/v1/render.pb.h"
#include "gobo/v1/service.pb.h"

namespace gobo::fuzz {
namespace {

/// Names of fields and enumerators of the messages that the request targets read, and of all that these hold.
std::set<std::string> schemaNames() {
  std::set<std::string> names, seen;
  const std::function<void(const google::protobuf::Descriptor&)> visit = [&](const google::protobuf::Descriptor& d) {
    if (!seen.insert(std::string(d.full_name())).second) return;
    for (int i = 0; i < d.field_count(); ++i) {
      const google::protobuf::FieldDescriptor& f = *d.field(i);
      const bool map = f.is_map();
      names.insert(std::string(f.name()));
      const google::protobuf::FieldDescriptor& value = map ? *f.message_type()->FindFieldByName("value") : f;
      if (const auto* e = value.enum_type())
        for (int k = 0; k < e->value_count(); ++k) names.insert(std::string(e->value(k)->name()));
      if (const auto* m = value.message_type()) visit(*m);
    }
  };
  for (const auto* d : {v1::RenderRequest::descriptor(), v1::RelightRequest::descriptor(), v1::PatchSceneRequest::descriptor(), v1::JobSpec::descriptor()})
    visit(*d);
  return names;
}

TEST(FuzzDictionary, HasEveryNameOfTheSchemaAndNoOther) {
  std::ifstream in("fuzz/request.dict");
  ASSERT_TRUE(in.good()) << "fuzz/request.dict";
  std::set<std::string> words;
  for (std::string line; std::getline(in, line);)
    if (line.size() >= 2 && line.front() == '"' && line.back() == '"') words.insert(line.substr(1, line.size() - 2));
  const std::set<std::string> names = schemaNames();
  EXPECT_GT(names.size(), 150u);
  for (const std::string& n : names) EXPECT_TRUE(words.count(n)) << "missing: \"" << n << '"';
  // Words of values and of JSON; whatever else looks like a name must be one.
  static const std::set<std::string> values{"NaN",  "Infinity",          "beauty,depth",     "key", "lamp", "environment", "none", "true",
                                            "null", "shadow_basis:lamp", "shadow_flags:lamp"};
  static const std::regex identifier("[A-Za-z_][A-Za-z0-9_]*");
  for (const std::string& w : words)
    if (std::regex_match(w, identifier) && !values.count(w)) { EXPECT_TRUE(names.count(w)) << "no field and no enumerator: \"" << w << '"'; }
}

}  // namespace
}  // namespace gobo::fuzz
