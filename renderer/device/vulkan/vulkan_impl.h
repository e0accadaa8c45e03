// SPDX-License-Identifier: Apache-2.0
// The Vulkan objects of a VulkanDevice. Private to device/vulkan. Members below `mutex` are used with it held.
#pragma once

#include <atomic>
#include <map>
#include <mutex>
#include <vector>

#include "device/vulkan/vulkan_device.h"
#include "device/vulkan/vulkan_result.h"

namespace gobo {
inline namespace device {

struct VulkanBuffer::Memory {
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  void* mapped = nullptr;  // null: reached through a staging buffer
  size_t bytes = 0;        // of the buffer
};

struct VulkanDevice::Impl {
  struct Pipeline {
    VkDescriptorSetLayout setLayout{};
    VkPipelineLayout layout{};
    VkPipeline pipeline{};
  };

  VkInstance instance = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger = VK_NULL_HANDLE;
  VkPhysicalDevice physical = VK_NULL_HANDLE;
  VkDevice device = VK_NULL_HANDLE;
  VkQueue queue = VK_NULL_HANDLE;
  uint32_t queueFamily = 0;
  bool timestamps = false;
  bool staging = false;  // device memory is never mapped
  VkPhysicalDeviceProperties properties{};
  VkPhysicalDeviceMemoryProperties memory{};
  std::string name, numericClass;
  std::mutex messageMutex;        // validation messages come from inside any call
  std::string validationMessage;  // the first since the last report

  std::mutex mutex;
  VkCommandPool commandPool = VK_NULL_HANDLE;
  VkCommandBuffer commands = VK_NULL_HANDLE;
  VkDescriptorPool descriptors = VK_NULL_HANDLE;
  VkQueryPool queries = VK_NULL_HANDLE;
  VkFence fence = VK_NULL_HANDLE;
  std::map<const uint32_t*, Pipeline> pipelines;
  // GPUs take milliseconds to give and to zero memory, as long as kernels and copies of it take: what is there is used again.
  VulkanBuffer::Memory stage;              // host memory that transfers go through, piece by piece
  std::vector<VulkanBuffer::Memory> kept;  // of freed buffers that the host cannot map, oldest first
  size_t keptBytes = 0;

  ~Impl();
  Status createInstance(bool validation);
  Status choosePhysical(const std::string& wanted);
  Status createDevice();
  Status makeBuffer(size_t bytes, VkBufferUsageFlags usage, bool host, VulkanBuffer::Memory& made);
  void freeBuffer(VulkanBuffer::Memory& memory) const;
  /// makeBuffer of storage for kernels, from what was kept where that fits.
  Status takeBuffer(size_t bytes, VulkanBuffer::Memory& made);
  /// Instead of freeBuffer, of a buffer from takeBuffer.
  void keepBuffer(VulkanBuffer::Memory& memory);
  void freeKept();
  /// `stage` of at least min(bytes, kStagePiece).
  Status makeStage(size_t bytes);
  Result<Pipeline> pipeline(const ComputeKernel& kernel);
  Status submitAndWait();
  Status copy(VkBuffer from, size_t fromOffset, VkBuffer to, size_t toOffset, size_t bytes);
  /// Internal with the layer's words, if it had any since the last call.
  Status validation();
};

/// Bytes that are on their way between host and device at once.
inline constexpr size_t kStagePiece = size_t(16) << 20;
/// Of freed device memory that waits for its next use.
inline constexpr size_t kMostKept = size_t(256) << 20;
/// Dispatches of one submission; run() splits longer lists.
inline constexpr uint32_t kMaxDispatches = 64;

}  // namespace device
}  // namespace gobo
