// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace gobo {
inline namespace jobs {

/// The schema "gobo", version 1: the tables of docs/job_store.md. Run in one transaction, with search_path = gobo.
extern const char* const kPostgresSchema;
/// From version 1 to 2. As above.
extern const char* const kPostgresVersion2;

}  // namespace jobs
}  // namespace gobo
