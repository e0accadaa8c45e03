// SPDX-License-Identifier: Apache-2.0
#include "server/scheduler.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "base/check.h"

namespace gobo {
inline namespace server {

namespace {
constexpr double kMeanWeight = 0.2;   // of the newest value in a moving mean
constexpr double kFirstRunGuess = 1;  // seconds, before anything was measured
constexpr double kLookAgain = 0.01;   // seconds
constexpr double kRounding = 1e-9;    // seconds: sums of intervals against their bound

template <typename Map>
size_t active(const Map& map) {
  return size_t(std::count_if(map.begin(), map.end(), [](const auto& c) { return c.second.queued + c.second.running > 0; }));
}

/// One that comes back from idle starts at the present virtual time of its likes.
template <typename Map, typename Member>
void comeBack(const Map& map, Member& member, double& clock) {
  if (member.queued + member.running > 0) return;
  double least = kNever;
  for (const auto& [name, c] : map)
    if (c.queued + c.running > 0) least = std::min(least, c.virtualTime);
  if (std::isfinite(least)) clock = std::max(clock, least);
  member.virtualTime = std::max(member.virtualTime, clock);
}

void intoMean(double& mean, double value) { mean = mean > 0 ? mean + kMeanWeight * (value - mean) : std::max(value, 1e-9); }
}  // namespace

Scheduler::Scheduler(const SchedulerOptions& options) : options_(options) { GOBO_CHECK_GT(options.slots, 0); }

double Scheduler::meanRun(int c) const {
  const double mean = classes_[size_t(c)].stats.meanRunSeconds;
  return mean > 0 ? mean : kFirstRunGuess;
}

bool Scheduler::due(int c) const {
  const ClassState& s = classes_[size_t(c)];
  return s.queued > 0 && s.running == s.beside && s.waited >= options_.ageing[size_t(c)] - kRounding;
}

// Brings all books to `now`: run seconds of clients, virtual time, waiting of classes.
double Scheduler::advance(double now) {
  if (!(now > now_)) return now_;
  for (auto& [id, job] : jobs_) {
    if (job.state == State::Queued) continue;
    const double seconds = now - job.chargedUntil;
    ClassState& s = classes_[size_t(job.spec.jobClass)];
    Group& group = s.groups[job.group];
    Client& client = group.clients[job.client];
    for (Client* who : {static_cast<Client*>(&group), &client}) {
      who->virtualTime += seconds;
      who->seconds += seconds;
    }
    s.stats.runSeconds += seconds;
    job.ran += seconds;
    job.chargedUntil = now;
    // Fluid fair share: what an ideal division among the active ones would have given each.
    s.virtualTime += seconds / double(std::max<size_t>(active(s.groups), 1));
    group.clock += seconds / double(std::max<size_t>(active(group.clients), 1));
  }
  for (auto& s : classes_) {
    const double seconds = std::isfinite(now_) ? now - now_ : 0;
    if (s.running > s.beside) {
      s.served += seconds;
      if (s.served >= options_.protectedSeconds - kRounding) s.waited = s.served = 0;
    } else if (s.queued > 0) {
      s.waited += seconds;
    }
  }
  return now_ = now;
}

void Scheduler::activate(ClassState& s, Group& group, Client& client) {
  comeBack(s.groups, group, s.virtualTime);
  comeBack(group.clients, client, group.clock);
}

void Scheduler::settle(ClassState& s) {
  const auto idle = [](const Client& c, double clock) { return c.queued + c.running == 0 && c.virtualTime <= clock + kRounding; };
  for (auto& g : s.groups) std::erase_if(g.second.clients, [&](const auto& c) { return idle(c.second, g.second.clock); });
  std::erase_if(s.groups, [&](const auto& g) { return idle(g.second, s.virtualTime); });
}

void Scheduler::count(Job& job, int queued, int running) {
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  Group& group = s.groups[job.group];
  for (Client* who : {static_cast<Client*>(&group), &group.clients[job.client]}) {
    who->queued += size_t(queued);
    who->running += size_t(running);
  }
  s.queued += size_t(queued);
  s.running += size_t(running);
  queued_ += size_t(queued);
  running_ += size_t(running);
  if (job.spec.small) s.small += size_t(queued);
  if (job.beside) s.beside += size_t(running), beside_ += size_t(running);
  if (queued == 0) return;
  size_t& mine = queuedOf_[job.group];
  mine += size_t(queued);
  if (mine == 0) queuedOf_.erase(job.group);
}

double Scheduler::retryMs(int c, bool clientBound, double now) {
  ClassState& s = classes_[size_t(c)];
  double interval = s.stats.startInterval > 0 ? s.stats.startInterval : meanRun(c) / options_.slots;
  interval = std::max(interval, s.queued > 0 ? now - std::max(s.lastStart, s.waitingSince) : 0.0);  // a stall shows before its end
  double scale = double(++s.refusedSinceStart);
  if (clientBound) {
    const auto waiting = std::count_if(s.groups.begin(), s.groups.end(), [](const auto& g) { return g.second.queued > 0; });
    scale *= double(std::max<long>(waiting, 1));
  }
  return std::clamp(interval * scale * 1e3, options_.retryMinMs, options_.retryMaxMs);
}

Submit Scheduler::refusal(const JobSpec& spec, double now) {
  now = advance(now);
  const int c = int(spec.jobClass);
  GOBO_CHECK(c >= 0 && c < kJobClasses);
  ClassState& s = classes_[size_t(c)];
  Submit result;
  const auto refuse = [&](Code code, std::string why, double retry) {
    ++s.stats.refused;
    result.status = Status(code, std::move(why));
    result.retryMs = retry;
    return result;
  };
  if (spec.pinnedBytes > options_.pinnedLimit)
    return refuse(
        Code::FailedPrecondition,
        "pinned bytes of the plan = " + std::to_string(spec.pinnedBytes) + ": at most " + std::to_string(options_.pinnedLimit) + " (scheduler.pinned_bytes)",
        0);
  if (spec.deadline <= now) return refuse(Code::DeadlineExceeded, "the deadline had passed on arrival", 0);
  if (s.queued >= options_.queueLimit[size_t(c)])
    return refuse(Code::ResourceExhausted,
                  std::string("queue is full: ") + std::to_string(s.queued) + " jobs of class " + kClassNames[c] + " wait: at most " +
                      std::to_string(options_.queueLimit[size_t(c)]) + " (scheduler.queued_" + kClassNames[c] + ")",
                  retryMs(c, false, now));
  const std::string name = spec.group.empty() ? spec.client : spec.group;
  const auto mine = queuedOf_.find(name);
  if ((mine == queuedOf_.end() ? 0 : mine->second) >= options_.clientLimit)
    return refuse(Code::ResourceExhausted,
                  "too many jobs of client '" + name + "' wait: at most " + std::to_string(options_.clientLimit) + " (scheduler.queued_per_client)",
                  retryMs(c, true, now));
  // Whoever is quick must leave places in the queue, or nobody else could ever enter it.
  const auto part = std::max<size_t>(1, size_t(std::ceil(double(options_.queueLimit[size_t(c)]) * options_.clientPart)));
  if (const auto known = s.groups.find(name); known != s.groups.end() && known->second.queued >= part)
    return refuse(Code::ResourceExhausted,
                  "too many jobs of client '" + name + "' wait in class " + kClassNames[c] + ": at most " + std::to_string(part) +
                      ", a part of scheduler.queued_" + kClassNames[c],
                  retryMs(c, true, now));
  return result;
}

Submit Scheduler::submit(const JobSpec& spec, double now) {
  Submit result = refusal(spec, now);
  if (!result.status.ok()) return result;
  ClassState& s = classes_[size_t(spec.jobClass)];
  const std::string name = spec.group.empty() ? spec.client : spec.group;
  Job job;
  job.spec = spec;
  job.group = name;
  Group& group = s.groups[name];
  job.client =
      active(group.clients) < kNames || (group.clients.count(spec.client) && group.clients[spec.client].queued + group.clients[spec.client].running > 0)
          ? spec.client
          : std::string();
  activate(s, group, group.clients[job.client]);
  if (s.queued == 0) s.waitingSince = now_;
  count(job, 1, 0);
  ++s.stats.submitted;
  result.id = next_++;
  jobs_[result.id] = std::move(job);
  return result;
}

void Scheduler::leave(Jobs::iterator at) {
  Job& job = at->second;
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  if (job.state == State::Queued) {
    count(job, -1, 0);
  } else {
    count(job, 0, -1);
    pinned_ -= job.spec.pinnedBytes;
  }
  jobs_.erase(at);
  if (s.queued == 0 && s.running == 0) s.waited = s.served = 0;
  settle(s);
}

void Scheduler::start(JobId id, Job& job, double now, bool beside) {
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  if (!beside && due(int(job.spec.jobClass))) job.protectedUntil = now + options_.protectedSeconds;
  job.beside = beside;
  count(job, -1, 1);
  pinned_ += job.spec.pinnedBytes;
  job.state = State::Running;
  job.started = job.chargedUntil = now;
  job.ranBefore = job.ran;
  job.blockedSince = kNever;
  ++s.stats.started;
  if (beside) return;
  if (s.lastStart >= s.waitingSince) intoMean(s.stats.startInterval, now - s.lastStart);  // jobs waited all the time between
  s.lastStart = now;
  s.refusedSinceStart = 0;
}

void Scheduler::expire(double now, std::vector<Action>& actions) {
  for (auto at = jobs_.begin(); at != jobs_.end();) {
    const auto job = at++;
    if (job->second.stopPending) {
      job->second.stopPending = false;
      actions.push_back({Action::Kind::Stop, job->first, StopReason::Cancelled});
    } else if (job->second.spec.deadline <= now && !job->second.cancelled) {
      if (job->second.state == State::Queued) {
        actions.push_back({Action::Kind::Expire, job->first, StopReason::Deadline});
        ++classes_[size_t(job->second.spec.jobClass)].stats.expired;
        leave(job);
      } else if (job->second.state != State::Stopping) {
        job->second.state = State::Stopping;
        actions.push_back({Action::Kind::Stop, job->first, StopReason::Deadline});
      }
    }
  }
}

std::vector<int> Scheduler::classOrder() const {
  std::vector<int> order{0, 1, 2};
  const auto overdue = [&](int c) { return due(c) ? classes_[size_t(c)].waited - options_.ageing[size_t(c)] + 1 : 0; };
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) { return overdue(a) > overdue(b); });
  return order;
}

bool Scheduler::preemptFor(const Job& job, double now, Room& room, std::vector<Action>& actions) {
  std::vector<std::pair<JobId, Job*>> victims;
  for (auto& [id, other] : jobs_)
    if (other.state == State::Running && !other.beside && other.spec.jobClass > job.spec.jobClass && other.protectedUntil <= now && !other.cancelled)
      victims.emplace_back(id, &other);
  std::sort(victims.begin(), victims.end(), [](const auto& a, const auto& b) {
    return std::tuple(a.second->spec.jobClass, a.second->started, a.first) > std::tuple(b.second->spec.jobClass, b.second->started, b.first);
  });
  int64_t slots = room.freeSlots + room.comingSlots;
  uint64_t bytes = room.freeBytes + room.comingBytes;
  const auto enough = [&] { return slots >= 1 && bytes >= job.spec.pinnedBytes; };
  size_t taken = 0;
  while (!enough() && taken < victims.size()) {
    ++slots;
    bytes += victims[taken++].second->spec.pinnedBytes;
  }
  if (!enough()) return false;
  victims.resize(taken);
  for (size_t i = 0; i < victims.size();) {  // the first ones may have proved needless when a larger one followed
    const uint64_t its = victims[i].second->spec.pinnedBytes;
    if (slots >= 2 && bytes - its >= job.spec.pinnedBytes) {
      --slots;
      bytes -= its;
      victims.erase(victims.begin() + long(i));
    } else {
      ++i;
    }
  }
  for (const auto& [id, victim] : victims) {
    victim->state = State::Preempting;
    ++room.comingSlots;
    room.comingBytes += victim->spec.pinnedBytes;
    actions.push_back({Action::Kind::Preempt, id, StopReason::Preempted});
  }
  return true;
}

double Scheduler::sliceEnd(const Job& job) const {
  return std::max(job.started + std::max(options_.slice[size_t(job.spec.jobClass)], job.ranBefore / 8), job.protectedUntil);
}

bool Scheduler::sliceFor(const Job& job, double now, Room& room, std::vector<Action>& actions) {
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  const auto had = [&](const std::string& group) {
    const auto at = s.groups.find(group);
    return at == s.groups.end() ? 0.0 : at->second.virtualTime;
  };
  std::pair<JobId, Job*> victim{0, nullptr};
  for (auto& [id, other] : jobs_) {
    if (other.state != State::Running || other.beside || other.cancelled || other.spec.jobClass != job.spec.jobClass || other.group == job.group) continue;
    if (sliceEnd(other) > now + kRounding || had(other.group) <= had(job.group)) continue;
    if (room.freeBytes + room.comingBytes + other.spec.pinnedBytes < job.spec.pinnedBytes) continue;
    if (!victim.second || had(other.group) > had(victim.second->group)) victim = {id, &other};
  }
  if (!victim.second) return false;
  victim.second->state = State::Preempting;
  ++room.comingSlots;
  room.comingBytes += victim.second->spec.pinnedBytes;
  actions.push_back({Action::Kind::Preempt, victim.first, StopReason::Preempted});
  return true;
}

/// Rules 2, 3 and 7: the queued jobs of a class in the order in which they are asked.
class Scheduler::Line {
 public:
  Line(const Scheduler& s, int c, double now) : mean_(s.meanRun(c)) {
    for (const auto& [id, job] : s.jobs_) {
      if (int(job.spec.jobClass) != c) continue;
      GroupLine& group = groups_[job.group];
      NameLine& line = group.lines[job.client];
      if (job.state != State::Queued) {
        const double spoken = job.beside ? 0 : std::max(0.0, mean_ - (now - job.started));  // not consumed yet, but spoken for
        line.virtualTime += spoken;
        group.virtualTime += spoken;
      } else if (now >= job.blockedSince + s.options_.reserveAfter) {
        reserved_.push_back(id);
      } else {
        line.jobs.push_back(id);
      }
    }
    for (auto& [groupName, group] : groups_) {
      const Group& books = s.classes_[size_t(c)].groups.at(groupName);
      group.virtualTime += books.virtualTime;
      for (auto& [name, line] : group.lines) {
        line.virtualTime += books.clients.at(name).virtualTime;
        std::stable_sort(line.jobs.begin(), line.jobs.end(), [&](JobId a, JobId b) { return s.jobs_.at(a).spec.deadline < s.jobs_.at(b).spec.deadline; });
      }
    }
  }
  /// They go first, oldest first.
  const std::vector<JobId>& reserved() const { return reserved_; }
  std::optional<JobId> next() {
    lastGroup_ = nullptr;
    NameLine* best = nullptr;
    for (auto& [name, group] : groups_) {
      NameLine* const line = group.next();
      if (line && (!best || std::tuple(group.virtualTime, line->first()) < std::tuple(lastGroup_->virtualTime, best->first())))
        lastGroup_ = &group, best = line;
    }
    lastName_ = best;
    if (!best) return std::nullopt;
    return best->jobs[best->at++];
  }
  /// The one that next() gave last starts.
  void took() {
    lastGroup_->virtualTime += mean_;
    lastName_->virtualTime += mean_;
  }

 private:
  struct NameLine {
    std::vector<JobId> jobs;
    size_t at = 0;
    double virtualTime = 0;
    bool over() const { return at == jobs.size(); }
    JobId first() const { return jobs[at]; }
  };
  struct GroupLine {
    std::map<std::string, NameLine> lines;
    double virtualTime = 0;
    NameLine* next() {
      NameLine* best = nullptr;
      for (auto& [name, line] : lines)
        if (!line.over() && (!best || std::tuple(line.virtualTime, line.first()) < std::tuple(best->virtualTime, best->first()))) best = &line;
      return best;
    }
  };
  double mean_;
  std::vector<JobId> reserved_;
  std::map<std::string, GroupLine> groups_;
  GroupLine* lastGroup_ = nullptr;
  NameLine* lastName_ = nullptr;
};

bool Scheduler::mayGoBeside(const Job& job, const Room& room) const {
  if (!job.spec.small || room.beside <= 0 || room.freeBytes < job.spec.pinnedBytes) return false;
  return std::none_of(jobs_.begin(), jobs_.end(), [&](const auto& other) {
    return other.second.state != State::Queued && !other.second.beside && other.second.spec.jobClass < job.spec.jobClass;
  });
}

// Starts the job, or books what it waits for. `first`: nobody may pass it. True if it started.
bool Scheduler::tryStart(JobId id, Job& job, double now, bool first, Room& room, std::vector<Action>& actions) {
  const uint64_t need = job.spec.pinnedBytes;
  if (room.freeSlots >= 1 && room.freeBytes >= need) {
    start(id, job, now, false);
    --room.freeSlots;
    room.freeBytes -= need;
    actions.push_back({Action::Kind::Start, id});
    return true;
  }
  if (mayGoBeside(job, room)) {
    start(id, job, now, true);
    --room.beside;
    room.freeBytes -= need;
    actions.push_back({Action::Kind::Start, id, StopReason::None, true});
    return false;  // a small one's time is charged when it was had, not before
  }
  if (room.freeBytes < need) job.blockedSince = std::min(job.blockedSince, now);
  const bool comes = (room.freeSlots + room.comingSlots >= 1 && room.freeBytes + room.comingBytes >= need) || preemptFor(job, now, room, actions) ||
                     sliceFor(job, now, room, actions);
  if (!comes && !first) return false;
  // Hold: free room first, then what jobs that are giving way will leave.
  const uint64_t bytes = std::min(need, room.freeBytes);
  room.freeBytes -= bytes;
  room.comingBytes -= std::min(need - bytes, room.comingBytes);
  if (room.freeSlots > 0) --room.freeSlots;
  else if (room.comingSlots > 0) --room.comingSlots;
  return false;
}

std::vector<Action> Scheduler::decide(double now) {
  now = advance(now);
  std::vector<Action> actions;
  expire(now, actions);
  for (auto& [id, job] : jobs_)
    if (job.beside && job.state == State::Running && now >= job.started + options_.besideSeconds - kRounding) {
      job.state = State::Preempting;
      actions.push_back({Action::Kind::Preempt, id, StopReason::Preempted});
    }
  if (queued_ == 0) return actions;
  Room room{options_.slots - int64_t(running_ - beside_), 0, options_.pinnedLimit - pinned_, 0, options_.beside - int64_t(beside_)};
  int lowest = -1;            // class of a job that could be preempted
  int highest = kJobClasses;  // of a job in a slot
  for (const auto& [id, job] : jobs_) {
    if (job.state != State::Queued && !job.beside) highest = std::min(highest, int(job.spec.jobClass));
    if (job.state == State::Preempting || job.state == State::Stopping) {
      room.comingSlots += !job.beside;
      room.comingBytes += job.spec.pinnedBytes;
    } else if (job.state == State::Running && !job.beside && job.protectedUntil <= now) {
      lowest = std::max(lowest, int(job.spec.jobClass));
    }
  }
  for (const int c : classOrder()) {
    ClassState& s = classes_[size_t(c)];
    if (s.queued == 0) continue;
    const bool sliced = std::any_of(jobs_.begin(), jobs_.end(), [&](const auto& j) {
      return j.second.state == State::Running && !j.second.beside && int(j.second.spec.jobClass) == c && sliceEnd(j.second) <= now + kRounding;
    });
    const auto nothingToBeHad = [&] {
      return room.freeSlots <= 0 && room.comingSlots <= 0 && lowest <= c && !sliced && (room.beside <= 0 || s.small == 0 || highest < c);
    };
    if (nothingToBeHad()) continue;
    const bool isDue = due(c);
    bool first = isDue;
    Line line(*this, c, now);
    for (const JobId id : line.reserved()) {
      if (tryStart(id, jobs_.at(id), now, true, room, actions)) highest = std::min(highest, c);
      first = false;
    }
    while (!nothingToBeHad()) {
      const auto id = line.next();
      if (!id) break;
      if (tryStart(*id, jobs_.at(*id), now, first, room, actions)) {
        line.took();
        highest = std::min(highest, c);
      }
      first = false;
    }
  }
  return actions;
}

void Scheduler::finished(JobId id, double now, Outcome outcome) {
  advance(now);
  const auto at = jobs_.find(id);
  GOBO_CHECK(at != jobs_.end() && at->second.state != State::Queued);
  const Job& job = at->second;
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  if (job.cancelled) ++s.stats.cancelled;
  else if (job.state == State::Stopping && outcome == Outcome::Failed) ++s.stats.expired;
  else if (outcome == Outcome::Done) ++s.stats.done;
  else ++s.stats.failed;
  if (!job.beside) {
    if (!job.cancelled) intoMean(s.stats.meanRunSeconds, job.ran);
    s.waited = s.served = 0;
  }
  leave(at);
}

bool Scheduler::preempted(JobId id, double now) {
  now = advance(now);
  const auto at = jobs_.find(id);
  GOBO_CHECK(at != jobs_.end() && at->second.state != State::Queued);
  Job& job = at->second;
  ClassState& s = classes_[size_t(job.spec.jobClass)];
  if (job.cancelled || job.spec.deadline <= now) {
    ++(job.cancelled ? s.stats.cancelled : s.stats.expired);
    leave(at);
    return false;
  }
  ++s.stats.preempted;
  pinned_ -= job.spec.pinnedBytes;
  if (s.queued == 0) s.waitingSince = now;
  count(job, 0, -1);
  if (job.beside) job.beside = job.spec.small = false;  // rule 10
  count(job, 1, 0);
  job.state = State::Queued;
  job.protectedUntil = -kNever;
  return true;
}

CancelResult Scheduler::cancel(JobId id, double now) {
  advance(now);
  const auto at = jobs_.find(id);
  if (at == jobs_.end()) return CancelResult::Unknown;
  Job& job = at->second;
  if (job.state == State::Queued) {
    ++classes_[size_t(job.spec.jobClass)].stats.cancelled;
    leave(at);
    return CancelResult::Removed;
  }
  if (!job.cancelled) job.stopPending = true;
  job.cancelled = true;
  job.state = State::Stopping;
  return CancelResult::Stopping;
}

std::optional<Place> Scheduler::place(JobId id, double now) {
  now = advance(now);
  const auto at = jobs_.find(id);
  if (at == jobs_.end()) return std::nullopt;
  const Job& job = at->second;
  Place place;
  const auto rest = [](const Job& j) { return std::max(j.spec.expected - j.ran, 0.0); };
  bool known = job.spec.expected > 0;
  double before = 0;  // seconds of slots
  const auto add = [&](const Job& other) {
    known = known && other.spec.expected > 0;
    before += rest(other);
  };
  if (job.state == State::Queued) {
    place.queued = true;
    const int c = int(job.spec.jobClass);
    Line line(*this, c, now);
    std::vector<JobId> first = line.reserved();
    for (auto next = line.next(); next; next = line.next()) {
      first.push_back(*next);
      line.took();
    }
    for (; first[place.ahead] != id; ++place.ahead) add(jobs_.at(first[place.ahead]));
    for (const auto& [otherId, other] : jobs_) {
      const int otherClass = int(other.spec.jobClass);
      if (other.state == State::Queued ? otherClass < c : !other.beside && otherClass <= c) add(other);
    }
  }
  if (known) place.expected = before / options_.slots + rest(job);
  return place;
}

double Scheduler::givesWayAt(const Job& job) const {
  const ClassState& s = classes_[size_t(job.spec.jobClass)];
  if (s.queued == 0 || !std::isfinite(sliceEnd(job))) return kNever;
  if (sliceEnd(job) > now_) return sliceEnd(job);
  // It is over, but whoever waits has had as much: until this one has had more.
  double least = kNever;
  for (const auto& [name, group] : s.groups)
    if (group.queued > 0 && name != job.group) least = std::min(least, group.virtualTime);
  const Group& mine = s.groups.at(job.group);
  return now_ + std::max((least - mine.virtualTime) / double(std::max<size_t>(mine.running, 1)), kLookAgain);
}

std::optional<double> Scheduler::nextEvent(double now) const {
  double next = kNever;
  for (const auto& [id, job] : jobs_) {
    if (job.stopPending) return now;
    if (job.state != State::Stopping) next = std::min(next, job.spec.deadline);
    if (job.beside && job.state == State::Running) next = std::min(next, job.started + options_.besideSeconds);
    if (queued_ == 0) continue;
    if (job.state == State::Running && job.protectedUntil > now_) next = std::min(next, job.protectedUntil);
    if (job.state == State::Running && !job.beside) next = std::min(next, givesWayAt(job));
    if (job.state == State::Queued && std::isfinite(job.blockedSince) && job.blockedSince + options_.reserveAfter > now_)
      next = std::min(next, job.blockedSince + options_.reserveAfter);
  }
  for (int c = 0; c < kJobClasses; ++c) {
    const ClassState& s = classes_[size_t(c)];
    const double left = options_.ageing[size_t(c)] - s.waited;
    if (s.queued > 0 && s.running == s.beside && left > kRounding) next = std::min(next, now_ + left);
  }
  if (!std::isfinite(next)) return std::nullopt;
  return std::max(next, now);
}

SchedulerStats Scheduler::stats() const {
  SchedulerStats stats;
  for (int c = 0; c < kJobClasses; ++c) {
    const ClassState& s = classes_[size_t(c)];
    stats.classes[size_t(c)] = s.stats;
    stats.classes[size_t(c)].queued = s.queued;
    stats.classes[size_t(c)].running = s.running;
    for (const auto& [name, group] : s.groups) stats.clientSeconds[name] += group.seconds;
  }
  stats.queued = queued_;
  stats.running = running_;
  stats.pinnedBytes = pinned_;
  for (const auto& [id, job] : jobs_)
    if (job.state == State::Running) stats.pinnedOfGroups[job.group] += job.spec.pinnedBytes;
  return stats;
}

}  // namespace server
}  // namespace gobo
