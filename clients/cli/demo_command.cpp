// SPDX-License-Identifier: Apache-2.0
// `gobo demo`: renders a scene, relights it in the ways that users relight, and prints what each edit cost and how far the
// picture is from the path-traced truth.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <utility>

#include "blobs.h"
#include "commands.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"
#include "turning_map.h"

namespace gobo::cli {

namespace {

namespace fs = std::filesystem;

struct Step {
  std::string name;
  std::vector<std::string> sets;
};

std::string number(double v) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", v);
  return text;
}
std::string triple(double x, double y, double z) { return number(x) + "," + number(y) + "," + number(z); }

/// A key light above the middle of the scene, sized by its bounds.
std::vector<std::string> keyLight(const v1::SceneInfo& info) {
  const auto &lo = info.bounds_min(), &hi = info.bounds_max();
  const double dx = hi.x() - lo.x(), dy = hi.y() - lo.y(), dz = hi.z() - lo.z();
  const double reach = std::max(std::min({dx, dy, dz}), 0.05 * std::max({dx, dy, dz}));
  const double cx = 0.5 * (lo.x() + hi.x()), cz = 0.5 * (lo.z() + hi.z()), y = lo.y() + 0.75 * dy;
  return {"lights.key.kind=RECT",
          "lights.key.position=" + triple(cx + 0.12 * dx, y, cz + 0.12 * dz),
          "lights.key.direction=0,-1,0",
          "lights.key.width=" + number(0.15 * reach),
          "lights.key.height=" + number(0.15 * reach),
          "lights.key.intensity=60",
          "lights.key.shadow.axis_aligned.k=3"};
}

std::string ranList(const v1::RenderReply& reply) {
  std::string text;
  for (const auto& n : reply.plan()) {
    if (n.state() != v1::NodeReport::RUN || n.node().find(":mean") != std::string::npos) continue;
    text += (text.empty() ? "" : " ") + n.node() + (n.reason().rfind("extended", 0) == 0 ? "(" + n.reason() + ")" : "");
  }
  return text.empty() ? "nothing" : text;
}

/// What one sees while a step renders: a bar, or lines where standard error is no terminal; the first picture of all as soon as it is there.
class Watcher {
 public:
  explicit Watcher(std::string folder) : folder_(std::move(folder)) {}
  StreamHooks hooks(const std::string& step) {
    bar_ = std::make_unique<ProgressBar>(true, true);
    StreamHooks hooks;
    hooks.progress = [this, step](const v1::Progress& p) {
      const std::string text = step + ": " + progressText(p);
      if (p.queued() || p.eta_ms() <= 0) bar_->wait(p.queued() ? text : step);
      else bar_->show(p.elapsed_ms() / (p.elapsed_ms() + p.eta_ms()), text);
    };
    hooks.snapshot = [this](const Answer& answer) -> Status { return first(answer); };
    return hooks;
  }
  Status first(const Answer& answer) {
    if (bar_) bar_->clear();
    if (std::exchange(seen_, true)) return {};
    std::string files;
    if (!folder_.empty()) {
      GOBO_ASSIGN(const std::vector<std::string> written, writeImages(answer, (fs::path(folder_) / "first.png").string()));
      for (const std::string& file : written) files += ": " + file;
    }
    std::fprintf(stderr, "first picture (%u x %u) %.2f s after the demo began%s\n", answer.reply.images(0).width(), answer.reply.images(0).height(),
                 std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count(), files.c_str());
    return {};
  }
  void clear() { bar_.reset(); }

 private:
  const std::string folder_;
  const std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  bool seen_ = false;
  std::unique_ptr<ProgressBar> bar_;
};

Status write(Session& session, v1::RenderRequest request, const std::string& file) {
  GOBO_ASSIGN(const v1::Encoding::Format format, formatOf(file));
  request.mutable_encoding()->set_format(format);
  request.clear_certificate();
  GOBO_ASSIGN(const Answer answer, renderOnce(session, request));
  return writeImages(answer, file).status();
}

Status demo(Session& session, const DemoCommand& c) {
  Watcher watcher(c.out);
  GOBO_ASSIGN(v1::RenderRequest request, makeRequest(session, c.request, c.scene));
  const std::string id = request.scene();
  v1::InspectSceneRequest inspect;
  inspect.set_scene(id);
  v1::SceneInfo info;
  {
    Session::Call call(session);
    GOBO_TRY(session.statusOf(session.scenes().Inspect(&call.context, inspect, &info)));
  }
  std::printf("scene %s: %llu triangles, %d lights, loaded in %.0f ms\n\n", id.c_str(), static_cast<unsigned long long>(info.triangles()), info.lights_size(),
              info.load_ms());

  if (c.request.size.empty()) {
    request.set_width(640);
    request.set_height(400);
  }
  if (!request.has_halt()) request.mutable_halt()->set_spp(64);
  if (!request.has_certificate()) request.mutable_certificate();
  const bool ownKey = std::any_of(info.lights().begin(), info.lights().end(), [](const auto& l) { return l.name() == "key"; });
  if (!ownKey)
    for (const std::string& s : keyLight(info)) GOBO_TRY(setPath(request, s));
  else GOBO_TRY(setPath(request, "lights.key.shadow.axis_aligned.k=3"));
  std::vector<std::string> moved;
  for (const auto& l : info.lights())
    if (l.name() == "key") moved = {"lights.key.position=" + triple(l.position().x() * 0.9 + 0.1, l.position().y(), l.position().z() * 0.9)};
  if (!ownKey) {
    const auto& p = request.lights().at("key").position();
    moved = {"lights.key.position=" + triple(p.x() - 0.2 * (info.bounds_max().x() - info.bounds_min().x()), p.y(), p.z())};
  }
  // Another environment: the user's map if one is given (the first pictures then use the scene's own or the sky).
  std::vector<std::string> environment{"environment.sky.sun_direction=0.5,0.35,-0.6"};
  if (!c.request.environment.empty()) {
    environment = {request.environment().has_digest() ? "environment.digest=" + request.environment().digest()
                                                      : "environment.path=" + request.environment().path()};
    request.clear_environment();
  }

  const std::vector<Step> steps{
      {"render", {}},
      {"same again", {}},
      {"light colour", {"lights.key.color=1,0.5,0.25"}},
      {"light moved", moved},
      {"environment", environment},
      {"exposure", {"tone_map.exposure=1"}},
      {"filter k=2", {"lights.key.shadow.axis_aligned.k=2"}},
      {"twice the samples", {"halt.spp=" + std::to_string(2 * std::max(16u, request.halt().spp()))}},
      {"without noise", {"denoise=auto"}},
  };
  std::vector<std::vector<std::string>> rows;
  std::string renderId;
  for (size_t i = 0; i < steps.size(); ++i) {
    v1::RelightRequest relight;
    relight.set_render_id(renderId);
    for (const std::string& s : steps[i].sets) {
      if (s.rfind("environment.", 0) == 0) request.clear_environment();
      GOBO_TRY(setPath(request, s));
      GOBO_TRY(setPath(*relight.mutable_patch(), s));
    }
    for (const std::string& p : setPaths(relight.patch())) relight.add_mask(p.rfind("environment.", 0) == 0 ? "environment" : p);
    // The first one is looked at while it comes; the others need no early pictures.
    request.mutable_encoding()->set_format(i == 0 ? v1::Encoding::PNG : v1::Encoding::RAW_FLOAT);
    request.mutable_scheduling()->set_ladder(i == 0);
    v1::RenderReply reply;
    if (i < 2) {
      GOBO_ASSIGN(const Answer answer, renderOnce(session, request, watcher.hooks(steps[i].name)));
      GOBO_TRY(watcher.first(answer));
      reply = answer.reply;
    } else {
      Session::Call call(session);
      relight.set_progressive(true);
      auto reader = session.render().Relight(&call.context, relight);
      GOBO_ASSIGN(const Answer answer, receive(session, call, *reader, watcher.hooks(steps[i].name)));
      reply = answer.reply;
    }
    watcher.clear();
    renderId = reply.render_id();
    int reused = 0;
    for (const auto& n : reply.plan()) reused += n.state() == v1::NodeReport::REUSED || n.state() == v1::NodeReport::NOT_NEEDED;
    const auto& q = reply.certificate();
    char ms[32], error[64];
    std::snprintf(ms, sizeof ms, "%.1f", reply.total_ms() - q.ms());
    std::snprintf(error, sizeof error, "%.4f +- %.4f", q.rmse(), q.standard_error());
    rows.push_back({steps[i].name, ms, std::to_string(reply.rays()), error, std::to_string(reused), ranList(reply)});
    if (!c.out.empty()) {
      char stem[64];
      std::snprintf(stem, sizeof stem, "%zu-", i);
      std::string name = steps[i].name;
      for (char& ch : name)
        if (ch == ' ' || ch == '=') ch = '-';
      const std::string base = (fs::path(c.out) / (stem + name)).string();
      GOBO_TRY(write(session, request, base + ".exr"));
      GOBO_TRY(write(session, request, base + ".png"));
    }
    for (const std::string& w : reply.warnings()) std::fprintf(stderr, "note: %s\n", w.c_str());
  }
  printTable({"request", "ms", "rays", "RMSE +- standard error", "kept", "ran"}, rows, {false, true, true, true, true, false});
  std::printf("\nms and rays are without the certificate that measures RMSE against the path-traced reference (docs/certificate.md).\n");
  GOBO_TRY(turnMap(session, info, request, c.out));
  if (!c.out.empty())
    std::printf("EXR and PNG of every row are in %s, with turning-map.png (an animation) and the plan of each of its pictures\n", c.out.c_str());
  return {};
}

}  // namespace

int runDemo(const SessionOptions& options, const DemoCommand& command) {
  std::error_code error;
  if (!command.out.empty()) fs::create_directories(command.out, error);
  if (error) return complain(invalidArgument("-o " + command.out + ": " + error.message()));
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = demo(**session, command);
  return status.ok() ? kOk : complain(status);
}

}  // namespace gobo::cli
