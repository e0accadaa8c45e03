// SPDX-License-Identifier: Apache-2.0
// Certificates for tests: an authority and what it signs, P-256 keys, PEM, made in memory by OpenSSL.
#pragma once

#include <openssl/ec.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>

namespace gobo::test {

struct Issued {
  std::string cert, key;
};

class Authority {
 public:
  explicit Authority(const std::string& name) : key_(EVP_EC_gen("P-256")), cert_(make(name, key_, -3600, 86400, true)) {}
  ~Authority() {
    X509_free(cert_);
    EVP_PKEY_free(key_);
  }
  Authority(const Authority&) = delete;
  Authority& operator=(const Authority&) = delete;
  std::string pem() const { return certText(cert_); }
  /// For localhost and 127.0.0.1, valid from now + `from` until now + `until` seconds.
  Issued issue(const std::string& name, long from = -3600, long until = 86400) {
    EVP_PKEY* key = EVP_EC_gen("P-256");
    X509* cert = make(name, key, from, until, false);
    Issued out{certText(cert), keyText(key)};
    X509_free(cert);
    EVP_PKEY_free(key);
    return out;
  }

 private:
  static void need(bool ok) {
    if (!ok) {
      std::cerr << "OpenSSL failed in tests/support/pki.h\n";
      std::abort();
    }
  }
  static std::string text(BIO* bio) {
    char* data = nullptr;
    const long n = BIO_get_mem_data(bio, &data);
    std::string out(data, size_t(n));
    BIO_free_all(bio);
    return out;
  }
  static std::string certText(X509* cert) {
    BIO* bio = BIO_new(BIO_s_mem());
    need(PEM_write_bio_X509(bio, cert) == 1);
    return text(bio);
  }
  static std::string keyText(EVP_PKEY* key) {
    BIO* bio = BIO_new(BIO_s_mem());
    need(PEM_write_bio_PrivateKey(bio, key, nullptr, nullptr, 0, nullptr, nullptr) == 1);
    return text(bio);
  }
  X509* make(const std::string& name, EVP_PKEY* key, long from, long until, bool authority) {
    static long serial = 1;
    X509* cert = X509_new();
    X509_set_version(cert, 2);
    ASN1_INTEGER_set(X509_get_serialNumber(cert), ++serial);
    X509_gmtime_adj(X509_getm_notBefore(cert), from);
    X509_gmtime_adj(X509_getm_notAfter(cert), until);
    X509_set_pubkey(cert, key);
    X509_NAME_add_entry_by_txt(X509_get_subject_name(cert), "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1, 0);
    X509_set_issuer_name(cert, authority ? X509_get_subject_name(cert) : X509_get_subject_name(cert_));
    const auto extension = [&](int nid, const char* value) {
      X509V3_CTX context;
      X509V3_set_ctx_nodb(&context);
      X509V3_set_ctx(&context, authority ? cert : cert_, cert, nullptr, nullptr, 0);
      X509_EXTENSION* e = X509V3_EXT_conf_nid(nullptr, &context, nid, value);
      need(e && X509_add_ext(cert, e, -1) == 1);
      X509_EXTENSION_free(e);
    };
    extension(NID_basic_constraints, authority ? "critical,CA:TRUE" : "CA:FALSE");
    if (!authority) extension(NID_subject_alt_name, "DNS:localhost,IP:127.0.0.1");
    need(X509_sign(cert, authority ? key : key_, EVP_sha256()) > 0);
    return cert;
  }
  EVP_PKEY* key_ = nullptr;
  X509* cert_ = nullptr;
};

inline void writeFile(const std::string& path, const std::string& content) { std::ofstream(path, std::ios::binary) << content; }

}  // namespace gobo::test
