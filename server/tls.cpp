// SPDX-License-Identifier: Apache-2.0
#include "server/tls.h"

#include <ctime>
#include <fstream>
#include <sstream>
#include <vector>

#include <grpc/grpc.h>
#include <grpc/grpc_security.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

namespace gobo {
inline namespace server {
namespace {

template <typename T, void (*Free)(T*)>
struct Freed {
  void operator()(T* p) const { Free(p); }
};
using Bio = std::unique_ptr<BIO, Freed<BIO, BIO_free_all>>;
using Cert = std::unique_ptr<X509, Freed<X509, X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Freed<EVP_PKEY, EVP_PKEY_free>>;

Status bad(const char* key, const std::string& path, const std::string& why) {
  return invalidArgument(std::string("tls.") + key + " = \"" + escaped(path) + "\": " + why);
}

Result<std::string> readPem(const char* key, const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  if (!in || !(text << in.rdbuf())) return bad(key, path, "cannot be read, or is empty");
  if (text.str().size() > (1u << 20)) return bad(key, path, "is larger than 1 MiB");
  return text.str();
}

Bio open(const std::string& pem) { return Bio(BIO_new_mem_buf(pem.data(), int(pem.size()))); }
// No terminal is asked for the passphrase of an encrypted key.
int noPassphrase(char*, int, int, void*) { return -1; }

int64_t unixTime(const ASN1_TIME* time) {
  std::tm t{};
  return ASN1_TIME_to_tm(time, &t) == 1 ? int64_t(::timegm(&t)) : 0;
}

std::string dateText(int64_t when) {
  const std::time_t t = std::time_t(when);
  std::tm utc{};
  gmtime_r(&t, &utc);
  char text[32];
  return std::string(text, strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc));
}

}  // namespace

bool holdsCertificate(const std::string& pem) {
  const Bio bio = open(pem);
  return Cert(PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) != nullptr;
}
bool holdsPrivateKey(const std::string& pem) {
  const Bio bio = open(pem);
  return Key(PEM_read_bio_PrivateKey(bio.get(), nullptr, noPassphrase, nullptr)) != nullptr;
}

Result<TlsFiles> readTls(const TlsConfig& config) {
  TlsFiles files;
  GOBO_ASSIGN(files.cert, readPem("cert", config.cert));
  GOBO_ASSIGN(files.key, readPem("key", config.key));
  const Bio certBio = open(files.cert), keyBio = open(files.key);
  const Cert cert(PEM_read_bio_X509(certBio.get(), nullptr, nullptr, nullptr));
  if (!cert) return bad("cert", config.cert, "holds no PEM certificate");
  const Key key(PEM_read_bio_PrivateKey(keyBio.get(), nullptr, noPassphrase, nullptr));
  if (!key) return bad("key", config.key, "holds no PEM private key without a passphrase");
  if (X509_check_private_key(cert.get(), key.get()) != 1)
    return bad("key", config.key, "is not the key of the certificate in \"" + escaped(config.cert) + "\"");
  files.expires = unixTime(X509_get0_notAfter(cert.get()));
  if (X509_cmp_current_time(X509_get0_notAfter(cert.get())) <= 0) return bad("cert", config.cert, "the certificate expired at " + dateText(files.expires));
  if (X509_cmp_current_time(X509_get0_notBefore(cert.get())) > 0)
    return bad("cert", config.cert, "the certificate is not valid before " + dateText(unixTime(X509_get0_notBefore(cert.get()))));
  char subject[256] = "";
  X509_NAME_oneline(X509_get_subject_name(cert.get()), subject, sizeof subject);
  files.subject = subject;
  if (!config.clientCa.empty()) {
    GOBO_ASSIGN(files.clientCa, readPem("client_ca", config.clientCa));
    if (!holdsCertificate(files.clientCa)) return bad("client_ca", config.clientCa, "holds no PEM certificate");
  }
  return files;
}

// gRPC's callback, once per handshake, and what one listening port has seen.
struct TlsFetch {
  std::shared_ptr<TlsSource> source;
  uint64_t seen = 0;  // under the source's mutex

  static grpc_ssl_certificate_config_reload_status fetch(void* user, grpc_ssl_server_certificate_config** out) {
    TlsFetch& port = *static_cast<TlsFetch*>(user);
    TlsSource& source = *port.source;
    const std::lock_guard lock(source.mutex_);
    if (port.seen == source.version_) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
    const grpc_ssl_pem_key_cert_pair pair{source.files_.key.c_str(), source.files_.cert.c_str()};
    // gRPC 1.51 aborts on a fetched configuration without roots. Without a client CA clients are not asked for certificates, so
    // nothing is ever checked against this: the server's own certificate fills the place.
    const std::string& roots = source.files_.clientCa.empty() ? source.files_.cert : source.files_.clientCa;
    *out = grpc_ssl_server_certificate_config_create(roots.c_str(), &pair, 1);
    if (!*out) return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_FAIL;
    port.seen = source.version_;
    return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
  }
};

namespace {

// Handshakes may be going on when a server is already gone, and gRPC does not say when the last one is over: what the callback
// reads lives as long as the process. A few hundred bytes per TLS listener ever started.
TlsFetch* keptForEver(std::shared_ptr<TlsSource> source) {
  static std::mutex mutex;
  static auto* all = new std::vector<std::unique_ptr<TlsFetch>>();
  const std::lock_guard lock(mutex);
  all->push_back(std::make_unique<TlsFetch>());
  all->back()->source = std::move(source);
  return all->back().get();
}

// gRPC's C++ API has no door to credentials that reload; its C API has.
class FetchedCredentials final : public grpc::ServerCredentials {
 public:
  FetchedCredentials(std::shared_ptr<TlsSource> source, grpc_ssl_client_certificate_request_type request)
      : credentials_(grpc_ssl_server_credentials_create_with_options(
            grpc_ssl_server_credentials_create_options_using_config_fetcher(request, &TlsFetch::fetch, keptForEver(std::move(source))))) {}
  ~FetchedCredentials() override {
    if (credentials_) grpc_server_credentials_release(credentials_);
  }
  void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>&) override {}  // tokens: server/auth.h

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override {
    return credentials_ ? grpc_server_add_http2_port(server, address.c_str(), credentials_) : 0;
  }
  grpc_server_credentials* credentials_;
};

}  // namespace

TlsSource::TlsSource(TlsFiles files, bool requireClientCert) : files_(std::move(files)), require_(requireClientCert) {}

void TlsSource::set(TlsFiles files) {
  const std::lock_guard lock(mutex_);
  files_ = std::move(files);
  ++version_;
}

int64_t TlsSource::expires() const {
  const std::lock_guard lock(mutex_);
  return files_.expires;
}

std::shared_ptr<grpc::ServerCredentials> TlsSource::credentials() {
  const auto request = files_.clientCa.empty() ? GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE
                       : require_              ? GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY
                                               : GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_AND_VERIFY;
  return std::make_shared<FetchedCredentials>(shared_from_this(), request);
}

}  // namespace server
}  // namespace gobo
