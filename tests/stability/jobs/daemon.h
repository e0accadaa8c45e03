// SPDX-License-Identifier: Apache-2.0
// The real daemon with durable jobs, to be killed and started again.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>

#include <grpcpp/grpcpp.h>

#include "gobo/v1/jobs.grpc.pb.h"
#include "gobo/v1/service.grpc.pb.h"

namespace gobo::test {

struct TemporaryFolder {
  std::string path = (std::filesystem::temp_directory_path() / "gobo-kill-XXXXXX").string();
  TemporaryFolder() {
    if (!::mkdtemp(path.data())) throw std::runtime_error("no temporary folder");
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
};

class Daemon {
 public:
  /// `jobs`: lines of its [jobs], with the folder.
  Daemon(std::string folder, int workers, const std::string& jobs = "folder = \"jobs\"\nlease_s = 5\n") : folder_(std::move(folder)) {
    std::ofstream(folder_ + "/gobod.toml") << "listen = [\"unix:s.sock\"]\n[log]\nlevel = \"info\"\n[engine]\nthreads = 2\nstore_bytes = \"256MiB\"\n"
                                              "[limits]\ntmp_folder = \"tmp\"\n[jobs]\n"
                                           << jobs << "workers = " << workers << "\ncheckpoint_s = 0.1\n";
    std::filesystem::create_directory(folder_ + "/tmp");
  }
  ~Daemon() {
    if (pid_ > 0) kill(SIGKILL);
  }

  bool start() {
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      const int log = ::open((folder_ + "/log").c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
      ::dup2(log, 1);
      ::dup2(log, 2);
      ::execl(GOBOD, "gobod", "--config", (folder_ + "/gobod.toml").c_str(), nullptr);
      ::_exit(127);
    }
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // no back-off inherited from the last life; the last one bounds a handshake
    arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 20);
    arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 100);
    arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 5000);
    channel_ = grpc::CreateCustomChannel("unix:" + folder_ + "/s.sock", grpc::InsecureChannelCredentials(), arguments);
    return channel_->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(60));
  }
  /// The exit status as waitpid gives it.
  int kill(int signal) {
    ::kill(pid_, signal);
    int status = 0;
    ::waitpid(pid_, &status, 0);
    pid_ = -1;
    return status;
  }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }

 private:
  std::string folder_;
  pid_t pid_ = -1;
  std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace gobo::test
