// SPDX-License-Identifier: Apache-2.0
// What a config's results depend on beside its own text: the files that its transforms name, and variables of its context. Of renderer/color alone.
// OpenColorIO's own cache id of a config knows a file by its inode and its time: another machine with the same files has another one, and a copy that keeps
// both is not noticed. So the digest is of contents. Not followed: a CLF or CTF file that names another file (<Reference>).
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include <OpenColorIO/OpenColorIO.h>

namespace gobo::color {

/// A file as it was: enough to notice that it is another one now.
struct FileStamp {
  uint64_t device = 0, inode = 0, size = 0;
  int64_t changedNs = 0;
  bool there = false;
  bool operator==(const FileStamp&) const = default;
};

struct ConfigFiles {
  std::string hash;                         ///< 32 hex digits
  std::map<std::string, FileStamp> stamps;  ///< by the place where a file was found, or its name where it was not
  /// A file that is not what it was; empty: none.
  std::string changed() const;
};

/// Reads every file that a colour space, look, view transform or named transform of `config` names, as the config's context finds it; one that is not there
/// counts as missing. `text`: the config's own bytes. Cost: the files, at memory speed.
ConfigFiles filesOf(const OCIO_NAMESPACE::ConstConfigRcPtr& config, const std::string& text);

}  // namespace gobo::color
