// SPDX-License-Identifier: Apache-2.0
// TLS and mutual TLS of TCP listeners, with certificates made here; reload of the files. Loopback only.
#include "server/tls.h"
#include "harness.h"
#include "support/pki.h"

namespace gobo {
namespace {

using test::Authority;
using test::Issued;

class Tls : public ServerTest {
 protected:
  void configure(ServerConfig& c) override {
    put(ca.issue("gobod"));
    test::writeFile(folder + "/clients.pem", clientsCa.pem());
    c.listen.push_back("127.0.0.1:0");
    c.tls = {folder + "/cert.pem", folder + "/key.pem", mutual() ? folder + "/clients.pem" : "", mutual()};
  }
  virtual bool mutual() const { return false; }
  void put(const Issued& issued) {
    test::writeFile(folder + "/cert.pem", issued.cert);
    test::writeFile(folder + "/key.pem", issued.key);
  }
  /// The status of one call over a connection of its own.
  grpc::Status call(const std::string& rootPem, const Issued& own = {}) { return ping(connect(grpc::SslCredentials({rootPem, own.key, own.cert}))); }
  std::shared_ptr<grpc::Channel> connect(const std::shared_ptr<grpc::ChannelCredentials>& credentials) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    return grpc::CreateCustomChannel(server->addresses()[1], credentials, arguments);
  }
  static grpc::Status ping(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    bound(context, 10);
    v1::ListScenesReply reply;
    return v1::Scenes::NewStub(channel)->List(&context, {}, &reply);
  }
  Authority ca{"test authority"}, clientsCa{"clients' authority"}, stranger{"a stranger"};
};

class MutualTls : public Tls {
 protected:
  bool mutual() const override { return true; }
};

TEST_F(Tls, OnlyTheRightAuthorityAndOnlyTls) {
  EXPECT_TRUE(call(ca.pem()).ok()) << call(ca.pem()).error_message();
  EXPECT_EQ(call(stranger.pem()).error_code(), grpc::UNAVAILABLE);
  EXPECT_EQ(ping(connect(grpc::InsecureChannelCredentials())).error_code(), grpc::UNAVAILABLE);
  EXPECT_TRUE(ping(channel).ok()) << "the Unix socket stays plain";
}

TEST_F(Tls, ReloadChangesNewConnectionsAndLeavesRunningOnes) {
  const auto old = connect(grpc::SslCredentials({ca.pem(), "", ""}));
  ASSERT_TRUE(ping(old).ok());
  put(stranger.issue("gobod"));
  ASSERT_TRUE(server->reload(config).ok());
  EXPECT_TRUE(ping(old).ok());
  EXPECT_TRUE(call(stranger.pem()).ok()) << call(stranger.pem()).error_message();
  EXPECT_EQ(call(ca.pem()).error_code(), grpc::UNAVAILABLE);
}

TEST_F(Tls, ABrokenReloadKeepsTheOldFiles) {
  const struct {
    Issued files;
    const char* words;
  } cases[] = {
      {ca.issue("gobod", -7200, -3600), "expired"},
      {ca.issue("gobod", 3600, 7200), "not valid before"},
      {{ca.issue("gobod").cert, ca.issue("gobod").key}, "is not the key"},
      {{"nonsense", ca.issue("gobod").key}, "no PEM certificate"},
      {{ca.issue("gobod").cert, ""}, "tls.key"},
  };
  for (const auto& c : cases) {
    put(c.files);
    const auto done = server->reload(config);
    EXPECT_EQ(done.status().code(), Code::InvalidArgument) << c.words;
    EXPECT_NE(done.status().message().find(c.words), std::string::npos) << done.status().message();
    EXPECT_TRUE(call(ca.pem()).ok()) << c.words;
  }
}

TEST_F(Tls, AnExpiredCertificateIsRefusedAtTheStart) {
  put(ca.issue("gobod", -7200, -3600));
  ServerConfig other = config;
  other.listen = {"127.0.0.1:0"};
  const auto started = Server::start(other, engineOptions(other), true);
  EXPECT_EQ(started.status().code(), Code::InvalidArgument);
  EXPECT_NE(started.status().message().find("expired"), std::string::npos) << started.status().message();
}

TEST_F(MutualTls, WantsAClientCertificateOfItsAuthorityThatIsValid) {
  EXPECT_TRUE(call(ca.pem(), clientsCa.issue("artist")).ok()) << call(ca.pem(), clientsCa.issue("artist")).error_message();
  EXPECT_EQ(call(ca.pem()).error_code(), grpc::UNAVAILABLE) << "none";
  EXPECT_EQ(call(ca.pem(), stranger.issue("artist")).error_code(), grpc::UNAVAILABLE) << "of another authority";
  EXPECT_EQ(call(ca.pem(), clientsCa.issue("artist", -7200, -3600)).error_code(), grpc::UNAVAILABLE) << "expired";
}

TEST_F(MutualTls, ReloadChangesTheClientsAuthority) {
  ASSERT_TRUE(call(ca.pem(), clientsCa.issue("artist")).ok());
  test::writeFile(folder + "/clients.pem", stranger.pem());
  ASSERT_TRUE(server->reload(config).ok());
  EXPECT_TRUE(call(ca.pem(), stranger.issue("artist")).ok());
  EXPECT_EQ(call(ca.pem(), clientsCa.issue("artist")).error_code(), grpc::UNAVAILABLE);
}

}  // namespace
}  // namespace gobo
