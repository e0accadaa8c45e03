// SPDX-License-Identifier: Apache-2.0
// The store's edition, and the one question that all streams share: whatever get() says differently has another edition, whoever changed it, and
// looking changes nothing.
#include "server/jobs/store_looks.h"

#include <random>

#include "server/jobs/job_hub.h"
#include "unit/jobs/store_fixture.h"

namespace gobo {
namespace {

struct LookedAt : test::OnEachStore<test::StoreFixture> {
  std::string all() {
    std::string text;
    const std::vector<int64_t> ids = *store->jobIds();
    for (const int64_t id : ids) text += store->get(id, true)->job.SerializeAsString() + '\n';
    return text;
  }
};
INSTANTIATE_TEST_SUITE_P(Stores, LookedAt, test::kBothStores, test::storeName);

TEST_P(LookedAt, WhatReadsDifferentlyHasAnotherEdition) {
  const auto other = another();
  ASSERT_TRUE(other.ok()) << other.status().toString();
  std::mt19937 random(5);
  std::vector<Lease> leases;
  std::string before = all(), edition = *store->edition();
  int changes = 0;
  for (int step = 0; step < 150; ++step) {
    SqlJobStore& by = random() % 2 ? *store : **other;
    const std::vector<int64_t> ids = *by.jobIds();
    const int64_t id = ids.empty() ? 0 : ids[random() % ids.size()], first = ids.empty() ? 0 : ids.front();
    bool existed = false;
    time += 0.25;
    switch (random() % 12) {
      case 0:
      case 1: (void)by.submit(makeJob(1 + int(random() % 3)), existed); break;
      case 2: (void)by.pause(id); break;
      case 3:
      case 4: (void)by.resume(id); break;
      case 5: (void)by.prioritize(id, random() % 2 ? v1::JobSpec::HIGH : v1::JobSpec::LOW); break;
      case 6: (void)(random() % 4 ? by.retry(id) : by.cancel(id)); break;
      case 7: (void)by.depend(id, id != first ? std::vector<int64_t>{first} : std::vector<int64_t>{}); break;
      case 8: (void)(random() % 3 ? by.expireLeases() : by.endAllLeases()); break;
      case 9: (void)by.remove(id); break;
      default:
        if (leases.empty() || random() % 3 == 0) {
          if (auto lease = by.claim("w", 3); lease.ok() && *lease) leases.push_back(**lease);
          break;
        }
        const Lease lease = leases[random() % leases.size()];
        const unsigned kind = random() % 4;
        if (kind == 0) (void)by.checkpoint(lease, {"recipe", "digest" + std::to_string(step), uint32_t(random() % 8), 7}, 0.5, 3);
        else if (kind == 1) (void)by.complete(lease, files(), 1);
        else if (kind == 2) (void)by.fail(lease, {Status(Code::Internal, "made to fail"), true, false});
        else (void)by.release(lease);
    }
    const std::string now = all(), next = *store->edition();
    if (now != before) {
      EXPECT_NE(next, edition) << "step " << step;
      ++changes;
    }
    before = now;
    edition = next;
  }
  EXPECT_GT(changes, 40);
}

TEST_P(LookedAt, LookingChangesNothing) {
  const int64_t id = submit(makeJob(2));
  ASSERT_TRUE(store->pause(id).ok());
  const std::string edition = *store->edition();
  (void)all();
  EXPECT_FALSE(claim());
  EXPECT_TRUE(store->changes(id, 0).ok());
  EXPECT_TRUE(store->expireLeases().ok());
  EXPECT_EQ(*store->edition(), edition);
}

TEST_P(LookedAt, ManyStreamsAskOnce) {
  const int64_t id = submit(makeJob());
  int statements = 0;
  options.step = [&](const char*) {
    ++statements;
    return Status();
  };
  open();
  JobHub hub;
  StoreLooks looks(*store);
  statements = 0;
  const uint64_t first = looks.number(hub.version());
  const int question = statements;
  for (int stream = 0; stream < 1000; ++stream) EXPECT_EQ(looks.number(hub.version()), first);
  EXPECT_LE(statements, 20 * question);  // a thousand within one tenth of a second, or a few on a machine that stands still
  ASSERT_TRUE(store->pause(id).ok());
  hub.changed();
  EXPECT_NE(looks.number(hub.version()), first);  // at once: the hub says that this daemon did something
}

TEST_P(LookedAt, AStoreThatDoesNotAnswerHasChanged) {
  bool broken = false;
  options.step = [&](const char*) { return broken ? Status(Code::Unavailable, "made to fail") : Status(); };
  open();
  JobHub hub;
  StoreLooks looks(*store);
  const uint64_t first = looks.number(0);
  broken = true;
  hub.changed();
  const uint64_t failed = looks.number(hub.version());
  EXPECT_NE(failed, first);
  broken = false;
  hub.changed();
  EXPECT_NE(looks.number(hub.version()), failed);
}

}  // namespace
}  // namespace gobo
