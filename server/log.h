// SPDX-License-Identifier: Apache-2.0
// The daemon's log on stderr: one event a line, with one write(2), so that lines of several threads do not mix.
//   text  2026-01-02T03:04:05.678Z INFO render request=5f1c... scene=cornell error="no scene 'x'"
//   json  {"time":"2026-01-02T03:04:05.678Z","level":"INFO","event":"render","request":"5f1c...","scene":"cornell"}
// Control characters are escaped: text from clients cannot forge a line; JSON strings are valid UTF-8 whatever came in.
// Every line that a thread writes while a LogRequest lives carries that request's id. Thread-safe.
#pragma once

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "base/status.h"

namespace gobo {
inline namespace server {

enum class LogLevel : int { Debug = 0, Info, Warn, Error, Off };
enum class LogFormat : int { Text = 0, Json };
using LogFields = std::vector<std::pair<std::string, std::string>>;

/// "debug", "info", "warn", "error", "off".
Result<LogLevel> parseLogLevel(const std::string& name);
/// "text", "json".
Result<LogFormat> parseLogFormat(const std::string& name);
void setLogLevel(LogLevel level);
void setLogFormat(LogFormat format);
/// Where lines go (without their line end); empty: stderr.
void setLogSink(std::function<void(const std::string& line)> sink);

/// `event` is a word; a field whose key is "request" overrides the thread's.
void logEvent(LogLevel level, const std::string& event, const LogFields& fields);
/// Free text: the event is "message" in JSON, the line itself in text.
void logLine(LogLevel level, const std::string& text);
void logInfo(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logWarn(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logError(const char* format, ...) __attribute__((format(printf, 1, 2)));
/// printf into a string.
std::string strf(const char* format, ...) __attribute__((format(printf, 1, 2)));
/// Control characters as \xNN, so that the text stays on its line, and what is no UTF-8, so that it can be sent: what was cut may end within a character.
std::string escaped(const std::string& text);
/// A JSON string with its quotes; bytes that are no UTF-8 become U+FFFD.
std::string jsonString(const std::string& text);

/// While it lives, this thread's lines carry the id.
class LogRequest {
 public:
  explicit LogRequest(const std::string& id);
  ~LogRequest();
  LogRequest(const LogRequest&) = delete;
  LogRequest& operator=(const LogRequest&) = delete;

 private:
  std::string before_;
};

}  // namespace server
}  // namespace gobo
