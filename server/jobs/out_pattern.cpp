// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/out_pattern.h"

#include <algorithm>
#include <cstring>
#include <functional>
#include <optional>

#include "server/jobs/job_spec.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

enum class OutVariable { Text, Name, Job, Frame, Output, Ext };

struct OutPiece {
  OutVariable variable = OutVariable::Text;
  std::string text;  ///< of Text
  int digits = 0;    ///< of Frame; 0: as it is
};

Status badOut(const std::string& pattern, const std::string& why) {
  return invalidArgument("job.out = \"" + escaped(pattern.substr(0, 200)) + "\": " + why, "job.out");
}

std::optional<OutPiece> outVariable(const std::string& word) {
  constexpr std::pair<const char*, OutVariable> kPlain[] = {
      {"name", OutVariable::Name}, {"job", OutVariable::Job}, {"frame", OutVariable::Frame}, {"output", OutVariable::Output}, {"ext", OutVariable::Ext}};
  for (const auto& [text, variable] : kPlain)
    if (word == text) return OutPiece{variable, {}, 0};
  if (word.size() == 8 && word.rfind("frame:0", 0) == 0 && word[7] >= '1' && word[7] <= '9') return OutPiece{OutVariable::Frame, {}, word[7] - '0'};
  return std::nullopt;
}

Result<std::vector<OutPiece>> outPieces(const std::string& pattern) {
  std::vector<OutPiece> pieces;
  std::string text;
  const auto flush = [&] {
    if (!text.empty()) pieces.push_back({OutVariable::Text, std::exchange(text, {}), 0});
  };
  for (size_t at = 0; at < pattern.size(); ++at) {
    if (pattern[at] == '}') return badOut(pattern, "a } without its {");
    if (pattern[at] != '{') {
      text += pattern[at];
      continue;
    }
    const size_t end = pattern.find('}', at);
    if (end == std::string::npos) return badOut(pattern, "a { without its }");
    const std::string word = pattern.substr(at + 1, end - at - 1);
    const auto piece = outVariable(word);
    if (!piece) return badOut(pattern, "{" + escaped(word.substr(0, 40)) + "} is none of {name}, {job}, {frame}, {frame:04} (01 to 09), {output}, {ext}");
    flush();
    pieces.push_back(*piece);
    at = end;
  }
  flush();
  return pieces;
}

bool usesOut(const std::vector<OutPiece>& pieces, OutVariable variable) {
  return std::any_of(pieces.begin(), pieces.end(), [&](const OutPiece& p) { return p.variable == variable; });
}

struct OutFile {
  std::string name, job, output, ext;
  int64_t frame = 0;
};

std::string outText(const std::vector<OutPiece>& pieces, const OutFile& file) {
  std::string path;
  for (const OutPiece& p : pieces) {
    switch (p.variable) {
      case OutVariable::Text: path += p.text; break;
      case OutVariable::Name: path += file.name; break;
      case OutVariable::Job: path += file.job; break;
      case OutVariable::Frame: path += strf("%0*lld", p.digits ? p.digits + (file.frame < 0) : 0, (long long)file.frame); break;
      case OutVariable::Output: path += file.output; break;
      case OutVariable::Ext: path += file.ext; break;
    }
  }
  return path;
}

Status checkPathParts(const std::string& pattern, const std::string& path) {
  if (path.size() > kOutPathBytes) return badOut(pattern, strf("a path of %zu bytes: at most %zu", path.size(), kOutPathBytes));
  for (size_t begin = 0; begin <= path.size();) {
    const size_t end = std::min(path.find('/', begin), path.size());
    const std::string part = path.substr(begin, end - begin);
    if (part.empty()) return badOut(pattern, "has an empty part: must be relative, with a name between any two /");
    if (part == "." || part == "..") return badOut(pattern, "has the part \"" + part + "\"");
    if (part.size() > kOutPartBytes) return badOut(pattern, strf("a name of %zu bytes: at most %zu", part.size(), kOutPartBytes));
    begin = end + 1;
  }
  return {};
}

OutFile outFileOf(const v1::JobSpec& spec, const std::string& job) { return {plainName(spec), job, {}, extensionOf(spec.request().encoding().format()), 0}; }

}  // namespace

std::vector<std::string> outputsInFiles(const v1::JobSpec& spec) {
  const v1::RenderRequest& r = spec.request();
  const bool exr = r.encoding().format() == v1::Encoding::FORMAT_UNSPECIFIED || r.encoding().format() == v1::Encoding::EXR;
  if (exr && r.encoding().layers()) return {"layers"};
  return {r.outputs().begin(), r.outputs().end()};
}

Status checkOutPattern(const std::string& pattern) {
  if (pattern.empty()) return {};
  if (pattern.size() > kOutPatternBytes) return invalidArgument(strf("job.out has %zu bytes: at most %zu", pattern.size(), kOutPatternBytes), "job.out");
  if (std::any_of(pattern.begin(), pattern.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; })) return badOut(pattern, "has a control character");
  if (pattern[0] == '/') return badOut(pattern, "is absolute: must be relative, below jobs.out_folder");
  GOBO_ASSIGN(const std::vector<OutPiece> pieces, outPieces(pattern));
  return checkPathParts(pattern, outText(pieces, {"name", "j-1", "output", "ext", 0}));
}

Status checkOutPaths(const v1::JobSpec& spec, const std::vector<int64_t>& frames, const StopToken& stop) {
  const std::string& pattern = spec.out();
  if (pattern.empty()) return {};
  GOBO_ASSIGN(const std::vector<OutPiece> pieces, outPieces(pattern));
  const std::vector<std::string> outputs = outputsInFiles(spec);
  if (frames.size() > 1 && !usesOut(pieces, OutVariable::Frame))
    return badOut(pattern, strf("has no {frame}, and the job has %zu frames: each file needs a path of its own", frames.size()));
  if (outputs.size() > 1 && !usesOut(pieces, OutVariable::Output))
    return badOut(pattern, strf("has no {output}, and each frame has %zu files: each needs a path of its own", outputs.size()));
  OutFile file = outFileOf(spec, jobIdText(INT64_MAX));  // the longest id
  // A name says what is in a file.
  const std::string sample = outText(pieces, file);
  const size_t dot = sample.rfind('.'), slash = sample.rfind('/');
  std::string ext = dot == std::string::npos || (slash != std::string::npos && dot < slash) ? std::string() : sample.substr(dot + 1);
  std::transform(ext.begin(), ext.end(), ext.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  if (ext == "jpeg") ext = "jpg";
  constexpr const char* kPictures[] = {"exr", "png", "jpg", "raw", "tif", "tiff", "hdr", "pfm", "tga", "bmp", "gif", "webp", "dpx"};
  if (ext != file.ext && std::any_of(std::begin(kPictures), std::end(kPictures), [&](const char* known) { return ext == known; }))
    return badOut(pattern,
                  "ends in ." + ext + ", but encoding.format is " + v1::Encoding::Format_Name(spec.request().encoding().format()) + ": {ext} follows it");
  std::vector<size_t> hashes;  // of the paths: there may be millions
  const auto each = [&](const std::function<Status(const std::string&)>& visit) -> Status {
    for (const int64_t frame : frames) {
      if (stop.stopRequested()) return {Code::Cancelled, "cancelled while its paths were checked"};
      for (const std::string& output : outputs) {
        file.frame = frame;
        file.output = plainText(output);
        GOBO_TRY(visit(outText(pieces, file)));
      }
    }
    return {};
  };
  GOBO_TRY(each([&](const std::string& path) {
    hashes.push_back(std::hash<std::string>()(path));
    return checkPathParts(pattern, path);
  }));
  std::sort(hashes.begin(), hashes.end());
  const auto twice = std::adjacent_find(hashes.begin(), hashes.end());
  if (twice == hashes.end()) return {};
  return each([&](const std::string& path) {
    return std::hash<std::string>()(path) == *twice ? badOut(pattern, "two files of the job would both be " + escaped(path)) : Status();
  });
}

std::string outPath(const v1::JobSpec& spec, const std::string& job, int64_t frame, const std::string& output) {
  const auto pieces = outPieces(spec.out());
  if (!pieces.ok()) return {};
  OutFile file = outFileOf(spec, job);
  file.frame = frame;
  file.output = plainText(output);
  return outText(*pieces, file);
}

}  // namespace jobs
}  // namespace gobo
