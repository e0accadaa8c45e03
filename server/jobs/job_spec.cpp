// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/job_spec.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "request/request.h"
#include "server/encode.h"
#include "server/jobs/frame_parts.h"
#include "server/jobs/out_pattern.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

constexpr int64_t kMostFrames = 100000, kMostTasks = 200000;

Status textBound(const std::string& text, const char* field) {
  if (text.size() <= 200) return {};
  return invalidArgument(strf("%s has %zu bytes: at most 200", field, text.size()), field);
}

/// Before defaults are filled in.
Status checkNumbers(const v1::FrameRange& range) {
  constexpr int64_t kMost = 1000000000;  // as first and last
  if (range.numbers().empty()) return {};
  if (range.has_first() || range.has_last() || range.has_step())
    return invalidArgument("job.frames.numbers: stands in place of first, last and step", "job.frames.numbers");
  std::set<int64_t> seen;
  for (const int64_t n : range.numbers()) {
    if (n < -kMost || n > kMost)
      return invalidArgument(strf("job.frames.numbers = %lld: must be within %lld of 0", (long long)n, (long long)kMost), "job.frames.numbers");
    if (!seen.insert(n).second) return invalidArgument(strf("job.frames.numbers: %lld is there twice", (long long)n), "job.frames.numbers");
  }
  return {};
}

Status checkParts(const v1::JobSpec& spec, int64_t frames) {
  if (!spec.has_tile_px()) return {};
  const v1::RenderRequest& r = spec.request();
  if (r.has_window()) return invalidArgument("job.tile_px and job.request.window: one of them", "job.tile_px");
  if (r.has_certificate() || r.halt().has_error())
    return invalidArgument(
        strf("job.tile_px = %u: %s is of a whole picture", spec.tile_px(), r.halt().has_error() ? "request.halt.error" : "request.certificate"), "job.tile_px");
  const int64_t tasks = frames * (1 + int64_t(partsOf(spec)));
  if (tasks <= kMostTasks) return {};
  return invalidArgument(
      strf("job.tile_px = %u: %lld frames of %u parts, at most %lld together", spec.tile_px(), (long long)frames, partsOf(spec), (long long)kMostTasks),
      "job.tile_px");
}

}  // namespace

const char* extensionOf(v1::Encoding::Format format) {
  switch (format) {
    case v1::Encoding::PNG: return "png";
    case v1::Encoding::JPEG: return "jpg";
    case v1::Encoding::RAW_FLOAT:
    case v1::Encoding::RAW_HALF: return "raw";
    default: return "exr";
  }
}

std::string plainText(const std::string& text) {
  std::string out;
  for (const unsigned char c : text) out += std::isalnum(c) || c == '-' || c == '_' || c == '.' ? char(c) : '_';
  if (!out.empty() && out[0] == '.') out[0] = '_';
  return out;
}

std::string plainName(const v1::JobSpec& spec) {
  const std::string name = plainText(spec.name().empty() ? spec.request().scene() : spec.name());
  return name.empty() ? "job" : name;
}

Result<std::vector<int64_t>> parseJobIds(const google::protobuf::RepeatedPtrField<std::string>& ids, const std::string& field) {
  if (ids.size() > kMostNeeds) return invalidArgument(strf("%s: %d jobs, at most %d", field.c_str(), ids.size(), kMostNeeds), field);
  std::vector<int64_t> out;
  std::set<int64_t> seen;
  for (int i = 0; i < ids.size(); ++i) {
    const std::string where = strf("%s[%d]", field.c_str(), i), said = "'" + escaped(ids[i].substr(0, 80)) + "'";
    const int64_t id = jobIdOf(ids[i]);
    if (!id) return notFound(where + ": no job " + said, where);
    if (!seen.insert(id).second) return invalidArgument(where + ": " + said + " is there twice", where);
    out.push_back(id);
  }
  return out;
}

bool jobHasFrame(const v1::JobSpec& spec, int64_t frame) {
  const v1::FrameRange& range = spec.frames();
  if (!range.numbers().empty()) return std::find(range.numbers().begin(), range.numbers().end(), frame) != range.numbers().end();
  return frame >= range.first() && frame <= range.last() && (frame - range.first()) % std::max(1u, range.step()) == 0;
}

std::string specDigest(const v1::JobSpec& sent) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream out(&stream);
    out.SetSerializationDeterministic(true);
    sent.SerializeToCodedStream(&out);
  }
  return sha256Hex(bytes.data(), bytes.size());
}

Result<NewJob> makeJob(const v1::JobSpec& sent, const std::string& client, Engine& engine, double nowUnix, const SceneAccess& access, const StopToken& stop,
                       const std::string& environmentFile) {
  NewJob job;
  job.digest = specDigest(sent);
  job.client = client;
  v1::JobSpec& spec = job.spec = sent;
  spec.DiscardUnknownFields();
  if (spec.ByteSizeLong() > kSpecBytes) return Status(Code::ResourceExhausted, strf("job has %zu bytes: at most %zu", spec.ByteSizeLong(), kSpecBytes), "job");
  GOBO_TRY(textBound(spec.name(), "job.name"));
  GOBO_TRY(textBound(spec.key(), "job.key"));
  if (!spec.has_request()) return invalidArgument("job.request: must be given", "job.request");
  if (spec.request().halt().has_time_s())
    return invalidArgument("job.request.halt.time_s: a job's result must be repeatable: halt by spp or error", "job.request.halt.time_s");
  GOBO_ASSIGN(job.after, parseJobIds(spec.after(), "job.after"));
  spec.clear_after();
  for (int64_t id : job.after) spec.add_after(jobIdText(id));  // as they are written everywhere
  GOBO_TRY(checkOutPattern(spec.out()));
  spec.mutable_request()->clear_scheduling();
  const auto curves = spec.request().curves();  // each frame's time has its own values
  const auto expressions = spec.request().expressions();
  GOBO_ASSIGN(*spec.mutable_request(), engine.resolve(spec.request(), access));
  *spec.mutable_request()->mutable_curves() = curves;
  *spec.mutable_request()->mutable_expressions() = expressions;
  spec.mutable_request()->mutable_scheduling()->set_priority(v1::Scheduling::BATCH);
  spec.mutable_request()->mutable_scheduling()->set_client(client);
  spec.set_client(client);
  v1::FrameRange& range = *spec.mutable_frames();
  GOBO_TRY(checkNumbers(range));
  // The request has its defaults, and lacks those that a view stands in the place of (plan/display_transforms.h).
  v1::RenderRequest resolved;
  resolved.Swap(spec.mutable_request());
  spec.clear_request();
  GOBO_TRY(resolveDefaults(spec, "job"));
  spec.mutable_request()->Swap(&resolved);
  if (spec.priority() == v1::JobSpec::PRIORITY_UNSPECIFIED || !v1::JobSpec::Priority_IsValid(spec.priority()))
    return invalidArgument(strf("job.priority = %d: must be LOW, MEDIUM or HIGH", int(spec.priority())), "job.priority");
  if (spec.has_deadline_unix_s() && spec.deadline_unix_s() <= nowUnix)
    return Status(Code::DeadlineExceeded, strf("job.deadline_unix_s = %.3f has passed", spec.deadline_unix_s()), "job.deadline_unix_s");
  if (!range.has_last()) range.set_last(range.first());
  if (range.last() < range.first())
    return invalidArgument(strf("job.frames.last = %lld: must be at least first = %lld", (long long)range.last(), (long long)range.first()), "job.frames.last");
  const int64_t count = range.numbers().empty() ? (range.last() - range.first()) / range.step() + 1 : range.numbers_size();
  if (count > kMostFrames) return invalidArgument(strf("job.frames: %lld frames, at most %lld", (long long)count, (long long)kMostFrames), "job.frames");
  for (int64_t i = 0; i < count; ++i) job.frames.push_back(range.numbers().empty() ? range.first() + i * range.step() : range.numbers(int(i)));
  if (!range.numbers().empty()) range.clear_first(), range.clear_last(), range.clear_step();
  GOBO_TRY(checkParts(spec, count));
  job.parts = partsOf(spec);
  v1::RenderRequest first = frameRequest(spec, job.frames.front());
  if (job.parts) *first.mutable_window() = partWindow(spec, 0);
  const Status planned = engine.prepare(first, nullptr, stop, access, environmentFile).status();  // a plan can be made: outputs, lights, environment
  if (job.parts && planned.location() == "request.window")
    return Status(planned.code(), strf("job.tile_px = %u: ", spec.tile_px()) + planned.message(), "job.tile_px");
  GOBO_TRY(planned);
  GOBO_TRY(checkOutPaths(spec, job.frames, stop));
  job.sceneHash = spec.request().scene_hash();
  return job;
}

v1::RenderRequest frameRequest(const v1::JobSpec& spec, int64_t frame) {
  v1::RenderRequest request = spec.request();
  if (spec.frames().has_fps()) request.set_time_s(double(frame) / spec.frames().fps());
  return request;
}

std::string resultName(const v1::JobSpec& spec, int64_t frame, const std::string& output, v1::Encoding::Format format) {
  std::string name = plainName(spec);
  name += strf(frame < 0 ? ".%05lld" : ".%04lld", (long long)frame);
  if (spec.request().outputs_size() > 1) name += "." + plainText(output);
  return name + "." + extensionOf(format);
}

}  // namespace jobs
}  // namespace gobo
