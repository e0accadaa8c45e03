// SPDX-License-Identifier: Apache-2.0
// Errors on their way to a client: code, message and place fit into what it takes of trailers, whatever the names in them.
#include "server/rpc.h"

#include <gtest/gtest.h>

#include "base/utf8.h"

namespace gobo::rpc_test {
namespace {

/// What grpc-message (percent-encoded) and the same text in base64 take together.
size_t inTrailers(const std::string& text) {
  size_t bytes = 0;
  for (const char c : text) bytes += c >= 0x20 && c < 0x7f && c != '%' ? 1 : 3;
  return bytes + (text.size() + 2) / 3 * 4;
}

TEST(ToGrpc, FitsIntoTrailersAndKeepsThePlace) {
  std::string foreign, percent(9000, '%'), control(9000, '\n');
  for (int i = 0; i < 9000; ++i) foreign += "\xc3\xbc";
  for (const std::string& text : {std::string(100, 'a'), std::string(20000, 'a'), foreign, "a" + foreign, percent, control}) {
    const grpc::Status status = toGrpc(Status(Code::NotFound, "no camera '" + text + "'", "request.camera.name"));
    EXPECT_EQ(status.error_code(), grpc::StatusCode::NOT_FOUND);
    EXPECT_LT(inTrailers(status.error_message()), 7500u);
    EXPECT_TRUE(status.error_message().ends_with(" (at request.camera.name)"));
    EXPECT_TRUE(isUtf8(status.error_message())) << "characters stay whole";
  }
  const grpc::Status place = toGrpc(Status(Code::InvalidArgument, std::string(20000, 'm'), "request.lights." + foreign));
  EXPECT_LT(inTrailers(place.error_message()), 7500u);
  EXPECT_NE(place.error_message().find("... (at request.lights."), std::string::npos);
  EXPECT_EQ(toGrpc(Status(Code::InvalidArgument, "must be 3", "request.x")).error_message(), "must be 3 (at request.x)");
}

}  // namespace
}  // namespace gobo::rpc_test
