// SPDX-License-Identifier: Apache-2.0
// What a coordinator's calls cost: played workers, each with a connection of its own over the loopback, claim a frame of many queued ones, hold it, put a
// picture and complete it, as fast as they can. A server as gobod has it, on SQLite or PostgreSQL (a private server; fsync on for both).
// Usage: farm_bench [--frames N] [--seconds S] [--bytes B] [--workers 1,2,4,...] [--postgres] [FOLDER]; a table, milliseconds.
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <thread>

#include "gobo/v1/farm.grpc.pb.h"
#include "latencies.h"
#include "server/encode.h"
#include "server/farm/messages.h"
#include "server/farm/numeric_class.h"
#include "server/jobs/durable_jobs.h"
#include "server/server.h"
#include "support/postgres_server.h"

using namespace gobo;

namespace {

using FarmClock = std::chrono::steady_clock;

using bench::millisSince;
using bench::quantile;

struct Times {
  std::vector<double> claim, hold, put, complete;
  void add(const Times& o) {
    claim.insert(claim.end(), o.claim.begin(), o.claim.end());
    hold.insert(hold.end(), o.hold.begin(), o.hold.end());
    put.insert(put.end(), o.put.begin(), o.put.end());
    complete.insert(complete.end(), o.complete.begin(), o.complete.end());
  }
};

/// One worker, until `seconds` are over.
void play(const std::string& address, int number, double seconds, size_t bytes, FarmClock::time_point begun, Times& times) {
  grpc::ChannelArguments own;
  own.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  const auto stub = v1::Farm::NewStub(grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), own));
  grpc::ClientContext attending;
  v1::AttendRequest attend;
  attend.mutable_worker()->set_name("w" + std::to_string(number));
  attend.mutable_worker()->set_build(buildVersion());
  attend.mutable_worker()->set_numeric_class(numericClass());
  const auto news = stub->Attend(&attending, attend);
  v1::FarmNews first;
  if (!news->Read(&first)) std::printf("%s\n", news->Finish().error_message().c_str()), std::abort();
  const auto timed = [](std::vector<double>& out, const auto& call) {
    const auto from = FarmClock::now();
    const grpc::Status status = call();
    out.push_back(millisSince(from));
    if (!status.ok()) std::printf("%s\n", status.error_message().c_str()), std::abort();
  };
  std::string picture(bytes, 'p');
  for (uint64_t n = 0; millisSince(begun) < seconds * 1e3; ++n) {
    v1::ClaimRequest claim;
    claim.set_worker(first.worker());
    v1::ClaimReply frame;
    timed(times.claim, [&] {
      grpc::ClientContext c;
      return stub->Claim(&c, claim, &frame);
    });
    if (!frame.has_lease()) break;
    v1::HoldRequest hold;
    *hold.mutable_lease() = frame.lease();
    hold.set_renew(true);
    v1::HoldReply held;
    timed(times.hold, [&] {
      grpc::ClientContext c;
      return stub->Hold(&c, hold, &held);
    });
    std::memcpy(picture.data(), &n, sizeof n);  // another file each time
    std::memcpy(picture.data() + sizeof n, &number, sizeof number);
    v1::FarmAck ack;
    v1::CompletionReport done;
    *done.mutable_lease() = frame.lease();
    v1::FrameFile& file = *done.add_files();
    file.set_output("beauty");
    file.set_bytes(picture.size());
    file.set_sha256(sha256Hex(picture.data(), picture.size()));
    timed(times.put, [&] {
      grpc::ClientContext c;
      const auto writer = stub->Put(&c, &ack);
      v1::PutFarmFileRequest message;
      *message.mutable_begin()->mutable_lease() = frame.lease();
      message.mutable_begin()->set_digest(file.sha256());
      message.mutable_begin()->set_bytes(picture.size());
      writer->Write(message);
      for (size_t at = 0; at < picture.size(); at += farm::kChunkBytes) {
        message.set_data(picture.data() + at, std::min(farm::kChunkBytes, picture.size() - at));
        writer->Write(message);
      }
      writer->WritesDone();
      return writer->Finish();
    });
    timed(times.complete, [&] {
      grpc::ClientContext c;
      return stub->Complete(&c, done, &ack);
    });
  }
  attending.TryCancel();
  (void)news->Finish();
}

void fill(JobStore& store, int frames) {
  NewJob job;
  job.spec.mutable_request()->set_scene("cornell");
  job.spec.set_max_attempts(3);
  job.client = "bench";
  for (int i = 0; i < frames; ++i) job.frames.push_back(i);
  bool existed = false;
  if (!store.submit(job, existed).ok()) std::abort();
}

}  // namespace

int main(int argc, char** argv) {
  int frames = 100000;
  double seconds = 5;
  size_t bytes = 1 << 20;
  bool postgres = false;
  std::string folder = std::filesystem::temp_directory_path(), counts = "1,2,4,8,16,64";
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--frames") && i + 1 < argc) frames = std::atoi(argv[++i]);
    else if (!std::strcmp(argv[i], "--seconds") && i + 1 < argc) seconds = std::atof(argv[++i]);
    else if (!std::strcmp(argv[i], "--bytes") && i + 1 < argc) bytes = std::max<size_t>(16, size_t(std::atoll(argv[++i])));
    else if (!std::strcmp(argv[i], "--workers") && i + 1 < argc) counts = argv[++i];
    else if (!std::strcmp(argv[i], "--postgres")) postgres = true;
    else folder = argv[i];
  }
  const std::string place = folder + "/gobo-farm-bench-" + std::to_string(::getpid());
  std::filesystem::create_directories(place);
  std::unique_ptr<test::PostgresServer> database;
  if (postgres) database = std::make_unique<test::PostgresServer>(true);
  ServerConfig config;
  config.listen = {"127.0.0.1:0"};
  config.logLevel = "off";
  config.tmpFolder = place;
  config.jobsFolder = place + "/jobs";
  if (postgres) config.jobsStore = database->uri();
  config.jobsWorkers = 0;
  config.jobsLeaseSeconds = 300;
  config.farmWorkers = 1024;
  config.rpcThreads = 4096;
  setLogLevel(LogLevel::Off);
  if (const Status checked = checkConfig(config); !checked.ok()) return std::printf("%s\n", checked.toString().c_str()), 2;
  auto server = Server::start(config, engineOptions(config), true);
  if (!server.ok()) return std::printf("%s\n", server.status().toString().c_str()), 2;
  fill((*server)->core().durable->store(), frames);
  std::printf("%d frames queued, %s, pictures of %zu bytes\n", frames, postgres ? "PostgreSQL" : "SQLite", bytes);
  std::printf("workers  claim p50     p99   hold p50     p99    put p50     p99  complete p50   p99   frames/s\n");
  std::istringstream list(counts);
  for (std::string one; std::getline(list, one, ',');) {
    const int n = std::atoi(one.c_str());
    std::vector<Times> times(static_cast<size_t>(n));
    std::vector<std::thread> threads;
    const auto begun = FarmClock::now();
    for (int i = 0; i < n; ++i) threads.emplace_back([&, i] { play((*server)->addresses()[0], i, seconds, bytes, begun, times[size_t(i)]); });
    for (auto& t : threads) t.join();
    const double took = millisSince(begun) * 1e-3;
    Times all;
    for (const Times& t : times) all.add(t);
    std::printf("%7d  %9.2f %7.1f  %9.2f %7.1f  %9.2f %7.1f  %9.2f %7.1f  %9.1f\n", n, quantile(all.claim, 0.5), quantile(all.claim, 0.99),
                quantile(all.hold, 0.5), quantile(all.hold, 0.99), quantile(all.put, 0.5), quantile(all.put, 0.99), quantile(all.complete, 0.5),
                quantile(all.complete, 0.99), double(all.complete.size()) / took);
    std::fflush(stdout);
  }
  (*server)->shutdown(1);
  std::error_code ignored;
  std::filesystem::remove_all(place, ignored);
  return 0;
}
