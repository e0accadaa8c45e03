// SPDX-License-Identifier: Apache-2.0
#include "server/dial.h"

#include "base/image_io.h"
#include "server/config.h"
#include "server/tls.h"

namespace gobo {
inline namespace server {

namespace {

Result<std::string> textOf(const std::string& file, const std::string& option) {
  if (file.empty()) return std::string();
  auto bytes = readFile(file, 1 << 20);
  if (!bytes.ok()) return bytes.status().at(option);
  return std::string(bytes->begin(), bytes->end());
}

}  // namespace

Result<Dialled> dial(const DialOptions& o) {
  GOBO_ASSIGN(const Address address, parseAddress(o.address));
  const std::string tokenFile = o.prefix + "token" + o.fill + "file";
  const bool tls = o.tls || !o.ca.empty() || !o.cert.empty() || !o.key.empty();
  Dialled out{nullptr, o.token};
  if (!o.tokenFile.empty()) {
    GOBO_ASSIGN(out.token, textOf(o.tokenFile, tokenFile));
    if (const size_t end = out.token.find_first_of("\r\n"); end != std::string::npos) out.token.resize(end);
  }
  for (const char c : out.token)
    if (c <= 0x20 || c >= 0x7f) return invalidArgument("the token must be printable ASCII without spaces", o.tokenFile.empty() ? "GOBO_TOKEN" : tokenFile);
  if (!out.token.empty() && !tls && !address.isUnix && !isLoopback(address.host))
    return invalidArgument("the token would go to " + o.address + " unencrypted: use " + o.prefix + "tls or " + o.prefix + "ca");
  std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::InsecureChannelCredentials();
  if (tls) {
    if (o.cert.empty() != o.key.empty()) return invalidArgument(o.prefix + "cert and " + o.prefix + "key go together");
    grpc::SslCredentialsOptions ssl;
    GOBO_ASSIGN(ssl.pem_root_certs, textOf(o.ca, o.prefix + "ca"));
    GOBO_ASSIGN(ssl.pem_cert_chain, textOf(o.cert, o.prefix + "cert"));
    GOBO_ASSIGN(ssl.pem_private_key, textOf(o.key, o.prefix + "key"));
    // gRPC takes any text, and then says of the server that it cannot be reached.
    if (!o.ca.empty() && !holdsCertificate(ssl.pem_root_certs)) return invalidArgument(o.prefix + "ca " + o.ca + ": holds no PEM certificate");
    if (!o.cert.empty() && !holdsCertificate(ssl.pem_cert_chain)) return invalidArgument(o.prefix + "cert " + o.cert + ": holds no PEM certificate");
    if (!o.key.empty() && !holdsPrivateKey(ssl.pem_private_key))
      return invalidArgument(o.prefix + "key " + o.key + ": holds no PEM private key without a passphrase");
    credentials = grpc::SslCredentials(ssl);
  }
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(-1);
  // A daemon that is started again is found again soon, and one that vanished without a word is noticed.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 20000);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 10000);
  out.channel = grpc::CreateCustomChannel(o.address, credentials, arguments);
  return out;
}

}  // namespace server
}  // namespace gobo
