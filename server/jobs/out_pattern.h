// SPDX-License-Identifier: Apache-2.0
// JobSpec.out: where a job's files are also written, a path below jobs.out_folder with variables:
//   {name}        the job's name, or its scene's; {name} and {output} with "_" for what does not belong into file names
//   {job}         "j-7"
//   {frame}       its number; {frame:04}: with at least so many digits (1 to 9), a sign beside them
//   {output}      "beauty"; "layers" where all are in one file
//   {ext}         of the encoding: exr, png, jpg, raw
// Pure. Errors: InvalidArgument at "job.out".
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"
#include "base/stop.h"
#include "gobo/v1/jobs.pb.h"

namespace gobo {
inline namespace jobs {

constexpr size_t kOutPatternBytes = 1000, kOutPathBytes = 1024, kOutPartBytes = 255;

/// What FrameFile.output says of a frame's files: the request's outputs, or "layers" alone. `resolved` as below.
std::vector<std::string> outputsInFiles(const v1::JobSpec& resolved);
/// Its form: relative, no empty part, no "." or "..", no control characters, known variables, no extension of another kind of file's. An empty one is fine.
Status checkOutPattern(const std::string& pattern);
/// What it comes to for this job: no two files have one path, and none is too long. `resolved`: outputs and encoding filled in. Cost: a path a file.
Status checkOutPaths(const v1::JobSpec& resolved, const std::vector<int64_t>& frames, const StopToken& stop = {});
/// The path of one file, relative. The pattern was checked.
std::string outPath(const v1::JobSpec& resolved, const std::string& job, int64_t frame, const std::string& output);

}  // namespace jobs
}  // namespace gobo
