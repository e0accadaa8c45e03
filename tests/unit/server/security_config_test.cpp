// SPDX-License-Identifier: Apache-2.0
// Tokens, TLS and HTTP in the configuration; the shipped files; that every key is documented.
#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include <toml++/toml.h>

#include "server/config.h"
#include "server/config_check.h"
#include "server/tls.h"
#include "support/pki.h"

namespace gobo::security_config_test {
namespace {

namespace fs = std::filesystem;
const std::string kDigest(64, 'a');

class SecurityConfig : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "gobo-config-XXXXXX").string();
    ASSERT_NE(::mkdtemp(pattern.data()), nullptr);
    folder = pattern;
  }
  void TearDown() override { fs::remove_all(folder); }
  Status read(const std::string& text) {
    config = {};
    test::writeFile(folder + "/g.toml", text);
    GOBO_TRY(readConfig(folder + "/g.toml", config));
    return checkConfig(config);
  }
  static std::string slurp(const std::string& path) {
    std::ostringstream text;
    text << std::ifstream(path).rdbuf();
    return text.str();
  }
  static std::string replaced(std::string text, const std::string& what, const std::string& with) {
    for (size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += with.size()) text.replace(at, what.size(), with);
    return text;
  }
  std::string folder;
  ServerConfig config;
};

TEST_F(SecurityConfig, ReadsATokenWithAllItsKeys) {
  fs::create_directory(folder + "/shows");
  const Status status = read("[[tokens]]\nname = \"a\"\nsha256 = \"" + kDigest +
                             "\"\nclasses = [\"batch\", \"normal\"]\nrequests_per_s = 2.5\nburst = 7\n"
                             "renders_at_once = 3\nmax_pixels = 1000\nmax_spp = 64\nmax_s = 10\nupload_bytes = \"2MiB\"\nroots = [\"shows\"]\nadmin = true\n"
                             "[[tokens]]\nname = \"b\"\nsha256 = \"" +
                             std::string(64, 'b') + "\"\n");
  ASSERT_TRUE(status.ok()) << status.toString();
  ASSERT_EQ(config.tokens.size(), 2u);
  TokenConfig want;
  want.name = "a";
  want.sha256 = kDigest;
  want.classes = {"batch", "normal"};
  want.requestsPerSecond = 2.5;
  want.burst = 7;
  want.rendersAtOnce = 3;
  want.maxPixels = 1000;
  want.maxSpp = 64;
  want.maxSeconds = 10;
  want.uploadBytes = 2 << 20;
  want.roots = std::vector<std::string>{folder + "/shows"};
  want.admin = true;
  EXPECT_EQ(config.tokens[0], want);
  EXPECT_FALSE(config.tokens[1].roots.has_value());
}

TEST_F(SecurityConfig, ErrorsNameFileLineKeyAndValue) {
  const std::string good = "name = \"a\"\nsha256 = \"" + kDigest + "\"\n";
  const struct {
    std::string text, words;
  } cases[] = {
      {"[[tokens]]\n" + good + "max_ssp = 3\n", ":4: unknown key \"tokens.max_ssp\""},
      {"[[tokens]]\n" + good + "max_spp = \"3\"\n", ":4: tokens.max_spp = '3': must be an integer"},
      {"[[tokens]]\n" + good + "requests_per_s = -1\n", ":4: tokens.requests_per_s = -1: must be in 0..1e+06"},
      {"\n[[tokens]]\nname = \"a\"\n", ":2: tokens.sha256 = \"\": must be"},
      {"[[tokens]]\nname = \"a b\"\nsha256 = \"" + kDigest + "\"\n", "tokens.name = \"a b\": must be"},
      {"[[tokens]]\nname = \"unix\"\nsha256 = \"" + kDigest + "\"\n", "tokens.name = \"unix\": must be another name"},
      {"[[tokens]]\nname = \"a\"\nsha256 = \"secret\"\n", "tokens.sha256 = \"secret\": must be the token's SHA-256"},
      {"[[tokens]]\nname = \"a\"\nsha256 = \"" + std::string(64, 'A') + "\"\n", "lower-case"},
      {"[[tokens]]\n" + good + "classes = [\"urgent\"]\n", "tokens.classes = \"urgent\": must be interactive, normal or batch"},
      {"[[tokens]]\n" + good + "[[tokens]]\n" + good, "given twice"},
      {"[[tokens]]\n" + good + "[[tokens]]\nname = \"b\"\nsha256 = \"" + kDigest + "\"\n", "another token has the same"},
      {"[[tokens]]\n" + good + "roots = [\"/no/such\"]\n", "\"/no/such\" is not a folder"},
      {"tokens = 3\n", ":1: tokens = 3: must be tables"},
      {"[auth]\nrequire_token = \"never\"\n", "auth.require_token = \"never\": must be tcp or always"},
      {"[auth]\nrequire_token = \"always\"\n", "nobody could call"},
      {"[tls]\ncert = \"x.pem\"\n", "both or none"},
      {"[tls]\nclient_ca = \"x.pem\"\n", "needs tls.cert"},
      {"[tls]\ncert = \"x.pem\"\nkey = \"x.key\"\nrequire_client_cert = true\n", "needs tls.client_ca"},
      {"[http]\nlisten = \"0.0.0.0:9464\"\n", "http.listen = \"0.0.0.0:9464\": not a loopback address"},
      {"[http]\nlisten = \"unix:/tmp/x\"\n", "must be HOST:PORT"},
      {"socket_mode = \"0999\"\n", ":1: socket_mode = '0999': must be an octal file mode"},
      {"[log]\nformat = \"xml\"\n", "log format \"xml\" is not one of text, json"},
      {"[limits]\nrequest_s = -1\n", ":2: limits.request_s = -1: must be in 0..86400"},
  };
  for (const auto& c : cases) {
    const Status status = read(c.text);
    EXPECT_FALSE(status.ok()) << c.text;
    EXPECT_NE(status.message().find(c.words), std::string::npos) << c.text << status.message();
  }
}

TEST_F(SecurityConfig, BeyondLoopbackOnlyWithTlsAndTokens) {
  const std::string tls = "[tls]\ncert = \"c\"\nkey = \"k\"\n", token = "[[tokens]]\nname = \"a\"\nsha256 = \"" + kDigest + "\"\n";
  const std::string listen = "listen = [\"0.0.0.0:50551\"]\n";
  EXPECT_EQ(read(listen).code(), Code::PermissionDenied);
  EXPECT_EQ(read(listen + tls).code(), Code::PermissionDenied);
  EXPECT_EQ(read(listen + token).code(), Code::PermissionDenied);
  EXPECT_TRUE(read(listen + tls + token).ok());
  EXPECT_TRUE(read(listen + "allow_remote = true\n").ok());
}

// Paths that a test machine does not have are moved below a temporary folder, with certificates made here; all else is as shipped.
TEST_F(SecurityConfig, TheShippedExamplesLoad) {
  test::Authority ca("authority"), clients("clients");
  const test::Issued own = ca.issue("gobod");
  for (const char* sub : {"etc", "srv", "cache", "lib", "run"}) fs::create_directory(folder + "/" + sub);
  test::writeFile(folder + "/etc/server.pem", own.cert);
  test::writeFile(folder + "/etc/server.key", own.key);
  test::writeFile(folder + "/etc/clients-ca.pem", clients.pem());
  int files = 0, tokens = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator("configs")) {
    std::string text = slurp(entry.path());
    for (const auto& [from, to] : std::map<std::string, std::string>{
             {"/etc/gobo", "etc"}, {"/srv/scenes", "srv"}, {"/var/cache/gobo", "cache"}, {"/var/lib/gobo", "lib"}, {"/run/gobo", "run"}})
      text = replaced(text, from, folder + "/" + to);
    const Status status = read(text);
    EXPECT_TRUE(status.ok()) << entry.path() << ": " << status.toString();
    if (config.tls.on()) {
      const auto read = readTls(config.tls);
      EXPECT_TRUE(read.ok()) << entry.path() << ": " << read.status().toString();
      EXPECT_NE(read->subject.find("gobod"), std::string::npos);
    }
    ++files;
    tokens += int(config.tokens.size());
  }
  EXPECT_EQ(files, 4);
  EXPECT_EQ(tokens, 4);
}

TEST_F(SecurityConfig, EveryKeyIsInTheShippedFilesAndInTheManual) {
  const toml::table all = toml::parse_file("configs/gobod.toml");
  const std::string manual = slurp("docs/operations.md"), studioText = slurp("configs/studio.toml");
  EXPECT_GT(configKeys().size(), 45u);
  for (const std::string& key : configKeys()) {
    EXPECT_NE(manual.find("`" + key + "`"), std::string::npos) << key << " is not in docs/operations.md";
    if (key == "listen") continue;  // its default depends on the user: shown in a comment
    if (key.rfind("tokens.", 0) == 0) {
      const std::string line = key.substr(7) + " = ";
      EXPECT_TRUE(studioText.find("\n" + line) != std::string::npos || studioText.find("\n# " + line) != std::string::npos)
          << key << " is not in configs/studio.toml";
    } else {
      EXPECT_TRUE(bool(all.at_path(key))) << key << " is not in configs/gobod.toml";
    }
  }
}

TEST(Reload, WhatMayChangeDoesAndTheRestIsNamed) {
  ServerConfig running, next;
  next.uploadBytes = 5;
  next.logLevel = "debug";
  next.roots = {"/x"};
  next.drainSeconds = 3;
  next.threads = 7;
  next.queuedBatch = 9;
  next.httpListen = "127.0.0.1:1";
  const ServerConfig now = reloaded(running, next);
  EXPECT_EQ(now.uploadBytes, 5u);
  EXPECT_EQ(now.logLevel, "debug");
  EXPECT_EQ(now.roots, next.roots);
  EXPECT_DOUBLE_EQ(now.drainSeconds, 3);
  EXPECT_EQ(now.threads, running.threads);
  EXPECT_EQ(now.queuedBatch, running.queuedBatch);
  EXPECT_EQ(fixedKeysThatDiffer(running, next), (std::vector<std::string>{"http.listen", "engine.threads", "scheduler.queued_batch"}));
  EXPECT_TRUE(fixedKeysThatDiffer(running, running).empty());
}

// None is passed over in silence: each either changes with a reload, or is named as one that waits for a restart.
TEST_F(SecurityConfig, EveryKeyIsReloadedOrNamedAsFixed) {
  const std::string digest = "\"" + std::string(64, 'b') + "\"";
  // Of each kind of value one that is no key's default.
  const std::vector<std::string> values = {"true", "17", "\"0640\"", digest, "[\"batch\"]"};
  for (const std::string& key : configKeys()) {
    const size_t dot = key.find('.');
    const std::string table = dot == std::string::npos ? "" : key.substr(0, dot), name = key.substr(dot + 1);  // npos + 1: all of it
    const auto with = [&](const std::string& value) {
      if (table != "tokens") return (table.empty() ? "" : "[" + table + "]\n") + name + " = " + value + "\n";
      std::map<std::string, std::string> lines{{"name", "\"a\""}, {"sha256", "\"" + kDigest + "\""}};
      if (!value.empty()) lines[name] = value;
      std::string text = "[[tokens]]\n";
      for (const auto& [k, v] : lines) text += k + " = " + v + "\n";
      return text;
    };
    const std::string file = folder + "/g.toml";
    ServerConfig running, next;
    if (table == "tokens") {
      test::writeFile(file, with(""));
      ASSERT_TRUE(readConfig(file, running).ok());
    }
    running.file = file;
    bool changed = false;
    for (size_t i = 0; i < values.size() && !changed; ++i) {
      test::writeFile(file, with(values[i]));
      next = {};
      changed = readConfig(file, next).ok() && !(next == running);
    }
    ASSERT_TRUE(changed) << key;
    const std::vector<std::string> fixed = fixedKeysThatDiffer(running, next);
    const bool named =
        std::any_of(fixed.begin(), fixed.end(), [&](const std::string& k) { return k == key || (!table.empty() && k.rfind(table + " (", 0) == 0); });
    EXPECT_TRUE(named || !(reloaded(running, next) == running)) << key;
    EXPECT_EQ(fixed.size(), named ? 1u : 0u) << key;
  }
}

}  // namespace
}  // namespace gobo::security_config_test
