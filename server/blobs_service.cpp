// SPDX-License-Identifier: Apache-2.0
#include "server/blobs_service.h"

#include <map>
#include <optional>

#include "server/limits.h"

namespace gobo {
inline namespace server {

namespace {
constexpr int kMostAsked = 10001;  // what one scene may have: its file and those beside it

Status tooLarge(const std::string& field, const v1::BlobDigest& blob, const UploadLimit& limit) {
  return {
      Code::ResourceExhausted,
      strf("%s = %llu: uploads are limited to %llu bytes (%s)", field.c_str(), (unsigned long long)blob.bytes(), (unsigned long long)limit.bytes, limit.key),
      field};
}
}  // namespace

grpc::Status BlobsService::Missing(grpc::ServerContext* context, const v1::MissingBlobsRequest* request, v1::MissingBlobsReply* reply) {
  return serve(core_, *context, "missing_blobs", [&](Rpc& rpc) -> grpc::Status {
    rpc.quiet();
    if (request->blobs_size() > kMostAsked)
      return toGrpc(invalidArgument(strf("missing.blobs: %d, at most %d", request->blobs_size(), kMostAsked), "missing.blobs"));
    for (int i = 0; i < request->blobs_size(); ++i) {
      const v1::BlobDigest& blob = request->blobs(i);
      const std::string place = strf("missing.blobs[%d]", i);
      if (const Status ok = checkSha256(blob.sha256(), place + ".sha256"); !ok.ok()) return toGrpc(ok);
      if (blob.bytes() == 0) return toGrpc(invalidArgument(place + ".bytes = 0: must be the file's size", place + ".bytes"));
    }
    std::map<std::string, uint64_t> together;
    for (int i = 0; i < request->blobs_size(); ++i) {
      const v1::BlobDigest& blob = request->blobs(i);
      together[blob.sha256()] = blob.bytes();
      const uint64_t received = core_.files->received(rpc.renderOwner(), blob.sha256(), blob.bytes());
      if (received == blob.bytes()) continue;
      // What could not be put is refused before anything of it, or of the files beside it, is sent.
      if (const UploadLimit limit = uploadLimit(rpc); blob.bytes() > limit.bytes)
        return rpc.refuse("upload_bytes", tooLarge(strf("missing.blobs[%d].bytes", i), blob, limit));
      v1::MissingBlob& missing = *reply->add_missing();
      *missing.mutable_blob() = blob;
      missing.set_received(received);
    }
    // Nor is anything sent of files that would push each other out.
    if (reply->missing_size() > 0)
      if (const Status fit = core_.files->fitTogether(rpc.renderOwner(), together); !fit.ok()) return rpc.refuse("blobs", fit.at("missing.blobs"));
    return grpc::Status::OK;
  });
}

grpc::Status BlobsService::Put(grpc::ServerContext* context, grpc::ServerReader<v1::PutBlobRequest>* reader, v1::PutBlobReply* reply) {
  return serve(core_, *context, "put_blob", [&](Rpc& rpc) { return put(rpc, *reader, reply); });
}

grpc::Status BlobsService::put(Rpc& rpc, grpc::ServerReader<v1::PutBlobRequest>& reader, v1::PutBlobReply* reply) {
  ServerCore::Call call(core_);
  if (!call.ok) return rpc.refuseDraining();
  const auto slot = core_.uploads.take(rpc.who().name, 1);
  if (!slot) return rpc.refuseFull("uploads", "uploads are in progress", core_.uploads, "limits.uploads_at_once", 1000);
  std::unique_ptr<FilePut> file;
  v1::PutBlobRequest message;
  const auto next = [&] {
    const IdleWatch::Wait wait(core_.idle, rpc.context());
    return reader.Read(&message);
  };
  while (next()) {
    if (call.stop.token().stopRequested()) return rpc.refuseDraining();
    if (!file) {
      const v1::BlobDigest& blob = message.blob();
      const UploadLimit limit = uploadLimit(rpc);
      if (blob.bytes() > limit.bytes) return rpc.refuse("upload_bytes", tooLarge("put.blob.bytes", blob, limit));
      auto begun = core_.files->begin(rpc.renderOwner(), blob.sha256(), blob.bytes(), message.offset(), call.stop.token());
      if (begun.status().code() == Code::Aborted) return rpc.refuseBusy("blobs", begun.status().message(), 200);
      if (begun.status().code() == Code::ResourceExhausted) return rpc.refuse("blobs", begun.status());
      if (!begun.ok()) return toGrpc(begun.status());
      file = std::move(*begun);
      rpc.note("sha256", blob.sha256());
      rpc.note("from", std::to_string(message.offset()));
    }
    if (const Status status = file->add(message.data()); !status.ok()) return toGrpc(status);
    if (!file->there()) core_.metrics.add("gobo_blob_put_bytes_total", {}, double(message.data().size()));
  }
  if (rpc.context().IsCancelled())
    return {grpc::StatusCode::CANCELLED,
            strf("put cancelled, by its client or because nothing came for %g s (limits.client_idle_s); what arrived is kept", core_.idle.seconds())};
  if (!file) return toGrpc(invalidArgument("no message: the first one names the blob", "put.blob"));
  if (const Status status = file->finish(); !status.ok()) return toGrpc(status);
  reply->set_received(file->received());
  return grpc::Status::OK;
}

Result<EnvironmentFile> environmentFile(const Rpc& rpc, const v1::RenderRequest& request, const std::string& field, const StopToken& stop) {
  EnvironmentFile out;
  if (!request.environment().has_digest()) return out;
  GOBO_ASSIGN(out.held, rpc.core().files->environment(rpc.renderOwner(), request.environment().digest(), field, out.path, stop));
  return out;
}

}  // namespace server
}  // namespace gobo
