// SPDX-License-Identifier: Apache-2.0
// Terms and folders for store tests: the value of term i is known from i, so any reader can say whether what it got is right.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <memory>
#include <string>

#include "support/temp_folder.h"
#include "terms/term.h"

namespace gobo::test {

inline Hash128 key(int i) { return Hasher("store test").add(i).digest(); }

/// A term of `elements` floats and a few integers; every value depends on i.
inline std::shared_ptr<Term> makeTerm(int i, int elements) {
  auto term = std::make_shared<Term>("test." + std::to_string(i % 7), Domain::List, Extent{elements, 1, 1});
  auto floats = term->addPlane<float>("value");
  for (size_t k = 0; k < floats.size(); ++k) floats[k] = float(i) + float(k) * 0.37f;
  auto bytes = term->addPlane<uint8_t>("tag", 1);
  for (size_t k = 0; k < bytes.size(); ++k) bytes[k] = uint8_t(i * 31 + int(k));
  return term;
}

inline std::string fileOf(const std::string& folder, int i) {
  const std::string name = key(i).hex();
  return folder + "/" + name.substr(0, 2) + "/" + name + ".term";
}

struct Files {
  uint64_t count = 0, bytes = 0;
};
/// Counted without the store's own code. Files may come and go meanwhile.
inline Files termFiles(const std::string& folder) {
  Files files;
  std::error_code ignored;
  for (std::filesystem::recursive_directory_iterator at(folder, ignored), end; at != end; at.increment(ignored)) {
    if (at->path().extension() != ".term" || at->is_symlink(ignored)) continue;
    const auto size = at->file_size(ignored);
    if (ignored) continue;
    ++files.count;
    files.bytes += size;
  }
  return files;
}

}  // namespace gobo::test
