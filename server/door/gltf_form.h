// SPDX-License-Identifier: Apache-2.0
// The multipart form of one HTTP request as it arrives: short text fields and one file, each given once.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include <microhttpd.h>

#include "base/status.h"
#include "server/encode.h"
#include "server/shared_limit.h"

namespace gobo {
inline namespace door {

/// One thread. What is wrong is remembered; the rest of the body is then dropped as it comes.
class GltfForm {
 public:
  static constexpr size_t kFields = 64, kValueBytes = 4096;
  /// `contentType`: names the boundary. `held`: the memory that was taken for it. `mostBytes`: of the file; `announced`: of the whole body, or its bound.
  GltfForm(MHD_Connection* connection, const std::string& contentType, uint64_t mostBytes, uint64_t announced, std::unique_ptr<SharedLimit::Hold> held);
  ~GltfForm();
  GltfForm(const GltfForm&) = delete;
  GltfForm& operator=(const GltfForm&) = delete;

  /// The Content-Type names a multipart form and its boundary.
  bool readable() const { return reader_ != nullptr; }
  void add(const char* data, size_t bytes);
  /// After the last piece, once. Errors: InvalidArgument naming the field, ResourceExhausted for a file that is too large.
  Status finish();

  const std::map<std::string, std::string>& fields() const { return fields_; }
  bool hasScene() const { return hasScene_; }
  const std::string& scene() const { return scene_; }
  const std::string& sceneSha256() const { return digest_; }  ///< after finish()
  /// The scene's bytes and the memory that was held for the form go; the digest stays.
  void dropScene();

 private:
  static MHD_Result take(void* self, MHD_ValueKind, const char* name, const char* fileName, const char*, const char*, const char* data, uint64_t offset,
                         size_t bytes);
  void count(const char* data, size_t bytes);
  Status takePiece(const std::string& name, const char* data, uint64_t offset, size_t bytes);

  MHD_PostProcessor* reader_ = nullptr;
  const uint64_t mostBytes_, announced_;
  uint64_t arrived_ = 0;
  std::unique_ptr<SharedLimit::Hold> held_;
  std::map<std::string, std::string> fields_;
  std::string scene_, digest_;
  bool hasScene_ = false;
  // The reader may begin a field with a piece of no bytes and then begin it once more, so that an empty field and a second one of its name look like one
  // field: then it is the number of delimiters that tells.
  std::set<std::string> begun_, empty_;  // names; those that have no byte yet
  std::string again_;                    // names that began once more after no byte
  std::string delimiter_, tail_;         // of the parts; the body's last bytes
  size_t delimiters_ = 0;
  Sha256 sha_;
  Status wrong_;
};

}  // namespace door
}  // namespace gobo
