// SPDX-License-Identifier: Apache-2.0
// Display, context, what the driver can do.
#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "device/egl/egl_impl.h"

namespace gobo {
inline namespace device {
namespace {

/// No driver, or one that lacks something: Unavailable, unless memory ran out.
Status noEglDevice(const std::string& why) {
  return {Code::Unavailable, "no EGL device: " + why + " (libgl1-mesa-dri has llvmpipe for machines without a GPU)"};
}
Status failed(const char* call) {
  const int error = eglGetError();
  if (error == EGL_BAD_ALLOC) return eglStatus(error, call);
  return noEglDevice(std::string(call) + ": " + eglErrorName(error));
}

bool hasWord(const char* list, const char* word) { return list && (" " + std::string(list) + " ").find(" " + std::string(word) + " ") != std::string::npos; }

Result<EGLDeviceEXT> deviceAt(const std::string& index) {
  const auto query = reinterpret_cast<PFNEGLQUERYDEVICESEXTPROC>(eglGetProcAddress("eglQueryDevicesEXT"));
  EGLint n = 0;
  if (!query) return noEglDevice("no EGL_EXT_device_enumeration");
  if (!query(0, nullptr, &n)) return failed("eglQueryDevicesEXT");
  std::vector<EGLDeviceEXT> all(size_t(std::max(n, 1)));
  if (!query(n, all.data(), &n)) return failed("eglQueryDevicesEXT");
  if (std::stol(index) >= n) return noEglDevice("GOBO_EGL_DEVICE=" + index + ", eglQueryDevicesEXT has " + std::to_string(n));
  return all[size_t(std::stol(index))];
}

}  // namespace

Status GlFunctions::load() {
#define X(name, NAME)                                                        \
  name = reinterpret_cast<PFNGL##NAME##PROC>(eglGetProcAddress("gl" #name)); \
  if (!name) return noEglDevice("eglGetProcAddress: the driver has no gl" #name);
  GOBO_GL_FUNCTIONS(X)
#undef X
  return {};
}

Status GlFunctions::check(const char* call) const {
  const GLenum error = GetError();
  if (error == GL_NO_ERROR) return {};
  for (int i = 0; i < 16 && GetError() != GL_NO_ERROR; ++i) {}  // a lost context may repeat itself for ever
  return glStatus(error, call);
}

EglDevice::Options EglDevice::Options::fromEnvironment() {
  const char* device = std::getenv("GOBO_EGL_DEVICE");
  return {device ? device : ""};
}

Status EglDevice::Impl::openDisplay(const std::string& device) {
  const char* extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  const bool number = !device.empty() && device.size() < 4 && std::all_of(device.begin(), device.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (number) {
    if (!hasWord(extensions, "EGL_EXT_platform_device")) return noEglDevice("no EGL_EXT_platform_device");
    GOBO_ASSIGN(const EGLDeviceEXT native, deviceAt(device));
    display = eglGetPlatformDisplay(EGL_PLATFORM_DEVICE_EXT, native, nullptr);
  } else if (device.empty() || device == "surfaceless") {
    if (!hasWord(extensions, "EGL_MESA_platform_surfaceless")) return noEglDevice("no driver has EGL_MESA_platform_surfaceless");
    display = eglGetPlatformDisplay(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, nullptr);
  } else {
    return noEglDevice("GOBO_EGL_DEVICE='" + device + "' is neither 'surfaceless' nor the number of a device");
  }
  if (display == EGL_NO_DISPLAY) return failed("eglGetPlatformDisplay");
  EGLint major = 0, minor = 0;
  if (!eglInitialize(display, &major, &minor)) return failed("eglInitialize");
  for (const char* need : {"EGL_KHR_surfaceless_context", "EGL_KHR_no_config_context"})
    if (!hasWord(eglQueryString(display, EGL_EXTENSIONS), need)) return noEglDevice(std::string("the driver has no ") + need);
  if (major == 1 && minor < 5) return noEglDevice("EGL 1.5 is needed, the driver has 1." + std::to_string(minor));
  return {};
}

Status EglDevice::Impl::createContext() {
  if (!eglBindAPI(EGL_OPENGL_API)) return failed("eglBindAPI");
  const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,           4,       EGL_CONTEXT_MINOR_VERSION, 5, EGL_CONTEXT_OPENGL_PROFILE_MASK,
                               EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
  if (context == EGL_NO_CONTEXT) return failed("eglCreateContext (OpenGL 4.5 core)");
  return gl.load();
}

Status EglDevice::Impl::describe() {
  const Current current(*this);
  GOBO_TRY(current.status());
  const auto text = [&](GLenum what) {
    const auto* s = reinterpret_cast<const char*>(gl.GetString(what));
    return std::string(s ? s : "unknown");
  };
  name = text(GL_RENDERER);
  numericClass = "glsl-f32/" + keyWord(name) + "-" + keyWord(text(GL_VERSION));
  GLint64 bytes = 0;
  GOBO_GL(gl, GetInteger64v, GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &bytes);
  maxBufferBytes = uint64_t(std::max<GLint64>(bytes, 0));
  for (int i = 0; i < 3; ++i) GOBO_GL(gl, GetIntegeri_v, GL_MAX_COMPUTE_WORK_GROUP_COUNT, GLuint(i), &maxGroups[i]);
  GLint bits = 0;
  GOBO_GL(gl, GetQueryiv, GL_TIMESTAMP, GL_QUERY_COUNTER_BITS, &bits);
  timestamps = bits > 0;
  GOBO_GL(gl, CreateBuffers, 1, &pushBuffer);
  GOBO_GL(gl, NamedBufferStorage, pushBuffer, kMaxPushBytes, nullptr, GL_DYNAMIC_STORAGE_BIT);
  return {};
}

EglDevice::Impl::~Impl() {
  if (context != EGL_NO_CONTEXT) eglDestroyContext(display, context);  // with its programs and buffers
}

EglDevice::Impl::Current::Current(Impl& impl) : lock_(impl.mutex), display_(impl.display) {
  // The API that eglMakeCurrent acts on is a property of the thread.
  if (!eglBindAPI(EGL_OPENGL_API)) status_ = eglStatus(eglGetError(), "eglBindAPI");
  else if (!eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, impl.context)) status_ = eglStatus(eglGetError(), "eglMakeCurrent");
}
EglDevice::Impl::Current::~Current() { eglMakeCurrent(display_, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT); }

EglDevice::EglDevice() : impl_(std::make_unique<Impl>()) {}
EglDevice::~EglDevice() = default;

Result<std::shared_ptr<EglDevice>> EglDevice::create(const Options& options) {
  std::shared_ptr<EglDevice> made(new EglDevice());
  GOBO_TRY(made->impl_->openDisplay(options.device));
  GOBO_TRY(made->impl_->createContext());
  GOBO_TRY(made->impl_->describe());
  return made;
}

Result<std::shared_ptr<EglDevice>> EglDevice::shared() {
  // Never destroyed: drivers' own static objects may be gone before ours at exit.
  static const auto* device = new Result<std::shared_ptr<EglDevice>>(create(Options::fromEnvironment()));
  return *device;
}

const std::string& EglDevice::name() const { return impl_->name; }
const std::string& EglDevice::numericClass() const { return impl_->numericClass; }
uint64_t EglDevice::maxBufferBytes() const { return impl_->maxBufferBytes; }

}  // namespace device
}  // namespace gobo
