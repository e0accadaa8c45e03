// SPDX-License-Identifier: Apache-2.0
// EGL's and OpenGL's error codes as Status; the text reads "<call>: <code>". Private to device/egl.
#pragma once

#include "base/status.h"

namespace gobo {
inline namespace device {

/// "EGL_BAD_MATCH"; "EGL error 0x1234" for one that this file does not know.
std::string eglErrorName(int error);
/// Ok for EGL_SUCCESS.
Status eglStatus(int error, const char* call);

/// "GL_OUT_OF_MEMORY"; "GL error 0x1234" for one that this file does not know.
std::string glErrorName(unsigned error);
/// Ok for GL_NO_ERROR.
Status glStatus(unsigned error, const char* call);

}  // namespace device
}  // namespace gobo
