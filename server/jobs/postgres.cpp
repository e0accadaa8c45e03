// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/postgres.h"

#include <libpq-fe.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include "base/utf8.h"
#include "server/log.h"

namespace gobo {
inline namespace jobs {

struct PostgresClear {
  void operator()(PGresult* r) const { PQclear(r); }
};
using PostgresResult = std::unique_ptr<PGresult, PostgresClear>;

namespace {

constexpr int kOldest = 130000;  // pg_current_xact_id
constexpr Oid kByteaType = 17, kInt8Type = 20, kTextType = 25, kFloat8Type = 701;

/// libpq's messages end with line feeds and have several lines.
std::string oneLine(const char* text) {
  std::string out = text ? text : "";
  while (!out.empty() && std::isspace(static_cast<unsigned char>(out.back()))) out.pop_back();
  std::replace(out.begin(), out.end(), '\n', ' ');
  return out;
}

std::map<std::string, std::string> postgresOptions(const std::string& uri, Status& status) {
  char* message = nullptr;
  PQconninfoOption* options = PQconninfoParse(uri.c_str(), &message);
  std::map<std::string, std::string> set;
  if (!options) {
    // libpq quotes what it stumbles over, which may be a password with an "@" in it.
    const std::string why = uri.find('@') == std::string::npos ? ": " + oneLine(message) : "";
    status = invalidArgument("is no connection URI of PostgreSQL, such as postgresql:///gobo?host=/run/postgresql" + why);
  }
  for (const PQconninfoOption* o = options; o && o->keyword; ++o)
    if (o->val) set[o->keyword] = o->val;
  PQconninfoFree(options);
  PQfreemem(message);
  return set;
}

/// PostgreSQL's text has no zero bytes and is UTF-8.
std::string postgresText(const std::string& text) {
  std::string clean = cleanUtf8(text);
  std::replace(clean.begin(), clean.end(), '\0', ' ');
  return clean;
}

Code codeOfState(const std::string& state) {
  const auto is = [&](const char* prefix) { return state.rfind(prefix, 0) == 0; };
  if (is("08") || is("57P") || is("57014") || is("40") || is("55P03") || is("55006") || is("25006") || is("25P03") || is("53300")) return Code::Unavailable;
  if (is("42P01") || is("3F000") || is("3D000")) return Code::Unavailable;  // taken away under the daemon: put back, it goes on
  if (is("53")) return Code::ResourceExhausted;
  if (is("XX001") || is("XX002")) return Code::DataLoss;
  if (is("42501") || is("28")) return Code::PermissionDenied;
  return Code::Internal;
}

}  // namespace

Status checkPostgresUri(const std::string& uri) {
  if (uri.rfind("postgresql://", 0) != 0 && uri.rfind("postgres://", 0) != 0)
    return invalidArgument("must begin with postgresql://, such as postgresql:///gobo?host=/run/postgresql");
  Status status;
  const auto options = postgresOptions(uri, status);
  GOBO_TRY(status);
  for (const char* secret : {"password", "sslpassword"})
    if (options.count(secret))
      return invalidArgument(std::string("has a ") + secret +
                             ", and configurations are read by many: put it into the file that PGPASSFILE names, of mode 0600");
  return {};
}

std::string postgresName(const std::string& uri) {
  Status ignored;
  auto options = postgresOptions(uri, ignored);
  std::string name = "postgresql://";
  if (options.count("user")) name += options["user"] + "@";
  const std::string host = options["host"];
  name += (host.rfind('/', 0) == 0 ? "" : host) + (options.count("port") ? ":" + options["port"] : "") + "/" + options["dbname"];
  if (host.rfind('/', 0) == 0) name += "?host=" + host;
  return name;
}

Postgres::Postgres(std::string uri, double waitSeconds) : uri_(std::move(uri)), name_(postgresName(uri_)), waitSeconds_(waitSeconds) {}

void Postgres::close() {
  if (connection_) PQfinish(connection_);
  connection_ = nullptr;
  prepared_.clear();
}

int Postgres::socket() const { return connection_ ? PQsocket(connection_) : -1; }

Status Postgres::lost(const std::string& why) {
  close();
  return {Code::Unavailable, "job store: " + why, name_};
}

Status Postgres::connect() {
  if (connection_) return {};
  const auto now = std::chrono::steady_clock::now();
  if (now < retryAfter_) return refused_;  // an unreachable server must not hold everybody up, one after the other
  const auto refuse = [&](Code code, const std::string& why) {
    close();
    retryAfter_ = std::chrono::steady_clock::now() + std::chrono::seconds(1);
    return refused_ = {code, "job store: " + why, name_};
  };
  const std::string wait = std::to_string(std::max(1, int(waitSeconds_)));
  // What stands before "dbname" are defaults, which the URI changes; what stands behind is ours. A peer that has gone without a word is
  // noticed by keepalives and by what is not acknowledged.
  const char* keys[] = {"application_name", "connect_timeout",     "tcp_user_timeout",
                        "keepalives_idle",  "keepalives_interval", "keepalives_count",
                        "dbname",           "client_encoding",     nullptr};
  const char* values[] = {"gobod", wait.c_str(), "10000", "10", "3", "3", uri_.c_str(), "UTF8", nullptr};
  connection_ = PQconnectdbParams(keys, values, 1);
  if (!connection_) return refuse(Code::ResourceExhausted, "no memory for a connection");
  if (PQstatus(connection_) != CONNECTION_OK) return refuse(Code::Unavailable, oneLine(PQerrorMessage(connection_)));
  PQsetNoticeProcessor(
      connection_, [](void*, const char*) {}, nullptr);
  if (const int version = PQserverVersion(connection_); version < kOldest)
    return refuse(Code::FailedPrecondition, "the server is PostgreSQL " + std::to_string(version / 10000) + "; 13 and later are used");
  if (const char* encoding = PQparameterStatus(connection_, "server_encoding"); !encoding || std::strcmp(encoding, "UTF8") != 0)
    return refuse(Code::FailedPrecondition, std::string("the database has the encoding ") + (encoding ? encoding : "?") + ": make it with ENCODING 'UTF8'");
  // The statistics of a queue are of another moment: what is read by an index is always read by it. A daemon that vanishes in the middle of a
  // transaction gives its locks back. A commit that is acknowledged is on disk, whatever the database's default says.
  const std::string setup =
      "SET search_path = gobo; SET enable_seqscan = off; SET enable_hashjoin = off; SET enable_mergejoin = off; SET enable_bitmapscan = off;"
      "SET jit = off; SET bytea_output = 'hex'; SET extra_float_digits = 1; SET idle_in_transaction_session_timeout = '30s'; SET statement_timeout = '60s';"
      "SET lock_timeout = '" +
      std::to_string(int(waitSeconds_ * 1e3)) +
      "ms';"
      "SELECT set_config('synchronous_commit', 'on', false) WHERE current_setting('synchronous_commit') = 'off'";
  const PostgresResult result(PQexec(connection_, setup.c_str()));
  if (PQresultStatus(result.get()) != PGRES_TUPLES_OK) return refuse(Code::Unavailable, oneLine(PQerrorMessage(connection_)));
  retryAfter_ = {};
  return {};
}

Status Postgres::failure(const pg_result* result) {
  const char* field = result ? PQresultErrorField(result, PG_DIAG_SQLSTATE) : nullptr;
  const std::string state = field ? field : "";
  const bool gone = !connection_ || PQstatus(connection_) != CONNECTION_OK;
  if (gone || state.empty()) return lost(connection_ ? oneLine(PQerrorMessage(connection_)) : "the connection was lost");
  conflict_ = state == "40001" || state == "40P01";
  const char* primary = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);  // the other lines have values of rows
  const Status status{codeOfState(state), "job store: " + oneLine(primary) + " (SQLSTATE " + state + ")", name_};
  if (state.rfind("57P", 0) == 0 || state.rfind("08", 0) == 0 || state == "25006" || state == "25P03") close();  // a server that leaves, or is none to write to
  return status;
}

Result<std::string> Postgres::exec(const std::string& sql) {
  conflict_ = false;
  if (!connection_) return lost("the connection was lost");
  if (step) GOBO_TRY(step(sql.c_str()));
  const PostgresResult result(PQexec(connection_, sql.c_str()));
  const ExecStatusType kind = PQresultStatus(result.get());
  if (kind != PGRES_TUPLES_OK && kind != PGRES_COMMAND_OK) return failure(result.get());
  if (kind == PGRES_TUPLES_OK && PQntuples(result.get()) > 0 && PQnfields(result.get()) > 0) return std::string(PQgetvalue(result.get(), 0, 0));
  return std::string();
}

Status Postgres::commit() {
  conflict_ = false;
  if (!connection_) return lost("the connection was lost");
  if (step) GOBO_TRY(step("COMMIT"));
  const PostgresResult result(PQexec(connection_, "COMMIT"));
  if (PQresultStatus(result.get()) != PGRES_COMMAND_OK) return failure(result.get());
  // After a statement that failed COMMIT rolls back and says so in nothing but its tag.
  if (std::strcmp(PQcmdStatus(result.get()), "COMMIT") != 0) return {Code::Internal, "job store: the transaction was rolled back", name_};
  return {};
}

Result<std::vector<std::string>> Postgres::notifications() {
  if (!connection_ || !PQconsumeInput(connection_)) return lost(connection_ ? oneLine(PQerrorMessage(connection_)) : "the connection was lost");
  std::vector<std::string> texts;
  while (PGnotify* n = PQnotifies(connection_)) {
    texts.push_back(n->extra ? n->extra : "");
    PQfreemem(n);
  }
  return texts;
}

class Postgres::Use final : public SqlStatement {
 public:
  Use(Postgres& db, const char* sql) : db_(db), sql_(sql) {}
  void bind(int64_t v) override { add(kInt8Type, std::to_string(v)); }
  void bind(double v) override { add(kFloat8Type, strf("%.17g", v)); }
  void bind(const std::string& text) override { add(kTextType, postgresText(text)); }
  void blob(const std::string& bytes) override { add(kByteaType, bytes); }
  bool next() override {
    if (!status_.ok()) return false;
    if (!result_) run();
    return status_.ok() && ++row_ < PQntuples(result_.get());
  }
  const Status& status() const override { return status_; }
  int64_t integer(int column) const override { return std::atoll(PQgetvalue(result_.get(), row_, column)); }
  double real(int column) const override { return std::atof(PQgetvalue(result_.get(), row_, column)); }
  std::string text(int column) const override {
    const char* value = PQgetvalue(result_.get(), row_, column);
    if (PQftype(result_.get(), column) != kByteaType) return value;
    size_t size = 0;
    unsigned char* bytes = PQunescapeBytea(reinterpret_cast<const unsigned char*>(value), &size);
    const std::string out(reinterpret_cast<const char*>(bytes), bytes ? size : 0);
    PQfreemem(bytes);
    return out;
  }

 private:
  void add(Oid type, std::string value) {
    types_.push_back(type);
    values_.push_back(std::move(value));
  }
  void run() {
    db_.conflict_ = false;
    if (!db_.connection_) {
      status_ = db_.lost("the connection was lost");
      return;
    }
    if (db_.step) status_ = db_.step(sql_);
    if (!status_.ok()) return;
    std::string key(reinterpret_cast<const char*>(types_.data()), types_.size() * sizeof(Oid));
    key += sql_;
    auto at = db_.prepared_.find(key);
    if (at == db_.prepared_.end()) {
      std::string text = sql_;
      std::replace(text.begin(), text.end(), '?', '$');
      const std::string name = "s" + std::to_string(db_.prepared_.size());
      const PostgresResult made(PQprepare(db_.connection_, name.c_str(), text.c_str(), int(types_.size()), types_.data()));
      if (PQresultStatus(made.get()) != PGRES_COMMAND_OK) {
        status_ = db_.failure(made.get());
        return;
      }
      at = db_.prepared_.emplace(key, name).first;
    }
    std::vector<const char*> values;
    std::vector<int> sizes, formats;
    for (size_t i = 0; i < values_.size(); ++i) {
      values.push_back(values_[i].c_str());
      sizes.push_back(int(values_[i].size()));
      formats.push_back(types_[i] == kByteaType);
    }
    result_.reset(PQexecPrepared(db_.connection_, at->second.c_str(), int(values.size()), values.data(), sizes.data(), formats.data(), 0));
    const ExecStatusType kind = PQresultStatus(result_.get());
    if (kind != PGRES_TUPLES_OK && kind != PGRES_COMMAND_OK) status_ = db_.failure(result_.get());
  }

  Postgres& db_;
  const char* sql_;
  std::vector<Oid> types_;
  std::vector<std::string> values_;
  PostgresResult result_;
  int row_ = -1;
  Status status_;
};

std::unique_ptr<SqlStatement> Postgres::use(const char* sql) { return std::make_unique<Use>(*this, sql); }

}  // namespace jobs
}  // namespace gobo
