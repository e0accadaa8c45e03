// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"
#include "tiles.h"

namespace gobo::cli {

namespace fs = std::filesystem;

namespace {

/// "lights.key.position=0:0/1/2,1.5:3/1/2;SMOOTH".
Status addCurve(v1::RenderRequest& request, const std::string& text) {
  const auto refuse = [&](const std::string& what) { return invalidArgument("--curve " + text + ": " + what); };
  const size_t equals = text.find('='), semicolon = text.find(';');
  if (equals == std::string::npos || equals == 0) return refuse("must be PATH=TIME:VALUE,TIME:VALUE");
  v1::Curve curve;
  if (semicolon != std::string::npos) {
    v1::Curve::Interpolation how = v1::Curve::INTERPOLATION_UNSPECIFIED;
    if (!v1::Curve::Interpolation_Parse(text.substr(semicolon + 1), &how)) return refuse("after ';' comes LINEAR, STEP or SMOOTH");
    curve.set_interpolation(how);
  }
  const std::string keys = text.substr(equals + 1, semicolon == std::string::npos ? semicolon : semicolon - equals - 1);
  const char* at = keys.c_str();
  const auto number = [&](double& out) {
    char* end = nullptr;
    out = std::strtod(at, &end);
    const bool any = end != at;
    at = end;
    return any;
  };
  for (double v = 0;; ++at) {
    if (!number(v) || *at != ':') return refuse("\"" + keys + "\" is not TIME:VALUE,TIME:VALUE");
    curve.add_time_s(v);
    do {
      ++at;
      if (!number(v)) return refuse("\"" + keys + "\" is not TIME:VALUE,TIME:VALUE");
      curve.add_value(v);
    } while (*at == '/');
    if (*at == 0) break;
    if (*at != ',') return refuse("\"" + keys + "\" is not TIME:VALUE,TIME:VALUE");
  }
  (*request.mutable_curves())[text.substr(0, equals)] = curve;
  return {};
}

/// A file's text, or what standard input has for "-".
Result<std::string> requestText(const std::string& file) {
  constexpr size_t kMost = 16 << 20;
  if (file != "-") {
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(file, kMost));
    return std::string(bytes.begin(), bytes.end());
  }
  std::string text;
  char piece[65536];
  while (const size_t n = std::fread(piece, 1, sizeof piece, stdin)) {
    text.append(piece, n);
    if (text.size() > kMost) return invalidArgument("--request -: more than 16 MiB");
  }
  return text;
}

}  // namespace

Result<v1::RenderRequest> makeRequest(const RequestOptions& o, const std::string& sceneId) {
  v1::RenderRequest request;
  if (!o.file.empty()) {
    GOBO_ASSIGN(const std::string text, requestText(o.file));
    GOBO_TRY(messageFromJson(text, request, o.file == "-" ? "standard input" : o.file));
  }
  if (!sceneId.empty()) request.set_scene(sceneId);
  if (!o.camera.empty()) request.mutable_camera()->set_name(o.camera);
  if (!o.size.empty()) {
    unsigned w = 0, h = 0;
    char tail;
    if (sscanf(o.size.c_str(), "%ux%u%c", &w, &h, &tail) != 2) return invalidArgument("--size " + o.size + ": must be WIDTHxHEIGHT, such as 640x480");
    request.set_width(w);
    request.set_height(h);
  }
  if (!o.environment.empty()) {
    std::error_code error;
    const bool file = fs::is_regular_file(o.environment, error);
    request.mutable_environment()->set_path(file ? fs::absolute(o.environment).string() : o.environment);
  }
  if (!o.outputs.empty()) GOBO_TRY(setPath(request, "outputs=" + o.outputs));
  if (o.spp) request.mutable_halt()->set_spp(o.spp);
  if (o.time > 0) request.mutable_halt()->set_time_s(o.time);
  if (o.error > 0) request.mutable_halt()->set_error(o.error);
  if (o.certificate) request.mutable_certificate();
  if (o.half) request.mutable_encoding()->set_half(true);
  if (o.layers) request.mutable_encoding()->set_layers(true);
  if (!o.priority.empty()) GOBO_TRY(setPath(request, "scheduling.priority=" + o.priority));
  if (o.deadlineMs > 0) request.mutable_scheduling()->set_deadline_ms(o.deadlineMs);
  for (const std::string& set : o.sets) GOBO_TRY(setPath(request, set));
  for (const std::string& curve : o.curves) GOBO_TRY(addCurve(request, curve));
  if (request.scene().empty()) return invalidArgument("no scene: name one, or put it into --request");
  return request;
}

namespace {

// Where the pictures go is checked before anything is rendered.
Status checkOut(const std::string& out) {
  if (out.empty() || out == "-") return {};
  GOBO_TRY(formatOf(out).status());
  const fs::path parent = fs::path(out).parent_path();
  std::error_code error;
  if (!parent.empty() && !fs::is_directory(parent, error)) return notFound("-o " + out + ": folder \"" + parent.string() + "\" does not exist");
  return {};
}

Status setEncoding(v1::RenderRequest& request, const std::string& out) {
  if (out.empty()) {
    request.mutable_encoding()->set_format(v1::Encoding::RAW_HALF);  // nothing is written: the cheapest to carry
    request.mutable_encoding()->clear_layers();
    return {};
  }
  if (out == "-") {  // as the request says
    if (request.outputs_size() > 1 && !request.encoding().layers())
      return invalidArgument("-o -: writes one picture, not " + std::to_string(request.outputs_size()));
    return {};
  }
  GOBO_ASSIGN(v1::Encoding::Format format, formatOf(out));
  if (format == v1::Encoding::RAW_FLOAT && request.encoding().half()) format = v1::Encoding::RAW_HALF;
  request.mutable_encoding()->set_format(format);
  return {};
}

/// One picture to standard output, and what there is to say to standard error.
Status deliverToPipe(const Answer& answer, bool json, bool quiet) {
  if (answer.images.size() != 1) return invalidArgument("-o -: writes one picture, not " + std::to_string(answer.images.size()));
  const std::string& bytes = answer.images[0];
  if (std::fwrite(bytes.data(), 1, bytes.size(), stdout) != bytes.size() || std::fflush(stdout) != 0)
    return internalError("cannot write the picture", "standard output");
  if (json) std::fprintf(stderr, "%s\n", messageToJson(answer.reply, true).c_str());
  else if (!quiet)
    for (const std::string& w : answer.reply.warnings()) std::fprintf(stderr, "warning: %s\n", w.c_str());
  return {};
}

Status deliver(const Answer& answer, const std::string& out, bool json, bool quiet) {
  if (out == "-") return deliverToPipe(answer, json, quiet);
  std::vector<std::string> files;
  if (!out.empty()) { GOBO_ASSIGN(files, writeImages(answer, out)); }
  if (json) std::printf("%s\n", messageToJson(answer.reply, true).c_str());
  else if (!quiet) printReply(answer.reply, files);
  return {};
}

uint32_t samplesOf(const v1::RenderReply& reply) {
  uint32_t samples = 0;
  for (const v1::NodeReport& n : reply.plan()) samples = std::max(samples, n.samples());
  return samples;
}

/// Share of the whole render that is done. The server reports the fraction of a pass of 16 samples; what ends the render is
/// known here. Never goes back.
class Advance {
 public:
  explicit Advance(const v1::Halt& halt) : halt_(halt) {}
  double to(uint32_t spp, double fraction) {
    constexpr double pass = 16, defaultSpp = 64;
    double done = fraction;
    if (halt_.has_time_s()) done = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun_).count() / halt_.time_s();
    else if (halt_.has_error()) done = 0;  // nobody knows
    else if (spp > 0) done = (spp - pass * (1 - fraction)) / (halt_.has_spp() ? halt_.spp() : defaultSpp);
    return shown_ = std::max(shown_, std::min(done, 1.0));
  }

 private:
  const v1::Halt halt_;
  const std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
  double shown_ = 0;
};

Status render(Session& session, const RenderCommand& c) {
  std::string id;
  if (!c.scene.empty()) { GOBO_ASSIGN(id, ensureScene(session, c.scene)); }
  GOBO_ASSIGN(v1::RenderRequest request, makeRequest(c.request, id));
  if (request.environment().has_path()) GOBO_TRY(putEnvironment(session, *request.mutable_environment()).status());
  ProgressBar bar(!c.quiet, c.progressive);
  if (c.tile) {
    const auto show = [&](int done, int all) { bar.show(double(done) / all, "tile " + std::to_string(done) + " of " + std::to_string(all)); };
    GOBO_ASSIGN(const Tiled made, renderTiles(session, request, c.tile, c.out, show));
    bar.clear();
    if (c.json) std::printf("%s\n", messageToJson(made.reply, true).c_str());
    else if (!c.quiet) printReply(made.reply, {c.out});
    return {};
  }
  GOBO_TRY(setEncoding(request, c.out));
  StreamHooks hooks;
  Advance advance(request.halt());
  if (c.progressive || (!c.quiet && onTerminal())) {
    hooks.progress = [&](const v1::Progress& p) { bar.show(advance.to(p.spp(), p.fraction()), progressText(p)); };
    hooks.snapshot = [&](const Answer& answer) -> Status {  // small pictures send no progress inside a pass
      v1::Progress p;
      p.set_stage("snapshot");
      p.set_spp(samplesOf(answer.reply));
      p.set_elapsed_ms(answer.reply.total_ms());
      bar.show(advance.to(p.spp(), 1), progressText(p));
      return {};
    };
  }
  // A bar alone needs no early pictures.
  if (!c.progressive && !request.scheduling().has_ladder()) request.mutable_scheduling()->set_ladder(false);
  if (c.progressive) {
    hooks.snapshot = [&](const Answer& answer) -> Status {
      if (c.out.empty()) return {};
      GOBO_ASSIGN(const std::vector<std::string> files, writeImages(answer, c.out));
      bar.clear();
      if (!c.quiet) std::fprintf(stderr, "snapshot at %u samples: %s\n", samplesOf(answer.reply), files.empty() ? "" : files[0].c_str());
      return {};
    };
  }
  GOBO_ASSIGN(const Answer answer, renderOnce(session, request, hooks));
  bar.clear();
  return deliver(answer, c.out, c.json, c.quiet);
}

Status plan(Session& session, const RenderCommand& c) {
  std::string id;
  if (!c.scene.empty()) { GOBO_ASSIGN(id, ensureScene(session, c.scene)); }
  GOBO_ASSIGN(v1::RenderRequest request, makeRequest(c.request, id));
  if (request.environment().has_path()) GOBO_TRY(putEnvironment(session, *request.mutable_environment()).status());
  v1::PlanReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.render().Plan(&call.context, request, &reply)));
  if (c.json) std::printf("%s\n", messageToJson(reply, true).c_str());
  else printPlan(reply);
  return {};
}

Status relight(Session& session, const RelightCommand& c) {
  v1::RelightRequest request;
  request.set_render_id(c.id);
  for (const std::string& set : c.sets) GOBO_TRY(setPath(*request.mutable_patch(), set));
  GOBO_TRY(setEncoding(*request.mutable_patch(), c.out));
  for (const std::string& path : setPaths(request.patch())) request.add_mask(path);
  if (request.patch().environment().has_path()) {
    GOBO_ASSIGN(const bool put, putEnvironment(session, *request.mutable_patch()->mutable_environment()));
    if (put) request.add_mask("environment.digest");
  }
  Session::Call call(session);
  auto reader = session.render().Relight(&call.context, request);
  GOBO_ASSIGN(const Answer answer, receive(session, call, *reader, {}));
  return deliver(answer, c.out, c.json, c.quiet);
}

template <typename Body>
int with(const SessionOptions& options, const Body& body) {
  auto session = Session::open(options);
  if (!session.ok()) return complain(session.status());
  const Status status = body(**session);
  return status.ok() ? kOk : complain(status);
}

}  // namespace

int runRender(const SessionOptions& options, const RenderCommand& command) {
  if (command.out == "-" && (command.progressive || command.tile))
    return complain(invalidArgument("-o -: writes one picture; not with --progressive or --tile"));
  if (command.tile && command.progressive) return complain(invalidArgument("--tile and --progressive: one of them"));
  if (command.tile && command.out.empty()) return complain(invalidArgument("--tile writes an EXR of tiles: name it with -o"));
  if (const Status status = checkOut(command.out); !status.ok()) return complain(status);
  return with(options, [&](Session& session) { return render(session, command); });
}

int runPlan(const SessionOptions& options, const RenderCommand& command) {
  return with(options, [&](Session& session) { return plan(session, command); });
}

int runRelight(const SessionOptions& options, const RelightCommand& command) {
  if (options.local) return complain(invalidArgument("relight needs a running gobod: with --local no earlier render is remembered"));
  if (const Status status = checkOut(command.out); !status.ok()) return complain(status);
  return with(options, [&](Session& session) { return relight(session, command); });
}

}  // namespace gobo::cli
