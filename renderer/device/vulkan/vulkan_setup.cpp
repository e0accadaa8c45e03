// SPDX-License-Identifier: Apache-2.0
// Instance, choice of device, logical device.
#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <cstring>

#include "device/vulkan/vulkan_impl.h"

namespace gobo {
inline namespace device {
namespace {

constexpr const char* kLayer = "VK_LAYER_KHRONOS_validation";

VKAPI_ATTR VkBool32 VKAPI_CALL onMessage(VkDebugUtilsMessageSeverityFlagBitsEXT, VkDebugUtilsMessageTypeFlagsEXT,
                                         const VkDebugUtilsMessengerCallbackDataEXT* data, void* user) {
  auto& impl = *static_cast<VulkanDevice::Impl*>(user);
  std::lock_guard lock(impl.messageMutex);
  if (impl.validationMessage.empty()) impl.validationMessage = data->pMessage ? data->pMessage : "no text";
  return VK_FALSE;
}

bool layerPresent() {
  uint32_t n = 0;
  vkEnumerateInstanceLayerProperties(&n, nullptr);
  std::vector<VkLayerProperties> layers(n);
  vkEnumerateInstanceLayerProperties(&n, layers.data());
  return std::any_of(layers.begin(), layers.end(), [](const auto& l) { return std::strcmp(l.layerName, kLayer) == 0; });
}

int typeRank(VkPhysicalDeviceType type) {
  switch (type) {
    case VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU: return 4;
    case VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU: return 3;
    case VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU: return 2;
    case VK_PHYSICAL_DEVICE_TYPE_CPU: return 1;
    default: return 0;
  }
}

std::string lower(std::string s) {
  for (char& c : s) c = char(std::tolower(static_cast<unsigned char>(c)));
  return s;
}

int computeFamily(VkPhysicalDevice physical, uint32_t* timestampBits = nullptr) {
  uint32_t n = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(physical, &n, nullptr);
  std::vector<VkQueueFamilyProperties> families(n);
  vkGetPhysicalDeviceQueueFamilyProperties(physical, &n, families.data());
  for (uint32_t i = 0; i < n; ++i)
    if (families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) {
      if (timestampBits) *timestampBits = families[i].timestampValidBits;
      return int(i);
    }
  return -1;
}

Status noVulkanDevice(const std::string& why) {
  return {Code::Unavailable, "no Vulkan device: " + why + " (mesa-vulkan-drivers has lavapipe for machines without a GPU)"};
}

}  // namespace

VulkanDevice::Options VulkanDevice::Options::fromEnvironment() {
  const char* device = std::getenv("GOBO_VULKAN_DEVICE");
  const char* validation = std::getenv("GOBO_VULKAN_VALIDATION");
  Options options;
  if (device) options.device = device;
  options.validation = validation && std::strcmp(validation, "1") == 0;
  return options;
}

Status VulkanDevice::Impl::createInstance(bool wantValidation) {
  VkApplicationInfo app{VK_STRUCTURE_TYPE_APPLICATION_INFO};
  app.pApplicationName = "gobo";
  app.apiVersion = VK_API_VERSION_1_2;
  VkInstanceCreateInfo info{VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO};
  info.pApplicationInfo = &app;
  VkDebugUtilsMessengerCreateInfoEXT debug{VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT};
  debug.messageSeverity = VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT;
  debug.messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT;
  debug.pfnUserCallback = onMessage;
  debug.pUserData = this;
  const char* extension = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
  if (wantValidation) {
    if (!layerPresent()) return {Code::Unavailable, std::string("GOBO_VULKAN_VALIDATION is set, but ") + kLayer + " is not installed"};
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &kLayer;
    info.enabledExtensionCount = 1;
    info.ppEnabledExtensionNames = &extension;
  }
  if (const VkResult r = vkCreateInstance(&info, nullptr, &instance); r != VK_SUCCESS) {
    if (r == VK_ERROR_INCOMPATIBLE_DRIVER) return noVulkanDevice("no driver is installed, vkCreateInstance: " + vkResultName(r));
    return vkStatus(r, "vkCreateInstance");
  }
  if (wantValidation) {
    const auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(vkGetInstanceProcAddr(instance, "vkCreateDebugUtilsMessengerEXT"));
    if (create) GOBO_VK(create, instance, &debug, nullptr, &messenger);
  }
  return {};
}

Status VulkanDevice::Impl::choosePhysical(const std::string& wanted) {
  uint32_t n = 0;
  GOBO_VK(vkEnumeratePhysicalDevices, instance, &n, nullptr);
  std::vector<VkPhysicalDevice> all(n);
  if (n) GOBO_VK(vkEnumeratePhysicalDevices, instance, &n, all.data());
  const bool isIndex = !wanted.empty() && wanted.size() < 4 && std::all_of(wanted.begin(), wanted.end(), [](char c) { return c >= '0' && c <= '9'; });
  std::string names;
  int best = -1;
  for (uint32_t i = 0; i < n; ++i) {
    VkPhysicalDeviceProperties p;
    vkGetPhysicalDeviceProperties(all[i], &p);
    names += (i ? ", " : "") + std::to_string(i) + ": " + p.deviceName;
    if (p.apiVersion < VK_API_VERSION_1_1 || computeFamily(all[i]) < 0) continue;
    if (isIndex && std::stoul(wanted) != i) continue;
    if (!wanted.empty() && !isIndex && lower(p.deviceName).find(lower(wanted)) == std::string::npos) continue;
    if (typeRank(p.deviceType) <= best) continue;
    best = typeRank(p.deviceType);
    physical = all[i];
    properties = p;
  }
  if (n == 0) return noVulkanDevice("the drivers offer none");
  if (physical == VK_NULL_HANDLE)
    return {Code::Unavailable, wanted.empty() ? "no Vulkan device with version 1.1 and compute among: " + names
                                              : "no usable Vulkan device matches GOBO_VULKAN_DEVICE='" + wanted + "' among: " + names};
  vkGetPhysicalDeviceMemoryProperties(physical, &memory);
  name = properties.deviceName;
  std::string driver = "driver-" + std::to_string(properties.driverVersion);
  if (properties.apiVersion >= VK_API_VERSION_1_2) {
    VkPhysicalDeviceDriverProperties info{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceProperties2 two{VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
    two.pNext = &info;
    vkGetPhysicalDeviceProperties2(physical, &two);
    driver = std::string(info.driverName) + "-" + info.driverInfo;
  }
  numericClass = "spirv-f32/" + keyWord(driver);
  if (properties.deviceType != VK_PHYSICAL_DEVICE_TYPE_CPU) numericClass += "-" + keyWord(properties.deviceName);
  return {};
}

Status VulkanDevice::Impl::createDevice() {
  uint32_t timestampBits = 0;
  queueFamily = uint32_t(computeFamily(physical, &timestampBits));
  timestamps = timestampBits > 0 && properties.limits.timestampPeriod > 0.0f;
  const float priority = 1.0f;
  VkDeviceQueueCreateInfo queueInfo{VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO};
  queueInfo.queueFamilyIndex = queueFamily;
  queueInfo.queueCount = 1;
  queueInfo.pQueuePriorities = &priority;
  VkDeviceCreateInfo info{VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO};
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queueInfo;
  GOBO_VK(vkCreateDevice, physical, &info, nullptr, &device);
  vkGetDeviceQueue(device, queueFamily, 0, &queue);

  VkCommandPoolCreateInfo pool{VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO};
  pool.flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT;
  pool.queueFamilyIndex = queueFamily;
  GOBO_VK(vkCreateCommandPool, device, &pool, nullptr, &commandPool);
  VkCommandBufferAllocateInfo allocate{VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO};
  allocate.commandPool = commandPool;
  allocate.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  allocate.commandBufferCount = 1;
  GOBO_VK(vkAllocateCommandBuffers, device, &allocate, &commands);
  const VkFenceCreateInfo fenceInfo{VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
  GOBO_VK(vkCreateFence, device, &fenceInfo, nullptr, &fence);
  const VkDescriptorPoolSize size{VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, kMaxDispatches * kMaxKernelBuffers};
  VkDescriptorPoolCreateInfo sets{VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO};
  sets.maxSets = kMaxDispatches;
  sets.poolSizeCount = 1;
  sets.pPoolSizes = &size;
  GOBO_VK(vkCreateDescriptorPool, device, &sets, nullptr, &descriptors);
  if (timestamps) {
    VkQueryPoolCreateInfo query{VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO};
    query.queryType = VK_QUERY_TYPE_TIMESTAMP;
    query.queryCount = 2 * kMaxDispatches;
    GOBO_VK(vkCreateQueryPool, device, &query, nullptr, &queries);
  }
  return validation();
}

Status VulkanDevice::Impl::validation() {
  std::lock_guard lock(messageMutex);
  if (validationMessage.empty()) return {};
  return internalError("Vulkan validation: " + std::exchange(validationMessage, {}));
}

VulkanDevice::Impl::~Impl() {
  if (device) {
    vkDeviceWaitIdle(device);
    freeKept();
    freeBuffer(stage);
    for (auto& [code, p] : pipelines) {
      vkDestroyPipeline(device, p.pipeline, nullptr);
      vkDestroyPipelineLayout(device, p.layout, nullptr);
      vkDestroyDescriptorSetLayout(device, p.setLayout, nullptr);
    }
    vkDestroyQueryPool(device, queries, nullptr);
    vkDestroyDescriptorPool(device, descriptors, nullptr);
    vkDestroyFence(device, fence, nullptr);
    vkDestroyCommandPool(device, commandPool, nullptr);
    vkDestroyDevice(device, nullptr);
  }
  if (messenger) {
    const auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(vkGetInstanceProcAddr(instance, "vkDestroyDebugUtilsMessengerEXT"));
    if (destroy) destroy(instance, messenger, nullptr);
  }
  if (instance) vkDestroyInstance(instance, nullptr);
}

VulkanDevice::VulkanDevice() : impl_(std::make_unique<Impl>()) {}
VulkanDevice::~VulkanDevice() = default;

Result<std::shared_ptr<VulkanDevice>> VulkanDevice::create(const Options& options) {
  std::shared_ptr<VulkanDevice> made(new VulkanDevice());
  GOBO_TRY(made->impl_->createInstance(options.validation));
  GOBO_TRY(made->impl_->choosePhysical(options.device));
  made->impl_->staging = options.staging || !made->software();
  GOBO_TRY(made->impl_->createDevice());
  return made;
}

Result<std::shared_ptr<VulkanDevice>> VulkanDevice::shared() {
  // Never destroyed: drivers' own static objects may be gone before ours at exit.
  static const auto* device = new Result<std::shared_ptr<VulkanDevice>>(create(Options::fromEnvironment()));
  return *device;
}

const std::string& VulkanDevice::name() const { return impl_->name; }
const std::string& VulkanDevice::numericClass() const { return impl_->numericClass; }
bool VulkanDevice::software() const { return impl_->properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU; }
uint64_t VulkanDevice::maxBufferBytes() const { return impl_->properties.limits.maxStorageBufferRange; }

}  // namespace device
}  // namespace gobo
