// SPDX-License-Identifier: Apache-2.0
// ComputeDevice: what a node needs of a machine that runs compute kernels: buffers, dispatches, timings. Vulkan
// (device/vulkan/vulkan_device.h) and OpenGL through EGL (device/egl/egl_device.h) implement it, and run the same *.comp text.
// Thread-safe: work of one device is serial. Errors: Unavailable (the device is gone), ResourceExhausted (out of memory, or over
// a limit of the device), Internal (anything else); the text names the call and its error code.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace device {

class ComputeDevice;

/// A storage buffer in device memory; freed with its last owner (which keeps the device alive). Other devices CHECK when given it.
class ComputeBuffer {
 public:
  virtual ~ComputeBuffer() = default;
  ComputeBuffer(const ComputeBuffer&) = delete;
  ComputeBuffer& operator=(const ComputeBuffer&) = delete;
  size_t bytes() const { return bytes_; }
  bool of(const ComputeDevice& device) const { return home_ == &device; }

 protected:
  ComputeBuffer(const ComputeDevice* home, size_t bytes) : home_(home), bytes_(bytes) {}

 private:
  const ComputeDevice* home_;
  size_t bytes_;
};
using ComputeBufferPtr = std::shared_ptr<ComputeBuffer>;

/// A compute program: one *.comp file as SPIR-V (Vulkan) and as preprocessed GLSL (OpenGL), entry point "main", storage buffers at
/// bindings 0..buffers-1, and PUSH_CONSTANTS (device/kernel.glsl.h) of `pushBytes`, at most 128. A device needs its own form only.
/// Give objects of static storage: devices keep what they made of a kernel by the address of its text.
struct ComputeKernel {
  const char* name = "";
  std::span<const uint32_t> code;
  int buffers = 0;
  int pushBytes = 0;
  const char* glsl = nullptr;
};

struct ComputeDispatch {
  const ComputeKernel* kernel = nullptr;
  std::vector<ComputeBufferPtr> buffers;
  std::span<const uint8_t> push;  ///< kernel->pushBytes of them
  uint32_t groups[3] = {1, 1, 1};
};

inline constexpr int kMaxKernelBuffers = 8;
inline constexpr int kMaxPushBytes = 128;

class ComputeDevice {
 public:
  virtual ~ComputeDevice() = default;
  ComputeDevice() = default;
  ComputeDevice(const ComputeDevice&) = delete;
  ComputeDevice& operator=(const ComputeDevice&) = delete;

  /// "vulkan", "egl".
  virtual const char* kind() const = 0;
  /// For reports: "llvmpipe (LLVM 15.0.6, 256 bits)".
  virtual const std::string& name() const = 0;
  /// Part of node keys: two devices of one class give the same bits.
  virtual const std::string& numericClass() const = 0;
  virtual uint64_t maxBufferBytes() const = 0;

  /// Uninitialised memory of at least one byte.
  virtual Result<ComputeBufferPtr> buffer(size_t bytes) = 0;
  virtual Status upload(ComputeBuffer& buffer, const void* data, size_t bytes) = 0;
  virtual Status download(const ComputeBuffer& buffer, void* data, size_t bytes) = 0;
  template <typename T>
  Result<ComputeBufferPtr> upload(std::span<const T> data) {
    GOBO_ASSIGN(ComputeBufferPtr made, buffer(data.size_bytes()));
    GOBO_TRY(upload(*made, data.data(), data.size_bytes()));
    return made;
  }

  /// Runs the dispatches in order (each sees what those before it wrote) and waits. `seconds`: device time of each, by
  /// timestamps; zeros where the device has none.
  virtual Status run(std::span<const ComputeDispatch> dispatches, std::vector<double>* seconds = nullptr) = 0;
};
using ComputeDevicePtr = std::shared_ptr<ComputeDevice>;

/// Work groups of `local` invocations covering `count`, folded into two dimensions: shaders index by
/// (gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x) * local + gl_LocalInvocationID.x.
void setLinearGroups(ComputeDispatch& dispatch, size_t count, uint32_t local);

/// Letters, digits, dots; anything else becomes one '-': the form in which drivers' names enter numeric classes.
std::string keyWord(const std::string& text);

}  // namespace device
}  // namespace gobo
