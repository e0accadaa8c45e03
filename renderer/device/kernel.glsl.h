// SPDX-License-Identifier: Apache-2.0
// What *.comp files write where Vulkan's and OpenGL's GLSL differ. Storage buffers are the same in both: layout(std430, binding = n),
// Vulkan's set being 0. Blocks of scalars and vec4 alone are laid out alike as push constants (std430) and as std140.
#ifndef GOBO_KERNEL_GLSL
#define GOBO_KERNEL_GLSL
#ifdef GOBO_OPENGL
#define PUSH_CONSTANTS layout(std140, binding = 0) uniform
#else
#define PUSH_CONSTANTS layout(push_constant) uniform
#endif
#endif
