// SPDX-License-Identifier: Apache-2.0
// Cold = warm: whatever was rendered before, a reply equals that of an empty store. `make bench` runs thousands of sequences.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "fuzz/plan/edit_sequences.h"

namespace gobo::testing {
namespace {

int sequences(int standard) {
  const char* asked = std::getenv("GOBO_FUZZ_SEQUENCES");
  return asked ? std::max(1, std::atoi(asked)) : standard;
}

void runSequences(uint64_t firstSeed, int count, int steps, uint64_t storeBytes, bool disk) {
  int reused = 0, ran = 0;
  for (int s = 0; s < count; ++s) {
    const auto folder = std::filesystem::temp_directory_path() / ("gobo-fuzz-" + std::to_string(getpid()) + "-" + std::to_string(s));
    EditSequence sequence(firstSeed + uint64_t(s), storeBytes, disk ? folder.string() : std::string());
    const SequenceResult r = sequence.run(steps);
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    ASSERT_EQ(r.failure, "") << "sequence seed " << firstSeed + s;
    reused += r.reusedNodes;
    ran += r.ranNodes;
  }
  // The test is empty if nothing is ever reused.
  EXPECT_GT(reused, count);
  std::cout << count << " sequences, " << ran << " nodes run, " << reused << " reused\n";
}

TEST(ColdWarm, RandomEditsLargeStore) { runSequences(1, sequences(150), 6, 256ull << 20, false); }
TEST(ColdWarm, RandomEditsTinyStoreEvicts) { runSequences(100001, sequences(60), 6, 96ull << 10, false); }
TEST(ColdWarm, RandomEditsDiskTier) { runSequences(200001, sequences(30), 6, 48ull << 10, true); }

}  // namespace
}  // namespace gobo::testing
