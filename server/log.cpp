// SPDX-License-Identifier: Apache-2.0
#include "server/log.h"

#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdarg>
#include <cstdio>
#include <ctime>
#include <vector>

namespace gobo {
namespace {

std::atomic<int> minimum{int(LogLevel::Info)};

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

void setLogLevel(LogLevel level) { minimum.store(int(level)); }

std::string escaped(const std::string& text) {
  std::string out;
  out.reserve(text.size());
  for (const unsigned char c : text) {
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

void logLine(LogLevel level, const std::string& text) {
  if (int(level) < minimum.load(std::memory_order_relaxed)) return;
  static const char* names[] = {"DEBUG", "INFO", "WARN", "ERROR", "OFF"};
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const long ms = long(std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char stamp[40];
  const size_t n = strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%S", &utc);
  const std::string line = strf("%.*s.%03ldZ %s ", int(n), stamp, ms, names[int(level)]) + escaped(text) + "\n";
  // A log that cannot be written is no reason to stop serving.
  if (::write(STDERR_FILENO, line.data(), line.size()) < 0) return;
}

std::string strf(const char* format, ...) {
  va_list args;
  va_start(args, format);
  std::string text = vstrf(format, args);
  va_end(args);
  return text;
}

#define GOBO_LOG_FUNCTION(name, level)        \
  void name(const char* format, ...) {        \
    va_list args;                             \
    va_start(args, format);                   \
    const std::string text = vstrf(format, args); \
    va_end(args);                             \
    logLine(level, text);                     \
  }
GOBO_LOG_FUNCTION(logInfo, LogLevel::Info)
GOBO_LOG_FUNCTION(logWarn, LogLevel::Warn)
GOBO_LOG_FUNCTION(logError, LogLevel::Error)

}  // namespace gobo
