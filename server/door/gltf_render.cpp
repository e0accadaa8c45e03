// SPDX-License-Identifier: Apache-2.0
#include "server/door/gltf_render.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <set>
#include <thread>

#include "request/request.h"
#include "server/door/door.h"
#include "server/door/gltf_images.h"
#include "server/door/upstream.h"
#include "server/log.h"
#include "server/random_hex.h"
#include "server/rpc.h"

namespace gobo {

namespace {

constexpr int kTries = 3;              // a scene may go, for others' memory, between its upload and its render
constexpr double kPatience = 30;       // seconds that an upload waits for its place among others
constexpr uint32_t kSamples = 16;      // of a colour picture whose caller says nothing
constexpr size_t kPiece = 1 << 20;     // of an upload
constexpr unsigned kMostSide = 16384;  // pixels; the schema's
constexpr const char* kText = "text/plain; charset=utf-8";

std::string shownValue(const std::string& name, const std::string& value) { return name + " = \"" + escaped(value.substr(0, 80)) + "\""; }

// The fields of one form, read one by one.
struct FormReader {
  const std::map<std::string, std::string>& fields;
  std::set<std::string> known;

  Result<std::string> text(const char* name) {
    known.insert(name);
    const auto at = fields.find(name);
    if (at == fields.end()) return invalidArgument(std::string(name) + ": is missing in the form", name);
    return at->second;
  }
  Result<double> number(const char* name, double least, double most, bool above, const char* range) {
    GOBO_ASSIGN(const std::string value, text(name));
    double v = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), v);
    if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(v))
      return invalidArgument(shownValue(name, value) + ": is not a number", name);
    if (v < least || v > most || (above && v == least)) return invalidArgument(shownValue(name, value) + ": must be " + range, name);
    return v;
  }
  Result<uint32_t> pixels(const char* name) {
    GOBO_ASSIGN(const std::string value, text(name));
    uint32_t v = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), v);
    if (error != std::errc() || end != value.data() + value.size() || v < 1 || v > kMostSide)
      return invalidArgument(shownValue(name, value) + ": must be a whole number of pixels from 1 to " + std::to_string(kMostSide), name);
    return v;
  }
  Status rest() const {
    for (const auto& [name, value] : fields)
      if (!known.count(name)) return invalidArgument(shownValue(escaped(name.substr(0, 80)), value) + ": no field of this API has that name", name);
    return {};
  }
};

Status readCamera(FormReader& form, v1::CameraSettings& camera) {
  constexpr double kFar = 1e9, kFocal = 1e7, kCentre = 1e6, kPi = 3.14159265358979323846;
  GOBO_ASSIGN(const double near, form.number("near", 0, kFar, false, "from 0 to 1e9 m"));
  GOBO_ASSIGN(const double far, form.number("far", near, kFar, true, "above near, and at most 1e9 m"));
  GOBO_ASSIGN(const double focalX, form.number("focal_x", 0.001, kFocal, false, "from 0.001 to 1e7 pixels"));
  GOBO_ASSIGN(const double focalY, form.number("focal_y", 0.001, kFocal, false, "from 0.001 to 1e7 pixels"));
  // What they say the focal lengths say; clients send both, rounded, and some that contradict.
  GOBO_TRY(form.number("fov_x", 0, kPi, true, "above 0 and at most pi radians").status());
  GOBO_TRY(form.number("fov_y", 0, kPi, true, "above 0 and at most pi radians").status());
  GOBO_ASSIGN(const double centreX, form.number("center_x", -kCentre, kCentre, false, "from -1e6 to 1e6 pixels"));
  GOBO_ASSIGN(const double centreY, form.number("center_y", -kCentre, kCentre, false, "from -1e6 to 1e6 pixels"));
  camera.set_clip_near(near);
  camera.set_clip_far(far);
  camera.set_focal_x(focalX);
  camera.set_focal_y(focalY);
  camera.set_center_x(centreX);
  camera.set_center_y(centreY);
  return {};
}

/// Settings of a colour picture that the caller left open.
void fillColour(v1::RenderRequest& request) {
  request.add_outputs("beauty");
  request.mutable_encoding()->set_format(v1::Encoding::PNG);
  request.mutable_encoding()->set_png_bits(8);
  const v1::Halt& halt = request.halt();
  if (!halt.has_spp() && !halt.has_time_s() && !halt.has_error()) request.mutable_halt()->set_spp(kSamples);
  // Pictures of one data set are to be comparable: the exposure is the same for all.
  if (!request.tone_map().has_auto_exposure()) request.mutable_tone_map()->set_auto_exposure(false);
}

/// How the scene stands and who goes first, nothing of how it looks.
v1::RenderRequest geometryOf(const v1::RenderRequest& extra) {
  v1::RenderRequest request;
  if (extra.camera().has_name()) request.mutable_camera()->set_name(extra.camera().name());
  if (extra.has_time_s()) request.set_time_s(extra.time_s());
  if (extra.has_animation()) request.set_animation(extra.animation());
  if (extra.has_variant()) request.set_variant(extra.variant());
  if (extra.has_scheduling()) *request.mutable_scheduling() = extra.scheduling();
  request.set_view_samples(1);  // in the pixel's middle: labels and depths are not mixed
  request.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  return request;
}

GltfAnswer refusal(const grpc::Status& status, long retrySeconds) {
  GltfAnswer answer;
  answer.status = httpStatusOf(status.error_code());
  answer.type = kText;
  answer.body = status.error_message() + "\n";
  answer.retrySeconds = retrySeconds;
  return answer;
}
GltfAnswer refusal(const Status& status, long retrySeconds = 0) { return refusal(toGrpc(status), retrySeconds); }

long retryOf(const grpc::ClientContext& context) {
  const auto& trailers = context.GetServerTrailingMetadata();
  const auto at = trailers.find(kRetryAfterKey);
  if (at == trailers.end()) return 0;
  return std::max(1L, (std::atol(std::string(at->second.data(), at->second.size()).c_str()) + 999) / 1000);
}

bool isPassing(const grpc::Status& status, long retrySeconds) { return status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && retrySeconds > 0; }

}  // namespace

Result<GltfRequest> gltfRequestOf(const std::map<std::string, std::string>& fields, const std::string& extra) {
  GltfRequest out;
  FormReader form{fields, {"submit"}};
  v1::RenderRequest given;
  if (!extra.empty()) GOBO_TRY(messageFromJson(extra, given, "the address' \"request\""));
  if (!given.scene().empty() || given.has_window() || given.outputs_size() > 0 || given.has_encoding() || given.has_width() || given.has_height())
    return invalidArgument("request: scene, width, height, window, outputs and encoding are not to be said in the address: the form says them", "request");
  GOBO_ASSIGN(const std::string sha256, form.text("scene_sha256"));
  if (sha256.empty()) return invalidArgument("scene_sha256 = \"\": must be the SHA-256 of the scene, 64 hex digits", "scene_sha256");
  GOBO_ASSIGN(const std::string type, form.text("image_type"));
  using Image = GltfRequest::Image;
  if (type == "color") out.image = Image::Color;
  else if (type == "depth") out.image = Image::Depth;
  else if (type == "label") out.image = Image::Label;
  else return invalidArgument(shownValue("image_type", type) + ": must be color, depth or label", "image_type");
  GOBO_ASSIGN(const uint32_t width, form.pixels("width"));
  GOBO_ASSIGN(const uint32_t height, form.pixels("height"));
  if (out.image == Image::Color) {
    out.render = given;
    fillColour(out.render);
  } else {
    out.render = geometryOf(given);
    if (out.image == Image::Label) out.render.add_outputs("albedo");
    out.render.add_outputs("z_depth");
  }
  out.render.set_width(width);
  out.render.set_height(height);
  GOBO_TRY(readCamera(form, *out.render.mutable_camera()));
  if (out.image == Image::Depth || fields.count("min_depth")) { GOBO_ASSIGN(out.minDepth, form.number("min_depth", 0, 1e9, false, "from 0 to 1e9 m")); }
  if (out.image == Image::Depth || fields.count("max_depth")) {
    GOBO_ASSIGN(out.maxDepth, form.number("max_depth", out.minDepth, 1e9, true, "above min_depth, and at most 1e9 m"));
  }
  GOBO_TRY(form.rest());
  return out;
}

GltfRenderer::GltfRenderer(const std::shared_ptr<grpc::Channel>& channel, uint64_t sceneBytes)
    : sceneBytes_(std::min(sceneBytes, kSceneBytes)),
      forms_(kHeldBytes),
      pictures_(kHeldBytes),
      scenes_(v1::Scenes::NewStub(channel)),
      render_(v1::Render::NewStub(channel)) {}

GltfAnswer GltfRenderer::admit(const GltfCaller& caller) {
  UpstreamCall call(caller.gone);
  caller.dress(call.context);
  v1::ListScenesReply reply;
  const grpc::Status status = callOnce(
      call, [&](auto* context, auto* queue) { return scenes_->AsyncList(context, v1::ListScenesRequest(), queue); }, reply);
  return status.ok() ? GltfAnswer() : refusal(status, retryOf(call.context));
}

std::string GltfRenderer::knownScene(const GltfCaller& caller, const std::string& sha256) {
  const std::lock_guard lock(mutex_);
  for (Caller& c : callers_) {
    if (c.key != caller.key) continue;
    for (auto at = c.scenes.begin(); at != c.scenes.end(); ++at) {
      if (at->sha256 != sha256) continue;
      c.scenes.splice(c.scenes.begin(), c.scenes, at);
      return c.scenes.front().id;
    }
  }
  return {};
}

void GltfRenderer::forget(const GltfCaller& caller, const std::string& id) {
  const std::lock_guard lock(mutex_);
  for (Caller& c : callers_)
    if (c.key == caller.key) c.scenes.remove_if([&](const Known& k) { return k.id == id; });
}

void GltfRenderer::remember(const GltfCaller& caller, const std::string& sha256, const std::string& id) {
  std::string gone;
  {
    const std::lock_guard lock(mutex_);
    auto at = std::find_if(callers_.begin(), callers_.end(), [&](const Caller& c) { return c.key == caller.key; });
    if (at == callers_.end()) at = callers_.insert(callers_.begin(), Caller{caller.key, {}});
    callers_.splice(callers_.begin(), callers_, at);
    if (callers_.size() > kCallers) callers_.pop_back();  // the service's own bound takes their scenes
    callers_.front().scenes.push_front({sha256, id});
    if (callers_.front().scenes.size() > kScenes) {
      gone = callers_.front().scenes.back().id;
      callers_.front().scenes.pop_back();
    }
  }
  if (!gone.empty()) unload(caller, gone);
}

void GltfRenderer::unload(const GltfCaller& caller, const std::string& id) {
  UpstreamCall call([] { return false; });
  caller.dress(call.context);
  v1::UnloadSceneRequest request;
  request.set_scene(id);
  v1::UnloadSceneReply reply;
  callOnce(
      call, [&](auto* context, auto* queue) { return scenes_->AsyncUnload(context, request, queue); }, reply);
}

grpc::Status GltfRenderer::upload(const GltfCaller& caller, const GltfForm& form, v1::SceneInfo& info, long& retrySeconds) {
  UpstreamCall call(caller.gone);
  caller.dress(call.context);
  const std::string& scene = form.scene();
  auto writer = scenes_->PrepareAsyncUpload(&call.context, &info, &call.queue);
  writer->StartCall(nullptr);
  call.wait();  // however it ended: Finish has the status
  v1::UploadSceneRequest message;
  // A name of its own: one that somebody loaded by hand is not this door's to unload.
  message.set_name("render-" + form.sceneSha256().substr(0, 16) + "-" + randomHex(4).value_or("0"));
  message.set_extension(scene.compare(0, 4, "glTF") == 0 ? ".glb" : ".gltf");
  message.set_total_bytes(scene.size());
  message.set_sha256(form.sceneSha256());
  bool taken = true;
  for (size_t at = 0; taken && at < scene.size(); at += kPiece) {
    message.set_data(scene.substr(at, kPiece));
    writer->Write(message, nullptr);
    taken = call.wait() == Upstream::Event;
    message.Clear();
  }
  if (taken) {
    writer->WritesDone(nullptr);
    call.wait();
  }
  grpc::Status status;
  writer->Finish(&status, nullptr);
  call.wait();
  retrySeconds = retryOf(call.context);
  return status;
}

// The scene's id at the service; a status other than 200: why there is none.
GltfAnswer GltfRenderer::loaded(const GltfCaller& caller, const GltfForm& form, std::string& id) {
  const std::string& sha256 = form.sceneSha256();
  if (id = knownScene(caller, sha256); !id.empty()) return {};
  std::unique_lock turn(uploading_, std::defer_lock);
  while (!turn.try_lock_for(Door::kPoll))
    if (caller.gone()) return refusal(Status(Code::Cancelled, "the client has gone"));
  if (id = knownScene(caller, sha256); !id.empty()) return {};  // another one of the same file was first
  v1::SceneInfo info;
  grpc::Status status;
  long retrySeconds = 0;
  const auto begun = std::chrono::steady_clock::now();
  do {
    status = upload(caller, form, info, retrySeconds);
    if (!isPassing(status, retrySeconds)) break;
    std::this_thread::sleep_for(Door::kPoll);
  } while (!caller.gone() && std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count() < kPatience);
  if (!status.ok()) {
    GltfAnswer answer = refusal(status, retrySeconds);
    answer.body = "scene: " + answer.body;
    if (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && retrySeconds == 0) answer.status = MHD_HTTP_CONTENT_TOO_LARGE;
    return answer;
  }
  id = info.id();
  remember(caller, sha256, id);
  return {};
}

grpc::Status GltfRenderer::pictures(const GltfCaller& caller, const v1::RenderRequest& request, Pictures& out, long& retrySeconds) {
  RenderStream stream(caller.gone, false);
  caller.dress(stream.context());
  const grpc::Status begun = stream.begin([&](auto* context, auto* queue) { return render_->PrepareAsyncRender(context, request, queue); });
  if (!begun.ok()) {
    retrySeconds = retryOf(stream.context());
    return begun;
  }
  out.head = stream.head();
  uint64_t expected = 0;
  for (const v1::ImageDescriptor& image : out.head.images()) expected += image.bytes();
  out.bytes.resize(expected);
  uint64_t at = 0;
  for (ssize_t n; at < expected && (n = stream.read(out.bytes.data() + at, expected - at)) > 0;) at += uint64_t(n);
  if (at == expected) return grpc::Status::OK;
  return caller.gone() ? grpc::Status(grpc::StatusCode::CANCELLED, "the client has gone")
                       : grpc::Status(grpc::StatusCode::INTERNAL, "the service's picture broke off");
}

GltfAnswer GltfRenderer::encoded(const GltfRequest& request, Pictures& made) {
  GltfAnswer answer;
  const size_t pixels = size_t(request.render.width()) * request.render.height();
  const auto isRaw = [&](int i, size_t channels) {
    return i < made.head.images_size() && made.head.images(i).format() == v1::Encoding::RAW_FLOAT && made.head.images(i).bytes() == 4 * channels * pixels;
  };
  const int width = int(request.render.width()), height = int(request.render.height());
  switch (request.image) {
    case GltfRequest::Image::Color:
      answer.type = "image/png";
      answer.body = std::move(made.bytes);
      return answer;
    case GltfRequest::Image::Depth: {
      if (!isRaw(0, 1)) break;
      std::vector<float> depth(pixels);
      std::memcpy(depth.data(), made.bytes.data(), 4 * pixels);
      made.bytes = {};
      toSensorDepth(depth, request.minDepth, request.maxDepth);
      answer.type = "image/tiff";
      answer.body = depthTiff(width, height, depth);
      return answer;
    }
    case GltfRequest::Image::Label: {
      if (!isRaw(0, 3) || !isRaw(1, 1)) break;
      std::vector<float> colours(3 * pixels), depth(pixels);
      std::memcpy(colours.data(), made.bytes.data(), 12 * pixels);
      std::memcpy(depth.data(), made.bytes.data() + 12 * pixels, 4 * pixels);
      made.bytes = {};
      const auto png = labelPng(width, height, colours, depth);
      if (!png.ok()) return refusal(png.status());
      answer.type = "image/png";
      answer.body.assign(png->begin(), png->end());
      return answer;
    }
  }
  return refusal(Status(Code::Internal, "the service's picture is not what was asked for"));
}

GltfAnswer GltfRenderer::render(const GltfCaller& caller, GltfForm& form, const std::string& extra) {
  if (const Status whole = form.finish(); !whole.ok()) {
    GltfAnswer answer = refusal(whole);
    if (whole.code() == Code::ResourceExhausted) answer.status = MHD_HTTP_CONTENT_TOO_LARGE;
    return answer;
  }
  auto request = gltfRequestOf(form.fields(), extra);
  if (!request.ok()) return refusal(Status(request.status().code(), request.status().message()));
  if (!form.hasScene() || form.scene().empty()) return refusal(invalidArgument("scene: is missing in the form, or has no bytes"));
  std::string said = form.fields().at("scene_sha256");
  std::transform(said.begin(), said.end(), said.begin(), [](unsigned char c) { return char(c >= 'A' && c <= 'Z' ? c + 32 : c); });
  if (said != form.sceneSha256()) return refusal(invalidArgument(shownValue("scene_sha256", said) + ": the scene that arrived has " + form.sceneSha256()));
  const uint64_t pixels = uint64_t(request->render.width()) * request->render.height();
  if (pixels > kPixels)
    return refusal(invalidArgument(strf("width x height = %llu: must be at most %llu pixels", (unsigned long long)pixels, (unsigned long long)kPixels)));
  const auto held = pictures_.take(caller.key, pixels * (request->image == GltfRequest::Image::Label ? 48 : 12));
  if (!held) return refusal(Status(Code::ResourceExhausted, "pictures are being made that need the memory; ask again"), 1);
  for (int tried = 1;; ++tried) {
    std::string id;
    if (GltfAnswer refused = loaded(caller, form, id); refused.status != MHD_HTTP_OK) return refused;
    request->render.set_scene(id);
    Pictures made;
    long retrySeconds = 0;
    const grpc::Status status = pictures(caller, request->render, made, retrySeconds);
    if (status.ok()) return encoded(*request, made);
    const bool lost = status.error_code() == grpc::StatusCode::NOT_FOUND;
    if (lost) forget(caller, id);
    if (!lost || tried == kTries) return refusal(status, retrySeconds);
  }
}

}  // namespace gobo
