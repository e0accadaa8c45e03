// SPDX-License-Identifier: Apache-2.0
// The EGL and OpenGL objects of an EglDevice. Private to device/egl. Everything OpenGL is used within a Current.
#pragma once

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <GL/glcorearb.h>

#include <map>
#include <mutex>

#include "device/egl/egl_device.h"
#include "device/egl/egl_result.h"

namespace gobo {
inline namespace device {

// The functions of OpenGL 4.5 in use; eglGetProcAddress gives them.
// clang-format off
#define GOBO_GL_FUNCTIONS(X)                                                                                                        \
  X(GetError, GETERROR) X(GetString, GETSTRING) X(GetIntegerv, GETINTEGERV) X(GetInteger64v, GETINTEGER64V)                         \
  X(GetIntegeri_v, GETINTEGERI_V) X(Finish, FINISH)                                                                                 \
  X(CreateShader, CREATESHADER) X(ShaderSource, SHADERSOURCE) X(CompileShader, COMPILESHADER) X(GetShaderiv, GETSHADERIV)           \
  X(GetShaderInfoLog, GETSHADERINFOLOG) X(DeleteShader, DELETESHADER) X(CreateProgram, CREATEPROGRAM) X(AttachShader, ATTACHSHADER) \
  X(LinkProgram, LINKPROGRAM) X(GetProgramiv, GETPROGRAMIV) X(GetProgramInfoLog, GETPROGRAMINFOLOG) X(DeleteProgram, DELETEPROGRAM) \
  X(UseProgram, USEPROGRAM) X(CreateBuffers, CREATEBUFFERS) X(NamedBufferStorage, NAMEDBUFFERSTORAGE)                               \
  X(NamedBufferSubData, NAMEDBUFFERSUBDATA) X(GetNamedBufferSubData, GETNAMEDBUFFERSUBDATA) X(DeleteBuffers, DELETEBUFFERS)         \
  X(BindBufferBase, BINDBUFFERBASE) X(DispatchCompute, DISPATCHCOMPUTE) X(MemoryBarrier, MEMORYBARRIER)                             \
  X(CreateQueries, CREATEQUERIES) X(DeleteQueries, DELETEQUERIES) X(QueryCounter, QUERYCOUNTER) X(GetQueryiv, GETQUERYIV)           \
  X(GetQueryObjectui64v, GETQUERYOBJECTUI64V)
// clang-format on

struct GlFunctions {
#define X(name, NAME) PFNGL##NAME##PROC name = nullptr;
  GOBO_GL_FUNCTIONS(X)
#undef X
  /// Unavailable naming the first function that the driver lacks.
  Status load();
  /// What has gone wrong since the last check, as an error of `call`.
  Status check(const char* call) const;
};

struct EglDevice::Impl {
  EGLDisplay display = EGL_NO_DISPLAY;
  EGLContext context = EGL_NO_CONTEXT;
  GlFunctions gl;
  std::string name, numericClass;
  uint64_t maxBufferBytes = 0;
  int maxGroups[3] = {0, 0, 0};
  bool timestamps = false;

  std::mutex mutex;
  GLuint pushBuffer = 0;
  std::map<const char*, GLuint> programs;  // by ComputeKernel::glsl

  ~Impl();
  Status openDisplay(const std::string& device);
  Status createContext();
  Status describe();
  Result<GLuint> program(const ComputeKernel& kernel);

  /// Holds the mutex with the context current on this thread.
  class Current {
   public:
    explicit Current(Impl& impl);
    ~Current();
    const Status& status() const { return status_; }

   private:
    std::lock_guard<std::mutex> lock_;
    EGLDisplay display_;
    Status status_;
  };
};

}  // namespace device
}  // namespace gobo

/// GOBO_GL(gl, DispatchCompute, x, y, z): calls it, and leaves the enclosing function with its error.
#define GOBO_GL(gl, function, ...)        \
  do {                                    \
    (gl).function(__VA_ARGS__);           \
    GOBO_TRY((gl).check("gl" #function)); \
  } while (0)
