// SPDX-License-Identifier: Apache-2.0
// Files for a server that cannot open them: sent by their SHA-256, once, in parts that go on where they broke off. One thread.
#pragma once

#include <map>
#include <string>

#include "session.h"

namespace gobo::cli {

/// A file here.
struct LocalBlob {
  std::string path;
  std::string sha256;  ///< empty until it has been read
  uint64_t bytes = 0;
};

/// A .gltf or .glb and the files below its folder that it names, by their names relative to it. What is not there is left out: the server judges that as on
/// its own disk. Nothing is read but the scene. Errors: NotFound.
Result<std::map<std::string, LocalBlob>> filesOf(const std::string& scene);
/// Sends what the server has not got of this caller's. Errors: the server's; Unimplemented of one that has no Blobs.
Status putBlobs(Session& session, const std::map<std::string, LocalBlob>& blobs);
/// Puts and opens a scene. Without a name the id is made from file name and content: a scene that is loaded is found under it and nothing is sent.
Result<v1::SceneInfo> openByDigest(Session& session, const std::string& scene, std::map<std::string, LocalBlob> files, const std::string& name);
/// request.environment.path of a .hdr or .exr that is here and that the server cannot open becomes environment.digest of the same file, put. True: it did.
/// One that the server can open becomes absolute.
Result<bool> putEnvironment(Session& session, v1::EnvironmentSettings& environment);

}  // namespace gobo::cli
