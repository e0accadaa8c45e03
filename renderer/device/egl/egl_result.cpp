// SPDX-License-Identifier: Apache-2.0
#include "device/egl/egl_result.h"

#include <EGL/egl.h>
#include <GL/glcorearb.h>

#include <cstdio>

namespace gobo {
inline namespace device {
namespace {

std::string hexadecimal(const char* what, unsigned value) {
  char text[32];
  std::snprintf(text, sizeof text, "%s 0x%04x", what, value);
  return text;
}

}  // namespace

std::string eglErrorName(int error) {
  switch (error) {
#define NAME(e) \
  case e: return #e
    NAME(EGL_SUCCESS);
    NAME(EGL_NOT_INITIALIZED);
    NAME(EGL_BAD_ACCESS);
    NAME(EGL_BAD_ALLOC);
    NAME(EGL_BAD_ATTRIBUTE);
    NAME(EGL_BAD_CONFIG);
    NAME(EGL_BAD_CONTEXT);
    NAME(EGL_BAD_CURRENT_SURFACE);
    NAME(EGL_BAD_DISPLAY);
    NAME(EGL_BAD_MATCH);
    NAME(EGL_BAD_NATIVE_PIXMAP);
    NAME(EGL_BAD_NATIVE_WINDOW);
    NAME(EGL_BAD_PARAMETER);
    NAME(EGL_BAD_SURFACE);
    NAME(EGL_CONTEXT_LOST);
    default: return hexadecimal("EGL error", unsigned(error));
  }
}

Status eglStatus(int error, const char* call) {
  Code code = Code::Internal;
  switch (error) {
    case EGL_SUCCESS: return {};
    case EGL_BAD_ALLOC: code = Code::ResourceExhausted; break;
    case EGL_NOT_INITIALIZED:
    case EGL_CONTEXT_LOST: code = Code::Unavailable; break;
    default: break;
  }
  return {code, std::string(call) + ": " + eglErrorName(error)};
}

std::string glErrorName(unsigned error) {
  switch (error) {
    NAME(GL_NO_ERROR);
    NAME(GL_INVALID_ENUM);
    NAME(GL_INVALID_VALUE);
    NAME(GL_INVALID_OPERATION);
    NAME(GL_INVALID_FRAMEBUFFER_OPERATION);
    NAME(GL_OUT_OF_MEMORY);
    NAME(GL_STACK_OVERFLOW);
    NAME(GL_STACK_UNDERFLOW);
    NAME(GL_CONTEXT_LOST);
#undef NAME
    default: return hexadecimal("GL error", error);
  }
}

Status glStatus(unsigned error, const char* call) {
  Code code = Code::Internal;
  switch (error) {
    case GL_NO_ERROR: return {};
    case GL_OUT_OF_MEMORY: code = Code::ResourceExhausted; break;
    case GL_CONTEXT_LOST: code = Code::Unavailable; break;
    default: break;
  }
  return {code, std::string(call) + ": " + glErrorName(error)};
}

}  // namespace device
}  // namespace gobo
