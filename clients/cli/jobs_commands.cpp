// SPDX-License-Identifier: Apache-2.0
// `gobo jobs ...`: durable renders. A stream that breaks (the daemon restarts) is opened again.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "frames.h"
#include "report.h"
#include "request/request.h"
#include "server/door/upstream.h"
#include "server/encode.h"
#include "server/jobs/out_pattern.h"
#include "words.h"

namespace gobo::cli {

namespace fs = std::filesystem;

namespace {

/// A job's stream that is opened again when the daemon goes away while the job goes on.
class Reopening {
 public:
  /// Something arrived: the tries count anew.
  void arrived() { broken_ = 0; }
  /// After a pause whether to try again; what to answer otherwise is in `status`. `hintMs`: what the server said of when to come again.
  bool again(Status& status, long hintMs) {
    // A daemon that closes answers calls with CANCELLED; ^C here reads the same.
    const bool passing = status.code() == Code::Unavailable || (status.code() == Code::Cancelled && !interrupted());
    if (!passing || broken_ >= kMost) return false;
    const long ms = std::max<long>(std::min(3000, 100 << std::min(broken_, 5)), std::min(hintMs, kLongestHintMs));
    ++broken_;
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(ms);
    while (!interrupted() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (!interrupted()) return true;
    status = Status(Code::Cancelled, "interrupted");
    return false;
  }

 private:
  static constexpr int kMost = 20;
  static constexpr long kLongestHintMs = 3600000;  // of the servers
  int broken_ = 0;
};

std::string stateOf(const v1::Job& job) { return lower(v1::Job::State_Name(job.state())); }
bool ended(const v1::Job& job) { return job.state() == v1::Job::DONE || job.state() == v1::Job::FAILED || job.state() == v1::Job::CANCELLED; }

std::string uniqueKey() {
  std::random_device device;
  std::string key;
  for (int i = 0; i < 4; ++i) key += strf("%08x", unsigned(device()));
  return key;
}

std::string doneText(const v1::Frame& f) {
  const std::string done = strf("%.0f %%", 100 * f.progress());
  return f.parts() ? strf("%u of %u parts, ", f.parts_done(), f.parts()) + done : done;
}

/// "j-1, j-2 and 5 more"
std::string waitsText(const v1::Job& job) {
  constexpr int kNamed = 8;
  std::string text;
  for (int i = 0; i < std::min(kNamed, job.waits_for_size()); ++i) text += (i ? ", " : "") + escaped(job.waits_for(i));
  return job.waits_for_size() > kNamed ? text + strf(" and %d more", job.waits_for_size() - kNamed) : text;
}

void printJob(const v1::Job& job) {
  std::printf("%s  %s  %s  %.0f %%  %llu of %llu frames%s\n", escaped(job.id()).c_str(), escaped(job.spec().name()).c_str(), stateOf(job).c_str(),
              100 * job.progress(), static_cast<unsigned long long>(job.frames_done()), static_cast<unsigned long long>(job.frames_total()),
              job.frames_failed() ? strf(", %llu failed", static_cast<unsigned long long>(job.frames_failed())).c_str() : "");
  std::printf("  submitted %s, started %s, ended %s, scene %s, results %s%s\n", timeText(job.submitted_unix_s()).c_str(),
              timeText(job.started_unix_s()).c_str(), timeText(job.ended_unix_s()).c_str(), escaped(job.spec().request().scene()).c_str(),
              bytesText(job.result_bytes()).c_str(), job.results_expired() ? " (expired)" : "");
  if (job.waits_for_size()) std::printf("  waits for %s\n", waitsText(job).c_str());
  if (job.has_error()) std::printf("  error: %s\n", escaped(job.error().message()).c_str());
  if (job.frames().empty()) return;
  std::vector<std::vector<std::string>> rows;
  for (const v1::Frame& f : job.frames()) {
    std::string files = f.has_error() ? "error: " + escaped(f.error().message()) : "";
    for (const v1::FrameFile& file : f.files()) files += (files.empty() ? "" : " ") + escaped(file.name());
    rows.push_back({std::to_string(f.frame()), lower(v1::Frame::State_Name(f.state())), doneText(f), std::to_string(f.spp()), std::to_string(f.attempts()),
                    strf("%.1f", f.seconds()), files});
  }
  printTable({"frame", "state", "done", "spp", "attempts", "s", "files"}, rows, {true, false, true, true, true, true, false});
}

Result<v1::Job> getJob(Session& session, const std::string& id) {
  v1::GetJobRequest request;
  request.set_id(id);
  v1::Job job;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.jobs().Get(&call.context, request, &job)));
  return job;
}

// 0 when it is done; otherwise says on stderr what became of it.
int exitOfJob(const v1::Job& job) {
  if (job.state() == v1::Job::DONE) return kOk;
  if (job.state() == v1::Job::CANCELLED) {
    std::fprintf(stderr, "gobo: job %s was cancelled\n", escaped(job.id()).c_str());
    return kStopped;
  }
  const Status status(Code(job.error().code()), "job " + job.id() + " failed: " + job.error().message());
  return status.ok() ? complain(Status(Code::Unknown, status.message())) : complain(status);
}

/// When a job will be over, by what was seen of it since it was watched.
class JobRate {
 public:
  /// 0: nothing is known yet.
  double restMs(const v1::Job& job) {
    const auto now = std::chrono::steady_clock::now();
    if (job.state() != v1::Job::RUNNING || !begun_) {  // paused: counted anew
      begun_ = job.state() == v1::Job::RUNNING ? std::optional(now) : std::nullopt;
      from_ = job.progress();
      return 0;
    }
    const double made = job.progress() - from_;
    return made > 0 ? std::chrono::duration<double, std::milli>(now - *begun_).count() / made * (1 - job.progress()) : 0;
  }

 private:
  std::optional<std::chrono::steady_clock::time_point> begun_;
  double from_ = 0;
};

Result<v1::Job> watch(Session& session, const std::string& id, bool json) {
  ProgressBar bar(!json, false);
  JobRate rate;
  v1::WatchJobRequest request;
  request.set_id(id);
  v1::Job last;
  std::set<int64_t> told;
  const auto frame = [&](const v1::Frame& f) {
    const bool over = f.state() == v1::Frame::DONE || f.state() == v1::Frame::FAILED || f.state() == v1::Frame::CANCELLED;
    if (json || !over || !told.insert(f.frame()).second) return;
    bar.clear();
    std::printf("frame %lld %s%s\n", static_cast<long long>(f.frame()), lower(v1::Frame::State_Name(f.state())).c_str(),
                f.has_error() && f.state() == v1::Frame::FAILED ? (": " + escaped(f.error().message())).c_str() : strf(" in %.1f s", f.seconds()).c_str());
    std::fflush(stdout);
  };
  for (Reopening stream;;) {
    Session::Call call(session);
    auto reader = session.jobs().Watch(&call.context, request);
    v1::JobEvent event;
    while (reader->Read(&event)) {
      stream.arrived();
      last = event.job();
      if (json) std::printf("%s\n", messageToJson(event, false).c_str());
      for (const v1::Frame& f : last.frames()) frame(f);
      if (event.has_frame()) frame(event.frame());
      bar.show(last.progress(), strf("%s  %llu of %llu frames%s", stateOf(last).c_str(), static_cast<unsigned long long>(last.frames_done()),
                                     static_cast<unsigned long long>(last.frames_total()), restText(rate.restMs(last)).c_str()));
    }
    Status status = session.statusOf(reader->Finish());
    if (status.ok()) break;
    if (last.id().empty() || !stream.again(status, retryMsOf(call.context))) return status;
  }
  bar.clear();
  if (!ended(last)) { GOBO_ASSIGN(last, getJob(session, id)); }
  return last;
}

template <typename Body>
int withCode(const SessionOptions& options, const Body& body) {
  if (options.local) return complain(invalidArgument("jobs need a running gobod: with --local nothing outlives this process"));
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  auto code = body(**session);
  return code.ok() ? *code : complain(code.status());
}

// One file as it arrives: into a name beside its place, renamed when the digest is right.
class Incoming {
 public:
  ~Incoming() { discard(); }
  Status begin(const std::string& folder, const v1::FetchedFile& head) {
    const std::string name = fs::path(head.file().name()).filename().string();
    if (name.empty() || name == "." || name == ".." || head.offset() != 0)  // the name comes from outside
      return {Code::DataLoss, "the server's answer is damaged: a file \"" + head.file().name() + "\""};
    GOBO_TRY(finish());
    head_ = head;
    path_ = (fs::path(folder) / name).string();
    part_ = path_ + "." + std::to_string(::getpid()) + ".part";
    out_.open(part_, std::ios::binary | std::ios::trunc);
    if (!out_) return ioError("cannot write file", path_);
    sha_ = std::make_unique<Sha256>();
    at_ = 0;
    return {};
  }
  Status add(const v1::FetchedChunk& chunk) {
    if (!sha_ || chunk.offset() != at_) return {Code::DataLoss, "the server's answer is damaged: a chunk out of place"};
    out_.write(chunk.data().data(), std::streamsize(chunk.data().size()));
    if (!out_) return ioError("cannot write file", path_);
    sha_->add(chunk.data().data(), chunk.data().size());
    at_ += chunk.data().size();
    return {};
  }
  /// Puts the file into its place, if one is open.
  Status finish() {
    if (!sha_) return {};
    out_.close();
    if (!out_) {
      const Status why = ioError("cannot write file", path_);
      discard();
      return why;
    }
    const std::string digest = std::exchange(sha_, nullptr)->hex();
    if (at_ != head_.file().bytes() || digest != head_.file().sha256())
      return discard(), Status(Code::DataLoss, "\"" + head_.file().name() + "\": the bytes do not have their digest");
    std::error_code error;
    fs::rename(part_, path_, error);
    if (error) return discard(), internalError("cannot write \"" + path_ + "\": " + error.message());
    part_.clear();
    std::printf("wrote %s (frame %lld, %s, %s)\n", path_.c_str(), static_cast<long long>(head_.frame()), escaped(head_.file().output()).c_str(),
                bytesText(at_).c_str());
    std::fflush(stdout);
    return {};
  }

 private:
  void discard() {
    std::error_code ignored;
    if (!part_.empty()) fs::remove(part_, ignored);
    part_.clear();
    sha_.reset();
  }
  v1::FetchedFile head_;
  std::string path_, part_;
  std::ofstream out_;
  std::unique_ptr<Sha256> sha_;
  uint64_t at_ = 0;
};

// True when the file of this frame is in the folder already.
bool have(const std::string& folder, const v1::FrameFile& file) {
  const std::string path = (fs::path(folder) / fs::path(file.name()).filename()).string();
  std::error_code error;
  if (!fs::is_regular_file(path, error) || fs::file_size(path, error) != file.bytes()) return false;
  auto bytes = readFile(path);
  return bytes.ok() && sha256Hex(bytes->data(), bytes->size()) == file.sha256();
}

Result<int> fetch(Session& session, const JobFetchCommand& c) {
  const std::string folder = c.out.empty() ? "." : c.out;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return invalidArgument("-o " + folder + ": " + error.message());
  v1::FetchRequest wanted;
  wanted.set_id(c.id);
  for (const std::string& output : commaList(c.outputs)) wanted.add_outputs(output);
  std::vector<int64_t> named;
  if (!c.frames.empty()) { GOBO_ASSIGN(named, parseFrames(c.frames, "--frames")); }
  const std::set<int64_t> selection(named.begin(), named.end());
  Reopening stream;
  for (bool opened = false;; opened = true) {
    const auto got = getJob(session, c.id);
    if (Status status = got.status(); !status.ok()) {
      if (opened && stream.again(status, 0)) continue;  // the daemon is not back yet
      return status;
    }
    const v1::Job& job = *got;
    const std::vector<std::string> has = outputsInFiles(job.spec());
    for (const std::string& output : wanted.outputs())
      if (std::find(has.begin(), has.end(), output) == has.end())
        return invalidArgument("--outputs " + output + ": job " + job.id() + " has no output of that name");
    if (job.results_expired()) return notFound("the results of " + job.id() + " were removed by the daemon's limits (jobs.keep_bytes, jobs.keep_days)");
    v1::FetchRequest request = wanted;
    bool any = false;
    for (const v1::Frame& f : job.frames()) {
      if (!selection.empty() && !selection.count(f.frame())) continue;
      any = true;
      bool complete = f.state() == v1::Frame::DONE;
      for (const v1::FrameFile& file : f.files()) {
        const bool selected =
            request.outputs().empty() || std::find(request.outputs().begin(), request.outputs().end(), file.output()) != request.outputs().end();
        if (selected && !have(folder, file)) complete = false;
      }
      if (!complete) request.add_frames(f.frame());
    }
    if (!any) return notFound("--frames " + c.frames + ": job " + job.id() + " has none of them");
    if (request.frames().empty()) return kOk;  // everything is here
    request.set_follow(c.follow);
    Session::Call call(session);
    auto reader = session.jobs().Fetch(&call.context, request);
    Incoming file;
    v1::FetchReply reply;
    Status fault;
    while (fault.ok() && reader->Read(&reply)) {
      stream.arrived();
      if (reply.has_file()) fault = file.begin(folder, reply.file());
      else if (reply.has_chunk()) fault = file.add(reply.chunk());
    }
    if (!fault.ok()) {
      call.context.TryCancel();
      (void)reader->Finish();
      return fault;
    }
    Status status = session.statusOf(reader->Finish());
    if (status.ok()) {
      GOBO_TRY(file.finish());
      return kOk;
    }
    if (!stream.again(status, retryMsOf(call.context))) return status;
  }
}

}  // namespace

int runJobSubmit(const SessionOptions& options, const JobSubmitCommand& c, bool json) {
  std::vector<int64_t> frames;
  if (!c.frames.empty()) {
    auto parsed = parseFrames(c.frames, "--frames");
    if (!parsed.ok()) return complain(parsed.status());
    frames = std::move(*parsed);
  }
  return withCode(options, [&](Session& session) -> Result<int> {
    v1::JobSpec spec;
    GOBO_ASSIGN(*spec.mutable_request(), makeRequest(session, c.request, c.scene));
    if (!c.format.empty()) GOBO_TRY(setPath(*spec.mutable_request(), "encoding.format=" + c.format));
    if (!frames.empty()) {
      FrameSpan span;
      constexpr int64_t kMostStep = 1000000;  // of the schema
      if (oneSpan(frames, span) && span.step <= kMostStep) {
        spec.mutable_frames()->set_first(span.first);
        spec.mutable_frames()->set_last(span.last);
        spec.mutable_frames()->set_step(uint32_t(span.step));
      } else {
        spec.mutable_frames()->mutable_numbers()->Add(frames.begin(), frames.end());
      }
    }
    if (c.fps > 0) spec.mutable_frames()->set_fps(c.fps);
    spec.set_name(c.name);
    spec.set_key(c.key.empty() ? uniqueKey() : c.key);
    if (!c.priority.empty()) GOBO_TRY(setPath(spec, "priority=" + c.priority));
    if (c.deadlineSeconds > 0)
      spec.set_deadline_unix_s(std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count() + c.deadlineSeconds);
    if (c.attempts) spec.set_max_attempts(c.attempts);
    if (c.tile) spec.set_tile_px(c.tile);
    for (const std::string& id : commaList(c.after)) spec.add_after(id);
    spec.set_out(c.out);
    v1::Job job;
    {
      Session::Call call(session);
      GOBO_TRY(session.statusOf(session.jobs().Submit(&call.context, spec, &job)));
    }
    if (json) std::printf("%s\n", messageToJson(job, true).c_str());
    else std::printf("%s\n", job.id().c_str());
    std::fflush(stdout);
    if (!c.watch) return int(kOk);
    GOBO_ASSIGN(const v1::Job last, watch(session, job.id(), json));
    return exitOfJob(last);
  });
}

int runJobList(const SessionOptions& options, const std::vector<std::string>& states, bool json) {
  return withCode(options, [&](Session& session) -> Result<int> {
    v1::ListJobsRequest request;
    for (std::string name : states) {
      for (char& ch : name) ch = char(std::toupper(static_cast<unsigned char>(ch)));
      v1::Job::State state;
      if (!v1::Job::State_Parse(name, &state)) return invalidArgument("--state " + name + ": no such state");
      request.add_states(state);
    }
    v1::ListJobsReply all;
    do {
      v1::ListJobsReply reply;
      Session::Call call(session);
      GOBO_TRY(session.statusOf(session.jobs().List(&call.context, request, &reply)));
      all.mutable_jobs()->MergeFrom(reply.jobs());
      request.set_page_token(reply.next_page_token());
    } while (!request.page_token().empty());
    if (json) {
      std::printf("%s\n", messageToJson(all, true).c_str());
      return int(kOk);
    }
    std::vector<std::vector<std::string>> rows;
    for (const v1::Job& job : all.jobs())
      rows.push_back({escaped(job.id()), stateOf(job) + (job.waits_for_size() && !ended(job) ? ", waits for " + waitsText(job) : ""),
                      strf("%.0f %%", 100 * job.progress()),
                      strf("%llu/%llu", static_cast<unsigned long long>(job.frames_done()), static_cast<unsigned long long>(job.frames_total())),
                      timeText(job.submitted_unix_s()), escaped(job.spec().name())});
    if (rows.empty()) std::printf("no jobs\n");
    else printTable({"job", "state", "done", "frames", "submitted", "name"}, rows, {false, false, true, true, false, false});
    return int(kOk);
  });
}

int runJobShow(const SessionOptions& options, const std::string& id, bool json) {
  return withCode(options, [&](Session& session) -> Result<int> {
    GOBO_ASSIGN(const v1::Job job, getJob(session, id));
    if (json) std::printf("%s\n", messageToJson(job, true).c_str());
    else printJob(job);
    return int(kOk);
  });
}

int runJobWatch(const SessionOptions& options, const std::string& id, bool json) {
  return withCode(options, [&](Session& session) -> Result<int> {
    GOBO_ASSIGN(const v1::Job last, watch(session, id, json));
    if (!json) {
      const auto whole = getJob(session, id);  // events have no specification
      printJob(whole.ok() ? *whole : last);
    }
    return exitOfJob(last);
  });
}

int runJobAct(const SessionOptions& options, JobAct act, const std::vector<std::string>& ids, bool json, const std::string& priority) {
  return withCode(options, [&](Session& session) -> Result<int> {
    int code = kOk;
    for (const std::string& id : ids) {
      Session::Call call(session);
      v1::Job job;
      v1::DeleteJobReply deleted;
      grpc::Status status;
      const auto request = [&](auto message) {
        message.set_id(id);
        return message;
      };
      switch (act) {
        case JobAct::Cancel: status = session.jobs().Cancel(&call.context, request(v1::CancelJobRequest()), &job); break;
        case JobAct::Pause: status = session.jobs().Pause(&call.context, request(v1::PauseJobRequest()), &job); break;
        case JobAct::Resume: status = session.jobs().Resume(&call.context, request(v1::ResumeJobRequest()), &job); break;
        case JobAct::Retry: status = session.jobs().Retry(&call.context, request(v1::RetryJobRequest()), &job); break;
        case JobAct::Prioritize: {
          auto message = request(v1::PrioritizeJobRequest());
          GOBO_TRY(setPath(message, "priority=" + priority));
          status = session.jobs().Prioritize(&call.context, message, &job);
          break;
        }
        case JobAct::Delete: status = session.jobs().Delete(&call.context, request(v1::DeleteJobRequest()), &deleted); break;
      }
      if (!status.ok()) {
        const int failed = complain(session.statusOf(status));
        if (code == kOk) code = failed;
      } else if (act == JobAct::Delete) {
        if (!json) std::printf("deleted %s\n", escaped(id).c_str());
      } else if (json) {
        std::printf("%s\n", messageToJson(job, true).c_str());
      } else {
        std::printf("%s is %s\n", escaped(job.id()).c_str(), stateOf(job).c_str());
      }
    }
    return code;
  });
}

int runJobFetch(const SessionOptions& options, const JobFetchCommand& command) {
  return withCode(options, [&](Session& session) { return fetch(session, command); });
}

}  // namespace gobo::cli
