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
inline namespace door {

namespace {

constexpr double kPatience = 30;                             // seconds that an upload waits for its place among others
constexpr double kUnloadSeconds = 5;                         // that one may wait for the end of a scene that it does not need
constexpr uint32_t kSamples = 16;                            // of a colour picture whose caller says nothing
constexpr size_t kPiece = 1 << 20;                           // of an upload
constexpr uint64_t kPixelBytes = 12, kLabelPixelBytes = 48;  // at most at once, of a picture as it came, as floats and encoded
static_assert(GltfRenderer::kPixels * kPixelBytes <= GltfRenderer::kHeldBytes && GltfRenderer::kLabelPixels * kLabelPixelBytes <= GltfRenderer::kHeldBytes);
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

GltfAnswer refusal(const grpc::Status& status, long retryMs) {
  GltfAnswer answer;
  answer.status = httpStatusOf(status.error_code());
  answer.type = kText;
  answer.body = status.error_message() + "\n";
  answer.retrySeconds = wholeSeconds(retryMs);
  return answer;
}
GltfAnswer refusal(const Status& status, long retryMs = 0) { return refusal(toGrpc(status), retryMs); }

// Of refusals that time mends, but for the caller's own rate, whose waiting is the caller's.
bool isPassing(const grpc::Status& status, long retryMs) {
  return status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && retryMs > 0 &&
         status.error_message().find("tokens.requests_per_s") == std::string::npos;
}

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

GltfRenderer::GltfRenderer(const std::shared_ptr<grpc::Channel>& channel, std::function<uint64_t()> sceneBytes)
    : sceneBytes_(std::move(sceneBytes)),
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
  return status.ok() ? GltfAnswer() : refusal(status, retryMsOf(call.context));
}

// With mutex_.
std::string GltfRenderer::knownScene(const std::string& key, const std::string& sha256) {
  const auto caller = std::find_if(callers_.begin(), callers_.end(), [&](const Caller& c) { return c.key == key; });
  if (caller == callers_.end()) return {};
  callers_.splice(callers_.begin(), callers_, caller);
  std::list<Known>& scenes = callers_.front().scenes;
  const auto scene = std::find_if(scenes.begin(), scenes.end(), [&](const Known& k) { return k.sha256 == sha256; });
  if (scene == scenes.end()) return {};
  scenes.splice(scenes.begin(), scenes, scene);
  return scenes.front().id;
}

// Known: the file is loaded, as `id`. Mine: this one is to upload it, then to call endTurn().
GltfRenderer::Turn GltfRenderer::takeTurn(const GltfCaller& caller, const std::string& sha256, std::string& id) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (id = knownScene(caller.key, sha256); !id.empty()) return Turn::Known;
    if (uploading_.emplace(caller.key, sha256).second) return Turn::Mine;
    turns_.wait_for(lock, Door::kPoll);
    if (caller.gone()) return Turn::Gone;
  }
}

void GltfRenderer::endTurn(const GltfCaller& caller, const std::string& sha256) {
  const std::lock_guard lock(mutex_);
  uploading_.erase({caller.key, sha256});
  turns_.notify_all();
}

void GltfRenderer::forget(const GltfCaller& caller, const std::string& id) {
  const std::lock_guard lock(mutex_);
  for (Caller& c : callers_)
    if (c.key == caller.key) c.scenes.remove_if([&](const Known& k) { return k.id == id; });
}

// Those that had to go for it: to be unloaded.
std::list<GltfRenderer::Loaded> GltfRenderer::remember(const GltfCaller& caller, const std::string& sha256, const std::string& id) {
  const std::lock_guard lock(mutex_);
  std::list<Loaded> gone;
  auto at = std::find_if(callers_.begin(), callers_.end(), [&](const Caller& c) { return c.key == caller.key; });
  if (at == callers_.end()) at = callers_.insert(callers_.begin(), Caller{caller.key, {}, {}});
  callers_.splice(callers_.begin(), callers_, at);
  Caller& mine = callers_.front();
  mine.dress = caller.dress;
  mine.scenes.push_front({sha256, id});
  if (mine.scenes.size() > kScenes) {
    gone.push_back({mine.key, mine.scenes.back().id, mine.dress});
    mine.scenes.pop_back();
  }
  if (callers_.size() > kCallers) {
    for (const Known& k : callers_.back().scenes) gone.push_back({callers_.back().key, k.id, callers_.back().dress});
    callers_.pop_back();
  }
  return gone;
}

// Under the rights of who loaded it. What fails here the service's own bound takes in time.
void GltfRenderer::unload(const GltfCaller& caller, const Loaded& scene) {
  UpstreamCall call(caller.stopping);  // also when the client has hung up: nobody else would
  scene.dress(call.context);
  call.context.set_deadline(std::chrono::system_clock::now() +
                            std::chrono::duration_cast<std::chrono::milliseconds>(std::chrono::duration<double>(kUnloadSeconds)));
  v1::UnloadSceneRequest request;
  request.set_scene(scene.id);
  v1::UnloadSceneReply reply;
  callOnce(
      call, [&](auto* context, auto* queue) { return scenes_->AsyncUnload(context, request, queue); }, reply);
}

// NOT_FOUND: the service has no such scene.
grpc::Status GltfRenderer::exists(const GltfCaller& caller, const std::string& id, long& retryMs) {
  UpstreamCall call(caller.gone);
  caller.dress(call.context);
  v1::InspectSceneRequest request;
  request.set_scene(id);
  v1::SceneInfo info;
  const grpc::Status status = callOnce(
      call, [&](auto* context, auto* queue) { return scenes_->AsyncInspect(context, request, queue); }, info);
  retryMs = retryMsOf(call.context);
  return status;
}

grpc::Status GltfRenderer::upload(const GltfCaller& caller, const GltfForm& form, v1::SceneInfo& info, long& retryMs) {
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
  retryMs = retryMsOf(call.context);
  return status;
}

// The scene's id at the service; a status other than 200: why there is none. The form's bytes go once they are uploaded; those of a scene that was known
// stay, as it may have gone meanwhile.
GltfAnswer GltfRenderer::loaded(const GltfCaller& caller, GltfForm& form, std::string& id) {
  using Clock = std::chrono::steady_clock;
  const std::string& sha256 = form.sceneSha256();
  const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(kPatience));
  for (;;) {
    switch (takeTurn(caller, sha256, id)) {
      case Turn::Known: return {};
      case Turn::Gone: return refusal(Status(Code::Cancelled, "the client has gone"));
      case Turn::Mine: break;
    }
    v1::SceneInfo info;
    grpc::Status status;
    long retryMs = 0;
    std::list<Loaded> gone;
    {
      struct TurnEnd {
        GltfRenderer& renderer;
        const GltfCaller& caller;
        const std::string& sha256;
        ~TurnEnd() { renderer.endTurn(caller, sha256); }
      } turnEnd{*this, caller, sha256};
      status = upload(caller, form, info, retryMs);
      if (status.ok()) gone = remember(caller, sha256, id = info.id());
    }
    if (status.ok()) {
      form.dropScene();
      for (const Loaded& scene : gone) unload(caller, scene);
      return {};
    }
    const auto next = Clock::now() + std::chrono::milliseconds(retryMs);
    if (!isPassing(status, retryMs) || next > end) {
      GltfAnswer answer = refusal(status, retryMs);
      answer.body = "scene: " + answer.body;
      if (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED && retryMs == 0) answer.status = MHD_HTTP_CONTENT_TOO_LARGE;
      if (status.error_code() == grpc::StatusCode::NOT_FOUND) answer.status = MHD_HTTP_BAD_REQUEST;  // a file that the scene names
      return answer;
    }
    while (Clock::now() < next) {
      if (caller.gone()) return refusal(Status(Code::Cancelled, "the client has gone"));
      std::this_thread::sleep_for(Door::kPoll);
    }
  }
}

grpc::Status GltfRenderer::pictures(const GltfCaller& caller, const v1::RenderRequest& request, Pictures& out, long& retryMs) {
  RenderStream stream(caller.gone, false);
  caller.dress(stream.context());
  const grpc::Status begun = stream.begin([&](auto* context, auto* queue) { return render_->PrepareAsyncRender(context, request, queue); });
  if (!begun.ok()) {
    retryMs = retryMsOf(stream.context());
    return begun;
  }
  out.head = stream.head();
  uint64_t expected = 0;
  for (const v1::ImageDescriptor& image : out.head.images()) expected += image.bytes();
  out.bytes.resize(expected);
  uint64_t at = 0;
  for (ssize_t n; at < expected && (n = stream.read(out.bytes.data() + at, expected - at)) > 0;) at += uint64_t(n);
  char more = 0;
  if (at == expected && stream.read(&more, 1) == 0) return grpc::Status::OK;  // to the call's own end: it was not cancelled, and ended well
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
    GltfAnswer answer = refusal(Status(whole.code(), whole.message()));
    if (whole.code() == Code::ResourceExhausted) answer.status = MHD_HTTP_CONTENT_TOO_LARGE;
    return answer;
  }
  auto request = gltfRequestOf(form.fields(), extra);
  if (!request.ok()) return refusal(Status(request.status().code(), request.status().message()));
  if (!form.hasScene() || form.scene().empty()) return refusal(invalidArgument("scene: is missing in the form, or has no bytes"));
  std::string said = form.fields().at("scene_sha256");
  std::transform(said.begin(), said.end(), said.begin(), [](unsigned char c) { return char(c >= 'A' && c <= 'Z' ? c + 32 : c); });
  if (said != form.sceneSha256()) return refusal(invalidArgument(shownValue("scene_sha256", said) + ": the scene that arrived has " + form.sceneSha256()));
  const bool label = request->image == GltfRequest::Image::Label;
  const uint64_t pixels = uint64_t(request->render.width()) * request->render.height(), mostPixels = label ? kLabelPixels : kPixels;
  if (pixels > mostPixels)
    return refusal(invalidArgument(strf("width x height = %llu: must be at most %llu pixels%s", (unsigned long long)pixels, (unsigned long long)mostPixels,
                                        label ? " in a picture of labels" : "")));
  auto held = pictures_.take(caller.key, pixels * (label ? kLabelPixelBytes : kPixelBytes));
  if (!held) return refusal(Status(Code::ResourceExhausted, "pictures are being made or fetched that need the memory; ask again"), 1000);
  for (;;) {
    std::string id;
    if (GltfAnswer refused = loaded(caller, form, id); refused.status != MHD_HTTP_OK) return refused;
    request->render.set_scene(id);
    Pictures made;
    long retryMs = 0;
    const grpc::Status status = pictures(caller, request->render, made, retryMs);
    if (status.ok()) {
      GltfAnswer answer = encoded(*request, made);
      answer.held = std::move(held);
      return answer;
    }
    if (status.error_code() != grpc::StatusCode::NOT_FOUND) return refusal(status, retryMs);
    // The scene, or something that the request names (a camera, a variant, a light)?
    const grpc::Status there = exists(caller, id, retryMs);
    if (there.ok()) return refusal(grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, status.error_message()), 0);
    if (there.error_code() != grpc::StatusCode::NOT_FOUND) return refusal(there, retryMs);
    forget(caller, id);
    if (form.scene().empty()) return refusal(Status(Code::Unavailable, "scene: had to go for others' memory before its picture was there; ask again"), 1000);
  }
}

}  // namespace door
}  // namespace gobo
