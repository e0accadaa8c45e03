// SPDX-License-Identifier: Apache-2.0
// Jobs that wait for others. A row of `depend` is a job that is not done yet and that another one needs: a job with rows gives no frames. Rows go when
// what is needed is done; when it fails, is cancelled or paused they stay, so a retry of it lets the others go on. Those of a job that ends
// before it was let go stay too: its retry waits again.
#include <algorithm>
#include <deque>
#include <map>
#include <set>

#include "server/jobs/sql_job_store.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

Status SqlJobStore::addNeeds(int64_t job, const std::vector<int64_t>& needs, const char* field) {
  // Shared: an end of theirs that is being written, which lets go of who waits, is waited for and then seen.
  std::vector<int64_t> ascending = needs;
  std::sort(ascending.begin(), ascending.end());
  for (int64_t need : ascending)
    if (need != job) GOBO_TRY(lockJob(need, Hold::Shared));
  for (size_t i = 0; i < needs.size(); ++i) {
    int64_t state = 0;
    {
      SqlQuery q(db(), "SELECT state FROM job WHERE id = ?1");
      q.bind(needs[i]);
      while (q.next()) state = q.integer(0);
      GOBO_TRY(q.status());
    }
    const std::string where = strf("%s[%zu]", field, i);
    if (!state) return notFound(where + ": no job '" + jobIdText(needs[i]) + "'", where);
    if (state == v1::Job::DONE) continue;
    SqlQuery q(db(), "INSERT INTO depend(job, needs) VALUES(?1, ?2)");
    GOBO_TRY(q.bind(job).bind(needs[i]).run());
  }
  return {};
}

Result<std::vector<int64_t>> SqlJobStore::needsOf(int64_t job) {
  std::vector<int64_t> needs;
  SqlQuery q(db(), "SELECT needs FROM depend WHERE job = ?1 ORDER BY needs");
  q.bind(job);
  while (q.next()) needs.push_back(q.integer(0));
  if (!q.status().ok()) return q.status();
  return needs;
}

Status SqlJobStore::readNeeds(int64_t first, int64_t last, std::vector<v1::Job>& jobs) {
  std::map<int64_t, v1::Job*> byId;
  for (v1::Job& job : jobs) byId[jobIdOf(job.id())] = &job;
  SqlQuery q(db(), "SELECT job, needs FROM depend WHERE job >= ?1 AND job <= ?2 ORDER BY job, needs");
  q.bind(first).bind(last);
  while (q.next())
    if (const auto at = byId.find(q.integer(0)); at != byId.end()) at->second->add_waits_for(jobIdText(q.integer(1)));
  return q.status();
}

Status SqlJobStore::depend(int64_t id, const std::vector<int64_t>& after) {
  const std::lock_guard lock(mutex_);
  return transact([&]() -> Status {
    {
      // One change of who waits for whom at a time: of two, each made without seeing the other, a circle could come. Submissions are kept off by the same
      // row of PostgreSQL's; SQLite has one writer anyway, and no such row.
      SqlQuery q(db(), "UPDATE counter SET value = value WHERE name = 'job'");
      GOBO_TRY(q.run());
    }
    GOBO_ASSIGN(const std::vector<int64_t> before, needsOf(id));
    std::set<int64_t> all(after.begin(), after.end());
    all.insert(before.begin(), before.end());
    all.insert(id);
    for (int64_t job : all) GOBO_TRY(lockJob(job, job == id ? Hold::Whole : Hold::Shared));
    GOBO_ASSIGN(JobRecord record, readJob(id));
    if (jobIsOver(record.job.state()) && !after.empty())
      return {Code::FailedPrecondition, jobIdText(id) + " is " + v1::Job::State_Name(record.job.state()) + ": it begins nothing that could wait", "id"};
    {
      SqlQuery q(db(), "DELETE FROM depend WHERE job = ?1");
      GOBO_TRY(q.bind(id).run());
    }
    GOBO_TRY(addNeeds(id, after, "after"));
    GOBO_TRY(checkCircle(id));
    GOBO_ASSIGN(const uint64_t revision, nextRevision());
    v1::JobSpec& spec = *record.job.mutable_spec();
    spec.clear_after();
    for (int64_t need : after) spec.add_after(jobIdText(need));
    {
      SqlQuery q(db(), "UPDATE job SET spec = ?2, revision = ?3 WHERE id = ?1");
      GOBO_TRY(q.bind(id).blob(spec.SerializeAsString()).bind(revision).run());
    }
    GOBO_TRY(noteJob(id, v1::JobLogEntry::DEPENDED));
    return tell(News::Work);
  });
}

Status SqlJobStore::checkCircle(int64_t job) {
  // All that is waited for from here on. Jobs that are done are in no row, and never wait again.
  std::multimap<int64_t, int64_t> edges;
  {
    SqlQuery q(db(),
               "WITH RECURSIVE way(job, needs) AS (SELECT job, needs FROM depend WHERE job = ?1"
               " UNION SELECT d.job, d.needs FROM depend d JOIN way ON d.job = way.needs) SELECT job, needs FROM way ORDER BY job, needs");
    q.bind(job);
    while (q.next()) edges.emplace(q.integer(0), q.integer(1));
    GOBO_TRY(q.status());
  }
  std::map<int64_t, int64_t> from;  // breadth first: the first way back is a shortest one
  std::deque<int64_t> next{job};
  while (!next.empty()) {
    const int64_t at = next.front();
    next.pop_front();
    for (auto [e, end] = edges.equal_range(at); e != end; ++e) {
      const int64_t need = e->second;
      if (need == job) {
        std::string way = jobIdText(job);
        for (int64_t k = at; k != job; k = from[k]) way = jobIdText(k) + " -> " + way;
        return invalidArgument("after: each of these would wait for the next: " + jobIdText(job) + " -> " + way, "after");
      }
      if (from.emplace(need, at).second) next.push_back(need);
    }
  }
  return {};
}

Status SqlJobStore::checkNobodyWaits(int64_t job) {
  constexpr int kNamed = 10;
  std::string names;
  int count = 0;
  SqlQuery q(db(), "SELECT job FROM depend WHERE needs = ?1 ORDER BY job");
  q.bind(job);
  while (q.next())
    if (++count <= kNamed) names += (names.empty() ? "" : ", ") + jobIdText(q.integer(0));
  GOBO_TRY(q.status());
  if (!count) return {};
  if (count > kNamed) names += strf(" and %d more", count - kNamed);
  return {Code::FailedPrecondition, jobIdText(job) + " is waited for by " + names + ": let them wait for something else, or delete them first", "id"};
}

Status SqlJobStore::letDependentsGo(int64_t job) {
  bool some = false;
  {
    SqlQuery q(db(), "DELETE FROM depend WHERE job = ?1 OR needs = ?1 RETURNING job");
    q.bind(job);
    while (q.next()) some = some || q.integer(0) != job;
    GOBO_TRY(q.status());
  }
  return some ? tell(News::Work) : Status();
}

}  // namespace jobs
}  // namespace gobo
