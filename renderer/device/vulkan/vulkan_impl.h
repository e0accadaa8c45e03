// SPDX-License-Identifier: Apache-2.0
// The Vulkan objects of a VulkanDevice. Private to device/vulkan. Members below `mutex` are used with it held.
#pragma once

#include <atomic>
#include <map>
#include <mutex>

#include "device/vulkan/vulkan_device.h"
#include "device/vulkan/vulkan_result.h"

namespace gobo {

struct VulkanBuffer::Memory {
  VkBuffer buffer = VK_NULL_HANDLE;
  VkDeviceMemory memory = VK_NULL_HANDLE;
  void* mapped = nullptr;  // null: reached through a staging buffer
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

  ~Impl();
  Status createInstance(bool validation);
  Status choosePhysical(const std::string& wanted);
  Status createDevice();
  Status makeBuffer(size_t bytes, VkBufferUsageFlags usage, bool host, VulkanBuffer::Memory& made);
  void freeBuffer(VulkanBuffer::Memory& memory) const;
  Result<Pipeline> pipeline(const ComputeKernel& kernel);
  Status submitAndWait();
  Status copy(VkBuffer from, VkBuffer to, size_t bytes);
  /// Internal with the layer's words, if it had any since the last call.
  Status validation();
};

/// Dispatches of one submission; run() splits longer lists.
inline constexpr uint32_t kMaxDispatches = 64;

}  // namespace gobo
