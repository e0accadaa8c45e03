// SPDX-License-Identifier: Apache-2.0
// What was recorded of each release (tests/data/versions/RELEASE, docs/versions.md): schema, messages, files. Tests run in the project's folder.
#pragma once

#include <google/protobuf/descriptor.pb.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "plan/engine.h"

namespace gobo::testing {

inline const char* const kReleases = "tests/data/versions";

/// The version of the project, without what git says of the build.
inline std::string thisRelease() {
  const std::string build = buildVersion();
  return build.substr(0, build.find('+'));
}

inline bool recording() { return std::getenv("GOBO_RECORD") != nullptr; }

/// Recorded releases, each a folder.
inline std::vector<std::string> releases() {
  std::vector<std::string> out;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(kReleases, error))
    if (entry.is_directory()) out.push_back(entry.path().filename().string());
  std::sort(out.begin(), out.end());
  return out;
}

inline std::string releaseFile(const std::string& release, const std::string& name) { return std::string(kReleases) + "/" + release + "/" + name; }

inline std::string readAll(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  EXPECT_TRUE(in.good()) << path << " cannot be read";
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

inline void writeAll(const std::string& path, const std::string& bytes) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), std::streamsize(bytes.size()));
  EXPECT_TRUE(out.good()) << path << " cannot be written";
}

/// Messages one after the other, each behind its length (u32, little endian).
inline std::string packed(const std::vector<std::string>& messages) {
  std::string out;
  for (const std::string& m : messages) {
    for (int i = 0; i < 4; ++i) out += char(uint32_t(m.size()) >> (8 * i));
    out += m;
  }
  return out;
}

inline std::vector<std::string> unpacked(const std::string& bytes) {
  std::vector<std::string> out;
  for (size_t at = 0; at + 4 <= bytes.size();) {
    uint32_t size = 0;
    for (int i = 0; i < 4; ++i) size |= uint32_t(uint8_t(bytes[at + size_t(i)])) << (8 * i);
    EXPECT_LE(at + 4 + size, bytes.size());
    out.push_back(bytes.substr(at + 4, size));
    at += 4 + size;
  }
  return out;
}

inline google::protobuf::FileDescriptorSet recordedSchema(const std::string& release) {
  google::protobuf::FileDescriptorSet set;
  EXPECT_TRUE(set.ParseFromString(readAll(releaseFile(release, "schema.bin")))) << release;
  EXPECT_GE(set.file_size(), 5) << release;
  return set;
}

}  // namespace gobo::testing
