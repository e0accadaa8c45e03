// SPDX-License-Identifier: Apache-2.0
#include "frames.h"

#include <cerrno>
#include <cstdlib>
#include <set>

namespace gobo::cli {

namespace {

constexpr int64_t kFarthest = 1000000000;  // of a frame from 0, as the schema has it
constexpr size_t kMost = 100000;

/// Moves `at` behind the number; false: there is none, or it is too far.
bool number(const char*& at, int64_t& out) {
  if ((*at < '0' || *at > '9') && *at != '-') return false;  // strtoll takes spaces and signs that nobody means
  char* end = nullptr;
  errno = 0;
  out = std::strtoll(at, &end, 10);
  if (end == at || errno != 0 || out > kFarthest || out < -kFarthest) return false;
  at = end;
  return true;
}

}  // namespace

Result<std::vector<int64_t>> parseFrames(const std::string& text, const std::string& flag) {
  std::vector<int64_t> frames;
  std::set<int64_t> seen;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(',', begin), text.size());
    const std::string part = text.substr(begin, end - begin);
    const auto refuse = [&](const std::string& what) { return invalidArgument(flag + " " + text + ": \"" + part + "\" " + what); };
    FrameSpan span;
    const char* at = part.c_str();
    bool good = number(at, span.first);
    span.last = span.first;
    if (good && *at == '-') good = number(++at, span.last);
    if (good && *at == ':') good = number(++at, span.step) && span.step >= 1;
    if (!good || *at != 0) return refuse("must be FRAME, FIRST-LAST or FIRST-LAST:STEP, with frames within 1000000000 of 0");
    if (span.last < span.first) return refuse("descends: name the smaller frame first");
    if (size_t((span.last - span.first) / span.step) + 1 + frames.size() > kMost) return refuse("makes more than 100000 frames");
    for (int64_t f = span.first; f <= span.last; f += span.step) {
      if (!seen.insert(f).second) return refuse("names frame " + std::to_string(f) + " again");
      frames.push_back(f);
    }
    begin = end + 1;
  }
  return frames;
}

bool oneSpan(const std::vector<int64_t>& frames, FrameSpan& span) {
  span = {frames.front(), frames.back(), frames.size() > 1 ? frames[1] - frames[0] : 1};
  if (span.step < 1) return false;
  for (size_t i = 1; i < frames.size(); ++i)
    if (frames[i] - frames[i - 1] != span.step) return false;
  return true;
}

}  // namespace gobo::cli
