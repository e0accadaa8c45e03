// SPDX-License-Identifier: Apache-2.0
// VulkanDevice: headless compute on one Vulkan device: buffers, SPIR-V pipelines, dispatches, timings. Knows nothing of what
// the kernels mean. Thread-safe: one mutex per device is held for each call (work of one device is serial anyway).
// Errors: Unavailable (no loader, driver, device, or the device was lost), ResourceExhausted (out of memory, or a buffer over
// the device's limit), Internal (anything else, and, with validation on, any message of the validation layer); the text names
// the call and the VkResult. Environment:
//   GOBO_VULKAN_DEVICE       index, or part of the name (any case), of the device to use; otherwise the first of the best type:
//                            discrete, integrated, virtual, then software (lavapipe)
//   GOBO_VULKAN_VALIDATION   1: VK_LAYER_KHRONOS_validation watches every call; Unavailable if it is not installed
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {

class VulkanDevice;

/// A storage buffer in device memory; freed with its last owner (which keeps the device alive).
class VulkanBuffer {
 public:
  ~VulkanBuffer();
  VulkanBuffer(const VulkanBuffer&) = delete;
  VulkanBuffer& operator=(const VulkanBuffer&) = delete;
  size_t bytes() const { return bytes_; }

 private:
  friend class VulkanDevice;
  struct Memory;
  VulkanBuffer(std::shared_ptr<const VulkanDevice> device, std::unique_ptr<Memory> memory, size_t bytes);
  std::shared_ptr<const VulkanDevice> device_;
  std::unique_ptr<Memory> memory_;
  size_t bytes_;
};
using VulkanBufferPtr = std::shared_ptr<VulkanBuffer>;

/// A compute program: embedded SPIR-V with entry point "main", storage buffers at set 0, bindings 0..buffers-1, and push
/// constants of `pushBytes` (at most 128). Give objects of static storage: the device keeps the pipeline by `code`'s address.
struct VulkanKernel {
  const char* name = "";
  std::span<const uint32_t> code;
  int buffers = 0;
  int pushBytes = 0;
};

struct VulkanDispatch {
  const VulkanKernel* kernel = nullptr;
  std::vector<VulkanBufferPtr> buffers;
  std::span<const uint8_t> push;       ///< kernel->pushBytes of them
  uint32_t groups[3] = {1, 1, 1};
};

class VulkanDevice : public std::enable_shared_from_this<VulkanDevice> {
 public:
  struct Options {
    std::string device;                ///< as GOBO_VULKAN_DEVICE
    bool validation = false;
    bool staging = false;              ///< never map device memory, as on GPUs: lets software devices test that path
    static Options fromEnvironment();
  };
  static Result<std::shared_ptr<VulkanDevice>> create(const Options& options);
  /// The process's device, made from the environment on first use; later calls give the same device or the same error.
  static Result<std::shared_ptr<VulkanDevice>> shared();
  ~VulkanDevice();

  /// For reports: "llvmpipe (LLVM 15.0.6, 256 bits)".
  const std::string& name() const;
  /// Part of node keys: "spirv-f32/<driver, its version, and the device unless software>".
  const std::string& numericClass() const;
  bool software() const;
  uint64_t maxBufferBytes() const;

  /// Uninitialised memory of at least one byte.
  Result<VulkanBufferPtr> buffer(size_t bytes);
  Status upload(VulkanBuffer& buffer, const void* data, size_t bytes);
  Status download(const VulkanBuffer& buffer, void* data, size_t bytes);
  template <typename T> Result<VulkanBufferPtr> upload(std::span<const T> data) {
    GOBO_ASSIGN(VulkanBufferPtr made, buffer(data.size_bytes()));
    GOBO_TRY(upload(*made, data.data(), data.size_bytes()));
    return made;
  }

  /// Runs the dispatches in order (each sees what those before it wrote) and waits. `seconds`: device time of each, by
  /// timestamps; zeros where the device has none.
  Status run(std::span<const VulkanDispatch> dispatches, std::vector<double>* seconds = nullptr);

  struct Impl;

 private:
  VulkanDevice();
  friend class VulkanBuffer;
  std::unique_ptr<Impl> impl_;
};

/// Work groups of `local` invocations covering `count`, folded into two dimensions: shaders index by
/// (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * local + gl_LocalInvocationID.x.
void setLinearGroups(VulkanDispatch& dispatch, size_t count, uint32_t local);

}  // namespace gobo
