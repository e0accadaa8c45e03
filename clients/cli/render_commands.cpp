// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "base/image_io.h"
#include "base/utf8.h"
#include "blobs.h"
#include "commands.h"
#include "pictures.h"
#include "report.h"
#include "request/request.h"
#include "request/style_sheet.h"
#include "tiles.h"
#include "words.h"

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

/// What is wrong with a --set, with its path and value.
Status ofSet(const std::string& set, const Status& s) { return s.ok() ? s : Status(s.code(), "--set " + set + ": " + s.message(), s.location()); }

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

Result<v1::RenderRequest> describedBy(const RequestOptions& o) {
  v1::RenderRequest request;
  if (!o.file.empty()) {
    GOBO_ASSIGN(const std::string text, requestText(o.file));
    GOBO_TRY(messageFromJson(text, request, o.file == "-" ? "standard input" : o.file));
  }
  if (!o.camera.empty()) request.mutable_camera()->set_name(o.camera);
  if (!o.size.empty()) {
    const auto size = pictureSize(o.size);
    if (!size) return invalidArgument("--size " + o.size + ": must be WIDTHxHEIGHT, such as 640x480");
    request.set_width(size->first);
    request.set_height(size->second);
  }
  if (!o.environment.empty()) {
    std::error_code error;
    const bool file = fs::is_regular_file(o.environment, error);
    const std::string path = file ? fs::absolute(o.environment).string() : o.environment;
    if (!isUtf8(path)) return invalidArgument("--env: the name is not UTF-8: \"" + cleanUtf8(path) + "\"");
    v1::EnvironmentSettings& e = *request.mutable_environment();  // what a request from a file says of it is another kind, perhaps
    e.clear_digest();
    e.clear_sky();
    e.clear_constant();
    e.set_path(path);
  }
  if (!o.outputs.empty()) GOBO_TRY(setPath(request, "outputs=" + o.outputs));
  if (!o.denoise.empty()) GOBO_TRY(setPath(request, "denoise=" + o.denoise).at("--denoise " + o.denoise));
  if (o.spp || o.time > 0 || o.error > 0) request.clear_halt();  // of the file's
  if (o.spp) request.mutable_halt()->set_spp(o.spp);
  if (o.time > 0) request.mutable_halt()->set_time_s(o.time);
  if (o.error > 0) request.mutable_halt()->set_error(o.error);
  if (o.certificate) request.mutable_certificate();
  if (o.half) request.mutable_encoding()->set_half(true);
  if (o.layers) request.mutable_encoding()->set_layers(true);
  if (!o.priority.empty()) GOBO_TRY(setPath(request, "scheduling.priority=" + o.priority));
  if (o.deadlineMs > 0) request.mutable_scheduling()->set_deadline_ms(o.deadlineMs);
  if (!o.style.empty()) {
    GOBO_ASSIGN(const std::vector<uint8_t> sheet, readFile(o.style, size_t(1) << 20));
    GOBO_TRY(applyStyleSheet(request, std::string(sheet.begin(), sheet.end()), o.style));
  }
  for (const std::string& set : o.sets) GOBO_TRY(ofSet(set, setPath(request, set)));
  for (const std::string& curve : o.curves) GOBO_TRY(addCurve(request, curve));
  for (const std::string& formula : o.formulas) {
    const size_t equals = formula.find('=');
    if (equals == std::string::npos || equals == 0) return invalidArgument("--formula " + formula + ": is not PATH=FORMULA");
    (*request.mutable_expressions())[formula.substr(0, equals)].set_formula(formula.substr(equals + 1));
  }
  return request;
}

Result<v1::RenderRequest> makeRequest(Session& session, const RequestOptions& o, const std::string& source) {
  GOBO_ASSIGN(v1::RenderRequest request, describedBy(o));
  if (!source.empty()) { GOBO_ASSIGN(*request.mutable_scene(), ensureScene(session, source)); }
  if (request.scene().empty()) return invalidArgument("no scene: name one, or put it into --request");
  if (request.environment().has_path()) GOBO_TRY(putEnvironment(session, *request.mutable_environment()).status());
  return request;
}

namespace {

// Where the pictures go is checked before anything is rendered.
Status checkOut(const std::string& out) {
  if (out.empty() || out == "-") return {};
  GOBO_TRY(formatOf(out).status());
  return checkFolder("-o", out);
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

Status deliver(const Answer& answer, const std::string& out, bool json, bool quiet, bool everyRow) {
  if (out == "-") return deliverToPipe(answer, json, quiet);
  std::vector<std::string> files;
  if (!out.empty()) { GOBO_ASSIGN(files, writeImages(answer, out)); }
  if (json) std::printf("%s\n", messageToJson(answer.reply, true).c_str());
  else if (!quiet) printReply(answer.reply, files, everyRow);
  return {};
}

uint32_t samplesOf(const v1::RenderReply& reply) {
  uint32_t samples = 0;
  for (const v1::NodeReport& n : reply.plan()) samples = std::max(samples, n.samples());
  return samples;
}

/// Share of the whole render that is done: by what the server expects of the rest, else from the fraction of a pass of 16 samples and what
/// ends the render. Never goes back.
class Advance {
 public:
  explicit Advance(const v1::Halt& halt) : halt_(halt) {}
  double to(const v1::Progress& p) {
    if (p.eta_ms() > 0) return shown_ = std::max(shown_, p.elapsed_ms() / (p.elapsed_ms() + p.eta_ms()));
    const double spp = p.spp(), fraction = p.fraction();
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

/// What a terminal, or --progressive, is shown of a render on its way. Lives as long as the call.
class Show {
 public:
  Show(const v1::Halt& halt, const std::string& out, bool progressive, bool quiet)
      : bar_(!quiet, progressive), advance_(halt), out_(out), progressive_(progressive), quiet_(quiet) {}
  bool any() const { return progressive_ || (!quiet_ && onTerminal()); }
  StreamHooks hooks() {
    StreamHooks hooks;
    if (!any()) return hooks;
    hooks.progress = [this](const v1::Progress& p) {
      if (p.queued()) return bar_.wait(progressText(p));
      if (p.stage().empty()) return;  // the wait is over
      bar_.show(advance_.to(p), progressText(p));
    };
    hooks.snapshot = [this](const Answer& answer) -> Status {
      if (progressive_) return keep(answer);
      v1::Progress p;  // small pictures send no progress inside a pass
      p.set_stage("snapshot");
      p.set_spp(samplesOf(answer.reply));
      p.set_fraction(1);
      p.set_elapsed_ms(answer.reply.total_ms());
      bar_.show(advance_.to(p), progressText(p));
      return {};
    };
    return hooks;
  }
  ProgressBar& bar() { return bar_; }

 private:
  Status keep(const Answer& answer) {
    if (out_.empty()) return {};
    GOBO_ASSIGN(const std::vector<std::string> files, writeImages(answer, out_));
    bar_.clear();
    if (!quiet_) std::fprintf(stderr, "snapshot at %u samples: %s\n", samplesOf(answer.reply), files.empty() ? "" : files[0].c_str());
    return {};
  }
  ProgressBar bar_;
  Advance advance_;
  const std::string out_;
  const bool progressive_, quiet_;
};

Status render(Session& session, const RenderCommand& c) {
  GOBO_ASSIGN(v1::RenderRequest request, makeRequest(session, c.request, c.scene));
  Show show(request.halt(), c.out, c.progressive, c.quiet);
  if (c.tile) {
    const auto tile = [&](int done, int all) { show.bar().show(double(done) / all, "tile " + std::to_string(done) + " of " + std::to_string(all)); };
    GOBO_ASSIGN(const Tiled made, renderTiles(session, request, c.tile, c.out, tile));
    show.bar().clear();
    if (c.json) std::printf("%s\n", messageToJson(made.reply, true).c_str());
    else if (!c.quiet) printReply(made.reply, {c.out}, c.planAll);
    return {};
  }
  GOBO_TRY(setEncoding(request, c.out));
  // A bar alone needs no early pictures.
  if (!c.progressive && !request.scheduling().has_ladder()) request.mutable_scheduling()->set_ladder(false);
  GOBO_ASSIGN(const Answer answer, renderOnce(session, request, show.hooks()));
  show.bar().clear();
  return deliver(answer, c.out, c.json, c.quiet, c.planAll);
}

Status plan(Session& session, const RenderCommand& c) {
  GOBO_ASSIGN(const v1::RenderRequest request, makeRequest(session, c.request, c.scene));
  v1::PlanReply reply;
  Session::Call call(session);
  GOBO_TRY(session.statusOf(session.render().Plan(&call.context, request, &reply)));
  if (c.json) std::printf("%s\n", messageToJson(reply, true).c_str());
  else printPlan(reply, c.planAll);
  return {};
}

/// What of the remembered request the patch replaces: each field that it has, but wholes where the parts of two requests would not fit together.
/// Takes out the --set that name elements of lists (filters[1].bloom.gain=0.3).
std::vector<std::string> elementSets(RequestOptions& o) {
  std::vector<std::string> elements;
  std::erase_if(o.sets, [&](const std::string& set) {
    if (set.find('[') >= set.find('=')) return false;
    elements.push_back(set);
    return true;
  });
  return elements;
}

std::set<std::string> maskOf(const v1::RenderRequest& patch, const RequestOptions& o) {
  std::set<std::string> mask;
  for (const std::string& path : setPaths(patch)) {
    if (path.rfind("halt.", 0) == 0) mask.insert("halt");  // one end or another
    else if (path.rfind("curves.", 0) == 0) mask.insert("curves");
    else if (path.rfind("expressions.", 0) == 0) mask.insert("expressions");
    else if (path.rfind("camera.", 0) == 0 && !o.camera.empty()) mask.insert("camera");
    else mask.insert(path);
  }
  // An environment is of one kind.
  const v1::EnvironmentSettings& e = patch.environment();
  if (e.has_path() || e.has_sky() || e.has_constant() || e.has_digest()) {
    if (!e.has_path()) mask.insert("environment.path");
    if (!e.has_sky()) mask.insert("environment.sky");
    if (!e.has_constant()) mask.insert("environment.constant");
    if (!e.has_digest()) mask.insert("environment.digest");
  }
  if (!patch.encoding().layers()) mask.insert("encoding.layers");
  return mask;
}

Status relight(Session& session, const RelightCommand& c) {
  v1::RelightRequest request;
  request.set_render_id(c.id);
  v1::RenderRequest& patch = *request.mutable_patch();
  RequestOptions whole = c.request;  // but for what names elements of lists, which the render that it is of may have
  const std::vector<std::string> elements = elementSets(whole);
  GOBO_ASSIGN(patch, describedBy(whole));
  if (!patch.scene().empty()) return invalidArgument("--request: a relight is of the scene that was rendered; leave out \"scene\"", "scene");
  if (patch.environment().has_path()) GOBO_TRY(putEnvironment(session, *patch.mutable_environment()).status());
  GOBO_TRY(setEncoding(patch, c.out));
  Show show(patch.halt(), c.out, c.progressive, c.quiet);
  request.set_progressive(show.any());
  if (show.any() && !c.progressive && !patch.scheduling().has_ladder()) patch.mutable_scheduling()->set_ladder(false);
  std::set<std::string> mask = maskOf(patch, whole);
  for (const std::string& set : elements) {
    GOBO_TRY(ofSet(set, setPatchPath(patch, set)));
    const std::string path = set.substr(0, set.find('='));
    if (!mask.count(path.substr(0, path.find('[')))) mask.insert(path);  // of a list that is given, all of it is
  }
  for (const std::string& path : mask) request.add_mask(path);
  Session::Call call(session);
  auto reader = session.render().Relight(&call.context, request);
  GOBO_ASSIGN(const Answer answer, receive(session, call, *reader, show.hooks()));
  show.bar().clear();
  return deliver(answer, c.out, c.json, c.quiet, c.planAll);
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
  if (command.out == "-" && command.progressive) return complain(invalidArgument("-o -: writes one picture; not with --progressive"));
  if (options.local) return complain(invalidArgument("relight needs a running gobod: with --local no earlier render is remembered"));
  if (const Status status = checkOut(command.out); !status.ok()) return complain(status);
  return with(options, [&](Session& session) { return relight(session, command); });
}

}  // namespace gobo::cli
