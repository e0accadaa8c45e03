// SPDX-License-Identifier: Apache-2.0
#include "server/http_endpoint.h"

#include <thread>

#include <httplib.h>

#include "server/core.h"
#include "server/server_metrics.h"

namespace gobo {

struct HttpEndpoint::Impl {
  httplib::Server server;
  std::thread thread;
};

HttpEndpoint::HttpEndpoint() : impl_(std::make_unique<Impl>()) {}

HttpEndpoint::~HttpEndpoint() {
  impl_->server.stop();
  if (impl_->thread.joinable()) impl_->thread.join();
}

Result<std::unique_ptr<HttpEndpoint>> HttpEndpoint::start(ServerCore& core, const std::string& text) {
  GOBO_ASSIGN(const Address address, parseAddress(text));
  std::unique_ptr<HttpEndpoint> self(new HttpEndpoint());
  httplib::Server& s = self->impl_->server;
  s.new_task_queue = [] { return new httplib::ThreadPool(2); };
  s.set_keep_alive_max_count(100);
  s.set_keep_alive_timeout(1);       // a scraper that keeps its connection must not hold one of the two threads for long
  s.set_read_timeout(2, 0);
  s.set_write_timeout(5, 0);
  s.set_payload_max_length(0);
  s.set_tcp_nodelay(true);
  // httplib's default is SO_REUSEPORT: a second daemon on the port would share it instead of failing.
  s.set_socket_options([](socket_t fd) {
    const int yes = 1;
    ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  s.Get("/metrics", [&core](const httplib::Request&, httplib::Response& r) {
    r.set_content(core.metrics.text(), "text/plain; version=0.0.4; charset=utf-8");
  });
  s.Get("/health", [&core](const httplib::Request&, httplib::Response& r) {
    const HealthReport report = healthReport(core);
    r.status = report.ready ? 200 : 503;
    r.set_content(report.json, "application/json");
  });
  s.Get("/ready", [&core](const httplib::Request&, httplib::Response& r) {
    const bool ready = !core.draining();
    r.status = ready ? 200 : 503;
    r.set_content(ready ? "ready\n" : "draining\n", "text/plain");
  });
  const int wanted = std::atoi(address.port.c_str());
  int port = wanted;
  if (wanted == 0) port = s.bind_to_any_port(address.host.c_str());
  else if (!s.bind_to_port(address.host.c_str(), wanted)) port = -1;
  if (port <= 0) return Status(Code::Unavailable, "http.listen: cannot listen on " + text + ": in use or not permitted");
  self->address_ = text.substr(0, text.rfind(':') + 1) + std::to_string(port);
  self->impl_->thread = std::thread([impl = self->impl_.get()] { impl->server.listen_after_bind(); });
  // stop() does nothing before the loop runs.
  while (!s.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return self;
}

}  // namespace gobo
