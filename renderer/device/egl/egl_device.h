// SPDX-License-Identifier: Apache-2.0
// EglDevice: OpenGL 4.5 compute without a window: an EGL context with no surface, of the platform EGL_MESA_platform_surfaceless
// (Mesa's GPU drivers, llvmpipe without a GPU) or of one device of EGL_EXT_platform_device (which NVIDIA's driver needs).
// Thread-safe: each call holds the device's mutex and makes the context current on its own thread for as long as it lasts; a
// caller's own EGL context is released by that. EGL displays stay initialised until the process ends, since eglTerminate would end
// those of every other user in it. Errors as in compute_device.h; creation: Unavailable (no driver, no OpenGL 4.5, no such device).
// Environment:
//   GOBO_EGL_DEVICE   empty or "surfaceless": that platform; a number: that device of eglQueryDevicesEXT
#pragma once

#include <memory>
#include <string>

#include "device/compute_device.h"

namespace gobo {
inline namespace device {

class EglDevice;

/// Of an EglDevice alone.
class EglBuffer final : public ComputeBuffer {
 public:
  ~EglBuffer() override;

 private:
  friend class EglDevice;
  EglBuffer(std::shared_ptr<const EglDevice> device, unsigned buffer, size_t bytes);
  std::shared_ptr<const EglDevice> device_;
  unsigned buffer_;
};

class EglDevice final : public ComputeDevice, public std::enable_shared_from_this<EglDevice> {
 public:
  struct Options {
    std::string device;  ///< as GOBO_EGL_DEVICE
    static Options fromEnvironment();
  };
  static Result<std::shared_ptr<EglDevice>> create(const Options& options);
  /// The process's device, made from the environment on first use; later calls give the same device or the same error.
  static Result<std::shared_ptr<EglDevice>> shared();
  ~EglDevice() override;

  const char* kind() const override { return "egl"; }
  /// GL_RENDERER.
  const std::string& name() const override;
  /// "glsl-f32/<GL_RENDERER and GL_VERSION>": the driver compiles the kernels, so its version is part of the numbers.
  const std::string& numericClass() const override;
  uint64_t maxBufferBytes() const override;

  using ComputeDevice::upload;
  Result<ComputeBufferPtr> buffer(size_t bytes) override;
  Status upload(ComputeBuffer& buffer, const void* data, size_t bytes) override;
  Status download(const ComputeBuffer& buffer, void* data, size_t bytes) override;
  Status run(std::span<const ComputeDispatch> dispatches, std::vector<double>* seconds = nullptr) override;

  struct Impl;

 private:
  EglDevice();
  friend class EglBuffer;
  std::unique_ptr<Impl> impl_;
};

}  // namespace device
}  // namespace gobo
