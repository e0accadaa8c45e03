// SPDX-License-Identifier: Apache-2.0
#include "credentials.h"

#include <cstdlib>
#include <fstream>
#include <sstream>

namespace gobo::cli {
namespace {

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

Result<std::string> content(const std::string& path) {
  if (path.empty()) return std::string();
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!in) return notFound("cannot read \"" + path + "\"");
  text << in.rdbuf();
  return text.str();
}

}  // namespace

Result<std::shared_ptr<grpc::ChannelCredentials>> channelCredentials(const CredentialOptions& o, bool isUnix) {
  const std::string ca = o.ca.empty() ? environment("GOBO_TLS_CA") : o.ca;
  if (isUnix || !(o.tls || !ca.empty() || !o.cert.empty() || !o.key.empty())) return grpc::InsecureChannelCredentials();
  grpc::SslCredentialsOptions ssl;
  GOBO_ASSIGN(ssl.pem_root_certs, content(ca));
  GOBO_ASSIGN(ssl.pem_cert_chain, content(o.cert));
  GOBO_ASSIGN(ssl.pem_private_key, content(o.key));
  return grpc::SslCredentials(ssl);
}

Result<std::string> bearerToken(const CredentialOptions& o) {
  const std::string file = o.tokenFile.empty() ? environment("GOBO_TOKEN_FILE") : o.tokenFile;
  std::string token = environment("GOBO_TOKEN");
  if (!file.empty()) { GOBO_ASSIGN(token, content(file)); }
  const char* space = " \t\r\n";
  const size_t from = token.find_first_not_of(space);
  if (from == std::string::npos) return file.empty() ? Result<std::string>(std::string()) : Result<std::string>(notFound("\"" + file + "\" holds no token"));
  token = token.substr(from, token.find_last_not_of(space) - from + 1);
  if (token.find_first_of(space) != std::string::npos) return invalidArgument("the token has white space inside");
  return token;
}

}  // namespace gobo::cli
