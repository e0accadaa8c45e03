// SPDX-License-Identifier: Apache-2.0
#include "blobs.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "base/image_io.h"
#include "server/encode.h"

namespace gobo::cli {

namespace fs = std::filesystem;

namespace {

constexpr size_t kPiece = 512 << 10;  // with its frame below any limits.request_bytes
constexpr int kTries = 8;             // of connections that break one after the other
constexpr int kBusyTries = 40;        // while another call puts the same file
constexpr int kMostPuts = 3;          // of one file: one that is still missing then has to go for others each time

Result<LocalBlob> sized(const std::string& path) {
  std::error_code error;
  const uint64_t bytes = fs::file_size(path, error);
  if (error) return notFound("cannot read \"" + path + "\"");
  if (bytes == 0) return invalidArgument("the file is empty", path);
  return LocalBlob{path, "", bytes};
}

Result<LocalBlob> blobOf(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return notFound("cannot read \"" + path + "\"");
  LocalBlob out{path, "", 0};
  Sha256 sha;
  std::string piece(kPiece, '\0');
  while (in.read(piece.data(), std::streamsize(piece.size())), in.gcount() > 0) {
    sha.add(piece.data(), size_t(in.gcount()));
    out.bytes += uint64_t(in.gcount());
  }
  if (out.bytes == 0) return invalidArgument("the file is empty", path);
  out.sha256 = sha.hex();
  return out;
}

/// %41 -> A; what is no such triple stays.
std::string decoded(const std::string& uri) {
  std::string out;
  for (size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] == '%' && i + 2 < uri.size() && std::isxdigit(uint8_t(uri[i + 1])) && std::isxdigit(uint8_t(uri[i + 2]))) {
      out += char(std::stoi(uri.substr(i + 1, 2), nullptr, 16));
      i += 2;
    } else out += uri[i];
  }
  return out;
}

/// The JSON of a .gltf or in a .glb; empty: neither, and the server says what is wrong.
std::string jsonOf(const std::string& scene) {
  std::ifstream in(scene, std::ios::binary);
  char head[20] = {};
  in.read(head, sizeof head);
  if (in.gcount() == sizeof head && std::memcmp(head, "glTF", 4) == 0) {
    uint32_t size = 0;
    std::memcpy(&size, head + 12, 4);
    std::error_code error;
    std::string text(size_t(std::min<uint64_t>(size, fs::file_size(scene, error))), '\0');
    in.read(text.data(), std::streamsize(text.size()));
    return text;
  }
  std::string extension = fs::path(scene).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (extension != ".gltf") return {};
  in.clear();
  in.seekg(0);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> urisOf(const std::string& text) {
  std::vector<std::string> out;
  const nlohmann::json document = nlohmann::json::parse(text, nullptr, false);
  std::vector<const nlohmann::json*> left{&document};
  while (!left.empty()) {
    const nlohmann::json& value = *left.back();
    left.pop_back();
    if (value.is_object()) {
      for (const auto& [key, inner] : value.items()) {
        if (key == "uri" && inner.is_string()) out.push_back(inner.get<std::string>());
        else left.push_back(&inner);
      }
    } else if (value.is_array()) {
      for (const auto& inner : value) left.push_back(&inner);
    }
  }
  return out;
}

Result<v1::MissingBlobsReply> missingOf(Session& session, const std::vector<LocalBlob>& blobs) {
  v1::MissingBlobsRequest request;
  for (const LocalBlob& b : blobs) {
    request.add_blobs()->set_sha256(b.sha256);
    request.mutable_blobs(request.blobs_size() - 1)->set_bytes(b.bytes);
  }
  v1::MissingBlobsReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.blobs().Missing(&call.context, request, &reply)));
  return reply;
}

Status putOne(Session& session, const LocalBlob& blob, uint64_t offset) {
  std::ifstream in(blob.path, std::ios::binary);
  in.seekg(std::streamoff(offset));
  v1::PutBlobRequest message;
  message.mutable_blob()->set_sha256(blob.sha256);
  message.mutable_blob()->set_bytes(blob.bytes);
  message.set_offset(offset);
  v1::PutBlobReply reply;
  Session::Call call(session);
  auto writer = session.blobs().Put(&call.context, &reply);
  std::string piece(kPiece, '\0');
  while (in.read(piece.data(), std::streamsize(piece.size())), in.gcount() > 0) {
    message.set_data(piece.data(), size_t(in.gcount()));
    if (!writer->Write(message)) break;
    message.Clear();
  }
  writer->WritesDone();
  return session.statusOf(writer->Finish());
}

/// Sends what is missing, up to the first that fails. `puts`: of each digest, those that were answered with Ok.
Status putMissing(Session& session, const v1::MissingBlobsReply& reply, const std::map<std::string, LocalBlob>& byDigest, std::map<std::string, int>& puts) {
  for (const auto& m : reply.missing()) {
    const auto known = byDigest.find(m.blob().sha256());
    if (known == byDigest.end()) return Status(Code::DataLoss, "the server misses \"" + m.blob().sha256() + "\", which it was not asked for");
    const LocalBlob& blob = known->second;
    if (puts[blob.sha256] >= kMostPuts)
      return Status(Code::ResourceExhausted, "the server does not keep \"" + blob.path + "\" beside the scene's other files (blobs.bytes)");
    const Status status = putOne(session, blob, m.received());
    // What was there does not fit and is dropped: it is asked for again.
    if (!status.ok() && !(status.code() == Code::InvalidArgument && m.received() > 0)) return status;
    ++puts[blob.sha256];
  }
  return {};
}

}  // namespace

Result<std::map<std::string, LocalBlob>> filesOf(const std::string& scene) {
  std::error_code error;
  const fs::path own = fs::absolute(scene, error), folder = fs::canonical(own.parent_path(), error);
  std::map<std::string, LocalBlob> out;
  GOBO_ASSIGN(out[own.filename().string()], sized(scene));
  for (const std::string& uri : urisOf(jsonOf(scene))) {
    const size_t colon = uri.find(':');
    if (colon != std::string::npos && colon < uri.find_first_of("/?#%")) continue;  // data: or another scheme
    const fs::path name = fs::path(decoded(uri)).lexically_normal();
    if (name.empty() || name.is_absolute() || *name.begin() == ".." || out.count(name.string())) continue;
    const fs::path real = fs::canonical(folder / name, error);
    if (error || std::mismatch(folder.begin(), folder.end(), real.begin(), real.end()).first != folder.end()) continue;
    if (!fs::is_regular_file(real, error) || fs::file_size(real, error) == 0 || error) continue;
    GOBO_ASSIGN(out[name.string()], sized(real.string()));
  }
  return out;
}

Status putBlobs(Session& session, const std::map<std::string, LocalBlob>& blobs) {
  std::map<std::string, LocalBlob> byDigest;
  for (const auto& [name, blob] : blobs) byDigest[blob.sha256] = blob;
  std::vector<LocalBlob> wanted;
  for (const auto& [digest, blob] : byDigest) wanted.push_back(blob);
  std::map<std::string, int> puts;
  int broken = 0, busy = 0;
  bool said = false;
  for (;;) {
    const auto reply = missingOf(session, wanted);
    if (reply.ok() && reply->missing().empty()) return {};
    Status status = reply.status();
    if (status.ok()) {
      uint64_t left = 0;
      for (const auto& m : reply->missing()) left += m.blob().bytes() - m.received();
      if (!said) std::fprintf(stderr, "gobo: sending %d of %zu files (%.1f MiB)\n", reply->missing_size(), wanted.size(), double(left) / (1 << 20));
      said = true;
      status = putMissing(session, *reply, byDigest, puts);
    }
    if (status.code() == Code::ResourceExhausted && exitCodeOf(status) == kBusy && ++busy < kBusyTries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(250));
    } else if (status.code() == Code::Unavailable && ++broken < kTries) {
      std::this_thread::sleep_for(std::chrono::milliseconds(100 << std::min(broken, 5)));
    } else if (!status.ok()) {
      return status;
    }
  }
}

Result<v1::SceneInfo> openByDigest(Session& session, const std::string& scene, std::map<std::string, LocalBlob> files, const std::string& name) {
  for (auto& [n, blob] : files) { GOBO_ASSIGN(blob, blobOf(blob.path)); }
  v1::OpenSceneRequest request;
  request.set_source(fs::path(scene).filename().string());
  request.set_name(name);
  std::string listed;
  for (const auto& [n, blob] : files) {
    (*request.mutable_files())[n] = blob.sha256;
    listed += n + " " + blob.sha256 + "\n";
  }
  v1::SceneInfo info;
  if (name.empty()) {
    const std::string digest = files.size() == 1 ? files.begin()->second.sha256 : sha256Hex(listed.data(), listed.size());
    request.set_name(fs::path(scene).stem().string() + "-" + digest.substr(0, 12));
    v1::InspectSceneRequest inspect;
    inspect.set_scene(request.name());
    Session::Call call(session);
    if (session.scenes().Inspect(&call.context, inspect, &info).ok()) return info;
  }
  for (int again = 0;; ++again) {
    GOBO_TRY(putBlobs(session, files));
    Session::Call call(session);
    const Status status = session.statusOf(session.scenes().Open(&call.context, request, &info));
    if (status.ok()) return info;
    // Others needed the room meanwhile, or the disk lost one: once more.
    if (again > 0 || status.code() != Code::NotFound || status.message().find("open.files") == std::string::npos) return status;
  }
}

Result<bool> putEnvironment(Session& session, v1::EnvironmentSettings& environment) {
  std::error_code error;
  std::string extension = fs::path(environment.path()).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (session.local() || (extension != ".hdr" && extension != ".exr") || !fs::is_regular_file(environment.path(), error)) return false;
  // A plan says whether the server can open it, and loads it if so.
  v1::RenderRequest probe;
  probe.set_scene("cornell");
  probe.set_width(1);
  probe.set_height(1);
  probe.mutable_halt()->set_spp(1);
  probe.mutable_environment()->set_path(fs::absolute(environment.path()).string());
  Status status;
  {
    v1::PlanReply reply;
    Session::Call call(session);
    status = session.statusOf(session.render().Plan(&call.context, probe, &reply));
  }
  // The server's working folder is another: what it opened was found from here.
  if (status.ok()) environment.set_path(probe.environment().path());
  const bool cannotSee = status.code() == Code::PermissionDenied || status.code() == Code::NotFound;
  if (!cannotSee || status.message().find("environment.path") == std::string::npos) return false;  // what else is wrong is said by the call itself
  GOBO_ASSIGN(const LocalBlob blob, blobOf(environment.path()));
  if (double(blob.bytes) > session.options().uploadMiB * (1 << 20))
    return Status(status.code(), status.message() + "; not sent: it is larger than --upload-limit");
  const Status put = putBlobs(session, {{"environment", blob}});
  if (put.code() == Code::Unimplemented) return false;  // a server of before Blobs
  GOBO_TRY(put);
  environment.clear_path();
  environment.set_digest(blob.sha256);
  return true;
}

}  // namespace gobo::cli
