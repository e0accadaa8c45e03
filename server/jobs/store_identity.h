// SPDX-License-Identifier: Apache-2.0
// The store of a jobs folder and its identity: a random name, in the store and in FOLDER/identity. It tells a folder that is used for
// the first time from one whose store was lost, and a store from that of another folder. docs/job_store.md has the table of cases.
#pragma once

#include <memory>

#include "server/jobs/job_files.h"
#include "server/jobs/postgres_job_store.h"
#include "server/jobs/sqlite_job_store.h"

namespace gobo {
inline namespace jobs {

/// Opens FOLDER/jobs.sqlite; makes it where the folder promises nothing yet. At the first start the store comes first, then the file,
/// so a kill between them leaves a store without the file, which is given one at the next start.
/// Errors: DataLoss when the store is missing or empty and the folder has an identity, results or checkpoints; FailedPrecondition when the
/// store is not that of the identity file; those of SqliteJobStore::open and of the files. They name the file and what can be done.
Result<std::unique_ptr<SqliteJobStore>> openStore(JobFiles& files, const JobStoreOptions& options = {});
/// The same for the store in a database, which all daemons of a farm open beside one folder. Errors as well: those of PostgresJobStore::open.
Result<std::unique_ptr<PostgresJobStore>> openPostgresStore(JobFiles& files, const std::string& uri, const JobStoreOptions& options = {});

}  // namespace jobs
}  // namespace gobo
