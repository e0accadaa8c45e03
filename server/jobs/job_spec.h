// SPDX-License-Identifier: Apache-2.0
// Job specs as values: checked, filled in and expanded to frames; the request of one frame; names of result files.
// Pure but for the engine's plan check. Thread-safe.
#pragma once

#include <string>
#include <vector>

#include "plan/engine.h"
#include "server/jobs/job_store.h"

namespace gobo {
inline namespace jobs {

constexpr size_t kSpecBytes = 1 << 20;  ///< of a job's spec as it is kept: lists show many of them

/// Checks the spec, resolves its request against the scene as it is now, and makes the frames. `client` is the one that is
/// charged. Fields that this build does not know are dropped; what is left may have kSpecBytes. Leaves sceneFile and environmentDigest to the caller;
/// `environmentFile`: see PreparedRender. Errors: InvalidArgument naming the field ("job.frames.last"); the engine's own for the request.
Result<NewJob> makeJob(const v1::JobSpec& sent, const std::string& client, Engine& engine, double nowUnix, const SceneAccess& access = {},
                       const StopToken& stop = {}, const std::string& environmentFile = {});
/// Of the spec as sent, whatever order its maps have.
std::string specDigest(const v1::JobSpec& sent);
/// The request of a frame: time_s = frame / fps when fps is given.
v1::RenderRequest frameRequest(const v1::JobSpec& spec, int64_t frame);
/// Ids of jobs as numbers, each once, at most kMostNeeds; `field` is what they are called ("job.after"). Errors: NotFound for what is no id, InvalidArgument;
/// both name FIELD[K].
constexpr int kMostNeeds = 200;
Result<std::vector<int64_t>> parseJobIds(const google::protobuf::RepeatedPtrField<std::string>& ids, const std::string& field);
bool jobHasFrame(const v1::JobSpec& resolved, int64_t frame);
/// The spec's name, or its scene's, with "_" for characters that do not belong into a file name; never empty, never begins with a dot.
std::string plainName(const v1::JobSpec& spec);
std::string plainText(const std::string& text);
/// "exr", of the encoding.
const char* extensionOf(v1::Encoding::Format format);
/// "NAME.0007.beauty.exr"; characters that do not belong into a file name become "_".
std::string resultName(const v1::JobSpec& spec, int64_t frame, const std::string& output, v1::Encoding::Format format);

}  // namespace jobs
}  // namespace gobo
