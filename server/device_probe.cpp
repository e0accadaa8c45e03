// SPDX-License-Identifier: Apache-2.0
#include "server/device_probe.h"

#include <chrono>
#include <fstream>

#include "device/egl/egl_device.h"
#include "device/vulkan/vulkan_device.h"

namespace gobo {
inline namespace server {
namespace {

std::string cpuText() {
  std::ifstream in("/proc/cpuinfo");
  std::string line, name = "unknown";
  while (std::getline(in, line))
    if (line.rfind("model name", 0) == 0 && line.find(": ") != std::string::npos) {
      name = line.substr(line.find(": ") + 2);
      break;
    }
  std::string isa;
  const auto add = [&](bool has, const char* word) {
    if (has) isa += (isa.empty() ? "" : " ") + std::string(word);
  };
  add(__builtin_cpu_supports("avx2"), "avx2");
  add(__builtin_cpu_supports("fma"), "fma");
  add(__builtin_cpu_supports("avx512f"), "avx512f");
  return "cpu: " + name + " (" + (isa.empty() ? "x86-64" : isa) + ")";
}

// The process's shared devices: what a later request on them would load anyway.
template <typename Device>
std::string deviceText(const char* kind) {
  auto device = Device::shared();
  return std::string(kind) + ": " + (device.ok() ? (*device)->name() : "none (" + device.status().message() + ")");
}

}  // namespace

DeviceProbe::DeviceProbe() : cpu_(cpuText()) {}

DeviceProbe::~DeviceProbe() {
  if (thread_.joinable()) thread_.join();
}

std::vector<std::string> DeviceProbe::list(double waitSeconds) {
  std::unique_lock lock(mutex_);
  if (!thread_.joinable())
    thread_ = std::thread([this] {
      const std::string vulkan = deviceText<VulkanDevice>("vulkan");
      {
        const std::lock_guard hold(mutex_);
        vulkan_ = vulkan;
      }
      const std::string egl = deviceText<EglDevice>("egl");
      const std::lock_guard hold(mutex_);
      egl_ = egl;
      changed_.notify_all();
    });
  changed_.wait_for(lock, std::chrono::duration<double>(waitSeconds), [&] { return !egl_.empty(); });
  return {cpu_, vulkan_.empty() ? "vulkan: being looked for" : vulkan_, egl_.empty() ? "egl: being looked for" : egl_};
}

}  // namespace server
}  // namespace gobo
