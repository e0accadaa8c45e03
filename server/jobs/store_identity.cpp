// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/store_identity.h"

#include "server/log.h"

namespace gobo {

Result<std::unique_ptr<SqliteJobStore>> openStore(JobFiles& files, const JobStoreOptions& wanted) {
  GOBO_ASSIGN(const std::string named, files.identity());
  JobStoreOptions options = wanted;
  options.create = named.empty() && !files.holdsPromises();
  auto opened = SqliteJobStore::open(files.storePath(), options);
  if (!opened.ok() && opened.status().code() == Code::DataLoss && !options.create)
    return Status(Code::DataLoss,
                  opened.status().message() + ", and the folder holds " + (named.empty() ? "results or checkpoints" : "the identity of a store") +
                      ": restore jobs.sqlite from a backup, or move the whole folder away to begin with no jobs",
                  opened.status().location());
  if (!opened.ok()) return opened.status();
  SqliteJobStore& store = **opened;
  GOBO_ASSIGN(std::string id, store.identity());
  if (id.empty() && named.empty()) {  // made by an earlier version
    GOBO_TRY(store.identify(newStoreIdentity()));
    GOBO_ASSIGN(id, store.identity());
    logInfo("jobs: %s was made by an earlier version and is taken over", files.storePath().c_str());
  }
  if (!named.empty() && id != named)
    return Status(Code::FailedPrecondition,
                  "job store is " + (id.empty() ? std::string("one without identity") : id) + ", but " + files.identityPath() + " names " + named +
                      ": put back the store of this folder; if this one is (a copy from before the upgrade), remove the file identity",
                  files.storePath());
  if (named.empty()) GOBO_TRY(files.writeIdentity(id));
  // Files of jobs that this store never made: it is an older copy. They stay, and their ids are not given again.
  GOBO_TRY(store.disown(files.lastJob()));
  return std::move(*opened);
}

}  // namespace gobo
