// SPDX-License-Identifier: Apache-2.0
// A real daemon (child process, Unix socket) under many clients.
//   relight  N clients change light colours as fast as they get pictures: errors, share of each client, latency percentiles; then
//            the same with batch renders running beside them.
//   soak     many small renders of ever new requests: resident memory, file descriptors and threads of the daemon over time.
// Usage: load_bench [--gobod FILE] [--clients 64] [--seconds 60] [--batch 4] [--soak 0] [--size 160x120] [--out table.json]
//   --soak K: K renders instead of the relight part. Exit code 1 if any call failed.
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <random>
#include <thread>

#include <grpcpp/grpcpp.h>

#include "gobo/v1/service.grpc.pb.h"
#include "measure/report.h"

namespace {

using namespace gobo;
using Clock = std::chrono::steady_clock;
double since(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }
double percentile(std::vector<double> v, double p) {
  if (v.empty()) return 0;
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, size_t(p * double(v.size())))];
}

class Daemon {
 public:
  /// `storeBytes`: of the term store in memory. A soak wants one that fills at once, so that growth is a leak and not the cache.
  Daemon(const std::string& program, const std::string& folder, const std::string& storeBytes) : address_("unix:" + folder + "/gobod.sock") {
    const std::string log = folder + "/gobod.log", config = folder + "/gobod.toml";
    // All clients come from one address without a token: one caller to the daemon, whose part of the queue is three quarters.
    std::ofstream(config) << "[engine]\nstore_bytes = \"" << storeBytes << "\"\n[scheduler]\nqueued_interactive = 128\nqueued_normal = 64\n";
    pid_ = ::fork();
    if (pid_ == 0) {
      if (!std::freopen(log.c_str(), "w", stdout) || !std::freopen(log.c_str(), "a", stderr)) ::_exit(126);
      ::execl(program.c_str(), program.c_str(), "--config", config.c_str(), "--listen", address_.c_str(), static_cast<char*>(nullptr));
      ::_exit(127);
    }
    grpc::ChannelArguments arguments;
    channel_ = grpc::CreateCustomChannel(address_, grpc::InsecureChannelCredentials(), arguments);
    ready_ = channel_->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(20));
  }
  ~Daemon() {
    ::kill(pid_, SIGTERM);
    int status = 0;
    ::waitpid(pid_, &status, 0);
  }
  bool ready() const { return ready_; }
  /// A connection of its own: one per client.
  std::unique_ptr<v1::Render::Stub> connect(int id) const {
    grpc::ChannelArguments arguments;
    arguments.SetInt("gobo.client", id);  // different arguments: no sharing of connections
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return v1::Render::NewStub(grpc::CreateCustomChannel(address_, grpc::InsecureChannelCredentials(), arguments));
  }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }

  struct Health {
    double rssMb = 0;
    int files = 0, threads = 0;
  };
  Health health() const {
    Health h;
    std::ifstream status("/proc/" + std::to_string(pid_) + "/status");
    for (std::string line; std::getline(status, line);) {
      if (line.rfind("VmRSS:", 0) == 0) h.rssMb = std::atof(line.c_str() + 6) / 1024;
      if (line.rfind("Threads:", 0) == 0) h.threads = std::atoi(line.c_str() + 8);
    }
    for ([[maybe_unused]] const auto& f : std::filesystem::directory_iterator("/proc/" + std::to_string(pid_) + "/fd")) ++h.files;
    return h;
  }

 private:
  std::string address_;
  pid_t pid_ = 0;
  bool ready_ = false;
  std::shared_ptr<grpc::Channel> channel_;
};

v1::RenderRequest requestOf(unsigned width, unsigned height, int client, uint64_t seed, uint32_t spp, v1::Scheduling::Class priority) {
  v1::RenderRequest r;
  r.set_scene("lights8");
  r.set_width(width);
  r.set_height(height);
  r.set_seed(seed);
  r.mutable_halt()->set_spp(spp);
  r.mutable_encoding()->set_format(v1::Encoding::RAW_HALF);
  r.mutable_scheduling()->set_priority(priority);
  r.mutable_scheduling()->set_client("client" + std::to_string(client));
  return r;
}

/// Reads a stream to its end; false and a message on any error. RESOURCE_EXHAUSTED counts as an error: nobody here may be refused.
bool drain(grpc::ClientReaderInterface<v1::RenderEvent>& reader, std::string* id, std::string* error) {
  v1::RenderEvent event;
  uint64_t bytes = 0, expected = 0;
  while (reader.Read(&event)) {
    if (event.has_reply()) {
      if (id) *id = event.reply().render_id();
      for (const auto& image : event.reply().images()) expected += image.bytes();
    }
    if (event.has_chunk()) bytes += event.chunk().data().size();
  }
  const grpc::Status status = reader.Finish();
  if (status.ok() && bytes == expected && expected > 0) return true;
  *error = status.ok() ? "picture cut short" : status.error_message();
  return false;
}

struct Load {
  std::vector<std::vector<double>> ms;
  std::atomic<uint64_t> errors{0}, batches{0};
  std::string firstError;
  std::mutex mutex;
};

void fail(Load& load, const std::string& error) {
  load.errors++;
  std::lock_guard lock(load.mutex);
  if (load.firstError.empty()) load.firstError = error;
}

void relightLoad(const Daemon& daemon, int clients, int batch, double seconds, unsigned width, unsigned height, const std::vector<std::string>& lights,
                 Load& load) {
  load.ms.assign(size_t(clients), {});
  std::atomic<bool> over{false};
  std::atomic<int> warm{0};
  std::vector<std::thread> threads;
  std::mutex batchMutex;
  std::vector<grpc::ClientContext*> batchCalls(size_t(batch), nullptr);  // to be cancelled at the end
  for (int b = 0; b < batch; ++b)
    threads.emplace_back([&, b] {
      auto stub = daemon.connect(10000 + b);
      for (uint64_t k = 0; !over; ++k) {
        grpc::ClientContext context;
        {
          std::lock_guard lock(batchMutex);
          batchCalls[size_t(b)] = &context;
        }
        auto reader = stub->Render(&context, requestOf(320, 240, 10000 + b, 1000 * uint64_t(b + 1) + k, 64, v1::Scheduling::BATCH));
        std::string error;
        const bool ok = drain(*reader, nullptr, &error);
        {
          std::lock_guard lock(batchMutex);
          batchCalls[size_t(b)] = nullptr;
        }
        if (ok) load.batches++;
        else if (!over) fail(load, "batch: " + error);
      }
    });
  for (int c = 0; c < clients; ++c)
    threads.emplace_back([&, c] {
      auto stub = daemon.connect(c);
      std::string id, error;
      {
        grpc::ClientContext context;
        auto reader = stub->Render(&context, requestOf(width, height, c, 7, 4, v1::Scheduling::INTERACTIVE));
        if (!drain(*reader, &id, &error)) {
          fail(load, "first render: " + error);
          warm++;
          return;
        }
      }
      warm++;
      while (warm < clients && !over) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      std::mt19937 random{unsigned(c)};
      while (!over) {
        v1::RelightRequest relight;
        relight.set_render_id(id);
        const std::string& light = lights[random() % lights.size()];
        auto* gain = (*relight.mutable_patch()->mutable_lights())[light].mutable_gain();
        gain->set_x(float(random() % 1000) / 500);
        gain->set_y(float(random() % 1000) / 500);
        gain->set_z(float(random() % 1000) / 500);
        relight.add_mask("lights." + light + ".gain");
        const auto begun = Clock::now();
        grpc::ClientContext context;
        auto reader = stub->Relight(&context, relight);
        if (drain(*reader, nullptr, &error)) load.ms[size_t(c)].push_back(since(begun) * 1e3);
        else if (!over) fail(load, "relight: " + error);
      }
    });
  while (warm < clients) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  over = true;
  {
    std::lock_guard lock(batchMutex);
    for (grpc::ClientContext* call : batchCalls)
      if (call) call->TryCancel();
  }
  for (std::thread& t : threads) t.join();
}

int soak(const Daemon& daemon, uint64_t renders, const std::string& out) {
  auto stub = daemon.connect(1);
  Table table("soak", {"renders", "RSS MiB", "file descriptors", "threads", "renders/s"});
  uint64_t errors = 0;
  std::string error, first;
  const auto begun = Clock::now();
  for (uint64_t k = 0; k <= renders; ++k) {
    if (k % std::max<uint64_t>(1, renders / 14) == 0) {
      const auto h = daemon.health();
      table.add({double(k), h.rssMb, double(h.files), double(h.threads), double(k) / std::max(1e-9, since(begun))});
      std::printf("%llu renders: %.1f MiB, %d files, %d threads\n", static_cast<unsigned long long>(k), h.rssMb, h.files, h.threads);
      std::fflush(stdout);
    }
    grpc::ClientContext context;
    auto reader = stub->Render(&context, requestOf(8, 8, 1, k, 1, v1::Scheduling::NORMAL));
    if (!drain(*reader, nullptr, &error)) {
      if (first.empty()) first = error;
      ++errors;
    }
  }
  table.note("errors", double(errors));
  std::printf("%s", table.text().c_str());
  if (errors) std::printf("first error: %s\n", first.c_str());
  if (!out.empty() && !table.write(out).ok()) return 1;
  return errors ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::string out = argumentOr(argc, argv, "--out", "");
  const std::string here = std::filesystem::path(argv[0]).parent_path().string();
  const std::string program = argumentOr(argc, argv, "--gobod", here + "/../server/gobod");
  const int clients = std::max(1, std::atoi(argumentOr(argc, argv, "--clients", "64").c_str()));
  const int batch = std::max(0, std::atoi(argumentOr(argc, argv, "--batch", "4").c_str()));
  const double seconds = std::atof(argumentOr(argc, argv, "--seconds", "60").c_str());
  const uint64_t renders = std::strtoull(argumentOr(argc, argv, "--soak", "0").c_str(), nullptr, 10);
  unsigned width = 160, height = 120;
  std::sscanf(argumentOr(argc, argv, "--size", "160x120").c_str(), "%ux%u", &width, &height);
  std::string folder = (std::filesystem::temp_directory_path() / "gobo-load-XXXXXX").string();
  if (!::mkdtemp(folder.data())) return 1;
  int code = 0;
  {
    const Daemon daemon(program, folder, renders ? "32MiB" : "4GiB");
    if (!daemon.ready()) {
      std::fprintf(stderr, "load_bench: %s does not answer; its log is %s/gobod.log\n", program.c_str(), folder.c_str());
      return 1;
    }
    if (renders) code = soak(daemon, renders, out);
    else {
      v1::SceneInfo info;
      grpc::ClientContext context;
      v1::OpenSceneRequest open;
      open.set_source("lights8");
      const auto status = v1::Scenes::NewStub(daemon.channel())->Open(&context, open, &info);
      if (!status.ok()) {
        std::fprintf(stderr, "load_bench: %s\n", status.error_message().c_str());
        return 1;
      }
      std::vector<std::string> lights;
      for (const auto& l : info.lights()) lights.push_back(l.name());
      Table table("load", {"load", "relights/s", "p50 ms", "p95 ms", "p99 ms", "worst ms", "least share", "largest share", "errors", "batch renders"});
      for (const int beside : {0, batch}) {
        Load load;
        relightLoad(daemon, clients, beside, seconds, width, height, lights, load);
        std::vector<double> all, counts;
        for (const auto& v : load.ms) {
          all.insert(all.end(), v.begin(), v.end());
          counts.push_back(double(v.size()));
        }
        const double mean = double(all.size()) / double(clients);
        table.add({std::to_string(clients) + " clients" + (beside ? ", " + std::to_string(beside) + " batch" : ""), double(all.size()) / seconds,
                   percentile(all, 0.5), percentile(all, 0.95), percentile(all, 0.99), percentile(all, 1.0),
                   *std::min_element(counts.begin(), counts.end()) / mean, *std::max_element(counts.begin(), counts.end()) / mean, double(load.errors),
                   double(load.batches)});
        if (load.errors) {
          std::printf("first error: %s\n", load.firstError.c_str());
          code = 1;
        }
        if (batch == 0) break;
      }
      const auto h = daemon.health();
      table.note("daemon afterwards", std::to_string(int(h.rssMb)) + " MiB, " + std::to_string(h.files) + " files, " + std::to_string(h.threads) + " threads");
      table.note("picture", std::to_string(width) + "x" + std::to_string(height) + " raw half; clients, daemon and batch renders share this machine's cores");
      std::printf("%s", table.text().c_str());
      if (!out.empty() && !table.write(out).ok()) code = 1;
    }
  }
  std::filesystem::remove_all(folder);
  return code;
}
