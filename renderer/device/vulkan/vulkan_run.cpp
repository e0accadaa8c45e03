// SPDX-License-Identifier: Apache-2.0
// Pipelines and dispatches.
#include <algorithm>

#include "base/check.h"
#include "device/vulkan/vulkan_impl.h"

namespace gobo {
inline namespace device {

Result<VulkanDevice::Impl::Pipeline> VulkanDevice::Impl::pipeline(const ComputeKernel& kernel) {
  if (const auto found = pipelines.find(kernel.code.data()); found != pipelines.end()) return found->second;
  GOBO_CHECK(!kernel.code.empty() && kernel.buffers >= 1 && kernel.buffers <= kMaxKernelBuffers && kernel.pushBytes <= kMaxPushBytes);
  Pipeline& made = pipelines[kernel.code.data()];  // whatever is made of it is freed with the device
  const auto build = [&]() -> Status {
    std::vector<VkDescriptorSetLayoutBinding> bindings;
    for (int i = 0; i < kernel.buffers; ++i) bindings.push_back({uint32_t(i), VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr});
    VkDescriptorSetLayoutCreateInfo set{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO};
    set.bindingCount = uint32_t(bindings.size());
    set.pBindings = bindings.data();
    GOBO_VK(vkCreateDescriptorSetLayout, device, &set, nullptr, &made.setLayout);
    const VkPushConstantRange range{VK_SHADER_STAGE_COMPUTE_BIT, 0, uint32_t(kernel.pushBytes)};
    VkPipelineLayoutCreateInfo layout{VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO};
    layout.setLayoutCount = 1;
    layout.pSetLayouts = &made.setLayout;
    layout.pushConstantRangeCount = kernel.pushBytes ? 1 : 0;
    layout.pPushConstantRanges = &range;
    GOBO_VK(vkCreatePipelineLayout, device, &layout, nullptr, &made.layout);
    VkShaderModuleCreateInfo module{VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO};
    module.codeSize = kernel.code.size_bytes();
    module.pCode = kernel.code.data();
    VkShaderModule shader = VK_NULL_HANDLE;
    GOBO_VK(vkCreateShaderModule, device, &module, nullptr, &shader);
    VkComputePipelineCreateInfo info{VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO};
    info.stage = {VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, nullptr, 0, VK_SHADER_STAGE_COMPUTE_BIT, shader, "main", nullptr};
    info.layout = made.layout;
    const VkResult r = vkCreateComputePipelines(device, VK_NULL_HANDLE, 1, &info, nullptr, &made.pipeline);
    vkDestroyShaderModule(device, shader, nullptr);
    return vkStatus(r, "vkCreateComputePipelines");
  };
  if (Status status = build(); !status.ok()) {
    vkDestroyPipelineLayout(device, made.layout, nullptr);
    vkDestroyDescriptorSetLayout(device, made.setLayout, nullptr);
    pipelines.erase(kernel.code.data());
    return Status(status.code(), std::string("kernel ") + kernel.name + ": " + status.message());
  }
  return made;
}

Status VulkanDevice::Impl::submitAndWait() {
  GOBO_VK(vkEndCommandBuffer, commands);
  VkSubmitInfo submit{VK_STRUCTURE_TYPE_SUBMIT_INFO};
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands;
  GOBO_VK(vkResetFences, device, 1, &fence);
  GOBO_VK(vkQueueSubmit, queue, 1, &submit, fence);
  GOBO_VK(vkWaitForFences, device, 1, &fence, VK_TRUE, UINT64_MAX);
  return validation();
}

Status VulkanDevice::run(std::span<const ComputeDispatch> dispatches, std::vector<double>* seconds) {
  if (seconds) seconds->assign(dispatches.size(), 0.0);
  std::lock_guard lock(impl_->mutex);
  Impl& d = *impl_;
  for (size_t first = 0; first < dispatches.size(); first += kMaxDispatches) {
    const auto batch = dispatches.subspan(first, std::min<size_t>(kMaxDispatches, dispatches.size() - first));
    GOBO_VK(vkResetDescriptorPool, d.device, d.descriptors, 0);
    VkCommandBufferBeginInfo begin{VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    begin.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
    // Everything that can fail comes before recording begins.
    std::vector<Impl::Pipeline> pipelines;
    std::vector<VkDescriptorSet> sets;
    for (const ComputeDispatch& dispatch : batch) {
      const ComputeKernel& kernel = *dispatch.kernel;
      GOBO_CHECK_EQ(int(dispatch.buffers.size()), kernel.buffers);
      GOBO_CHECK_EQ(int(dispatch.push.size()), kernel.pushBytes);
      for (const ComputeBufferPtr& buffer : dispatch.buffers) GOBO_CHECK(buffer->of(*this));
      for (int i = 0; i < 3; ++i) GOBO_CHECK(dispatch.groups[i] >= 1 && dispatch.groups[i] <= d.properties.limits.maxComputeWorkGroupCount[i]);
      GOBO_ASSIGN(Impl::Pipeline pipeline, d.pipeline(kernel));
      pipelines.push_back(pipeline);
      VkDescriptorSetAllocateInfo allocate{VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO};
      allocate.descriptorPool = d.descriptors;
      allocate.descriptorSetCount = 1;
      allocate.pSetLayouts = &pipeline.setLayout;
      VkDescriptorSet set = VK_NULL_HANDLE;
      GOBO_VK(vkAllocateDescriptorSets, d.device, &allocate, &set);
      sets.push_back(set);
      VkDescriptorBufferInfo infos[kMaxKernelBuffers];
      VkWriteDescriptorSet writes[kMaxKernelBuffers];
      for (int i = 0; i < kernel.buffers; ++i) {
        infos[i] = {static_cast<const VulkanBuffer&>(*dispatch.buffers[size_t(i)]).memory_->buffer, 0, VK_WHOLE_SIZE};
        writes[i] = {VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET, nullptr, set, uint32_t(i), 0, 1, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, nullptr, &infos[i], nullptr};
      }
      vkUpdateDescriptorSets(d.device, uint32_t(kernel.buffers), writes, 0, nullptr);
    }
    const bool timed = seconds && d.timestamps;
    GOBO_VK(vkBeginCommandBuffer, d.commands, &begin);
    if (timed) vkCmdResetQueryPool(d.commands, d.queries, 0, 2 * kMaxDispatches);
    for (size_t i = 0; i < batch.size(); ++i) {
      const ComputeDispatch& dispatch = batch[i];
      vkCmdBindPipeline(d.commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipelines[i].pipeline);
      vkCmdBindDescriptorSets(d.commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipelines[i].layout, 0, 1, &sets[i], 0, nullptr);
      if (!dispatch.push.empty())
        vkCmdPushConstants(d.commands, pipelines[i].layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, uint32_t(dispatch.push.size()), dispatch.push.data());
      if (timed) vkCmdWriteTimestamp(d.commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, d.queries, uint32_t(2 * i));
      vkCmdDispatch(d.commands, dispatch.groups[0], dispatch.groups[1], dispatch.groups[2]);
      if (timed) vkCmdWriteTimestamp(d.commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, d.queries, uint32_t(2 * i + 1));
      VkMemoryBarrier barrier{VK_STRUCTURE_TYPE_MEMORY_BARRIER};
      barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT;
      barrier.dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_HOST_READ_BIT;
      vkCmdPipelineBarrier(d.commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                           VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT | VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, nullptr, 0,
                           nullptr);
    }
    GOBO_TRY(d.submitAndWait());
    if (!timed) continue;
    std::vector<uint64_t> ticks(2 * batch.size());
    GOBO_VK(vkGetQueryPoolResults, d.device, d.queries, 0, uint32_t(ticks.size()), ticks.size() * 8, ticks.data(), 8, VK_QUERY_RESULT_64_BIT);
    for (size_t i = 0; i < batch.size(); ++i) (*seconds)[first + i] = double(ticks[2 * i + 1] - ticks[2 * i]) * d.properties.limits.timestampPeriod * 1e-9;
  }
  return {};
}

}  // namespace device
}  // namespace gobo
