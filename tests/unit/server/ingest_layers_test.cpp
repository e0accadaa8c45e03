// SPDX-License-Identifier: Apache-2.0
// The layers around the reader of files beside its filter: each alone keeps out what it is there for, scenes and environment maps are
// read behind the same ones, and the daemon knows which they are.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

#include "ingest/layers.h"
#include "server/ingest_child.h"
#include "server/sandbox_probe.h"
#include "support/small_gltf.h"

namespace gobo::ingest_layers_test {
namespace {

namespace fs = std::filesystem;
using ingest::Layers;

bool has(const Layers& l, const std::string& name) { return std::find(l.active.begin(), l.active.end(), name) != l.active.end(); }
std::string joined(const Layers& l) {
  std::string out;
  for (const std::string& s : l.active) out += s + " ";
  for (const std::string& s : l.missing) out += "[" + s + "] ";
  return out;
}

enum Answer { Denied, Happened, Lacking };
/// What becomes of `attempt` in a process that has entered `layers` (without the filter, which would hide them).
Answer behind(const std::function<void(Layers&)>& enter, const char* layer, const std::function<bool()>& attempt) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    Layers layers;
    enter(layers);
    ::_exit(!has(layers, layer) ? Lacking : attempt() ? Happened : Denied);
  }
  int status = 0;
  ::waitpid(pid, &status, 0);
  return WIFEXITED(status) ? Answer(WEXITSTATUS(status)) : Happened;
}
bool opens() { return ::open("/etc/passwd", O_RDONLY) >= 0; }
/// A packet to this machine's own loopback leaves the process.
bool sends() {
  const int fd = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(9);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return fd >= 0 && ::sendto(fd, "x", 1, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 1;
}
bool mounts() { return ::mkdir("/gobo-layers-test", 0700) == 0 || ::access("/etc", F_OK) == 0 || ::access("/proc", F_OK) == 0; }

TEST(IngestLayers, EachAloneKeepsOutWhatItIsThereFor) {
  const auto namespaces = [](Layers& l) {
    ingest::enterUserNamespace(l);
    ingest::enterNamespaces(l);
  };
  ASSERT_TRUE(opens());
  const struct {
    const char* layer;
    std::function<void(Layers&)> enter;
    bool (*attempt)();
  } rows[] = {{"landlock", ingest::denyFiles, opens},
              {"mount_namespace", namespaces, opens},
              {"mount_namespace", namespaces, mounts},
              {"network_namespace", namespaces, sends}};
  int tried = 0;
  for (const auto& row : rows) {
    const Answer a = behind(row.enter, row.layer, row.attempt);
    EXPECT_NE(a, Happened) << row.layer;
    tried += a == Denied;
  }
  if (tried == 0) GTEST_SKIP() << "this machine gives neither namespaces nor Landlock";
}

Layers layersOf(ingest::Task task, const std::string& path) {
  const int out = ::memfd_create("layers", MFD_CLOEXEC);
  const ingest::Job job{task, path, 1 << 20, 1 << 30, 1 << 30, 1ull << 30, 64 << 20, 20};
  const auto result = runIngest(*forkedReaders(findIngestProgram()), job, out, 60, {});
  ::close(out);
  EXPECT_TRUE(result.ok()) << result.status().toString();
  return result.ok() ? result->done.layers : Layers{};
}

// Also: nothing but these names, each either there or missing with a reason.
TEST(IngestLayers, ScenesAndEnvironmentMapsAreReadBehindTheSame) {
  std::string folder = (fs::temp_directory_path() / "gobo-layers-XXXXXX").string();
  ASSERT_NE(::mkdtemp(folder.data()), nullptr);
  Image sky(8, 4, 3);
  const auto exr = encodeExr(sky);
  std::ofstream(folder + "/sky.exr", std::ios::binary).write(reinterpret_cast<const char*>(exr->data()), std::streamsize(exr->size()));
  std::ofstream(folder + "/scene.gltf") << smallGltf("");
  const Layers scene = layersOf(ingest::Task::Scene, folder + "/scene.gltf"), map = layersOf(ingest::Task::Environment, folder + "/sky.exr");
  fs::remove_all(folder);
  EXPECT_EQ(scene.active, map.active);
  EXPECT_EQ(scene.missing, map.missing);
  EXPECT_TRUE(has(scene, "seccomp")) << joined(scene);
  std::cout << "  " << joined(scene) << "\n";
  for (const char* name : {"user_namespace", "mount_namespace", "network_namespace", "ipc_namespace", "uts_namespace", "landlock"}) {
    const auto why = std::find_if(scene.missing.begin(), scene.missing.end(), [&](const std::string& m) { return m.starts_with(std::string(name) + ": "); });
    EXPECT_NE(has(scene, name), why != scene.missing.end()) << name << ": " << joined(scene);
  }
  EXPECT_EQ(scene.active.size() + scene.missing.size(), 7u) << joined(scene);

  SandboxProbe probe(""), wrong("/no/such/program");
#ifndef GOBO_THREAD_SANITIZER  // its own thread is there from the start of a program, and a namespace of users is for processes of one
  EXPECT_EQ(probe.layers(60).active, scene.active);
  EXPECT_EQ(probe.layers(60).missing, scene.missing);
#endif
  EXPECT_NE(joined(wrong.layers(60)).find("ingest.program"), std::string::npos) << joined(wrong.layers(60));
}

std::vector<int> children() {
  std::vector<int> out;
  for (const auto& task : fs::directory_iterator("/proc/self/task")) {
    std::ifstream in(task.path() / "children");
    for (int pid; in >> pid;) out.push_back(pid);
  }
  std::sort(out.begin(), out.end());
  return out;
}

// A daemon that ends soon, or does other things first, does not pay for libraries of readers.
TEST(IngestLayers, TheProbeLoadsNothingThatReadersNeedBeforeItsTime) {
#if defined(__SANITIZE_ADDRESS__) || defined(GOBO_THREAD_SANITIZER)
  GTEST_SKIP() << "readers are spawned under a sanitizer: nothing is prepared";
#endif
  const fs::path found = findIngestProgram();
  const std::string program = (found.parent_path() / "." / found.filename()).string();  // by a name of its own: a nursery that no other test has
  const auto readers = forkedReaders(program, 120);  // patience with a busy machine: one that is replaced would be another process
  const auto before = children();
  {
    SandboxProbe later(program, 1e6);
    EXPECT_TRUE(has(later.layers(60), "seccomp")) << joined(later.layers(0));
    EXPECT_EQ(children(), before);
  }
  SandboxProbe now(program, 0);
  EXPECT_TRUE(has(now.layers(60), "seccomp"));
  for (int tries = 0; tries < 2000 && children().size() == before.size(); ++tries) ::usleep(10000);
  const auto after = children();
  EXPECT_EQ(after.size(), before.size() + 1);
  const int out = ::memfd_create("layers", MFD_CLOEXEC);
  EXPECT_TRUE(runIngest(*readers, {ingest::Task::Probe, "empty", 0, 0, 0, 256ull << 20, 1 << 20, 20}, out, 60, {}).ok());
  ::close(out);
  EXPECT_EQ(children(), after);
  readers->crashed();  // it goes: other tests count processes
  EXPECT_EQ(children(), before);
}

std::string parentOf(const std::string& process) {
  std::ifstream in("/proc/" + process + "/status");
  for (std::string word; in >> word;)
    if (word == "PPid:" && in >> word) return word;
  return {};
}

/// Guard, nursery, and the process that this one started may stand between.
bool readsForMe(std::string process) {
  for (int up = 0; up < 4; ++up)
    if ((process = parentOf(process)) == std::to_string(::getpid())) return true;
  return false;
}

// The reader is a process of one thread: what a library starts before main would have no filter.
TEST(IngestLayers, TheReaderHasOneThread) {
#ifdef GOBO_THREAD_SANITIZER
  GTEST_SKIP() << "the sanitizer has a thread of its own in every process";
#endif
  const int out = ::memfd_create("layers", MFD_CLOEXEC);
  StopSource stop;
  std::string found;
  std::thread reader([&] {
    (void)runIngest(*forkedReaders(findIngestProgram()), {ingest::Task::Probe, "sleep", 0, 0, 0, 1ull << 30, 1 << 20, 20}, out, 60, stop.token());
  });
  for (int tries = 0; tries < 2000 && found.empty(); ++tries) {
    ::usleep(10000);
    for (const auto& process : fs::directory_iterator("/proc")) {
      std::ifstream in(process.path() / "status");
      std::string status((std::istreambuf_iterator<char>(in)), {});
      if (status.starts_with("Name:\tgobo-ingest\n") && status.find("Seccomp:\t2\n") != std::string::npos && readsForMe(process.path().filename()))
        found = status;
    }
  }
  stop.stop(StopReason::Cancelled);
  reader.join();
  ::close(out);
  ASSERT_FALSE(found.empty()) << "no reader behind its filter";
  EXPECT_NE(found.find("\nThreads:\t1\n"), std::string::npos) << found;
  EXPECT_NE(found.find("\nCapEff:\t0000000000000000\n"), std::string::npos) << found;
  EXPECT_NE(found.find("\nNoNewPrivs:\t1\n"), std::string::npos) << found;
}

}  // namespace
}  // namespace gobo::ingest_layers_test
