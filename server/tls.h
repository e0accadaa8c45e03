// SPDX-License-Identifier: Apache-2.0
// TLS of the TCP listeners. The files are read and checked here (the key belongs to the certificate, which is valid today), and
// handed to gRPC per handshake (grpc_ssl_server_credentials_create_options_using_config_fetcher): a reload changes what new
// connections get and touches no running one. gRPC 1.51 speaks TLS 1.2 and 1.3. Thread-safe.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include <grpcpp/security/server_credentials.h>

#include "server/config.h"

namespace gobo {
inline namespace server {

/// The files of [tls], read and checked.
struct TlsFiles {
  std::string cert, key, clientCa;
  int64_t expires = 0;  ///< Unix time at which the certificate ends
  std::string subject;
};
/// Errors: InvalidArgument "tls.KEY = \"PATH\": ..." for what cannot be read, is no PEM, does not belong together or is expired.
Result<TlsFiles> readTls(const TlsConfig& config);

/// Whether a text holds a certificate in PEM.
bool holdsCertificate(const std::string& pem);
/// A private key in PEM that needs no passphrase.
bool holdsPrivateKey(const std::string& pem);

class TlsSource : public std::enable_shared_from_this<TlsSource> {
 public:
  TlsSource(TlsFiles files, bool requireClientCert);
  /// From the next handshake on.
  void set(TlsFiles files);
  int64_t expires() const;
  /// For ServerBuilder::AddListeningPort, of one address each.
  std::shared_ptr<grpc::ServerCredentials> credentials();

 private:
  friend struct TlsFetch;
  mutable std::mutex mutex_;
  TlsFiles files_;
  uint64_t version_ = 1;
  const bool require_;
};

}  // namespace server
}  // namespace gobo
