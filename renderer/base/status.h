// SPDX-License-Identifier: Apache-2.0
// Status and Result<T>: how an expected failure leaves a module. No exceptions cross module borders.
// A Status carries a gRPC-compatible code, a message, and where the fault is (file + JSON pointer, or a request field path).
// Values are immutable after construction; any thread may read them.
#pragma once

#include <optional>
#include <string>
#include <utility>

namespace gobo {
inline namespace base {

/// Numerically equal to grpc::StatusCode, so that the server maps them without a table.
enum class Code {
  Ok = 0,
  Cancelled = 1,
  Unknown = 2,
  InvalidArgument = 3,
  DeadlineExceeded = 4,
  NotFound = 5,
  AlreadyExists = 6,
  PermissionDenied = 7,
  ResourceExhausted = 8,
  FailedPrecondition = 9,
  Aborted = 10,
  OutOfRange = 11,
  Unimplemented = 12,
  Internal = 13,
  Unavailable = 14,
  DataLoss = 15,
  Unauthenticated = 16,
};

const char* codeName(Code code);

class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(Code code, std::string message, std::string location = {}) : code_(code), message_(std::move(message)), location_(std::move(location)) {}

  bool ok() const { return code_ == Code::Ok; }
  Code code() const { return code_; }
  const std::string& message() const { return message_; }
  /// "scene.gltf#/materials/3/alphaMode" or "request.shadows.k"; empty when the fault has no place.
  const std::string& location() const { return location_; }
  /// "INVALID_ARGUMENT: message (at location)".
  std::string toString() const;
  /// The same status, placed at `prefix` if it had no location yet.
  Status at(std::string prefix) const;

 private:
  Code code_ = Code::Ok;
  std::string message_;
  std::string location_;
};

inline Status invalidArgument(std::string message, std::string location = {}) { return {Code::InvalidArgument, std::move(message), std::move(location)}; }
inline Status notFound(std::string message, std::string location = {}) { return {Code::NotFound, std::move(message), std::move(location)}; }
inline Status internalError(std::string message, std::string location = {}) { return {Code::Internal, std::move(message), std::move(location)}; }

/// A value or the Status that explains its absence.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}          // NOLINT: implicit on purpose, `return value;`
  Result(Status status) : status_(std::move(status)) {}  // NOLINT: implicit on purpose, `return status;`

  bool ok() const { return value_.has_value(); }
  explicit operator bool() const { return ok(); }
  const Status& status() const { return status_; }
  T& value() & { return *value_; }
  const T& value() const& { return *value_; }
  T&& value() && { return std::move(*value_); }
  T& operator*() & { return *value_; }
  const T& operator*() const& { return *value_; }
  T&& operator*() && { return std::move(*value_); }
  T* operator->() { return &*value_; }
  const T* operator->() const { return &*value_; }

 private:
  std::optional<T> value_;
  Status status_;
};

}  // namespace base
}  // namespace gobo

#define GOBO_CONCAT_INNER(a, b) a##b
#define GOBO_CONCAT(a, b) GOBO_CONCAT_INNER(a, b)
/// Leaves the enclosing function with the Status of `expr` unless it is ok.
#define GOBO_TRY(expr)                                                    \
  do {                                                                    \
    if (auto goboStatus_ = (expr); !goboStatus_.ok()) return goboStatus_; \
  } while (0)
/// `GOBO_ASSIGN(auto x, f())`: x = the value, or leaves the enclosing function with the Status.
#define GOBO_ASSIGN(decl, expr) GOBO_ASSIGN_INNER(GOBO_CONCAT(goboResult_, __LINE__), decl, expr)
#define GOBO_ASSIGN_INNER(tmp, decl, expr) \
  auto tmp = (expr);                       \
  if (!tmp.ok()) return tmp.status();      \
  decl = std::move(*tmp)
