// SPDX-License-Identifier: Apache-2.0
#include "regress/record.h"

#include <cmath>

#include <nlohmann/json.hpp>

#include "regress/page.h"
#include "server/log.h"

namespace gobo::cli {
namespace {

using Json = nlohmann::ordered_json;

constexpr CaseStatus kAll[] = {CaseStatus::Same, CaseStatus::Noise, CaseStatus::Changed, CaseStatus::Slower, CaseStatus::Missing, CaseStatus::Failed};

std::string written(const Json& j, int indent) { return j.dump(indent, ' ', false, Json::error_handler_t::replace); }

Json caseToJson(const CaseRecord& c) {
  return {{"case", c.name},
          {"status", statusName(c.status)},
          {"message", c.message},
          {"exit_code", c.exitCode},
          {"excess", c.excess},
          {"chance", c.chance},
          {"strongest", c.strongest},
          {"mean_reference", c.meanReference},
          {"mean_now", c.meanNow},
          {"mean_standard_error", c.meanStandardError},
          {"rmse", c.rmse},
          {"noise_rmse", c.noiseRmse},
          {"flip", c.flip},
          {"plan_difference", c.plan},
          {"reference", {{"digest", c.referenceDigest}, {"by", c.by}, {"why", c.why}, {"when", c.when}, {"ms", c.referenceMs}, {"rays", c.referenceRays}}},
          {"parts_digest", c.partsDigest},
          {"render", Json::parse(factsToJson(c.facts))}};
}

CaseRecord caseFromJson(const Json& j) {
  CaseRecord c;
  c.name = j.at("case");
  const std::string status = j.at("status");
  for (const CaseStatus s : kAll)
    if (status == statusName(s)) c.status = s;
  c.message = j.at("message");
  c.exitCode = j.at("exit_code");
  c.excess = j.at("excess");
  c.chance = j.at("chance");
  c.strongest = j.at("strongest");
  c.meanReference = j.at("mean_reference");
  c.meanNow = j.at("mean_now");
  c.meanStandardError = j.at("mean_standard_error");
  c.rmse = j.at("rmse");
  c.noiseRmse = j.at("noise_rmse");
  c.flip = j.at("flip");
  c.plan = j.at("plan_difference").get<std::vector<std::string>>();
  const Json& r = j.at("reference");
  c.referenceDigest = r.at("digest");
  c.by = r.at("by");
  c.why = r.at("why");
  c.when = r.at("when");
  c.referenceMs = r.at("ms");
  c.referenceRays = r.at("rays");
  c.partsDigest = j.at("parts_digest");
  c.facts = factsFromJson(j.at("render").dump());
  return c;
}

}  // namespace

const char* statusName(CaseStatus status) {
  switch (status) {
    case CaseStatus::Same: return "same";
    case CaseStatus::Noise: return "noise";
    case CaseStatus::Changed: return "changed";
    case CaseStatus::Slower: return "slower";
    case CaseStatus::Missing: return "missing";
    case CaseStatus::Failed: break;
  }
  return "failed";
}

std::string factsToJson(const RenderFacts& f) {
  const Json j = {{"output", f.output}, {"width", f.width}, {"height", f.height},        {"spp", f.spp},     {"parts", f.parts}, {"seed", f.seed},
                  {"rays", f.rays},     {"ms", f.ms},       {"scene_hash", f.sceneHash}, {"build", f.build}, {"nodes", f.nodes}, {"request", f.request}};
  return written(j, -1);
}

RenderFacts factsFromJson(const std::string& text) {
  const Json j = Json::parse(text);
  RenderFacts f;
  f.output = j.at("output");
  f.width = j.at("width");
  f.height = j.at("height");
  f.spp = j.at("spp");
  f.parts = j.at("parts");
  f.seed = j.at("seed");
  f.rays = j.at("rays");
  f.ms = j.at("ms");
  f.sceneHash = j.at("scene_hash");
  f.build = j.at("build");
  f.nodes = j.at("nodes").get<std::vector<std::string>>();
  f.request = j.at("request");
  return f;
}

std::string runToJson(const RunRecord& run) {
  Json cases = Json::array();
  for (const CaseRecord& c : run.cases) cases.push_back(caseToJson(c));
  return written({{"suite", run.suite}, {"when", run.when}, {"build", run.build}, {"cases", cases}}, 1) + "\n";
}

Result<RunRecord> runFromJson(const std::string& text, const std::string& file) {
  try {
    const Json j = Json::parse(text);
    RunRecord run;
    run.suite = j.at("suite");
    run.when = j.at("when");
    run.build = j.at("build");
    for (const Json& c : j.at("cases")) run.cases.push_back(caseFromJson(c));
    return run;
  } catch (const std::exception& e) { return invalidArgument(file + ": is no record of a run: " + e.what()); }
}

std::string historyLine(const RunRecord& run) {
  Json cases = Json::array();
  for (const CaseRecord& c : run.cases)
    cases.push_back({{"case", c.name}, {"status", statusName(c.status)}, {"excess", c.excess}, {"rmse", c.rmse}, {"ms", c.facts.ms}, {"rays", c.facts.rays}});
  return written({{"when", run.when}, {"build", run.build}, {"cases", cases}}, -1) + "\n";
}

std::vector<PastRun> readHistory(const std::string& text) {
  std::vector<PastRun> out;
  for (size_t begin = 0; begin < text.size();) {
    const size_t end = std::min(text.find('\n', begin), text.size());
    try {
      const Json j = Json::parse(text.substr(begin, end - begin));
      PastRun run{j.at("when"), j.at("build"), {}};
      for (const Json& c : j.at("cases")) run.cases.push_back({c.at("case"), c.at("status"), c.at("excess"), c.at("rmse"), c.at("ms"), c.at("rays")});
      out.push_back(std::move(run));
    } catch (const std::exception&) {}  // NOLINT(bugprone-empty-catch): said above
    begin = end + 1;
  }
  return out;
}

int exitCodeOf(const RunRecord& run) {
  int code = 0;
  bool changed = false, missing = false;
  for (const CaseRecord& c : run.cases) {
    if (c.status == CaseStatus::Failed && code == 0) code = c.exitCode ? c.exitCode : 1;
    changed |= c.status == CaseStatus::Changed || c.status == CaseStatus::Slower;
    missing |= c.status == CaseStatus::Missing;
  }
  return code ? code : changed ? 1 : missing ? 3 : 0;
}

std::string junitXml(const RunRecord& run) {
  int failures = 0, errors = 0;
  double seconds = 0;
  for (const CaseRecord& c : run.cases) {
    failures += c.status == CaseStatus::Changed || c.status == CaseStatus::Slower;
    errors += c.status == CaseStatus::Failed || c.status == CaseStatus::Missing;
    seconds += c.facts.ms / 1000;
  }
  std::string out = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  out += strf("<testsuite name=\"%s\" tests=\"%zu\" failures=\"%d\" errors=\"%d\" time=\"%.3f\" timestamp=\"%s\">\n", markup(run.suite).c_str(),
              run.cases.size(), failures, errors, seconds, markup(run.when).c_str());
  for (const CaseRecord& c : run.cases) {
    out += strf("  <testcase classname=\"%s\" name=\"%s\" time=\"%.3f\">", markup(run.suite).c_str(), markup(c.name).c_str(), c.facts.ms / 1000);
    const std::string message = markup(c.message);
    if (c.status == CaseStatus::Changed || c.status == CaseStatus::Slower)
      out += "<failure type=\"" + std::string(statusName(c.status)) + "\" message=\"" + message + "\"/>";
    if (c.status == CaseStatus::Failed || c.status == CaseStatus::Missing)
      out += "<error type=\"" + std::string(statusName(c.status)) + "\" message=\"" + message + "\"/>";
    out += "</testcase>\n";
  }
  return out + "</testsuite>\n";
}

}  // namespace gobo::cli
