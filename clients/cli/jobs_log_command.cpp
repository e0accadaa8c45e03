// SPDX-License-Identifier: Apache-2.0
// `gobo jobs depend` and `gobo jobs log`.
#include <chrono>
#include <cstdio>
#include <deque>
#include <set>
#include <thread>

#include "base/image_io.h"
#include "commands.h"
#include "frames.h"
#include "request/request.h"
#include "words.h"

namespace gobo::cli {

namespace {

constexpr int kLogReconnects = 20;
constexpr std::chrono::milliseconds kLogPoll{500};
// Of changes that are made at the same moment one may be seen before another with a smaller number: what is younger than this is asked for again.
constexpr double kLogOverlap = 10;  // seconds

std::string logLine(const v1::JobLogEntry& e) {
  std::string text = timeText(e.unix_s()) + "  " + strf("%-11s", lower(v1::JobLogEntry::Kind_Name(e.kind())).c_str());
  if (e.has_frame()) text += strf(" frame %lld", static_cast<long long>(e.frame()));
  if (e.has_part()) text += strf(" part %u", e.part());
  if (!e.holder().empty()) text += " by " + escaped(e.holder());
  if (e.kind() == v1::JobLogEntry::DONE) text += strf(" in %.1f s", e.seconds());
  if (e.has_error()) text += ": " + escaped(e.error().message());
  return text;
}

Result<bool> jobHasEnded(Session& session, const std::string& id) {
  v1::GetJobRequest request;
  request.set_id(id);
  v1::Job job;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.jobs().Get(&call.context, request, &job)));
  return job.state() == v1::Job::DONE || job.state() == v1::Job::FAILED || job.state() == v1::Job::CANCELLED;
}

/// What was not printed yet, oldest first.
class LogTail {
 public:
  explicit LogTail(bool json) : json_(json) {}
  void show(const v1::JobLogReply& reply) {
    for (const v1::JobLogEntry& e : reply.entries()) {
      newest_ = std::max(newest_, e.unix_s());
      if (!shown_.insert(e.sequence()).second) continue;
      recent_.push_back({e.sequence(), e.unix_s()});
      std::printf("%s\n", json_ ? messageToJson(e, false).c_str() : logLine(e).c_str());
    }
    std::fflush(stdout);
    for (; !recent_.empty() && recent_.front().second < newest_ - kLogOverlap; recent_.pop_front()) {
      after_ = std::max(after_, recent_.front().first);
      shown_.erase(shown_.begin(), shown_.upper_bound(after_));
    }
  }
  uint64_t after() const { return after_; }

 private:
  bool json_;
  uint64_t after_ = 0;
  double newest_ = 0;
  std::set<uint64_t> shown_;                        // above after_
  std::deque<std::pair<uint64_t, double>> recent_;  // sequence, time
};

Result<int> showLog(Session& session, const JobLogCommand& c) {
  v1::JobLogRequest request;
  request.set_id(c.id);
  request.set_most(c.most);
  if (!c.frames.empty()) {
    GOBO_ASSIGN(const std::vector<int64_t> frames, parseFrames(c.frames, "--frame"));
    request.mutable_frames()->Add(frames.begin(), frames.end());
  }
  LogTail tail(c.json);
  for (int broken = 0;;) {
    // Asked first: whatever led to the end is in the log then.
    const auto ended = c.follow ? jobHasEnded(session, c.id) : Result<bool>(true);
    v1::JobLogReply reply;
    Status status = ended.status();
    if (status.ok()) {
      Session::Call call(session);
      status = session.statusOf(session.jobs().Log(&call.context, request, &reply));
    }
    if (!status.ok()) {
      if (!c.follow || status.code() != Code::Unavailable || ++broken > kLogReconnects) return status;
    } else {
      broken = 0;
      tail.show(reply);
      if (*ended) return int(kOk);
    }
    request.set_after(tail.after());
    request.set_most(10000);
    std::this_thread::sleep_for(kLogPoll);
    if (interrupted()) return Status(Code::Cancelled, "interrupted");
  }
}

template <typename Body>
int withJobs(const SessionOptions& options, const Body& body) {
  if (options.local) return complain(invalidArgument("jobs need a running gobod: with --local nothing outlives this process"));
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  auto code = body(**session);
  return code.ok() ? *code : complain(code.status());
}

}  // namespace

int runJobDepend(const SessionOptions& options, const std::vector<std::string>& ids, const std::string& after, bool none, bool json) {
  if (after.empty() && !none) return complain(invalidArgument("--after JOB,... or --none: one of them must be given"));
  return withJobs(options, [&](Session& session) -> Result<int> {
    int code = kOk;
    for (const std::string& id : ids) {
      v1::DependRequest request;
      request.set_id(id);
      for (const std::string& need : commaList(after)) request.add_after(need);
      v1::Job job;
      Session::Call call(session);
      if (const Status status = session.statusOf(session.jobs().Depend(&call.context, request, &job)); !status.ok()) {
        const int failed = complain(status);
        if (code == kOk) code = failed;
      } else if (json) {
        std::printf("%s\n", messageToJson(job, true).c_str());
      } else {
        std::string waits;
        for (const std::string& need : job.waits_for()) waits += (waits.empty() ? " waits for " : ", ") + escaped(need);
        std::printf("%s%s\n", escaped(job.id()).c_str(), waits.empty() ? " waits for nothing" : waits.c_str());
      }
    }
    return code;
  });
}

int runJobLog(const SessionOptions& options, const JobLogCommand& command) {
  return withJobs(options, [&](Session& session) { return showLog(session, command); });
}

}  // namespace gobo::cli
