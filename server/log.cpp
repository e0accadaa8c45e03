// SPDX-License-Identifier: Apache-2.0
#include "server/log.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <ctime>
#include <mutex>
#include <vector>

#include "base/utf8.h"

namespace gobo {
inline namespace server {
namespace {

std::atomic<int> minimum{int(LogLevel::Info)};
std::atomic<int> format_{int(LogFormat::Text)};
thread_local std::string requestId;
std::mutex sinkMutex;
std::function<void(const std::string&)> sink;

std::string stamp() {
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const long ms = long(std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[40];
  const size_t n = strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
  return strf("%.*s.%03ldZ", int(n), text, ms);
}

// Bare when it is one word, else in quotes with quotes and backslashes escaped.
std::string textValue(const std::string& value) {
  if (!value.empty() && value.find_first_of(" \"=\\") == std::string::npos) return escaped(value);
  std::string out = "\"";
  for (const char c : value) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return escaped(out + "\"");
}

void write(LogLevel level, const std::string& event, const std::string& message, const LogFields& fields) {
  static const char* names[] = {"DEBUG", "INFO", "WARN", "ERROR", "OFF"};
  const bool json = format_.load(std::memory_order_relaxed) == int(LogFormat::Json);
  bool ownId = false;
  for (const auto& [key, value] : fields) ownId = ownId || key == "request";
  std::string line;
  const auto add = [&](const std::string& key, const std::string& value) {
    line += json ? "," + jsonString(key) + ":" + jsonString(value) : " " + escaped(key) + "=" + textValue(value);
  };
  if (json) line = "{\"time\":\"" + stamp() + "\",\"level\":\"" + names[int(level)] + "\",\"event\":" + jsonString(event);
  else line = stamp() + " " + names[int(level)] + " " + escaped(message.empty() ? event : message);
  if (!ownId && !requestId.empty()) add("request", requestId);
  if (json && !message.empty()) add("message", message);
  for (const auto& [key, value] : fields) add(key, value);
  if (json) line += "}";
  {
    const std::lock_guard lock(sinkMutex);
    if (sink) return sink(line);
  }
  line += "\n";
  // A log that cannot be written is no reason to stop serving.
  if (::write(STDERR_FILENO, line.data(), line.size()) < 0) return;
}

std::string vstrf(const char* format, va_list args) {
  va_list copy;
  va_copy(copy, args);
  const int n = vsnprintf(nullptr, 0, format, copy);
  va_end(copy);
  if (n <= 0) return {};
  std::string text(size_t(n), '\0');
  vsnprintf(text.data(), size_t(n) + 1, format, args);
  return text;
}

}  // namespace

Result<LogLevel> parseLogLevel(const std::string& name) {
  const char* names[] = {"debug", "info", "warn", "error", "off"};
  for (int i = 0; i < 5; ++i)
    if (name == names[i]) return LogLevel(i);
  return invalidArgument("log level \"" + name + "\" is not one of debug, info, warn, error, off");
}

Result<LogFormat> parseLogFormat(const std::string& name) {
  if (name == "text") return LogFormat::Text;
  if (name == "json") return LogFormat::Json;
  return invalidArgument("log format \"" + escaped(name) + "\" is not one of text, json");
}

void setLogLevel(LogLevel level) { minimum.store(int(level)); }
void setLogFormat(LogFormat format) { format_.store(int(format)); }
void setLogSink(std::function<void(const std::string&)> target) {
  const std::lock_guard lock(sinkMutex);
  sink = std::move(target);
}

std::string jsonString(const std::string& text) {
  std::string out = "\"";
  for (size_t i = 0; i < text.size();) {
    const unsigned char c = static_cast<unsigned char>(text[i]);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += char(c);
      ++i;
    } else if (c < 0x20 || c == 0x7f) {
      out += strf("\\u%04x", c);
      ++i;
    } else if (c < 0x80) {
      out += char(c);
      ++i;
    } else {
      // RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF.
      const size_t n = c >= 0xc2 && c <= 0xdf ? 2 : c >= 0xe0 && c <= 0xef ? 3 : c >= 0xf0 && c <= 0xf4 ? 4 : 0;
      bool valid = n != 0 && i + n <= text.size();
      for (size_t k = 1; valid && k < n; ++k) valid = (static_cast<unsigned char>(text[i + k]) & 0xc0) == 0x80;
      const unsigned second = valid ? static_cast<unsigned char>(text[i + 1]) : 0;
      if (valid && ((c == 0xe0 && second < 0xa0) || (c == 0xed && second > 0x9f) || (c == 0xf0 && second < 0x90) || (c == 0xf4 && second > 0x8f)))
        valid = false;
      out += valid ? text.substr(i, n) : "\xef\xbf\xbd";
      i += valid ? n : 1;
    }
  }
  return out + "\"";
}

std::string escaped(const std::string& text) {
  std::string out;
  out.reserve(text.size());
  for (const unsigned char c : cleanUtf8(text)) {
    if (c >= 0x20 && c != 0x7f) {
      out += char(c);
    } else {
      char hex[8];
      snprintf(hex, sizeof hex, "\\x%02x", c);
      out += hex;
    }
  }
  return out;
}

LogRequest::LogRequest(const std::string& id) : before_(requestId) { requestId = id; }
LogRequest::~LogRequest() { requestId = before_; }

void logEvent(LogLevel level, const std::string& event, const LogFields& fields) {
  if (int(level) >= minimum.load(std::memory_order_relaxed)) write(level, event, "", fields);
}

void logLine(LogLevel level, const std::string& text) {
  if (int(level) >= minimum.load(std::memory_order_relaxed)) write(level, "message", text, {});
}

std::string strf(const char* format, ...) {
  va_list args;
  va_start(args, format);
  std::string text = vstrf(format, args);
  va_end(args);
  return text;
}

#define GOBO_LOG_FUNCTION(name, level)            \
  void name(const char* format, ...) {            \
    va_list args;                                 \
    va_start(args, format);                       \
    const std::string text = vstrf(format, args); \
    va_end(args);                                 \
    logLine(level, text);                         \
  }
GOBO_LOG_FUNCTION(logInfo, LogLevel::Info)
GOBO_LOG_FUNCTION(logWarn, LogLevel::Warn)
GOBO_LOG_FUNCTION(logError, LogLevel::Error)

}  // namespace server
}  // namespace gobo
