// SPDX-License-Identifier: Apache-2.0
// `gobo regress`: renders a suite and holds it against accepted references (docs/regression.md). The output folder holds run.json, history.jsonl, report.html,
// junit.xml, and of every case NAME.parts.exr (what `accept` accepts) and pictures as PNG.
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <set>

#include "base/image_io.h"
#include "blobs.h"
#include "commands.h"
#include "measure/change.h"
#include "measure/metrics.h"
#include "pictures.h"
#include "plan/engine.h"
#include "regress/page.h"
#include "regress/record.h"
#include "regress/references.h"
#include "regress/suite.h"
#include "report.h"
#include "request/request.h"
#include "server/encode.h"

namespace gobo::cli {
namespace {

namespace fs = std::filesystem;

class OutputFolder {
 public:
  explicit OutputFolder(const Suite& suite, const std::string& named)
      : option_(named.empty() ? "" : " --out " + named),
        folder_(named.empty() ? (fs::absolute(suite.file).parent_path() / (fs::path(suite.file).stem().string() + ".out")) : fs::path(named)) {}
  Status make() const {
    std::error_code error;
    fs::create_directories(folder_, error);
    return error ? invalidArgument("--out " + folder_.string() + ": cannot make the folder: " + error.message()) : Status();
  }
  /// As other commands on the same folder need it.
  const std::string& option() const { return option_; }
  std::string path(const std::string& file) const { return (folder_ / file).string(); }
  std::string parts(const std::string& name) const { return path(name + ".parts.exr"); }
  std::string picture(const std::string& name, const char* kind) const { return path(name + "." + kind + ".png"); }
  /// What an earlier run left of a case.
  void forget(const std::string& name) const {
    std::error_code error;
    fs::remove(parts(name), error);
    for (const char* kind : {"now", "reference", "evidence"}) fs::remove(picture(name, kind), error);
  }

 private:
  std::string option_;
  fs::path folder_;
};

/// A line more at the end; two runs at once leave both of theirs.
Status append(const std::string& file, const std::string& line) {
  std::FILE* f = std::fopen(file.c_str(), "ab");
  if (!f) return invalidArgument("cannot write \"" + file + "\": " + std::strerror(errno));
  const bool written = std::fwrite(line.data(), 1, line.size(), f) == line.size();
  return std::fclose(f) == 0 && written ? Status() : Status(Code::DataLoss, "cannot write \"" + file + "\"");
}

/// What can be a reference: finite, and of channels that are compared.
Status checkRender(const RegressCase& c, const std::vector<Image>& parts) {
  for (size_t k = 0; k < parts.size(); ++k) {
    if (parts[k].channels == 2)
      return invalidArgument("case \"" + c.name + "\": output = \"" + c.request.outputs(0) + "\" has two channels: must have one, three or four");
    for (size_t i = 0; i < parts[k].data.size(); ++i)
      if (!std::isfinite(parts[k].data[i]))
        return invalidArgument("case \"" + c.name + "\": part " + std::to_string(k) + " of the render is not finite at pixel " +
                               std::to_string(i / size_t(parts[k].channels) % size_t(parts[k].width)) + ", " +
                               std::to_string(i / size_t(parts[k].channels) / size_t(parts[k].width)));
  }
  return {};
}

std::string textOf(const std::string& file) {
  const auto bytes = readFile(file, 1 << 28);
  return bytes.ok() ? std::string(bytes->begin(), bytes->end()) : std::string();
}
std::vector<uint8_t> bytesOf(const std::string& file) {
  auto bytes = readFile(file, 1 << 28);
  return bytes.ok() ? std::move(*bytes) : std::vector<uint8_t>();
}
Status write(const std::string& file, const std::string& text) { return writeFileAtomic(file, text.data(), text.size()); }

struct Rendered {
  std::vector<Image> parts;
  RenderFacts facts;
  v1::ToneMap toneMap;
};

Result<Rendered> renderParts(Session& session, const RegressCase& c) {
  Rendered out;
  v1::RenderRequest request = c.request;
  GOBO_ASSIGN(*request.mutable_scene(), ensureScene(session, c.scene));
  if (!c.environment.empty()) request.mutable_environment()->set_path(c.environment);
  if (request.environment().has_path()) GOBO_TRY(putEnvironment(session, *request.mutable_environment()).status());
  out.facts.request = messageToJson(c.request, false);  // without what differs between machines: ids of scenes
  request.mutable_encoding()->set_format(v1::Encoding::RAW_FLOAT);
  for (uint32_t k = 0; k < c.parts; ++k) {
    request.set_seed(c.seed * kMostParts + k);  // other seeds of a suite share no part: flips of signs take parts for independent
    GOBO_ASSIGN(const Answer answer, renderOnce(session, request));
    GOBO_ASSIGN(Image image, rawImage(answer, 0));
    out.parts.push_back(std::move(image));
    const v1::RenderReply& r = answer.reply;
    out.facts.rays += r.rays();
    out.facts.ms += r.total_ms() - r.queue_ms();
    if (k) continue;
    out.facts.build = r.build();
    out.facts.sceneHash = r.resolved().scene_hash();
    for (const v1::NodeReport& n : r.plan())
      if (n.state() == v1::NodeReport::RUN || n.state() == v1::NodeReport::REUSED) out.facts.nodes.push_back(n.node());
    out.toneMap = r.resolved().tone_map();
  }
  out.facts.output = c.request.outputs(0);
  out.facts.width = out.parts[0].width;
  out.facts.height = out.parts[0].height;
  out.facts.spp = c.request.halt().spp();
  out.facts.parts = c.parts;
  out.facts.seed = c.seed;
  return out;
}

/// A reference that says nothing about this render: another size, or noise of another size.
Status checkReference(const Suite& suite, const RegressCase& c, const Accepted& a, const RenderFacts& now) {
  const auto refuse = [&](const char* what, const std::string& is, const std::string& was) {
    return invalidArgument(suite.file + ":" + std::to_string(c.line) + ": case \"" + c.name + "\": " + what + " = " + is + ", but the reference, accepted by " +
                           a.by + " on " + a.when + ", is of " + was + ": accept one of this");
  };
  const RenderFacts& f = a.facts;
  const auto size = [](const RenderFacts& r) { return std::to_string(r.width) + "x" + std::to_string(r.height); };
  if (size(f) != size(now)) return refuse("size", size(now), size(f));
  if (f.output != now.output) return refuse("output", now.output, f.output);
  if (f.parts != now.parts) return refuse("parts", std::to_string(now.parts), std::to_string(f.parts));
  if (f.spp != now.spp) return refuse("spp", std::to_string(now.spp), std::to_string(f.spp));
  return {};
}

Status writePng(const OutputFolder& out, const std::string& name, const char* kind, const Image& image) {
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, encodePng(image));
  return writeFileAtomic(out.picture(name, kind), bytes.data(), bytes.size());
}

std::string placeOf(const ChangeStatistic& s) { return s.size == 0 ? s.name : s.name + strf(" at pixel %d, %d (%s)", s.x, s.y, s.channel.c_str()); }

void judge(const ChangeFigures& f, const RegressCase& c, CaseRecord& r) {
  r.excess = f.excess;
  r.chance = f.chance;
  r.meanReference = f.meanReference;
  r.meanNow = f.meanNow;
  r.meanStandardError = f.meanStandardError;
  r.noiseRmse = f.noiseRmse;
  if (f.strongest >= 0) r.strongest = placeOf(f.statistics[size_t(f.strongest)]);
  const double times = r.referenceMs > 0 ? r.facts.ms / r.referenceMs : 0, rays = r.referenceRays > 0 ? double(r.facts.rays) / double(r.referenceRays) : 0;
  if (f.sameBits) r.status = CaseStatus::Same, r.message = "every bit as accepted";
  else if (f.changed) {
    r.status = CaseStatus::Changed;
    r.message = strf("changed: %s is %.3g standard deviations above noise (more than %.0f); mean %+.3f %%, RMSE %.3g, of noise %.3g", r.strongest.c_str(),
                     f.excess, kChangeExcess, f.meanReference != 0 ? 100 * (f.meanNow / f.meanReference - 1) : 0.0, r.rmse, f.noiseRmse);
  } else {
    r.status = CaseStatus::Noise;
    r.message = strf("other bits, no more than noise: RMSE %.3g, of noise %.3g", r.rmse, f.noiseRmse);
  }
  if (f.changed) return;
  if (c.maxTime > 0 && times > c.maxTime)
    r.status = CaseStatus::Slower, r.message += strf("; %.2f times the reference's time, max_time = %g", times, c.maxTime);
  if (c.maxRays > 0 && rays > c.maxRays) r.status = CaseStatus::Slower, r.message += strf("; %.2f times the reference's rays, max_rays = %g", rays, c.maxRays);
}

/// The server is gone, or somebody has had enough: the other cases would say the same.
bool endsRun(const Status& status) { return !status.ok() && (status.code() == Code::Unavailable || interrupted()); }

Status runCase(Session& session, const Suite& suite, const RegressCase& c, const References& references, const std::map<std::string, Accepted>& accepted,
               const OutputFolder& out, CaseRecord& record) {
  const auto entry = accepted.find(c.name);
  Result<Rendered> rendered = renderParts(session, c);
  // Else the report shows a case that fails with pictures of another run. One that ends here leaves the last run as it is.
  if (!endsRun(rendered.status())) out.forget(c.name);
  GOBO_ASSIGN(const Rendered now, std::move(rendered));
  GOBO_TRY(checkRender(c, now.parts));
  record.facts = now.facts;
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, encodeParts(now.parts));
  GOBO_TRY(writeFileAtomic(out.parts(c.name), bytes.data(), bytes.size()));
  record.partsDigest = sha256Hex(bytes.data(), bytes.size());
  const Image mean = meanOf(now.parts), shown = toneMapped(mean, now.toneMap);
  GOBO_TRY(writePng(out, c.name, "now", shown));
  if (entry == accepted.end()) {
    record.status = CaseStatus::Missing;
    record.message = "nothing is accepted yet: gobo regress accept " + suite.file + " " + c.name + " --by NAME --why TEXT" + out.option();
    return {};
  }
  const Accepted& a = entry->second;
  record.referenceDigest = a.digest;
  record.by = a.by, record.why = a.why, record.when = a.when;
  record.referenceMs = a.facts.ms, record.referenceRays = a.facts.rays;
  record.plan = planDifference(a.facts.nodes, now.facts.nodes);
  GOBO_TRY(checkReference(suite, c, a, now.facts));
  GOBO_ASSIGN(const std::vector<Image> before, references.parts(a));
  ChangeOptions options;
  options.tolerance = c.tolerance;
  // What the reference holds is three channels or one: so is what is compared.
  GOBO_ASSIGN(const std::vector<Image> here, decodeParts(bytes, out.parts(c.name), c.parts));
  GOBO_ASSIGN(const ChangeFigures figures, findChange(before, here, options));
  const Image reference = meanOf(before);
  GOBO_ASSIGN(const ErrorFigures errors, compareImages(mean, reference));
  record.rmse = errors.rmse;
  record.flip = errors.flip;
  judge(figures, c, record);
  const Image was = toneMapped(reference, now.toneMap);
  GOBO_TRY(writePng(out, c.name, "reference", was));
  return writePng(out, c.name, "evidence", evidencePicture(was, figures.map));
}

void printRun(const RunRecord& run) {
  std::vector<std::vector<std::string>> rows;
  const auto ratio = [](double a, double b) { return b > 0 ? strf("%.2f", a / b) : std::string("-"); };
  for (const CaseRecord& c : run.cases)
    rows.push_back({c.name, statusName(c.status), strf("%.1f", c.excess),
                    c.meanReference != 0 ? strf("%+.3f %%", 100 * (c.meanNow / c.meanReference - 1)) : "-", strf("%.3g", c.rmse), strf("%.3g", c.noiseRmse),
                    strf("%.3g", c.flip), ratio(c.facts.ms, c.referenceMs), ratio(double(c.facts.rays), double(c.referenceRays)), escaped(c.message)});
  printTable({"case", "status", "excess", "mean", "RMSE", "of noise", "FLIP", "time", "rays", "what"}, rows,
             {false, false, true, true, true, true, true, true, true, false});
}

Status writePage(const RunRecord& run, const OutputFolder& out) {
  const std::vector<PastRun> history = readHistory(textOf(out.path("history.jsonl")));
  const auto pictures = [&](const std::string& name) {
    return CasePictures{bytesOf(out.picture(name, "reference")), bytesOf(out.picture(name, "now")), bytesOf(out.picture(name, "evidence"))};
  };
  GOBO_TRY(write(out.path("report.html"), reportPage(run, history, pictures)));
  return write(out.path("junit.xml"), junitXml(run));
}

Result<std::vector<const RegressCase*>> chosen(const Suite& suite, const std::vector<std::string>& names) {
  std::vector<const RegressCase*> out;
  std::set<std::string> left(names.begin(), names.end());
  for (const RegressCase& c : suite.cases)
    if (names.empty() || left.erase(c.name)) out.push_back(&c);
  if (!left.empty()) return notFound(suite.file + ": no case \"" + *left.begin() + "\"");
  return out;
}

Result<RunRecord> lastRun(const OutputFolder& out) {
  std::error_code error;
  if (!fs::exists(out.path("run.json"), error)) return notFound("no run: \"" + out.path("run.json") + "\" is not there: gobo regress run makes it");
  GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(out.path("run.json"), 1 << 28));
  return runFromJson(std::string(bytes.begin(), bytes.end()), out.path("run.json"));
}

Result<int> run(const SessionOptions& options, const RegressCommand& command) {
  GOBO_ASSIGN(const Suite suite, readSuite(command.suite));
  GOBO_ASSIGN(const std::vector<const RegressCase*> cases, chosen(suite, command.cases));
  const OutputFolder out(suite, command.out);
  GOBO_TRY(out.make());
  const References references(suite.references);
  GOBO_ASSIGN(const auto accepted, references.accepted());
  GOBO_ASSIGN(const std::unique_ptr<Session> session, Session::open(options));
  RunRecord record{suite.name, timeNow(), buildVersion(), {}};
  const Unfinished unfinished;  // Ctrl-C leaves no temporary files
  for (const RegressCase* c : cases) {
    if (interrupted()) return Status(Code::Cancelled, "interrupted");
    CaseRecord r;
    r.name = c->name;
    const Status status = runCase(*session, suite, *c, references, accepted, out, r);
    if (endsRun(status)) return status;
    if (!status.ok()) {
      r.status = CaseStatus::Failed;
      r.exitCode = exitCodeOf(status);
      r.message = status.message();
      std::fprintf(stderr, "gobo: case %s: ", c->name.c_str());
      complain(status);
    }
    record.cases.push_back(std::move(r));
  }
  GOBO_TRY(write(out.path("run.json"), runToJson(record)));
  GOBO_TRY(append(out.path("history.jsonl"), historyLine(record)));
  GOBO_TRY(writePage(record, out));
  if (command.json) std::printf("%s", runToJson(record).c_str());
  else {
    printRun(record);
    std::printf("wrote %s\n", out.path("report.html").c_str());
  }
  return exitCodeOf(record);
}

Result<int> accept(const RegressCommand& command) {
  GOBO_ASSIGN(const Suite suite, readSuite(command.suite));
  GOBO_ASSIGN(const std::vector<const RegressCase*> cases, chosen(suite, command.cases));
  if (command.by.empty()) return invalidArgument("--by \"\": must name who accepts");
  if (command.why.empty()) return invalidArgument("--why \"\": must say why");
  const OutputFolder out(suite, command.out);
  GOBO_ASSIGN(const RunRecord last, lastRun(out));
  References references(suite.references);
  const Unfinished unfinished;  // Ctrl-C leaves no temporary files in a folder that is committed
  int count = 0;
  for (const RegressCase* c : cases) {
    const CaseRecord* r = nullptr;
    for (const CaseRecord& each : last.cases)
      if (each.name == c->name) r = &each;
    const bool named = !command.cases.empty();
    if (!r || r->partsDigest.empty()) {
      if (named) return notFound("case \"" + c->name + "\" is not in the last run (" + out.path("run.json") + ")");
      continue;
    }
    // Unasked, what is as accepted stays: its line in the log says who looked at it. What failed wants a look.
    if (!named && r->status != CaseStatus::Changed && r->status != CaseStatus::Slower && r->status != CaseStatus::Missing) continue;
    GOBO_ASSIGN(const std::vector<uint8_t> bytes, readFile(out.parts(c->name)));
    if (sha256Hex(bytes.data(), bytes.size()) != r->partsDigest)
      return Status(Code::FailedPrecondition, "case \"" + c->name + "\": " + out.parts(c->name) + " is not what the last run wrote: run again");
    GOBO_TRY(references.accept({c->name, "", command.by, command.why, timeNow(), r->facts}, bytes));
    std::printf("accepted %s (%s)\n", c->name.c_str(), r->partsDigest.substr(0, 16).c_str());
    ++count;
  }
  if (count == 0) std::printf("nothing to accept: every case of the last run is as accepted\n");
  return int(kOk);
}

Result<int> report(const RegressCommand& command) {
  GOBO_ASSIGN(const Suite suite, readSuite(command.suite));
  const OutputFolder out(suite, command.out);
  GOBO_ASSIGN(const RunRecord last, lastRun(out));
  GOBO_TRY(writePage(last, out));
  if (command.json) std::printf("%s", runToJson(last).c_str());
  else {
    printRun(last);
    std::printf("wrote %s\n", out.path("report.html").c_str());
  }
  return exitCodeOf(last);
}

}  // namespace

int runRegress(const SessionOptions& options, RegressAct act, const RegressCommand& command) {
  const Result<int> code = act == RegressAct::Run ? run(options, command) : act == RegressAct::Accept ? accept(command) : report(command);
  return code.ok() ? *code : complain(code.status());
}

}  // namespace gobo::cli
