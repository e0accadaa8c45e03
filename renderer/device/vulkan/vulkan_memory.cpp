// SPDX-License-Identifier: Apache-2.0
// Buffers and transfers: device-local memory that the host can map is written directly, other memory through staging.
#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "base/check.h"
#include "device/vulkan/vulkan_impl.h"

namespace gobo {
inline namespace device {
namespace {

constexpr VkMemoryPropertyFlags kHost = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;

int memoryType(const VkPhysicalDeviceMemoryProperties& memory, uint32_t allowed, VkMemoryPropertyFlags flags) {
  for (uint32_t i = 0; i < memory.memoryTypeCount; ++i)
    if ((allowed >> i & 1) && (memory.memoryTypes[i].propertyFlags & flags) == flags) return int(i);
  return -1;
}

}  // namespace

Status VulkanDevice::Impl::makeBuffer(size_t bytes, VkBufferUsageFlags usage, bool host, VulkanBuffer::Memory& made) {
  VkBufferCreateInfo info{VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO};
  info.size = bytes;
  info.usage = usage;
  info.sharingMode = VK_SHARING_MODE_EXCLUSIVE;
  made.bytes = bytes;
  GOBO_VK(vkCreateBuffer, device, &info, nullptr, &made.buffer);
  VkMemoryRequirements need;
  vkGetBufferMemoryRequirements(device, made.buffer, &need);
  // Software devices: the one kind of memory is both. GPUs: mapped video memory is slow to read, so it is not used.
  const bool mappable = host || !staging;
  int type = -1;
  if (mappable) type = memoryType(memory, need.memoryTypeBits, kHost | VK_MEMORY_PROPERTY_HOST_CACHED_BIT);
  if (type < 0 && host) type = memoryType(memory, need.memoryTypeBits, kHost);
  if (type < 0) type = memoryType(memory, need.memoryTypeBits, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
  if (type < 0) type = memoryType(memory, need.memoryTypeBits, 0);
  if (type < 0) return internalError("no Vulkan memory type fits a storage buffer");
  VkMemoryAllocateInfo allocate{VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO};
  allocate.allocationSize = need.size;
  allocate.memoryTypeIndex = uint32_t(type);
  GOBO_VK(vkAllocateMemory, device, &allocate, nullptr, &made.memory);
  GOBO_VK(vkBindBufferMemory, device, made.buffer, made.memory, 0);
  if ((memory.memoryTypes[type].propertyFlags & kHost) == kHost && mappable) GOBO_VK(vkMapMemory, device, made.memory, 0, VK_WHOLE_SIZE, 0, &made.mapped);
  return {};
}

void VulkanDevice::Impl::freeBuffer(VulkanBuffer::Memory& m) const {
  vkDestroyBuffer(device, m.buffer, nullptr);
  vkFreeMemory(device, m.memory, nullptr);  // unmaps
  m = {};
}

namespace {
/// Sizes in steps of a quarter of a power of two, so that buffers fit each other's place.
size_t roundedSize(size_t bytes) {
  const size_t step = std::max<size_t>(std::bit_floor(bytes) / 4, 256);
  return (bytes + step - 1) / step * step;
}
}  // namespace

Status VulkanDevice::Impl::takeBuffer(size_t bytes, VulkanBuffer::Memory& made) {
  constexpr VkBufferUsageFlags usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  const size_t wanted = staging ? std::max(bytes, std::min<size_t>(roundedSize(bytes), properties.limits.maxStorageBufferRange)) : bytes;
  const auto found = std::find_if(kept.rbegin(), kept.rend(), [&](const VulkanBuffer::Memory& m) { return m.bytes == wanted; });
  if (found != kept.rend()) {
    made = *found;
    keptBytes -= made.bytes;
    kept.erase(std::next(found).base());
    return {};
  }
  Status status = makeBuffer(wanted, usage, false, made);
  if (status.code() != Code::ResourceExhausted || kept.empty()) return status;
  freeBuffer(made);
  freeKept();
  return makeBuffer(wanted, usage, false, made);
}

void VulkanDevice::Impl::keepBuffer(VulkanBuffer::Memory& m) {
  if (m.mapped || m.memory == VK_NULL_HANDLE || m.bytes > kMostKept) return freeBuffer(m);
  kept.push_back(std::exchange(m, {}));
  keptBytes += kept.back().bytes;
  while (keptBytes > kMostKept) {
    keptBytes -= kept.front().bytes;
    freeBuffer(kept.front());
    kept.erase(kept.begin());
  }
}

void VulkanDevice::Impl::freeKept() {
  for (VulkanBuffer::Memory& m : kept) freeBuffer(m);
  kept.clear();
  keptBytes = 0;
}

Status VulkanDevice::Impl::makeStage(size_t bytes) {
  const size_t wanted = std::bit_ceil(std::clamp<size_t>(bytes, 1 << 16, kStagePiece));
  if (stage.bytes >= wanted) return {};
  freeBuffer(stage);
  Status status = makeBuffer(wanted, VK_BUFFER_USAGE_TRANSFER_SRC_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT, true, stage);
  if (!status.ok()) freeBuffer(stage);
  return status;
}

VulkanBuffer::VulkanBuffer(std::shared_ptr<const VulkanDevice> device, std::unique_ptr<Memory> memory, size_t bytes)
    : ComputeBuffer(device.get(), bytes), device_(std::move(device)), memory_(std::move(memory)) {}
VulkanBuffer::~VulkanBuffer() {
  std::lock_guard lock(device_->impl_->mutex);
  device_->impl_->keepBuffer(*memory_);
}

Result<ComputeBufferPtr> VulkanDevice::buffer(size_t bytes) {
  if (bytes > maxBufferBytes())
    return Status(Code::ResourceExhausted,
                  "a Vulkan buffer of " + std::to_string(bytes) + " bytes is over the limit of " + name() + ", " + std::to_string(maxBufferBytes()));
  bytes = std::max<size_t>(bytes, 1);
  std::lock_guard lock(impl_->mutex);
  auto made = std::make_unique<VulkanBuffer::Memory>();
  Status status = impl_->takeBuffer(bytes, *made);
  if (status.ok()) status = impl_->validation();
  if (!status.ok()) {
    impl_->freeBuffer(*made);
    return status;
  }
  return ComputeBufferPtr(new VulkanBuffer(shared_from_this(), std::move(made), bytes));
}

Status VulkanDevice::Impl::copy(VkBuffer from, size_t fromOffset, VkBuffer to, size_t toOffset, size_t bytes) {
  VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
  begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  GOBO_VK(vkBeginCommandBuffer, commands, &begin);
  const VkBufferCopy region{fromOffset, toOffset, bytes};
  vkCmdCopyBuffer(commands, from, to, 1, &region);
  VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
  barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT | VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT;
  vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1, &barrier, 0, nullptr,
                       0, nullptr);
  return submitAndWait();
}

Status VulkanDevice::upload(ComputeBuffer& to, const void* data, size_t bytes) {
  GOBO_CHECK(to.of(*this));
  const VulkanBuffer& buffer = static_cast<const VulkanBuffer&>(to);
  GOBO_CHECK_LE(bytes, buffer.bytes());
  if (bytes == 0) return {};
  std::lock_guard lock(impl_->mutex);
  if (buffer.memory_->mapped) {
    std::memcpy(buffer.memory_->mapped, data, bytes);
    return {};
  }
  GOBO_TRY(impl_->makeStage(bytes));
  for (size_t done = 0; done < bytes; done += kStagePiece) {
    const size_t piece = std::min(bytes - done, kStagePiece);
    std::memcpy(impl_->stage.mapped, static_cast<const char*>(data) + done, piece);
    GOBO_TRY(impl_->copy(impl_->stage.buffer, 0, buffer.memory_->buffer, done, piece));
  }
  return {};
}

Status VulkanDevice::download(const ComputeBuffer& from, void* data, size_t bytes) {
  GOBO_CHECK(from.of(*this));
  const VulkanBuffer& buffer = static_cast<const VulkanBuffer&>(from);
  GOBO_CHECK_LE(bytes, buffer.bytes());
  if (bytes == 0) return {};
  std::lock_guard lock(impl_->mutex);
  if (buffer.memory_->mapped) {
    std::memcpy(data, buffer.memory_->mapped, bytes);
    return {};
  }
  GOBO_TRY(impl_->makeStage(bytes));
  for (size_t done = 0; done < bytes; done += kStagePiece) {
    const size_t piece = std::min(bytes - done, kStagePiece);
    GOBO_TRY(impl_->copy(buffer.memory_->buffer, done, impl_->stage.buffer, 0, piece));
    std::memcpy(static_cast<char*>(data) + done, impl_->stage.mapped, piece);
  }
  return {};
}

}  // namespace device
}  // namespace gobo
