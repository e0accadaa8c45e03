// SPDX-License-Identifier: Apache-2.0
// One HTTP GET over a loopback socket, and Prometheus's text format read strictly.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <map>
#include <regex>
#include <sstream>
#include <string>

namespace gobo::test {

struct HttpAnswer {
  int status = 0;
  std::string head, body;
};

/// `address` is 127.0.0.1:PORT. Status 0: no connection. Bounded to 10 s.
inline HttpAnswer httpGet(const std::string& address, const std::string& path, const std::string& method = "GET") {
  HttpAnswer answer;
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const timeval limit{10, 0};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(uint16_t(std::atoi(address.substr(address.rfind(':') + 1).c_str())));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string all;
  if (::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0) {
    const std::string request = method + " " + path + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    char piece[4096];
    if (::send(fd, request.data(), request.size(), MSG_NOSIGNAL) == ssize_t(request.size()))
      for (ssize_t n; (n = ::recv(fd, piece, sizeof piece, 0)) > 0;) all.append(piece, size_t(n));
  }
  ::close(fd);
  const size_t end = all.find("\r\n\r\n");
  if (end == std::string::npos || all.rfind("HTTP/1.1 ", 0) != 0) return answer;
  answer.status = std::atoi(all.c_str() + 9);
  answer.head = all.substr(0, end);
  answer.body = all.substr(end + 4);
  return answer;
}

/// "name{labels}" -> value. Fails the test for a line that is not in the format, a sample without # TYPE before it, a family that
/// is declared twice, and a histogram whose buckets fall or whose +Inf is not its count.
inline std::map<std::string, double> parseMetrics(const std::string& text) {
  static const std::regex sample(R"(([a-zA-Z_:][a-zA-Z0-9_:]*)(\{([a-zA-Z_]\w*="([^"\\\n]|\\[\\"n])*"(,(?=[a-zA-Z_]))?)*\})? (-?[0-9.e+-]+|[+-]Inf|NaN))");
  std::map<std::string, double> values;
  std::map<std::string, std::string> types;
  std::istringstream in(text);
  std::string line, bucketSeries;
  double bucket = 0;
  while (std::getline(in, line)) {
    if (line.rfind("# TYPE ", 0) == 0) {
      std::istringstream words(line.substr(7));
      std::string name, type;
      words >> name >> type;
      EXPECT_TRUE(types.emplace(name, type).second) << line;
      continue;
    }
    if (line.rfind("# HELP ", 0) == 0) continue;
    std::smatch m;
    if (!std::regex_match(line, m, sample)) {
      ADD_FAILURE() << "not in the format: " << line;
      continue;
    }
    std::string family = m[1];
    for (const char* suffix : {"_bucket", "_sum", "_count"}) {
      const size_t n = std::string(suffix).size();
      if (!types.count(family) && family.size() > n && family.compare(family.size() - n, n, suffix) == 0) family.resize(family.size() - n);
    }
    EXPECT_EQ(types.count(family), 1u) << line;
    const std::string name = m[1], labels = m[2];
    const double value = std::stod(m[6]);
    EXPECT_TRUE(values.emplace(name + labels, value).second) << "twice: " << line;
    if (types[family] == "histogram" && name == family + "_bucket") {
      const std::string series = labels.substr(0, labels.find("le=\""));
      if (series + name == bucketSeries) { EXPECT_GE(value, bucket) << line; }
      bucketSeries = series + name;
      bucket = value;
    }
    if (types[family] == "histogram" && name == family + "_count") EXPECT_EQ(value, bucket) << line;
  }
  return values;
}

}  // namespace gobo::test
