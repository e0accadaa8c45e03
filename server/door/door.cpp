// SPDX-License-Identifier: Apache-2.0
#include "server/door/door.h"

#include <fcntl.h>
#include <microhttpd.h>
#include <openssl/crypto.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <initializer_list>
#include <list>
#include <optional>
#include <string_view>
#include <thread>

#include "base/closest.h"
#include "base/descriptor.h"
#include "gobo/v1/farm.grpc.pb.h"
#include "gobo/v1/jobs.grpc.pb.h"
#include "request/request.h"
#include "server/bound_socket.h"
#include "server/door/gltf_render.h"
#include "server/door/schema.h"
#include "server/door/upstream.h"
#include "server/door/viewer_files.h"
#include "server/rpc.h"
#include "server/shared_limit.h"

namespace gobo {
inline namespace door {

namespace {

constexpr unsigned kSilentSeconds = 30;  // of a client that neither sends nor takes
constexpr size_t kConnectionMemory = 32768;
constexpr size_t kBlock = 256 << 10;          // of a stream, at once
constexpr uint64_t kBodies = 128ull << 20;    // of messages that arrive or are being read, of which one caller has half
constexpr uint64_t kSmallBody = 64ull << 10;  // never waits for others: kConnections of them are nothing

// What browsers are told of every answer: nothing but this door's own files may be loaded, and nobody may frame the page.
constexpr const char* kHeaders[][2] = {
    {"Content-Security-Policy", "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"},
    {"X-Content-Type-Options", "nosniff"},
    {"Referrer-Policy", "no-referrer"},
    {"Cache-Control", "no-cache"},
};

const char* mediaTypeOf(v1::Encoding::Format format) {
  switch (format) {
    case v1::Encoding::PNG: return "image/png";
    case v1::Encoding::JPEG: return "image/jpeg";
    case v1::Encoding::EXR: return "image/x-exr";
    default: return "application/octet-stream";
  }
}

/// "localhost:80", "[::1]:80", "host" -> the host.
std::string hostOf(const std::string& authority) {
  if (!authority.empty() && authority[0] == '[') return authority.substr(1, authority.find(']') - 1);
  return authority.substr(0, authority.rfind(':'));
}

/// What gRPC takes as a value of metadata: it ends the process that sends anything else.
bool isMetadata(std::string_view value) {
  return std::all_of(value.begin(), value.end(), [](char c) { return c >= 0x20 && c <= 0x7e; });
}

const char* headerOf(MHD_Connection* connection, const char* name) { return MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name); }

// One request of a connection, from its first line until it has been answered.
struct Exchange {
  std::string body;
  uint64_t room = 0;                         // for the body; what comes without any is read and dropped
  std::unique_ptr<SharedLimit::Hold> place;  // of a body that is not small
  bool grows = false;                        // its length is not known: `room` is for a small one
  bool tooLarge = false;
  grpc::Status refused;                   // why the body has no room
  long retryMs = 0;                       // of that
  std::unique_ptr<PutStream> put;         // of a body that is no message: it goes on as it comes
  std::unique_ptr<GltfForm> form;         // of a body that is a form
  std::atomic<int>* answering = nullptr;  // counts it from when the whole of it is here until its answer has gone
  void dropBody() {
    room = 0;
    body = std::string();
    place.reset();
  }
  ~Exchange() {
    if (answering) --*answering;
  }
};

/// A whole number of the request's query; nothing when it is not one.
std::optional<uint64_t> queryNumber(MHD_Connection* connection, const char* name) {
  const char* text = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, name);
  if (!text || !*text || std::strlen(text) > 18 || std::strspn(text, "0123456789") != std::strlen(text)) return std::nullopt;
  return std::strtoull(text, nullptr, 10);
}

/// A query with a name that `path` does not know, or with one twice, is an error: misspelt, it would be another picture, and nobody told.
grpc::Status checkQuery(MHD_Connection* connection, std::initializer_list<std::string_view> known) {
  struct Found {
    std::initializer_list<std::string_view> known;
    std::vector<std::string> names;
    std::string strange;
  } found{known, {}, {}};
  const auto look = [](void* self, MHD_ValueKind, const char* key, const char*) -> MHD_Result {
    Found& f = *static_cast<Found*>(self);
    const std::string name = key ? key : "";
    const bool twice = std::find(f.names.begin(), f.names.end(), name) != f.names.end();
    if (!twice && std::find(f.known.begin(), f.known.end(), name) != f.known.end()) {
      f.names.push_back(name);
      return MHD_YES;
    }
    f.strange = "the address's query: '" + escaped(name.substr(0, 80)) + "' " + (twice ? "stands in it twice" : "is not known here");
    if (!twice) f.strange += f.known.size() == 0 ? ", which takes none" : didYouMean(name, {f.known.begin(), f.known.end()});
    return MHD_NO;
  };
  MHD_get_connection_values(connection, MHD_GET_ARGUMENT_KIND, look, &found);
  return found.strange.empty() ? grpc::Status::OK : grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, found.strange);
}

const std::string kBlobsPath = "/v1/blobs/";
constexpr const char* kGltfPath = "/render";
constexpr std::chrono::milliseconds kLastAnswers{1000};  // less than main.cpp's grace

// A listener of the library, which knows one certificate all its life.
struct Serving {
  std::string cert, key;
  MHD_Daemon* daemon = nullptr;
  Descriptor retired;  // the socket that it listened on until another took over; its threads may look at it until they have ended
  ~Serving() {
    if (daemon) MHD_stop_daemon(daemon);
  }
  bool idle() const { return MHD_get_daemon_info(daemon, MHD_DAEMON_INFO_CURRENT_CONNECTIONS)->num_connections == 0; }
};

}  // namespace

struct Door::Impl {
  DoorOptions options;
  std::string host;  // that it was told to listen on
  std::unique_ptr<v1::Scenes::Stub> scenes;
  std::unique_ptr<v1::Render::Stub> render;
  std::unique_ptr<v1::Admin::Stub> admin;
  std::unique_ptr<v1::Blobs::Stub> blobs;
  std::unique_ptr<v1::Jobs::Stub> jobs;
  std::unique_ptr<v1::Farm::Stub> farm;
  std::unique_ptr<GltfRenderer> gltf;
  std::unique_ptr<SharedLimit> bodies;
  std::string schema;
  std::atomic<bool> stopping{false};
  std::atomic<int> answering{0};
  bool tls = false;
  Descriptor listening;         // each listener has a descriptor of its own of it
  std::list<Serving> servings;  // the last one takes connections, those before it finish what they have
  std::atomic<MHD_Daemon*> current{nullptr};

  /// Another listener takes what connects from now on.
  Status serve(const std::string& cert, const std::string& key) {
    Descriptor socket(::fcntl(listening.get(), F_DUPFD_CLOEXEC, 0));
    if (!socket) return Status(Code::Unavailable, "cannot start the HTTP listener on " + options.listen + ": " + std::strerror(errno));
    std::list<Serving> fresh(1);
    Serving& next = fresh.front();
    next.cert = cert;
    next.key = key;
    const MHD_OptionItem security[] = {{MHD_OPTION_HTTPS_MEM_CERT, 0, const_cast<char*>(next.cert.c_str())},
                                       {MHD_OPTION_HTTPS_MEM_KEY, 0, const_cast<char*>(next.key.c_str())},
                                       {MHD_OPTION_END, 0, nullptr}};
    const MHD_OptionItem none[] = {{MHD_OPTION_END, 0, nullptr}};
    // The socket is the daemon's, also of one that does not start. MHD_USE_ITC: for MHD_quiesce_daemon.
    next.daemon = MHD_start_daemon(MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_THREAD_PER_CONNECTION | MHD_USE_POLL | MHD_USE_ITC | (tls ? MHD_USE_TLS : 0), 0,
                                   nullptr, nullptr, &Impl::answer, this, MHD_OPTION_LISTEN_SOCKET, socket.release(), MHD_OPTION_CONNECTION_LIMIT, kConnections,
                                   MHD_OPTION_PER_IP_CONNECTION_LIMIT, kConnections / 2, MHD_OPTION_CONNECTION_TIMEOUT, kSilentSeconds,
                                   MHD_OPTION_CONNECTION_MEMORY_LIMIT, kConnectionMemory, MHD_OPTION_NOTIFY_COMPLETED, &Impl::completed, this, MHD_OPTION_ARRAY,
                                   tls ? security : none, MHD_OPTION_END);
    if (!next.daemon) return Status(Code::Unavailable, "cannot start the HTTP listener on " + options.listen + (tls ? " (certificate and key?)" : ""));
    current = next.daemon;
    if (!servings.empty()) servings.back().retired = Descriptor(MHD_quiesce_daemon(servings.back().daemon));
    servings.splice(servings.end(), fresh);
    return {};
  }

  // Answers.

  MHD_Result queue(MHD_Connection* connection, int code, MHD_Response* response, const char* type) {
    if (!response) return MHD_NO;
    MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, type);
    for (const auto& [name, value] : kHeaders) MHD_add_response_header(response, name, value);
    // Of a listener whose certificate is not served any more: its clients shall connect anew.
    if (MHD_get_connection_info(connection, MHD_CONNECTION_INFO_DAEMON)->daemon != current)
      MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
    const MHD_Result result = MHD_queue_response(connection, unsigned(code), response);
    MHD_destroy_response(response);
    return result;
  }
  MHD_Result reply(MHD_Connection* connection, int code, const std::string& body, const char* type) {
    MHD_Response* response = MHD_create_response_from_buffer(body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
    if (response && code == MHD_HTTP_UNAUTHORIZED) MHD_add_response_header(response, "WWW-Authenticate", "Bearer");
    if (response && code == MHD_HTTP_METHOD_NOT_ALLOWED) MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD, POST");
    return queue(connection, code, response, type);
  }
  MHD_Result fail(MHD_Connection* connection, const grpc::Status& status, long retryMs = 0) {
    const std::string body = "{\"error\":" + errorJson(status) + "}\n";
    MHD_Response* response = MHD_create_response_from_buffer(body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
    if (response && status.error_code() == grpc::StatusCode::UNAUTHENTICATED) MHD_add_response_header(response, "WWW-Authenticate", "Bearer");
    if (response && retryMs > 0) MHD_add_response_header(response, "Retry-After", std::to_string(wholeSeconds(retryMs)).c_str());
    return queue(connection, httpStatusOf(status.error_code()), response, "application/json");
  }
  MHD_Result fail(MHD_Connection* connection, grpc::StatusCode code, const std::string& message) { return fail(connection, {code, escaped(message)}); }
  MHD_Result json(MHD_Connection* connection, const google::protobuf::Message& message) {
    return reply(connection, MHD_HTTP_OK, messageToJson(message, false), "application/json");
  }

  // Who may ask.

  /// Ok, or why this caller gets nothing.
  grpc::Status admit(MHD_Connection* connection) const {
    const char* given = headerOf(connection, MHD_HTTP_HEADER_HOST);
    const std::string authority = given ? given : "", name = hostOf(authority);
    // Another name for this address would be a page of somebody else's that had its name point here.
    const bool ours = isLoopback(name) || name == host || std::find(options.hosts.begin(), options.hosts.end(), name) != options.hosts.end();
    if (!ours && options.secret.empty() && !tls)
      return {grpc::StatusCode::PERMISSION_DENIED, "Host: \"" + escaped(name.substr(0, 80)) + "\" is not a name of this address"};
    if (const char* origin = headerOf(connection, MHD_HTTP_HEADER_ORIGIN); origin && origin != "http://" + authority && origin != "https://" + authority)
      return {grpc::StatusCode::PERMISSION_DENIED, "Origin: \"" + escaped(std::string(origin).substr(0, 80)) + "\": pages of other origins get nothing here"};
    if (const char* sent = headerOf(connection, MHD_HTTP_HEADER_AUTHORIZATION); sent && !isMetadata(sent))
      return {grpc::StatusCode::UNAUTHENTICATED, "authorization: has characters that no token has"};
    return grpc::Status::OK;
  }
  grpc::Status checkSecret(MHD_Connection* connection) const {
    if (options.secret.empty()) return grpc::Status::OK;
    const char* sent = headerOf(connection, MHD_HTTP_HEADER_AUTHORIZATION);
    const std::string wanted = "Bearer " + options.secret, given = sent ? sent : "";
    if (given.size() == wanted.size() && CRYPTO_memcmp(given.data(), wanted.data(), wanted.size()) == 0) return grpc::Status::OK;
    return {grpc::StatusCode::UNAUTHENTICATED, given.empty() ? "authorization: none was sent; this server wants \"Authorization: Bearer TOKEN\""
                                                             : "authorization: the token is not known to this server"};
  }

  // Calls.

  std::function<bool()> goneOf(MHD_Connection* connection) const {
    const MHD_ConnectionInfo* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    return [this, fd = info ? int(info->connect_fd) : -1] {
      pollfd p{fd, POLLRDHUP, 0};
      return stopping.load() || (fd >= 0 && ::poll(&p, 1, 0) > 0 && (p.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0);
    };
  }
  /// What a caller's calls send with them; holds no part of its connection.
  std::function<void(grpc::ClientContext&)> dressing(MHD_Connection* connection) const {
    std::vector<std::pair<std::string, std::string>> words;
    const char* sent = headerOf(connection, MHD_HTTP_HEADER_AUTHORIZATION);
    if (options.secret.empty() && sent && isMetadata(sent)) words.emplace_back("authorization", sent);
    if (!options.secret.empty() && !options.authorization.empty()) words.emplace_back("authorization", options.authorization);
    if (const char* id = headerOf(connection, kRequestIdKey); id && isMetadata(id)) words.emplace_back(kRequestIdKey, id);
    if (options.tellsPeer) {
      const MHD_ConnectionInfo* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
      words.emplace_back(kPeerKey, info ? peerText(*info->client_addr) : "?");
    }
    return [words = std::move(words)](grpc::ClientContext& context) {
      for (const auto& [name, value] : words) context.AddMetadata(name, value);
    };
  }
  void dress(MHD_Connection* connection, grpc::ClientContext& context) const { dressing(connection)(context); }
  template <typename Reply, typename Start>
  MHD_Result unary(MHD_Connection* connection, Start&& start) {
    UpstreamCall call(goneOf(connection));
    dress(connection, call.context);
    Reply answer;
    const grpc::Status status = callOnce(call, start, answer);
    return status.ok() ? json(connection, answer) : fail(connection, status, retryMsOf(call.context));
  }

  static ssize_t readStream(void* stream, uint64_t, char* to, size_t most) {
    const ssize_t n = static_cast<RenderStream*>(stream)->read(to, most);
    return n > 0 ? n : n == 0 ? ssize_t(MHD_CONTENT_READER_END_OF_STREAM) : ssize_t(MHD_CONTENT_READER_END_WITH_ERROR);
  }
  static void dropStream(void* stream) { delete static_cast<RenderStream*>(stream); }

  MHD_Result stream(MHD_Connection* connection, bool frames, const RenderStream::Start& start) {
    auto call = std::make_unique<RenderStream>(goneOf(connection), frames);
    dress(connection, call->context());
    if (const grpc::Status status = call->begin(start); !status.ok()) return fail(connection, status);
    uint64_t size = MHD_SIZE_UNKNOWN;
    const char* type = "application/octet-stream";
    const v1::RenderReply head = call->head();
    if (!frames) {
      size = head.images(0).bytes();
      type = mediaTypeOf(head.images(0).format());
    }
    MHD_Response* response = MHD_create_response_from_callback(size, kBlock, &Impl::readStream, call.get(), &Impl::dropStream);
    if (!response) return MHD_NO;
    call.release();
    if (!frames) {
      MHD_add_response_header(response, "Gobo-Render-Id", head.render_id().c_str());
      MHD_add_response_header(response, "Gobo-Request-Hash", head.request_hash().c_str());
    }
    return queue(connection, MHD_HTTP_OK, response, type);
  }

  static grpc::Status onePicture(const v1::RenderRequest& request) {
    if (request.outputs_size() <= 1 || request.encoding().layers()) return grpc::Status::OK;
    return {grpc::StatusCode::INVALID_ARGUMENT,
            "request.outputs: a reply holds one picture: ask for one output, for an EXR with encoding.layers, or call " + std::string("/v1/render/stream")};
  }

  // Routes.

  MHD_Result get(MHD_Connection* connection, const std::string& path) {
    if (path == "/v1/schema") return reply(connection, MHD_HTTP_OK, schema, "application/json");
    if (path.rfind("/v1/", 0) != 0) {
      const std::string name = path == "/" ? "index.html" : path.substr(1);
      for (const ViewerFile& file : viewerFiles())
        if (file.name == name)
          return queue(connection, MHD_HTTP_OK,
                       MHD_create_response_from_buffer(file.bytes.size(), const_cast<char*>(file.bytes.data()), MHD_RESPMEM_PERSISTENT),
                       std::string(file.type).c_str());
      return fail(connection, grpc::StatusCode::NOT_FOUND, "nothing at " + path.substr(0, 200));
    }
    if (const grpc::Status known = checkSecret(connection); !known.ok()) return fail(connection, known);
    const std::string scenesPath = "/v1/scenes/";
    if (path == "/v1/status")
      return unary<v1::StatusReply>(connection, [&](auto* context, auto* queue) { return admin->AsyncGetStatus(context, v1::StatusRequest(), queue); });
    if (path == "/v1/jobs") return listJobs(connection);
    if (path == "/v1/workers")
      return unary<v1::WorkersReply>(connection, [&](auto* context, auto* queue) { return farm->AsyncWorkers(context, v1::WorkersRequest(), queue); });
    if (path == "/v1/scenes")
      return unary<v1::ListScenesReply>(connection, [&](auto* context, auto* queue) { return scenes->AsyncList(context, v1::ListScenesRequest(), queue); });
    if (path.rfind(scenesPath, 0) == 0) {
      v1::InspectSceneRequest request;
      request.set_scene(path.substr(scenesPath.size()));
      return unary<v1::SceneInfo>(connection, [&](auto* context, auto* queue) { return scenes->AsyncInspect(context, request, queue); });
    }
    if (path.rfind(kBlobsPath, 0) == 0) return received(connection, path.substr(kBlobsPath.size()));
    return fail(connection, grpc::StatusCode::NOT_FOUND, "nothing to GET at " + path.substr(0, 200) + " (docs/live.md)");
  }

  /// For a page that asks every second: what jobs render, the largest part by far, is left out.
  MHD_Result listJobs(MHD_Connection* connection) {
    UpstreamCall call(goneOf(connection));
    dress(connection, call.context);
    v1::ListJobsReply list;
    const grpc::Status status = callOnce(
        call, [&](auto* context, auto* queue) { return jobs->AsyncList(context, v1::ListJobsRequest(), queue); }, list);
    if (!status.ok()) return fail(connection, status, retryMsOf(call.context));
    for (v1::Job& job : *list.mutable_jobs()) job.mutable_spec()->clear_request();
    return json(connection, list);
  }

  /// Bytes that are there of the blob: all of them, or where to go on.
  MHD_Result received(MHD_Connection* connection, const std::string& sha256) {
    v1::MissingBlobsRequest request;
    request.add_blobs()->set_sha256(sha256);
    request.mutable_blobs(0)->set_bytes(queryNumber(connection, "bytes").value_or(0));
    UpstreamCall call(goneOf(connection));
    dress(connection, call.context);
    v1::MissingBlobsReply missing;
    const grpc::Status status = callOnce(
        call, [&](auto* context, auto* queue) { return blobs->AsyncMissing(context, request, queue); }, missing);
    if (!status.ok()) return fail(connection, status, retryMsOf(call.context));
    v1::PutBlobReply answer;
    answer.set_received(missing.missing_size() ? missing.missing(0).received() : request.blobs(0).bytes());
    return json(connection, answer);
  }

  /// Begins to take a body of bytes. Ok, or what to answer at once.
  grpc::Status beginPut(MHD_Connection* connection, const std::string& sha256, Exchange& exchange) {
    if (const grpc::Status known = checkSecret(connection); !known.ok()) return known;
    // A form of somebody else's page cannot send this type without asking first.
    const char* type = headerOf(connection, MHD_HTTP_HEADER_CONTENT_TYPE);
    if (!type || std::string(type) != "application/octet-stream")
      return {grpc::StatusCode::INVALID_ARGUMENT,
              "Content-Type: " + escaped(std::string(type ? type : "none was sent").substr(0, 80)) + ": must be application/octet-stream"};
    const auto bytes = queryNumber(connection, "bytes");
    if (!bytes) return {grpc::StatusCode::INVALID_ARGUMENT, "bytes: the query must say how many the whole file has"};
    const bool given = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "offset") != nullptr;
    const auto offset = queryNumber(connection, "offset");
    if (given && !offset) return {grpc::StatusCode::INVALID_ARGUMENT, "offset: must be a whole number"};
    v1::BlobDigest blob;
    blob.set_sha256(sha256);
    blob.set_bytes(*bytes);
    // Too large, or nothing for this caller: said before the body is read, as nobody sends a terabyte to be told. What is wrong with the numbers themselves Put
    // says.
    v1::MissingBlobsRequest asked;
    *asked.add_blobs() = blob;
    v1::MissingBlobsReply missing;
    UpstreamCall ask(goneOf(connection));
    dress(connection, ask.context);
    grpc::Status may = callOnce(
        ask, [&](auto* context, auto* queue) { return blobs->AsyncMissing(context, asked, queue); }, missing);
    if (may.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED) {  // in the caller's words
      std::string message = may.error_message();
      const std::string field = "missing.blobs[0].";
      if (message.rfind(field, 0) == 0) message.erase(0, field.size());
      may = {may.error_code(), message};
    }
    if (!may.ok() && may.error_code() != grpc::StatusCode::INVALID_ARGUMENT) return may;
    exchange.put = std::make_unique<PutStream>(goneOf(connection));
    dress(connection, exchange.put->context());
    exchange.put->begin(*blobs, blob, offset.value_or(0));
    return grpc::Status::OK;
  }
  MHD_Result endPut(MHD_Connection* connection, PutStream& put) {
    v1::PutBlobReply answer;
    const grpc::Status status = put.finish(answer);
    return status.ok() ? json(connection, answer) : fail(connection, status, retryMsOf(put.call().context));
  }

  // The render API for glTF, whose errors are plain sentences.

  GltfCaller gltfCaller(MHD_Connection* connection) const {
    const char* sent = headerOf(connection, MHD_HTTP_HEADER_AUTHORIZATION);
    return {options.secret.empty() && options.nameOf ? options.nameOf(sent ? sent : "") : "", dressing(connection), goneOf(connection),
            [this] { return stopping.load(); }};
  }
  static void dropAnswer(void* answer) { delete static_cast<GltfAnswer*>(answer); }
  /// The body goes to the client as it lies, with what holds its memory.
  MHD_Result plain(MHD_Connection* connection, GltfAnswer answer) {
    auto owned = std::make_unique<GltfAnswer>(std::move(answer));
    std::string& body = owned->body;
    MHD_Response* response = MHD_create_response_from_buffer_with_free_callback_cls(body.size(), body.data(), &Impl::dropAnswer, owned.get());
    if (!response) return MHD_NO;
    const GltfAnswer& kept = *owned.release();
    if (kept.status == MHD_HTTP_UNAUTHORIZED) MHD_add_response_header(response, "WWW-Authenticate", "Bearer");
    if (kept.retrySeconds > 0) MHD_add_response_header(response, "Retry-After", std::to_string(kept.retrySeconds).c_str());
    return queue(connection, kept.status, response, kept.type);
  }
  MHD_Result plain(MHD_Connection* connection, const grpc::Status& status) {
    return plain(connection, refused(httpStatusOf(status.error_code()), status.error_message()));
  }
  static GltfAnswer refused(int status, const std::string& message, long retrySeconds = 0) {
    GltfAnswer answer;
    answer.status = status;
    answer.body = message + "\n";
    answer.retrySeconds = retrySeconds;
    return answer;
  }
  /// Begins to take a form. 200, or what to answer at once.
  GltfAnswer beginForm(MHD_Connection* connection, Exchange& exchange) {
    if (const grpc::Status known = checkSecret(connection); !known.ok()) return refused(httpStatusOf(known.error_code()), known.error_message());
    const char* type = headerOf(connection, MHD_HTTP_HEADER_CONTENT_TYPE);
    const std::string shown = escaped(std::string(type ? type : "none was sent").substr(0, 80));
    if (!type || ::strncasecmp(type, "multipart/form-data", 19) != 0)
      return refused(MHD_HTTP_BAD_REQUEST, "Content-Type: " + shown + ": must be multipart/form-data");
    const GltfCaller caller = gltfCaller(connection);
    GltfAnswer admitted = gltf->admit(caller);
    if (admitted.status != MHD_HTTP_OK) return admitted;
    const uint64_t sceneBytes = gltf->sceneBytes(), most = sceneBytes + GltfRenderer::kFormOverhead;
    const char* length = headerOf(connection, MHD_HTTP_HEADER_CONTENT_LENGTH);
    const uint64_t bytes = length ? std::strtoull(length, nullptr, 10) : most;
    if (bytes > most)
      return refused(MHD_HTTP_CONTENT_TOO_LARGE,
                     "the body has " + std::to_string(bytes) + " bytes: at most " + std::to_string(most) + " (limits.upload_bytes, and 256 MiB here)");
    auto held = gltf->forms().take(caller.key, bytes);
    if (!held) return refused(MHD_HTTP_TOO_MANY_REQUESTS, "forms are arriving that need the memory; ask again", 1);
    exchange.form = std::make_unique<GltfForm>(connection, type, sceneBytes, bytes, std::move(held));
    return exchange.form->readable() ? GltfAnswer() : refused(MHD_HTTP_BAD_REQUEST, "Content-Type: " + shown + ": the boundary is missing");
  }
  MHD_Result endForm(MHD_Connection* connection, GltfForm& form) {
    const char* extra = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "request");
    return plain(connection, gltf->render(gltfCaller(connection), form, extra ? extra : ""));
  }

  // Bodies that are messages.

  /// Whose they are: callers of whom no token is known have one part of the memory together.
  std::string payer(MHD_Connection* connection) const {
    if (!options.secret.empty()) return checkSecret(connection).ok() ? "known" : "";
    const char* sent = headerOf(connection, MHD_HTTP_HEADER_AUTHORIZATION);
    return sent && options.nameOf ? options.nameOf(sent) : "";
  }
  /// Whether this caller may ask at all; asks the service.
  grpc::Status mayAsk(MHD_Connection* connection, long& retryMs) {
    if (const grpc::Status known = checkSecret(connection); !known.ok()) return known;
    UpstreamCall call(goneOf(connection));
    dress(connection, call.context);
    v1::ListScenesReply reply;
    const grpc::Status status = callOnce(
        call, [&](auto* context, auto* queue) { return scenes->AsyncList(context, v1::ListScenesRequest(), queue); }, reply);
    retryMs = retryMsOf(call.context);
    return status;
  }
  /// Room for a body that comes. One that gets none is read to its end all the same: a client that still sends would lose the answer.
  void beginBody(MHD_Connection* connection, Exchange& exchange) {
    const char* length = headerOf(connection, MHD_HTTP_HEADER_CONTENT_LENGTH);
    exchange.grows = headerOf(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING) != nullptr;  // chunked: a length does not count
    const uint64_t bytes = exchange.grows ? std::min(kSmallBody, options.requestBytes) : length ? std::strtoull(length, nullptr, 10) : 0;
    exchange.tooLarge = bytes > options.requestBytes;
    if (exchange.tooLarge) return;
    if (bytes > kSmallBody) giveRoom(connection, exchange, bytes);
    else exchange.room = bytes;
    exchange.body.reserve(exchange.room);
  }
  void giveRoom(MHD_Connection* connection, Exchange& exchange, uint64_t bytes) {
    exchange.room = 0;
    const std::string who = payer(connection);
    if (who.empty()) exchange.refused = mayAsk(connection, exchange.retryMs);  // a request of the caller's rate: known ones are spared it
    if (!exchange.refused.ok()) return;
    exchange.place = bodies->take(who, bytes);
    if (exchange.place) {
      exchange.room = bytes;
      return;
    }
    exchange.refused = {grpc::StatusCode::RESOURCE_EXHAUSTED, "bodies are arriving that need the memory; ask again"};
    exchange.retryMs = 1000;
  }
  /// What has come of a body.
  void addBody(MHD_Connection* connection, Exchange& exchange, const char* data, size_t bytes) {
    const uint64_t size = exchange.body.size() + bytes;
    if (exchange.room > 0 && exchange.grows && size > exchange.room) {  // chunked, and not small
      exchange.grows = false;
      giveRoom(connection, exchange, options.requestBytes);
    }
    exchange.tooLarge = exchange.tooLarge || (exchange.room > 0 && size > exchange.room);
    if (exchange.tooLarge || exchange.room == 0) exchange.dropBody();
    else exchange.body.append(data, bytes);
  }

  template <typename Request>
  static grpc::Status parse(Exchange& exchange, Request& request) {
    const grpc::Status status = toGrpc(messageFromJson(exchange.body, request, "the request's body"));
    exchange.dropBody();  // the answer may take long
    return status;
  }

  /// "/v1/scenes/ID/patch" -> ID; nothing of any other.
  static std::string patchedScene(const std::string& path) {
    constexpr std::string_view before = "/v1/scenes/", after = "/patch";
    const bool patch = path.size() > before.size() + after.size() && path.starts_with(before) && path.ends_with(after);
    return patch ? path.substr(before.size(), path.size() - before.size() - after.size()) : "";
  }
  static bool takesPosts(const std::string& path) {
    constexpr const char* kPaths[] = {"/v1/render", "/v1/render/stream", "/v1/relight", "/v1/relight/stream", "/v1/plan", "/v1/scenes"};
    return std::find(std::begin(kPaths), std::end(kPaths), path) != std::end(kPaths) || !patchedScene(path).empty();
  }

  MHD_Result post(MHD_Connection* connection, const std::string& path, Exchange& exchange) {
    if (const grpc::Status known = checkSecret(connection); !known.ok()) return fail(connection, known);
    if (!takesPosts(path)) return fail(connection, grpc::StatusCode::NOT_FOUND, "nothing to POST to at " + path.substr(0, 200) + " (docs/live.md)");
    // A form of somebody else's page cannot send this type without asking first.
    const char* type = headerOf(connection, MHD_HTTP_HEADER_CONTENT_TYPE);
    if (!type || std::string(type).rfind("application/json", 0) != 0)
      return fail(connection, grpc::StatusCode::INVALID_ARGUMENT,
                  "Content-Type: " + std::string(type ? type : "none was sent").substr(0, 80) + ": must be application/json");
    if (exchange.tooLarge)
      return fail(connection, grpc::StatusCode::RESOURCE_EXHAUSTED,
                  "the body has more than " + std::to_string(options.requestBytes) + " bytes (limits.request_bytes)");
    if (!exchange.refused.ok()) return fail(connection, exchange.refused, exchange.retryMs);
    const bool frames = path.size() > 7 && path.compare(path.size() - 7, 7, "/stream") == 0;
    const std::string what = frames ? path.substr(0, path.size() - 7) : path;
    if (what == "/v1/render") {
      v1::RenderRequest request;
      if (const grpc::Status read = parse(exchange, request); !read.ok()) return fail(connection, read);
      if (const grpc::Status one = onePicture(request); !frames && !one.ok()) return fail(connection, one);
      return stream(connection, frames, [&](auto* context, auto* queue) {
        return frames ? render->PrepareAsyncRenderProgressive(context, request, queue) : render->PrepareAsyncRender(context, request, queue);
      });
    }
    if (what == "/v1/relight") {
      v1::RelightRequest request;
      if (const grpc::Status read = parse(exchange, request); !read.ok()) return fail(connection, read);
      if (const grpc::Status one = onePicture(request.patch()); !frames && !one.ok()) return fail(connection, one);
      request.set_progressive(frames);
      return stream(connection, frames, [&](auto* context, auto* queue) { return render->PrepareAsyncRelight(context, request, queue); });
    }
    if (path == "/v1/plan") {
      v1::RenderRequest request;
      if (const grpc::Status read = parse(exchange, request); !read.ok()) return fail(connection, read);
      return unary<v1::PlanReply>(connection, [&](auto* context, auto* queue) { return render->AsyncPlan(context, request, queue); });
    }
    if (path == "/v1/scenes") {
      v1::OpenSceneRequest request;
      if (const grpc::Status read = parse(exchange, request); !read.ok()) return fail(connection, read);
      return unary<v1::SceneInfo>(connection, [&](auto* context, auto* queue) { return scenes->AsyncOpen(context, request, queue); });
    }
    v1::PatchSceneRequest request;
    if (const grpc::Status read = parse(exchange, request); !read.ok()) return fail(connection, read);
    const std::string id = patchedScene(path);
    if (!request.scene().empty() && request.scene() != id)
      return fail(connection, grpc::StatusCode::INVALID_ARGUMENT,
                  "patch.scene = \"" + escaped(request.scene().substr(0, 80)) + "\": the address says another one");
    request.set_scene(id);
    return unary<v1::SceneInfo>(connection, [&](auto* context, auto* queue) { return scenes->AsyncPatch(context, request, queue); });
  }

  static MHD_Result answer(void* self, MHD_Connection* connection, const char* url, const char* method, const char*, const char* data, size_t* bytes,
                           void** state) {
    Impl& impl = *static_cast<Impl*>(self);
    Exchange* exchange = static_cast<Exchange*>(*state);
    if (!exchange) {  // the head alone has come: what is refused by it is refused before its body is read
      *state = exchange = new Exchange();
      grpc::Status admitted = impl.admit(connection);
      const std::string path = url;
      if (impl.gltf && path == kGltfPath && std::strcmp(method, MHD_HTTP_METHOD_POST) == 0) {
        if (admitted.ok()) admitted = impl.checkSecret(connection);
        if (admitted.ok()) admitted = checkQuery(connection, {"request"});
        if (!admitted.ok()) return impl.plain(connection, admitted);
        try {
          GltfAnswer begun = impl.beginForm(connection, *exchange);
          return begun.status == MHD_HTTP_OK ? MHD_YES : impl.plain(connection, std::move(begun));
        } catch (const std::exception& e) {
          return impl.plain(connection, refused(MHD_HTTP_INTERNAL_SERVER_ERROR, std::string("exception in the door: ") + e.what()));
        }
      }
      if (admitted.ok() && std::strcmp(method, MHD_HTTP_METHOD_POST) == 0) {
        try {
          const bool blob = path.rfind(kBlobsPath, 0) == 0;
          if (blob || takesPosts(path)) {  // any other: post() says that there is nothing
            admitted = impl.checkSecret(connection);
            if (admitted.ok()) admitted = blob ? checkQuery(connection, {"bytes", "offset"}) : checkQuery(connection, {});
          }
          if (admitted.ok() && blob) admitted = impl.beginPut(connection, path.substr(kBlobsPath.size()), *exchange);
          else if (admitted.ok()) impl.beginBody(connection, *exchange);
        } catch (const std::exception& e) { admitted = {grpc::StatusCode::INTERNAL, std::string("exception in the door: ") + e.what()}; }
      }
      return admitted.ok() ? MHD_YES : impl.fail(connection, admitted);
    }
    if (*bytes > 0 && exchange->put) {
      exchange->put->add(data, *bytes);
      *bytes = 0;
      return MHD_YES;
    }
    if (*bytes > 0 && exchange->form) {
      exchange->form->add(data, *bytes);
      *bytes = 0;
      return MHD_YES;
    }
    if (*bytes > 0) {
      try {
        impl.addBody(connection, *exchange, data, *bytes);
      } catch (const std::exception& e) {
        exchange->dropBody();
        exchange->refused = {grpc::StatusCode::INTERNAL, std::string("exception in the door: ") + e.what()};
      }
      *bytes = 0;
      return MHD_YES;
    }
    if (!exchange->answering) {
      exchange->answering = &impl.answering;
      ++impl.answering;
    }
    try {
      if (exchange->put) return impl.endPut(connection, *exchange->put);
      if (exchange->form) return impl.endForm(connection, *exchange->form);
      const std::string path = url;
      if (std::strcmp(method, MHD_HTTP_METHOD_GET) == 0 || std::strcmp(method, MHD_HTTP_METHOD_HEAD) == 0) return impl.get(connection, path);
      if (std::strcmp(method, MHD_HTTP_METHOD_POST) == 0) {
        const MHD_Result sent = impl.post(connection, path, *exchange);
        exchange->dropBody();  // a stream may go on for long
        return sent;
      }
      return impl.reply(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET, HEAD and POST\n", "text/plain");
    } catch (const std::exception& e) {
      const grpc::Status status(grpc::StatusCode::INTERNAL, std::string("exception in the door: ") + e.what());
      return exchange->form ? impl.plain(connection, status) : impl.fail(connection, status);
    }
  }
  static void completed(void*, MHD_Connection*, void** state, MHD_RequestTerminationCode) { delete static_cast<Exchange*>(*state); }
};

Door::Door() = default;

Door::~Door() {
  if (!impl_ || impl_->servings.empty()) return;
  // Calls that have ended are answers on their way: a picture that was waited for is not lost at the door.
  const auto end = std::chrono::steady_clock::now() + kLastAnswers;
  while (impl_->answering.load() > 0 && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  impl_->stopping = true;
  impl_->servings.clear();
}

bool Door::secure() const { return impl_->tls; }

Status Door::setCertificate(const std::string& cert, const std::string& key) {
  std::list<Serving>& servings = impl_->servings;
  if (!impl_->tls || (servings.back().cert == cert && servings.back().key == key)) return {};
  GOBO_TRY(impl_->serve(cert, key));
  for (auto old = servings.begin(); old != std::prev(servings.end(), 2);) old = old->idle() ? servings.erase(old) : std::next(old);
  return {};
}

Result<std::unique_ptr<Door>> Door::start(DoorOptions options) {
  GOBO_ASSIGN(const Address address, parseAddress(options.listen));
  if (address.isUnix) return invalidArgument("\"" + escaped(options.listen) + "\": must be HOST:PORT");
  GOBO_ASSIGN(BoundSockets bound, bindTcp(options.listen));
  std::unique_ptr<Door> self(new Door());
  self->impl_ = std::make_unique<Impl>();
  Impl& impl = *self->impl_;
  impl.options = std::move(options);
  impl.host = address.host;
  impl.scenes = v1::Scenes::NewStub(impl.options.channel);
  impl.render = v1::Render::NewStub(impl.options.channel);
  impl.admin = v1::Admin::NewStub(impl.options.channel);
  impl.blobs = v1::Blobs::NewStub(impl.options.channel);
  impl.jobs = v1::Jobs::NewStub(impl.options.channel);
  impl.farm = v1::Farm::NewStub(impl.options.channel);
  if (impl.options.sceneBytes) impl.gltf = std::make_unique<GltfRenderer>(impl.options.channel, impl.options.sceneBytes);
  impl.schema = schemaJson(*v1::RenderRequest::descriptor());
  self->address_ = bound.served;
  impl.bodies = std::make_unique<SharedLimit>(std::max(kBodies, 2 * impl.options.requestBytes));
  impl.tls = !impl.options.cert.empty();
  impl.listening = std::move(bound.sockets[0]);  // a name with several addresses is served on the first
  GOBO_TRY(impl.serve(impl.options.cert, impl.options.key));
  impl.options.cert.clear();
  impl.options.key.clear();
  return self;
}

}  // namespace door
}  // namespace gobo
