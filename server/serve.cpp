// SPDX-License-Identifier: Apache-2.0
#include "server/serve.h"

#include <algorithm>
#include <cmath>
#include <thread>

#include <google/protobuf/any.pb.h>
#include <google/protobuf/duration.pb.h>
#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include "server/random_hex.h"

namespace gobo {
inline namespace server {
namespace {

namespace pb = google::protobuf;

std::string newId() {
  if (const auto id = randomHex(8)) return *id;
  return strf("%016llx", (unsigned long long)std::chrono::steady_clock::now().time_since_epoch().count());
}

std::string requestId(const grpc::ServerContext& context) {
  const auto [first, last] = context.client_metadata().equal_range(kRequestIdKey);
  if (first == last || std::next(first) != last) return newId();
  const std::string sent(first->second.data(), first->second.size());
  const char* letters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._:-";
  return sent.empty() || sent.size() > 64 || sent.find_first_not_of(letters) != std::string::npos ? newId() : sent;
}

// A message of up to one number and length-delimited fields, by hand: google/rpc/*.proto are in no Debian package.
struct Wire {
  std::string bytes;
  void number(int field, uint64_t value) {
    pb::io::StringOutputStream stream(&bytes);
    pb::io::CodedOutputStream out(&stream);
    out.WriteTag(uint32_t(field) << 3);
    out.WriteVarint64(value);
  }
  void text(int field, const std::string& value) {
    pb::io::StringOutputStream stream(&bytes);
    pb::io::CodedOutputStream out(&stream);
    out.WriteTag(uint32_t(field) << 3 | 2);
    out.WriteVarint32(uint32_t(value.size()));
    out.WriteString(value);
  }
};

std::string any(const char* type, const std::string& value) {
  pb::Any any;
  any.set_type_url(std::string("type.googleapis.com/google.rpc.") + type);
  any.set_value(value);
  return any.SerializeAsString();
}

// google.rpc.Status{code = 1, message = 2, details = 3} with RequestInfo{request_id = 1}, RetryInfo{retry_delay = 1}.
std::string details(const grpc::Status& status, const std::string& id, double retryMs) {
  Wire out, info;
  out.number(1, uint64_t(status.error_code()));
  out.text(2, status.error_message());
  info.text(1, id);
  out.text(3, any("RequestInfo", info.bytes));
  if (retryMs > 0) {
    pb::Duration delay;
    delay.set_seconds(int64_t(retryMs / 1e3));
    delay.set_nanos(int32_t(std::fmod(retryMs, 1e3) * 1e6));
    Wire retry;
    retry.text(1, delay.SerializeAsString());
    out.text(3, any("RetryInfo", retry.bytes));
  }
  return out.bytes;
}

}  // namespace

Rpc::Rpc(ServerCore& core, grpc::ServerContext& context, const char* method)
    : core_(core), context_(context), method_(method), id_(requestId(context)), log_(id_) {
  context_.AddTrailingMetadata(kRequestIdKey, id_);
}

grpc::Status Rpc::admit() {
  const grpc::Status known = core_.tokens.identify(context_, who_);
  if (!known.ok()) {
    core_.metrics.add("gobo_refused_total", {{"reason", "token"}});
    who_.name = clientName(context_, "");
    return known;
  }
  const double wait = who_.takeRequest(JobRunner::now());
  if (wait > 0)
    return refuseBusy("rate", strf("requests per second: at most %g (tokens.requests_per_s of \"%s\")", who_.token->requestsPerSecond, who_.name.c_str()),
                      wait * 1e3);
  return grpc::Status::OK;
}

grpc::Status Rpc::finish(grpc::Status status) {
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count();
  const Code code = Code(int(status.error_code()));
  core_.metrics.add("gobo_requests_total", {{"method", method_}, {"code", codeName(code)}});
  core_.metrics.observe("gobo_request_seconds", {{"method", method_}}, seconds);
  const bool broken = code == Code::Internal || code == Code::Unknown || code == Code::DataLoss;
  const LogLevel level = broken ? LogLevel::Error : code == Code::Unauthenticated ? LogLevel::Warn : quiet_ && status.ok() ? LogLevel::Debug : LogLevel::Info;
  LogFields fields{{"request", id_}, {"client", who_.name}};
  fields.insert(fields.end(), fields_.begin(), fields_.end());
  fields.emplace_back("ms", strf("%.1f", seconds * 1e3));
  fields.emplace_back("status", codeName(code));
  if (!status.ok()) fields.emplace_back("error", status.error_message());
  logEvent(level, method_, fields);
  if (status.ok()) return status;
  return {status.error_code(), status.error_message(), details(status, id_, retryMs_)};
}

void Rpc::pause() {
  if (retryMs_ <= 0 || core_.draining()) return;
  const double seconds = core_.impatient.begin(who_.name, JobRunner::now(), retryMs_ * 1e-3);
  if (seconds <= 0) return;
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < until && !context_.IsCancelled() && !core_.draining()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  core_.impatient.end(who_.name);
}

grpc::Status Rpc::refuse(const char* reason, const Status& status) {
  core_.metrics.add("gobo_refused_total", {{"reason", reason}});
  return toGrpc(status);
}

grpc::Status Rpc::refuseFull(const char* reason, const std::string& what, const SharedLimit& limit, const std::string& option, double retryMs) {
  return refuseBusy(reason,
                    strf("%llu %s, %llu of them of \"%s\": at most %llu, half of it for one client%s", (unsigned long long)limit.used(), what.c_str(),
                         (unsigned long long)limit.usedBy(who_.name), who_.name.c_str(), (unsigned long long)limit.limit(),
                         option.empty() ? "" : (" (" + option + ")").c_str()),
                    retryMs);
}

grpc::Status Rpc::refuseBusy(const char* reason, const std::string& what, double retryMs) {
  core_.metrics.add("gobo_refused_total", {{"reason", reason}});
  retryMs_ = retryMs;
  return busy(context_, what, retryMs);
}

grpc::Status Rpc::refuseDraining() {
  core_.metrics.add("gobo_refused_total", {{"reason", "draining"}});
  retryMs_ = kDrainRetryMs;
  context_.AddTrailingMetadata(kRetryAfterKey, strf("%.0f", kDrainRetryMs));
  return {grpc::StatusCode::UNAVAILABLE, strf("the server is shutting down; retry after %.0f ms", kDrainRetryMs)};
}

grpc::Status Rpc::needAdmin(const char* what) {
  if (who_.admin) return grpc::Status::OK;
  return refuse("admin", {Code::PermissionDenied, std::string(what) + " needs a token with admin = true; \"" + who_.name + "\" has not"});
}

grpc::Status Rpc::needWorker(const char* what) {
  if (who_.worker) return grpc::Status::OK;
  return refuse("worker", {Code::PermissionDenied, std::string(what) + " needs a token with worker = true or admin = true; \"" + who_.name + "\" has neither"});
}

Result<std::string> Rpc::client(const std::string& named) const {
  if (who_.token) {
    if (named.empty() || named == who_.name || !core_.tokens.isName(named)) return who_.name;
  } else if (!core_.tokens.isName(named)) {
    return clientName(context_, named);
  }
  return Status(Code::PermissionDenied, "client = \"" + escaped(named.substr(0, 80)) + "\": is the name of another's token", "request.scheduling.client");
}

}  // namespace server
}  // namespace gobo
