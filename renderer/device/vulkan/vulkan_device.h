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

#include <memory>
#include <string>

#include "device/compute_device.h"

namespace gobo {
inline namespace device {

class VulkanDevice;

/// Of a VulkanDevice alone.
class VulkanBuffer final : public ComputeBuffer {
 public:
  ~VulkanBuffer() override;

 private:
  friend class VulkanDevice;
  struct Memory;
  VulkanBuffer(std::shared_ptr<const VulkanDevice> device, std::unique_ptr<Memory> memory, size_t bytes);
  std::shared_ptr<const VulkanDevice> device_;
  std::unique_ptr<Memory> memory_;
};

class VulkanDevice final : public ComputeDevice, public std::enable_shared_from_this<VulkanDevice> {
 public:
  struct Options {
    std::string device;  ///< as GOBO_VULKAN_DEVICE
    bool validation = false;
    bool staging = false;  ///< never map device memory, as on GPUs: lets software devices test that path
    static Options fromEnvironment();
  };
  static Result<std::shared_ptr<VulkanDevice>> create(const Options& options);
  /// The process's device, made from the environment on first use; later calls give the same device or the same error.
  static Result<std::shared_ptr<VulkanDevice>> shared();
  ~VulkanDevice() override;

  const char* kind() const override { return "vulkan"; }
  const std::string& name() const override;
  /// "spirv-f32/<driver, its version, and the device unless software>".
  const std::string& numericClass() const override;
  uint64_t maxBufferBytes() const override;
  bool software() const;

  using ComputeDevice::upload;
  Result<ComputeBufferPtr> buffer(size_t bytes) override;
  Status upload(ComputeBuffer& buffer, const void* data, size_t bytes) override;
  Status download(const ComputeBuffer& buffer, void* data, size_t bytes) override;
  Status run(std::span<const ComputeDispatch> dispatches, std::vector<double>* seconds = nullptr) override;

  struct Impl;

 private:
  VulkanDevice();
  friend class VulkanBuffer;
  std::unique_ptr<Impl> impl_;
};

}  // namespace device
}  // namespace gobo
