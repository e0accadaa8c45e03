// SPDX-License-Identifier: Apache-2.0
// Jobs that the tests of farms submit while everything around them is killed, and what must be true of them in the end: each done, each frame completed
// once, with the bits of a render by one daemon alone.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "daemon.h"
#include "import/load.h"
#include "plan/engine.h"
#include "server/encode.h"
#include "server/jobs/job_store.h"

namespace gobo::test {

inline void rest(double seconds) { std::this_thread::sleep_for(std::chrono::duration<double>(seconds)); }

template <typename Request, typename Reply, typename Call>
bool ask(const Daemon& daemon, Call call, const Request& request, Reply& reply) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(10));
  const auto stub = v1::Jobs::NewStub(daemon.channel());
  return (stub.get()->*call)(&context, request, &reply).ok();
}

class FarmJobs {
 public:
  explicit FarmJobs(std::vector<uint32_t> samples) : samples_(std::move(samples)) {}

  /// Three frames of a tiny picture; samples in turn; every other job in parts.
  v1::JobSpec spec(int i) const {
    v1::JobSpec s;
    s.set_key("shot-" + std::to_string(i));
    s.mutable_frames()->set_first(1);
    s.mutable_frames()->set_last(3);
    if (i % 2 == 1) s.set_tile_px(16);
    v1::RenderRequest& r = *s.mutable_request();
    r.set_scene(i % 3 == 2 ? "grids" : "cornell");
    r.set_width(24);
    r.set_height(24);
    r.set_seed(uint64_t(i));
    r.mutable_halt()->set_spp(samples_[size_t(i) % samples_.size()]);
    r.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
    r.mutable_integrator()->set_max_bounces(2);
    return s;
  }
  /// To any of the daemons, and again until one has acknowledged it.
  void submit(int i, const std::vector<const Daemon*>& daemons) {
    for (int attempt = 0; attempt < 60 && !ids_.count(i); ++attempt) {
      v1::Job job;
      if (ask(*daemons[size_t(i + attempt) % daemons.size()], &v1::Jobs::Stub::Submit, spec(i), job)) ids_[i] = job.id();
      else rest(0.1);
    }
    ASSERT_TRUE(ids_.count(i)) << "nobody takes job " << i;
  }
  void waitUntilOver(const Daemon& daemon) const {
    std::vector<v1::Job> all;
    for (const auto start = std::chrono::steady_clock::now();; rest(0.1)) {
      v1::ListJobsRequest l;
      l.set_page_size(100);
      v1::ListJobsReply reply;
      if (ask(daemon, &v1::Jobs::Stub::List, l, reply)) {
        all.assign(reply.jobs().begin(), reply.jobs().end());
        if (all.size() >= ids_.size() && std::all_of(all.begin(), all.end(), [](const v1::Job& j) { return jobIsOver(j.state()); })) break;
      }
      ASSERT_LT(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(), 120) << "jobs do not end";
    }
    EXPECT_EQ(all.size(), ids_.size()) << "a job is there twice";
  }
  /// `results`: the folder of files; nothing may lie in it when every daemon has ended but what the frames name, which is remembered here.
  void expectRendered(const std::vector<const Daemon*>& daemons, const std::string& results) {
    EngineOptions options;
    options.loader = inProcessLoader();
    options.threads = 2;
    auto engine = std::move(*Engine::create(options));
    for (const auto& [i, id] : ids_) {
      v1::GetJobRequest g;
      g.set_id(id);
      v1::Job job;
      // Whom it asks may have been killed a moment ago, on a machine that is faster than the daemon's start.
      bool there = false;
      for (int k = 0; k < 300 && !there; ++k)
        if (!(there = ask(*daemons[size_t(i) % daemons.size()], &v1::Jobs::Stub::Get, g, job))) rest(0.1);
      ASSERT_TRUE(there) << job.id();
      EXPECT_EQ(job.state(), v1::Job::DONE) << job.ShortDebugString();
      EXPECT_EQ(job.frames_done(), 3u);
      const auto whole = engine->render(spec(i).request());
      ASSERT_TRUE(whole.ok());
      const std::vector<uint8_t> bits = rawBytes(whole->images[0].pixels(), false).copy();
      for (const v1::Frame& frame : job.frames()) {
        EXPECT_EQ(frame.attempts(), 1u) << job.id();
        ASSERT_EQ(frame.files_size(), 1);
        const std::string path = results + "/" + job.id().substr(2) + "/" + frame.files(0).sha256();
        wanted_.insert(path);
        std::ifstream in(path, std::ios::binary);
        const std::string bytes((std::istreambuf_iterator<char>(in)), {});
        EXPECT_TRUE(bytes == std::string(bits.begin(), bits.end())) << job.id() << " frame " << frame.frame();
      }
    }
  }
  void expectNothingElse(const std::string& results) const {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(results))
      EXPECT_TRUE(!entry.is_regular_file() || wanted_.count(entry.path().string())) << entry.path() << " is nobody's";
  }
  /// The renderers' own words: each frame was completed once. How many of them did some.
  static int completedOnceBy(const std::vector<std::string>& logs) {
    std::map<std::string, int> done;
    int hands = 0;
    for (const std::string& path : logs) {
      std::ifstream log(path);
      bool some = false;
      for (std::string line; std::getline(log, line);) {
        const size_t at = line.find(" done seconds=");
        if (at == std::string::npos) continue;
        const std::string name = line.substr(line.find("job j-"), at - line.find("job j-"));
        EXPECT_EQ(++done[name], 1) << name << " was completed twice";
        some = true;
      }
      hands += some;
    }
    return hands;
  }

 private:
  const std::vector<uint32_t> samples_;
  std::map<int, std::string> ids_;
  std::set<std::string> wanted_;
};

}  // namespace gobo::test
