// SPDX-License-Identifier: Apache-2.0
#include "server/jobs/postgres_schema.h"

namespace gobo {

// States are the numbers of v1.Job.State and v1.Frame.State. Text is compared by its bytes, as SQLite does. Frames change several times in their
// life and are found by state: room in each page keeps the new version of a row beside the old one.
const char* const kPostgresSchema = R"(
CREATE TABLE store(version bigint NOT NULL);
INSERT INTO store VALUES(1);
CREATE TABLE counter(name text PRIMARY KEY, value bigint NOT NULL);
INSERT INTO counter VALUES('job', 0), ('revision', 0);
CREATE SEQUENCE token;
CREATE FUNCTION seconds() RETURNS double precision LANGUAGE sql VOLATILE AS 'SELECT extract(epoch FROM clock_timestamp())::double precision';
CREATE TABLE identity(id text NOT NULL);
CREATE TABLE unowned(first bigint NOT NULL, last bigint NOT NULL);
CREATE TABLE job(
  id bigint PRIMARY KEY, client text COLLATE "C" NOT NULL, key text COLLATE "C" NOT NULL, digest text NOT NULL, spec bytea NOT NULL,
  priority bigint NOT NULL, deadline double precision, max_attempts bigint NOT NULL, state bigint NOT NULL,
  error_code bigint NOT NULL DEFAULT 0, error text NOT NULL DEFAULT '', frames bigint NOT NULL, done bigint NOT NULL DEFAULT 0,
  failed bigint NOT NULL DEFAULT 0, scene_hash text NOT NULL, scene_source text NOT NULL, scene_file text COLLATE "C" NOT NULL,
  environment_digest text COLLATE "C" NOT NULL, submitted double precision NOT NULL, started double precision NOT NULL DEFAULT 0,
  ended double precision NOT NULL DEFAULT 0, ended_uptime double precision NOT NULL DEFAULT 0,
  result_bytes bigint NOT NULL DEFAULT 0, expired bigint NOT NULL DEFAULT 0, revision bigint NOT NULL) WITH (fillfactor = 50);
CREATE UNIQUE INDEX job_key ON job(client, key) WHERE key <> '';
CREATE INDEX job_order ON job(client, priority DESC, coalesce(deadline, 1e300), id) WHERE state IN (1, 2);
CREATE INDEX job_state ON job(state, id);
CREATE TABLE task(
  job bigint NOT NULL REFERENCES job(id) ON DELETE CASCADE, idx bigint NOT NULL, frame bigint NOT NULL, state bigint NOT NULL,
  failures bigint NOT NULL DEFAULT 0, losses bigint NOT NULL DEFAULT 0, token bigint NOT NULL DEFAULT 0,
  holder text NOT NULL DEFAULT '', expires double precision NOT NULL DEFAULT 0, ready double precision NOT NULL DEFAULT 0,
  progress double precision NOT NULL DEFAULT 0, spp bigint NOT NULL DEFAULT 0, error_code bigint NOT NULL DEFAULT 0,
  error text NOT NULL DEFAULT '', seconds double precision NOT NULL DEFAULT 0, revision bigint NOT NULL, PRIMARY KEY(job, idx)) WITH (fillfactor = 70);
CREATE INDEX task_queued ON task(job, idx) WHERE state = 1;
CREATE INDEX task_running ON task(expires) WHERE state = 2;
CREATE INDEX task_running_of ON task(job, idx) WHERE state = 2;
CREATE INDEX task_partial ON task(job, progress) WHERE state < 3 AND progress > 0;
CREATE INDEX task_changed ON task(job, revision);
CREATE TABLE checkpoint(
  job bigint NOT NULL, idx bigint NOT NULL, recipe text COLLATE "C" NOT NULL, blocks bigint NOT NULL, digest text NOT NULL, bytes bigint NOT NULL,
  PRIMARY KEY(job, idx, recipe), FOREIGN KEY(job, idx) REFERENCES task(job, idx) ON DELETE CASCADE);
CREATE TABLE file(
  job bigint NOT NULL, idx bigint NOT NULL, output bigint NOT NULL, sha256 text NOT NULL, bytes bigint NOT NULL, message bytea NOT NULL,
  PRIMARY KEY(job, idx, output), FOREIGN KEY(job, idx) REFERENCES task(job, idx) ON DELETE CASCADE);
)";

}  // namespace gobo
