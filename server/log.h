// SPDX-License-Identifier: Apache-2.0
// The daemon's log: plain lines on stderr, "2026-01-02T03:04:05.678Z INFO text". One write(2) a line, so that lines of
// several threads do not mix. Control characters are escaped: text from clients cannot forge a line. Thread-safe.
#pragma once

#include <string>

#include "base/status.h"

namespace gobo {

enum class LogLevel : int { Debug = 0, Info, Warn, Error, Off };

/// "debug", "info", "warn", "error", "off".
Result<LogLevel> parseLogLevel(const std::string& name);
void setLogLevel(LogLevel level);
void logLine(LogLevel level, const std::string& text);
void logInfo(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logWarn(const char* format, ...) __attribute__((format(printf, 1, 2)));
void logError(const char* format, ...) __attribute__((format(printf, 1, 2)));
/// printf into a string.
std::string strf(const char* format, ...) __attribute__((format(printf, 1, 2)));
/// Control characters as \xNN, so that the text stays on its line.
std::string escaped(const std::string& text);

}  // namespace gobo
