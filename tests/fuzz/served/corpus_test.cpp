// SPDX-License-Identifier: Apache-2.0
// The regressions and the corpora of what needs a renderer or a server. Those of the readers: tests/fuzz/properties.
#include <gtest/gtest.h>

#include "fuzz/pack.h"
#include "fuzz/targets.h"

namespace gobo::fuzz::corpus_test {
namespace {

TEST(ServedCorpus, HoldsWhatWasFound) {
  ASSERT_EQ(servedTargets().size(), std::size(kServedNames));
  for (const Target& t : servedTargets()) {
    const std::string file = std::string("tests/data/fuzz/corpus/") + t.name + ".pack";
    const auto pack = readPack(file);
    ASSERT_TRUE(pack.ok()) << pack.status().toString();
    Inputs inputs = readInputs(std::string("tests/data/fuzz/") + t.name, t.mostBytes);
    EXPECT_GT(inputs.size(), 0u) << t.name;
    inputs.insert(inputs.end(), pack->begin(), pack->end());
    size_t accepted = 0;
    for (size_t i = 0; i < inputs.size(); ++i) {
      const Outcome out = t.property(inputs[i]);
      EXPECT_EQ(out.broken, "") << t.name << ", input " << i;
      accepted += out.accepted;
    }
    std::printf("%s: %zu inputs, %zu accepted\n", t.name, inputs.size(), accepted);
    EXPECT_GT(accepted, 0u) << t.name;
  }
}

}  // namespace
}  // namespace gobo::fuzz::corpus_test
