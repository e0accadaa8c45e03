// SPDX-License-Identifier: Apache-2.0
// Buffers, transfers, programs, dispatches.
#include <algorithm>

#include "base/check.h"
#include "device/egl/egl_impl.h"

namespace gobo {
inline namespace device {

EglBuffer::EglBuffer(std::shared_ptr<const EglDevice> device, unsigned buffer, size_t bytes)
    : ComputeBuffer(device.get(), bytes), device_(std::move(device)), buffer_(buffer) {}
EglBuffer::~EglBuffer() {
  const EglDevice::Impl::Current current(*device_->impl_);
  if (current.status().ok()) device_->impl_->gl.DeleteBuffers(1, &buffer_);  // otherwise it goes with the context
}

Result<ComputeBufferPtr> EglDevice::buffer(size_t bytes) {
  if (bytes > maxBufferBytes())
    return Status(Code::ResourceExhausted,
                  "an OpenGL buffer of " + std::to_string(bytes) + " bytes is over the limit of " + name() + ", " + std::to_string(maxBufferBytes()));
  bytes = std::max<size_t>(bytes, 1);
  GLuint made = 0;
  {
    const Impl::Current current(*impl_);
    GOBO_TRY(current.status());
    GOBO_GL(impl_->gl, CreateBuffers, 1, &made);
    impl_->gl.NamedBufferStorage(made, GLsizeiptr(bytes), nullptr, GL_DYNAMIC_STORAGE_BIT);
    if (Status status = impl_->gl.check("glNamedBufferStorage"); !status.ok()) {
      impl_->gl.DeleteBuffers(1, &made);
      return status;
    }
  }
  return ComputeBufferPtr(new EglBuffer(shared_from_this(), made, bytes));
}

Status EglDevice::upload(ComputeBuffer& to, const void* data, size_t bytes) {
  GOBO_CHECK(to.of(*this));
  GOBO_CHECK_LE(bytes, to.bytes());
  if (bytes == 0) return {};
  const Impl::Current current(*impl_);
  GOBO_TRY(current.status());
  GOBO_GL(impl_->gl, NamedBufferSubData, static_cast<const EglBuffer&>(to).buffer_, 0, GLsizeiptr(bytes), data);
  return {};
}

Status EglDevice::download(const ComputeBuffer& from, void* data, size_t bytes) {
  GOBO_CHECK(from.of(*this));
  GOBO_CHECK_LE(bytes, from.bytes());
  if (bytes == 0) return {};
  const Impl::Current current(*impl_);
  GOBO_TRY(current.status());
  GOBO_GL(impl_->gl, GetNamedBufferSubData, static_cast<const EglBuffer&>(from).buffer_, 0, GLsizeiptr(bytes), data);
  return {};
}

Result<GLuint> EglDevice::Impl::program(const ComputeKernel& kernel) {
  GOBO_CHECK(kernel.glsl && kernel.buffers >= 1 && kernel.buffers <= kMaxKernelBuffers && kernel.pushBytes <= kMaxPushBytes);
  if (const auto found = programs.find(kernel.glsl); found != programs.end()) return found->second;
  char log[2048] = "";
  GLint good = 0;
  const auto wrong = [&](const char* call) { return internalError(std::string("kernel ") + kernel.name + ": " + call + ": " + log); };
  const GLuint shader = gl.CreateShader(GL_COMPUTE_SHADER);
  GOBO_TRY(gl.check("glCreateShader"));
  gl.ShaderSource(shader, 1, &kernel.glsl, nullptr);
  gl.CompileShader(shader);
  gl.GetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (!good) {
    gl.GetShaderInfoLog(shader, sizeof log, nullptr, log);
    gl.DeleteShader(shader);
    return wrong("glCompileShader");
  }
  const GLuint made = gl.CreateProgram();
  gl.AttachShader(made, shader);
  gl.LinkProgram(made);
  gl.DeleteShader(shader);  // goes with the program
  gl.GetProgramiv(made, GL_LINK_STATUS, &good);
  Status status = gl.check("glLinkProgram");
  if (status.ok() && !good) {
    gl.GetProgramInfoLog(made, sizeof log, nullptr, log);
    status = wrong("glLinkProgram");
  }
  if (!status.ok()) {
    gl.DeleteProgram(made);
    return status;
  }
  programs[kernel.glsl] = made;
  return made;
}

namespace {

/// Two timestamps a dispatch; none if `count` is 0.
struct Timestamps {
  Timestamps(const GlFunctions& functions, size_t count) : gl(functions), queries(2 * count) {
    if (count) gl.CreateQueries(GL_TIMESTAMP, GLsizei(queries.size()), queries.data());
  }
  ~Timestamps() {
    if (!queries.empty()) gl.DeleteQueries(GLsizei(queries.size()), queries.data());
  }
  void mark(size_t i) const {
    if (!queries.empty()) gl.QueryCounter(queries[i], GL_TIMESTAMP);
  }
  double seconds(size_t dispatch) const {
    GLuint64 begin = 0, end = 0;
    gl.GetQueryObjectui64v(queries[2 * dispatch], GL_QUERY_RESULT, &begin);
    gl.GetQueryObjectui64v(queries[2 * dispatch + 1], GL_QUERY_RESULT, &end);
    return end > begin ? double(end - begin) * 1e-9 : 0.0;
  }
  const GlFunctions& gl;
  std::vector<GLuint> queries;
};

}  // namespace

Status EglDevice::run(std::span<const ComputeDispatch> dispatches, std::vector<double>* seconds) {
  if (seconds) seconds->assign(dispatches.size(), 0.0);
  if (dispatches.empty()) return {};
  const Impl::Current current(*impl_);
  GOBO_TRY(current.status());
  Impl& d = *impl_;
  // Everything that can fail for its own reasons comes before the first dispatch.
  for (const ComputeDispatch& dispatch : dispatches) {
    GOBO_CHECK_EQ(int(dispatch.buffers.size()), dispatch.kernel->buffers);
    GOBO_CHECK_EQ(int(dispatch.push.size()), dispatch.kernel->pushBytes);
    for (int i = 0; i < 3; ++i) GOBO_CHECK(dispatch.groups[i] >= 1 && dispatch.groups[i] <= uint32_t(d.maxGroups[i]));
    for (const ComputeBufferPtr& buffer : dispatch.buffers) GOBO_CHECK(buffer->of(*this));
    GOBO_TRY(d.program(*dispatch.kernel).status());
  }
  const bool timed = seconds && d.timestamps;
  const Timestamps stamps(d.gl, timed ? dispatches.size() : 0);
  GOBO_GL(d.gl, BindBufferBase, GL_UNIFORM_BUFFER, 0, d.pushBuffer);
  for (size_t k = 0; k < dispatches.size(); ++k) {
    const ComputeDispatch& dispatch = dispatches[k];
    GOBO_ASSIGN(const GLuint program, d.program(*dispatch.kernel));
    GOBO_GL(d.gl, UseProgram, program);
    for (size_t i = 0; i < dispatch.buffers.size(); ++i)
      GOBO_GL(d.gl, BindBufferBase, GL_SHADER_STORAGE_BUFFER, GLuint(i), static_cast<const EglBuffer&>(*dispatch.buffers[i]).buffer_);
    if (!dispatch.push.empty()) GOBO_GL(d.gl, NamedBufferSubData, d.pushBuffer, 0, GLsizeiptr(dispatch.push.size()), dispatch.push.data());
    stamps.mark(2 * k);
    GOBO_GL(d.gl, DispatchCompute, dispatch.groups[0], dispatch.groups[1], dispatch.groups[2]);
    GOBO_GL(d.gl, MemoryBarrier, GL_SHADER_STORAGE_BARRIER_BIT | GL_BUFFER_UPDATE_BARRIER_BIT);
    stamps.mark(2 * k + 1);
  }
  GOBO_GL(d.gl, Finish);
  for (size_t k = 0; timed && k < dispatches.size(); ++k) (*seconds)[k] = stamps.seconds(k);
  return d.gl.check("glGetQueryObjectui64v");
}

}  // namespace device
}  // namespace gobo
