# SPDX-License-Identifier: Apache-2.0
"""bench/crash_suite sees what it is there to see: a store in order passes, and each fault made by hand is counted as what it is."""
import hashlib
import os
import sqlite3
import sys
import unittest

import gobo  # noqa: F401  (its messages are what the suite's modules import)
from support import SOURCE

sys.path[:0] = [os.path.join(SOURCE, "bench", "crash"), os.path.join(SOURCE, "bench", "attackers")]
from world import Ledger, World  # noqa: E402

PICTURE = b"the right bits"
SHA = hashlib.sha256(PICTURE).hexdigest()


class CrashLedger(unittest.TestCase):
    def setUp(self):
        self.world = World("no program")
        self.addCleanup(self.world.remove)
        self.ledger = Ledger(self.world, [SHA])
        results = os.path.join(self.world.folder, "jobs", "results", "1")
        os.makedirs(results)
        self.result = os.path.join(results, SHA)
        with open(self.result, "wb") as file:
            file.write(PICTURE)
        self.run_sql("CREATE TABLE job(id INTEGER PRIMARY KEY, key TEXT, frames INTEGER); CREATE TABLE task(job, idx, frame, state);"
                     "CREATE TABLE file(job, idx, output, sha256);"
                     "INSERT INTO job VALUES(1, 'job0', 2); INSERT INTO task VALUES(1, 0, 1, 3); INSERT INTO task VALUES(1, 1, 2, 2);"
                     f"INSERT INTO file VALUES(1, 0, 0, '{SHA}')")
        self.say("job j-1 frame 1 done seconds=0.1 checkpoints=0 resumed=0\n")
        self.ledger.acknowledge("job0", "j-1")

    def run_sql(self, text):
        base = sqlite3.connect(os.path.join(self.world.folder, "jobs", "jobs.sqlite"))
        base.executescript(text)
        base.close()

    def say(self, text):
        with open(self.world.log, "a", encoding="utf-8") as file:
            file.write(text)

    def counts(self):
        self.ledger.read()
        return {k: getattr(self.ledger, k) for k in ("lost", "twice", "wrong", "broken")}

    def expect(self, **want):
        self.assertEqual(self.counts(), {**dict.fromkeys(("lost", "twice", "wrong", "broken"), 0), **want}, self.ledger.first)

    def test_in_order(self):
        self.expect()
        self.run_sql(f"UPDATE task SET state = 3; INSERT INTO file VALUES(1, 1, 0, '{SHA}')")
        self.say("job j-1 frame 2 done seconds=0.1 checkpoints=1 resumed=1\n")
        self.expect()

    def test_the_store_is_gone(self):
        os.unlink(os.path.join(self.world.folder, "jobs", "jobs.sqlite"))
        self.expect(lost=1)

    def test_an_acknowledged_job_is_gone(self):
        self.run_sql("DELETE FROM job; DELETE FROM task; DELETE FROM file")
        self.expect(lost=1)

    def test_a_finished_frame_is_not_finished_any_more(self):
        self.expect()
        self.run_sql("UPDATE task SET state = 1; DELETE FROM file")
        self.expect(lost=1)

    def test_a_row_is_gone(self):
        self.run_sql("DELETE FROM task WHERE idx = 1")
        self.expect(lost=1)

    def test_a_finished_frame_has_no_file(self):
        self.run_sql("DELETE FROM file")
        self.expect(lost=1)

    def test_the_file_is_not_on_the_disk(self):
        os.unlink(self.result)
        self.expect(lost=1)

    def test_one_key_two_jobs(self):
        self.run_sql("INSERT INTO job VALUES(2, 'job0', 0)")
        self.assertGreater(self.counts()["twice"], 0)
        self.ledger.acknowledge("job0", "j-2")
        self.assertGreater(self.counts()["twice"], 1)

    def test_a_frame_was_finished_twice(self):
        self.expect()
        self.say("job j-1 frame 1 done seconds=0.1 checkpoints=0 resumed=0\n")
        self.expect(twice=1)

    def test_other_bits(self):
        with open(self.result, "wb") as file:
            file.write(b"other bits")
        self.expect(wrong=1)

    def test_a_damaged_store(self):
        with open(os.path.join(self.world.folder, "jobs", "jobs.sqlite"), "r+b") as file:
            file.seek(100)
            file.write(b"\xff" * 4000)
        self.assertGreater(self.counts()["broken"], 0)


if __name__ == "__main__":
    unittest.main()
