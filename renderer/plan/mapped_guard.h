// SPDX-License-Identifier: Apache-2.0
// MappedGuard: the mapped files under one render. A file that breaks while it is read shows zeroes (base/mapped_faults.h): what was made of
// them must neither leave nor be kept. Terms are asked for before the store, parked states and checkpoints get them; the picture at the end.
// Acceleration structures and posed scenes, which look into the mapping, are kept by mapping and need not be asked for: nobody finds those
// of a broken one. One thread.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/mapped_file.h"
#include "scene/scene.h"

namespace gobo {
inline namespace plan {

class MappedGuard {
 public:
  MappedGuard(const Scene& scene, const std::string& id) { add(scene.file, "scene '" + id + "'", "request.scene"); }
  void add(const Environment& map, const std::string& path) { add(map.file, "environment '" + path + "'", "request.environment.path"); }
  /// DataLoss that names the file and what it holds, if one is not intact. What has been read so far is right otherwise.
  Status check() const;
  std::vector<std::shared_ptr<const MappedFile>> broken() const;

 private:
  struct Watched {
    std::shared_ptr<const MappedFile> file;
    std::string what, field;
  };
  void add(const std::shared_ptr<const MappedFile>& file, const std::string& what, const char* field) {
    if (file) files_.push_back({file, what, field});
  }
  std::vector<Watched> files_;
};

}  // namespace plan
}  // namespace gobo
