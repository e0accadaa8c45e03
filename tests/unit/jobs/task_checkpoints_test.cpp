// SPDX-License-Identifier: Apache-2.0
// Checkpoint files under other names: a state of another recipe is no state, whatever file and row say of it.
#include "server/jobs/task_checkpoints.h"

#include <fstream>
#include <random>

#include "server/log.h"
#include "unit/jobs/store_fixture.h"

namespace gobo::task_checkpoints_test {
namespace {

struct Checkpoints : test::StoreFixture {
  JobFiles files_;
  void SetUp() override {
    setLogLevel(LogLevel::Off);
    StoreFixture::SetUp();
    bool alone = false;
    ASSERT_TRUE(files_.open(folder, alone).ok());
  }
  static TermPtr state(int i) {
    auto term = std::make_shared<Term>("path_trace", Domain::Pixel, Extent{3, 2, 1});
    for (double& v : term->addPlane<double>("sum", 3)) v = i;
    for (uint32_t& v : term->addPlane<uint32_t>("samples")) v = 4;
    return term;
  }
  static Hash128 recipe(int i) { return Hasher("recipe").add(i).digest(); }
};

TEST_F(Checkpoints, StatesThatTradeNamesAndRowsAreNotUsed) {
  constexpr int kStates = 12;
  submit(makeJob());
  const auto lease = claim();
  ASSERT_TRUE(lease);
  {
    TaskCheckpoints writing(*store, files_, *lease, {});
    for (int i = 0; i < kStates; ++i) writing.save(recipe(i), 1, state(i));
    ASSERT_TRUE(writing.flush(0.5, 4).ok());
  }
  const std::vector<CheckpointRow> rows = *store->checkpoints(lease->task);
  ASSERT_EQ(rows.size(), size_t(kStates));
  const auto wrong = [&](std::vector<CheckpointRow> said) {
    int used = 0;
    TaskCheckpoints reading(*store, files_, *lease, std::move(said));
    for (int i = 0; i < kStates; ++i) {
      const TermPtr term = reading.load(recipe(i), 1);
      if (!term) continue;
      ++used;
      EXPECT_EQ(term->content(), state(i)->content()) << i;  // never another's
    }
    return used;
  };
  EXPECT_EQ(wrong(rows), kStates);
  std::mt19937 random(3);
  for (int round = 0; round < 50; ++round) {
    // The rows' digests trade places: each names a whole file that has its digest, of another recipe.
    std::vector<CheckpointRow> traded = rows;
    const size_t a = random() % rows.size(), b = (a + 1 + random() % (rows.size() - 1)) % rows.size();
    std::swap(traded[a].digest, traded[b].digest);
    EXPECT_EQ(wrong(traded), kStates - 2) << a << " " << b;
  }
  // The files trade names.
  for (size_t i = 0; i < rows.size(); ++i) std::filesystem::rename(files_.checkpointPath(lease->task, rows[i].digest), folder + "/" + std::to_string(i));
  for (size_t i = 0; i < rows.size(); ++i)
    std::filesystem::rename(folder + "/" + std::to_string(i), files_.checkpointPath(lease->task, rows[(i + 1) % rows.size()].digest));
  EXPECT_EQ(wrong(rows), 0);
}

// A render that searches for its sample count begins with few: what an earlier one has of many waits until as many are asked for.
TEST_F(Checkpoints, ARunTowardsFewerReplacesNothingOfOneTowardsMore) {
  submit(makeJob());
  const auto lease = claim();
  ASSERT_TRUE(lease);
  {
    TaskCheckpoints writing(*store, files_, *lease, {});
    EXPECT_FALSE(writing.load(recipe(0), 256));
    EXPECT_FALSE(writing.kept());
    writing.save(recipe(0), 256, state(7));
    EXPECT_TRUE(writing.kept());
    ASSERT_TRUE(writing.flush(0.5, 4).ok());
    EXPECT_FALSE(writing.load(recipe(0), 1));
    writing.save(recipe(0), 1, state(1));
    EXPECT_FALSE(writing.pending());
  }
  TaskCheckpoints after(*store, files_, *lease, *store->checkpoints(lease->task));
  EXPECT_FALSE(after.load(recipe(0), 1));
  after.save(recipe(0), 1, state(1));
  EXPECT_FALSE(after.pending());
  EXPECT_FALSE(after.kept()) << "the next run towards as many begins anew";
  const TermPtr found = after.load(recipe(0), 256);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->content(), state(7)->content());
  after.save(recipe(0), 512, state(9));
  ASSERT_TRUE(after.flush(0.7, 8).ok());
  EXPECT_EQ((*store->checkpoints(lease->task)).at(0).blocks, 512u);
}

}  // namespace
}  // namespace gobo::task_checkpoints_test
