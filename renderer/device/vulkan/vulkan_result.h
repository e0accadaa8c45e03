// SPDX-License-Identifier: Apache-2.0
// VkResult as Status. Private to device/vulkan.
#pragma once

#include <vulkan/vulkan.h>

#include "base/status.h"

namespace gobo {
inline namespace device {

/// "VK_ERROR_DEVICE_LOST"; "VkResult -1000012345" for one that this header does not know.
std::string vkResultName(VkResult result);
/// Ok for VK_SUCCESS. The text reads "<call>: <VkResult>".
Status vkStatus(VkResult result, const char* call);

}  // namespace device
}  // namespace gobo

#define GOBO_VK(call, ...) GOBO_TRY(::gobo::vkStatus(call(__VA_ARGS__), #call))
