// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <microhttpd.h>
#include <sys/socket.h>

#include <chrono>
#include <cstring>
#include <list>

#include "server/bound_socket.h"
#include "server/core.h"
#include "server/server_metrics.h"

namespace gobo {
inline namespace server {

using Clock = std::chrono::steady_clock;

namespace {
constexpr double kReadySeconds = 0.5;  // an accept may take that long
constexpr double kReadyKept = 0.25;    // and its answer counts for that long: asking often costs nothing
double since(Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); }
}  // namespace

// Callbacks come on libmicrohttpd's one thread only.
struct HttpEndpoint::Impl {
  struct Open {
    int fd;
    Clock::time_point since;
  };
  ServerCore& core;
  MHD_Daemon* daemon = nullptr;
  std::list<Open> open;  // oldest first
  bool reached = true;
  Clock::time_point asked{};

  explicit Impl(ServerCore& c) : core(c) {}

  bool reachable() {
    if (!core.reachable) return true;
    if (since(asked) > kReadyKept) {
      reached = core.reachable(kReadySeconds);
      asked = Clock::now();
    }
    return reached;
  }

  static MHD_Result reply(MHD_Connection* connection, unsigned code, const std::string& body, const char* type) {
    MHD_Response* response = MHD_create_response_from_buffer(body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
    if (!response) return MHD_NO;
    MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, type);
    if (code == MHD_HTTP_METHOD_NOT_ALLOWED) MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
    const MHD_Result result = MHD_queue_response(connection, code, response);
    MHD_destroy_response(response);
    return result;
  }

  static MHD_Result answer(void* self, MHD_Connection* connection, const char* url, const char* method, const char*, const char*, size_t* bodyBytes, void**) {
    Impl& impl = *static_cast<Impl*>(self);
    if (*bodyBytes > 0) return MHD_NO;  // bodies are not read: the connection closes
    if (std::strcmp(method, MHD_HTTP_METHOD_GET) != 0 && std::strcmp(method, MHD_HTTP_METHOD_HEAD) != 0)
      return reply(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET\n", "text/plain");
    if (std::strcmp(url, "/metrics") == 0) return reply(connection, MHD_HTTP_OK, impl.core.metrics.text(), "text/plain; version=0.0.4; charset=utf-8");
    if (std::strcmp(url, "/health") == 0) {
      const HealthReport report = healthReport(impl.core);
      return reply(connection, report.ready ? MHD_HTTP_OK : MHD_HTTP_SERVICE_UNAVAILABLE, report.json, "application/json");
    }
    if (std::strcmp(url, "/ready") == 0) {
      const bool draining = impl.core.draining(), ready = !draining && impl.reachable();
      return reply(connection, ready ? MHD_HTTP_OK : MHD_HTTP_SERVICE_UNAVAILABLE,
                   ready      ? "ready\n"
                   : draining ? "draining\n"
                              : "connections are not accepted\n",
                   "text/plain");
    }
    return reply(connection, MHD_HTTP_NOT_FOUND, "has /metrics, /health and /ready\n", "text/plain");
  }

  static void connection(void* self, MHD_Connection* connection, void**, MHD_ConnectionNotificationCode what) {
    Impl& impl = *static_cast<Impl*>(self);
    const MHD_ConnectionInfo* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    if (!info) return;
    if (what == MHD_CONNECTION_NOTIFY_CLOSED) {
      impl.open.remove_if([&](const Open& o) { return o.fd == info->connect_fd; });
      return;
    }
    impl.open.push_back({info->connect_fd, Clock::now()});
    // Time-outs count silence; a client that drips is ended by its age once there are many.
    if (impl.open.size() <= kConnections / 2) return;
    for (const Open& o : impl.open)
      if (since(o.since) > kOldest) ::shutdown(o.fd, SHUT_RDWR);
  }
};

HttpEndpoint::HttpEndpoint() = default;

HttpEndpoint::~HttpEndpoint() {
  if (impl_ && impl_->daemon) MHD_stop_daemon(impl_->daemon);
}

Result<std::unique_ptr<HttpEndpoint>> HttpEndpoint::start(ServerCore& core, const std::string& text) {
  auto bound = bindTcp(text);
  if (!bound.ok()) return Status(bound.status().code(), "http.listen: " + bound.status().message());
  std::unique_ptr<HttpEndpoint> self(new HttpEndpoint());
  self->impl_ = std::make_unique<Impl>(core);
  self->address_ = bound->served;
  Impl* impl = self->impl_.get();
  // A name with several addresses is served on the first.
  impl->daemon = MHD_start_daemon(MHD_USE_EPOLL_INTERNAL_THREAD, 0, nullptr, nullptr, &Impl::answer, impl, MHD_OPTION_LISTEN_SOCKET, bound->sockets[0].get(),
                                  MHD_OPTION_CONNECTION_LIMIT, kConnections, MHD_OPTION_CONNECTION_TIMEOUT, unsigned(kOldest),
                                  MHD_OPTION_CONNECTION_MEMORY_LIMIT, size_t(16384), MHD_OPTION_NOTIFY_CONNECTION, &Impl::connection, impl, MHD_OPTION_END);
  if (!impl->daemon) return Status(Code::Unavailable, "http.listen: cannot start the HTTP listener on " + text);
  bound->sockets[0].release();  // the daemon's now
  return self;
}

}  // namespace server
}  // namespace gobo
