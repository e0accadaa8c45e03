// SPDX-License-Identifier: Apache-2.0
#include "server/limits.h"

#include <algorithm>
#include <filesystem>

#include "plan/outputs.h"
#include "scene/load.h"
#include "server/render_call.h"

namespace gobo {
inline namespace server {

namespace fs = std::filesystem;
using Steady = std::chrono::steady_clock;

static unsigned long long ull(uint64_t v) { return v; }

bool mayUse(const Rpc& rpc, v1::Scheduling::Class priority) {
  const TokenConfig* t = rpc.who().token.get();
  return !t || t->classes.empty() || std::find(t->classes.begin(), t->classes.end(), kClassNames[int(jobClassOf(priority))]) != t->classes.end();
}

void chooseClass(const Rpc& rpc, bool progressive, v1::RenderRequest& request, v1::RenderRequest& resolved) {
  if (request.scheduling().has_priority() || !mayUse(rpc, v1::Scheduling::INTERACTIVE)) return;
  const bool firstHits = std::all_of(resolved.outputs().begin(), resolved.outputs().end(), [](const std::string& output) {
    const OutputInfo* const info = findOutput(output);
    return info && showsFirstHits(*info);
  });
  if (!progressive && !firstHits && request.scheduling().session().empty()) return;
  request.mutable_scheduling()->set_priority(v1::Scheduling::INTERACTIVE);
  resolved.mutable_scheduling()->set_priority(v1::Scheduling::INTERACTIVE);
}

grpc::Status checkRender(Rpc& rpc, v1::RenderRequest& request, const v1::RenderRequest& resolved) {
  const bool part = resolved.has_window();
  const uint32_t width = part ? resolved.window().width() : resolved.width(), height = part ? resolved.window().height() : resolved.height();
  const uint64_t pixels = uint64_t(width) * height;
  uint64_t outputs = uint64_t(std::max(1, resolved.outputs_size()));
  for (const std::string& output : resolved.outputs())
    if (const OutputInfo* const info = findOutput(output); info && info->kind == OutputKind::Matte) outputs += 2;  // three layers of four channels
  const uint64_t bytes = pixels * outputs * 16, most = rpc.core().live()->imageBytes;
  if (bytes > most)
    return rpc.refuse("image_bytes", invalidArgument(strf("width x height x outputs = %u x %u x %llu needs %llu bytes: at most %llu (limits.image_bytes)",
                                                          width, height, ull(outputs), ull(bytes), ull(most)),
                                                     part ? "request.window.width" : "request.width"));
  if (const TokenConfig* t = rpc.who().token.get()) {
    if (!mayUse(rpc, resolved.scheduling().priority())) {
      const std::string name = kClassNames[int(jobClassOf(resolved.scheduling().priority()))];
      std::string allowed;
      for (const std::string& c : t->classes) allowed += (allowed.empty() ? "" : ", ") + c;
      return rpc.refuse("class",
                        {Code::PermissionDenied, "scheduling.priority = " + name + ": token \"" + t->name + "\" may use " + allowed + " (tokens.classes)",
                         "request.scheduling.priority"});
    }
    if (t->maxPixels && pixels > t->maxPixels)
      return rpc.refuse("pixels", invalidArgument(strf("width x height = %u x %u = %llu pixels: at most %llu (tokens.max_pixels of \"%s\")", width, height,
                                                       ull(pixels), ull(t->maxPixels), t->name.c_str()),
                                                  part ? "request.window.width" : "request.width"));
    if (t->maxSpp && resolved.halt().has_spp() && resolved.halt().spp() > t->maxSpp)
      return rpc.refuse("spp", invalidArgument(strf("halt.spp = %u: at most %u (tokens.max_spp of \"%s\")", resolved.halt().spp(), t->maxSpp, t->name.c_str()),
                                               "request.halt.spp"));
    if (t->maxSpp && resolved.certificate().spp() > t->maxSpp)
      return rpc.refuse(
          "spp", invalidArgument(strf("certificate.spp = %u: at most %u (tokens.max_spp of \"%s\")", resolved.certificate().spp(), t->maxSpp, t->name.c_str()),
                                 "request.certificate.spp"));
    // Bound by time or error alone it would go on to the engine's own bound.
    if (t->maxSpp && !resolved.halt().has_spp()) request.mutable_halt()->set_spp(t->maxSpp);
  }
  return checkPath(rpc, resolved.environment().path(), "request.environment.path");
}

grpc::Status checkPath(Rpc& rpc, const std::string& path, const char* field) {
  const TokenConfig* t = rpc.who().token.get();
  if (!t || !t->roots || path.empty() || path == "none") return grpc::Status::OK;
  const auto& builtin = builtinSceneNames();
  if (std::find(builtin.begin(), builtin.end(), path) != builtin.end()) return grpc::Status::OK;
  std::error_code error;
  const fs::path real = fs::weakly_canonical(path, error);
  for (const std::string& root : *t->roots) {
    std::error_code ignored;
    const fs::path base = fs::canonical(root, ignored);
    if (!error && !ignored && std::mismatch(base.begin(), base.end(), real.begin(), real.end()).first == base.end()) return grpc::Status::OK;
  }
  return rpc.refuse("root", {Code::PermissionDenied,
                             "\"" + escaped(path.substr(0, 1024)) + "\" is not under a folder that token \"" + t->name + "\" may read (tokens.roots)", field});
}

UploadLimit uploadLimit(const Rpc& rpc) {
  const uint64_t all = rpc.core().live()->uploadBytes;
  const TokenConfig* t = rpc.who().token.get();
  return t && t->uploadBytes && t->uploadBytes < all ? UploadLimit{t->uploadBytes, "tokens.upload_bytes"} : UploadLimit{all, "limits.upload_bytes"};
}

Deadline deadlineFor(const Rpc& rpc, const grpc::ServerContext& context, const v1::Scheduling& scheduling) {
  Deadline out{deadlineOf(context, scheduling), {}};
  const auto bound = [&](double seconds, const std::string& text) {
    if (seconds <= 0) return;
    const Steady::time_point at = Steady::now() + std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(seconds));
    if (out.at && *out.at <= at) return;
    out = {at, text};
  };
  const double all = rpc.core().live()->requestSeconds;
  bound(all, strf("limits.request_s = %g", all));
  if (const TokenConfig* t = rpc.who().token.get()) bound(t->maxSeconds, strf("tokens.max_s of \"%s\" = %g", t->name.c_str(), t->maxSeconds));
  return out;
}

}  // namespace server
}  // namespace gobo
