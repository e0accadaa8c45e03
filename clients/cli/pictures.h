// SPDX-License-Identifier: Apache-2.0
// Pictures as they arrive from a server: the stream of events put together, checked against size and digest, and written
// to files named by the user's -o.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/image.h"
#include "base/status.h"
#include "gobo/v1/render.pb.h"
#include "session.h"

namespace gobo::cli {

struct Answer {
  v1::RenderReply reply;
  std::vector<std::string> images;  ///< encoded bytes, in the order of reply.images
};

struct StreamHooks {
  std::function<void(const v1::Progress&)> progress;  ///< may be empty
  std::function<Status(const Answer&)> snapshot;      ///< may be empty
};

/// Errors: the call's; DataLoss when bytes are missing, out of place or do not have the digest that was promised.
Result<Answer> receive(Session& session, Session::Call& call, grpc::ClientReader<v1::RenderEvent>& reader, const StreamHooks& hooks);
/// Renders with hooks.progress or hooks.snapshot set: RenderProgressive; otherwise Render.
Result<Answer> renderOnce(Session& session, const v1::RenderRequest& request, const StreamHooks& hooks = {});

/// Format by extension: .exr .png .jpg .jpeg .raw. Errors: InvalidArgument.
Result<v1::Encoding::Format> formatOf(const std::string& file);
/// Errors: NotFound where the folder of `file` does not exist. So that nothing is rendered for it. Empty: no file.
Status checkFolder(const std::string& flag, const std::string& file);
/// out.exr for one image; out.NAME.exr for several (":" and "/" in NAME become "-").
std::string fileFor(const std::string& out, const std::string& output, bool several);
/// Writes every image atomically; returns the names.
Result<std::vector<std::string>> writeImages(const Answer& answer, const std::string& out);
/// The floats of a RAW_FLOAT image.
Result<Image> rawImage(const Answer& answer, size_t index);

}  // namespace gobo::cli
