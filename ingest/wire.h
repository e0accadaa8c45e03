// SPDX-License-Identifier: Apache-2.0
// What daemon and gobo-ingest say to each other over one socket pair (child's descriptor 3); the blob goes to descriptor 4.
// Little endian, same machine. Frames: u8 type, u64 body bytes, body.
//   parent  Job        everything the child needs to know, then a File frame with the scene file
//   child   Ask        a name beside the scene file; the parent answers with File or Refusal
//   child   Note       what it is about to parse, so that its end can be blamed on that: "" for the file itself, else a place in it
//   child   Done       the blob is complete on descriptor 4: times, layers of the sandbox
//   child   Failed     one error: code, message, location
// The parent trusts none of it: names are checked again, counts and sizes are bounded, and the blob is verified.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/status.h"

namespace gobo::ingest {

inline constexpr int kSocket = 3, kOutput = 4;
enum class Frame : uint8_t { Job = 1, File = 2, Refusal = 3, Ask = 4, Done = 5, Failed = 6, Note = 7 };
enum class Task : uint8_t { Scene = 1, Environment = 2, Probe = 3 };  ///< Probe: path names a thing to try (probe.h)

struct Job {
  Task task = Task::Scene;
  std::string path;                                           ///< for messages and scene names only: the child cannot open it
  uint64_t maxTriangles = 0, maxBytes = 0, textureBytes = 0;  ///< maxBytes: of all files together; the parent keeps it
  uint64_t memoryBytes = 0, blobBytes = 0;                    ///< RLIMIT_AS beyond the program itself, RLIMIT_FSIZE
  uint32_t cpuSeconds = 0;                                    ///< RLIMIT_CPU
};
/// What stood around the reader while it read ("seccomp", "landlock", ...), and what the machine did not give, each with why.
struct Layers {
  std::vector<std::string> active, missing;
};
struct Done {
  double parseMs = 0, textureMs = 0;
  Layers layers;
};

std::vector<uint8_t> encode(const Job& job);
std::vector<uint8_t> encode(const Done& done);
std::vector<uint8_t> encode(const Status& status);
/// False when the bytes are not exactly one such message.
bool decode(const std::vector<uint8_t>& body, Job& job);
bool decode(const std::vector<uint8_t>& body, Done& done);
bool decode(const std::vector<uint8_t>& body, Status& status);

/// Blocking reads and writes of whole pieces; false at end of file or on an error.
bool readAll(int fd, void* to, size_t bytes);
bool writeAll(int fd, const void* from, size_t bytes);
bool writeFrame(int fd, Frame type, const void* body, size_t bytes);

}  // namespace gobo::ingest
