// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/store_identity.h"

#include "server/log.h"

namespace gobo {
inline namespace jobs {

namespace {

/// `what`: "jobs.sqlite", "the database"; `where`: file or database, as errors place it.
template <typename Store, typename Open>
Result<std::unique_ptr<Store>> openIdentified(JobFiles& files, const JobStoreOptions& wanted, const std::string& what, const std::string& where,
                                              const Open& open) {
  GOBO_ASSIGN(const std::string named, files.identity());
  JobStoreOptions options = wanted;
  options.create = named.empty() && !files.holdsPromises();
  Result<std::unique_ptr<Store>> opened = open(options);
  if (!opened.ok() && opened.status().code() == Code::DataLoss && !options.create)
    return Status(Code::DataLoss,
                  opened.status().message() + ", and the folder holds " + (named.empty() ? "results or checkpoints" : "the identity of a store") +
                      ": restore " + what + " from a backup, or move the whole folder away to begin with no jobs",
                  opened.status().location());
  if (!opened.ok()) return opened.status();
  Store& store = **opened;
  GOBO_ASSIGN(std::string id, store.identity());
  if (id.empty() && named.empty()) {  // made by an earlier version
    GOBO_TRY(store.identify(newStoreIdentity()));
    GOBO_ASSIGN(id, store.identity());
    logInfo("jobs: %s was made by an earlier version and is taken over", where.c_str());
  }
  if (!named.empty() && id != named)
    return Status(Code::FailedPrecondition,
                  "job store is " + (id.empty() ? std::string("one without identity") : id) + ", but " + files.identityPath() + " names " + named +
                      ": put back the store of this folder; if this one is (a copy from before the upgrade), remove the file identity",
                  where);
  if (named.empty()) GOBO_TRY(files.writeIdentity(id));
  // Files of jobs that this store never made: it is an older copy. They stay, and their ids are not given again.
  GOBO_TRY(store.disown(files.lastJob()));
  return opened;
}

}  // namespace

Result<std::unique_ptr<SqliteJobStore>> openStore(JobFiles& files, const JobStoreOptions& options) {
  const std::string path = files.storePath();
  return openIdentified<SqliteJobStore>(files, options, "jobs.sqlite", path, [&](const JobStoreOptions& o) { return SqliteJobStore::open(path, o); });
}

Result<std::unique_ptr<PostgresJobStore>> openPostgresStore(JobFiles& files, const std::string& uri, const JobStoreOptions& options) {
  GOBO_TRY(checkPostgresUri(uri));
  return openIdentified<PostgresJobStore>(files, options, "the database", postgresName(uri),
                                          [&](const JobStoreOptions& o) { return PostgresJobStore::open(uri, o); });
}

}  // namespace jobs
}  // namespace gobo
