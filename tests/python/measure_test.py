# SPDX-License-Identifier: Apache-2.0
"""`gobo measure` and gobo.report: columns as docs/measuring.md lists them, interleaved repeats, the command's figures against Python's from the rows, refusals,
figures of equal bytes."""
import base64
import csv
import itertools
import json
import math
import os
import pathlib
import re
import subprocess
import sys
import unittest
from unittest import mock

import numpy as np

import gobo
from gobo import measurement, report
from support import SOURCE, DaemonTest

try:
    import matplotlib
except ImportError:
    matplotlib = None

needs_matplotlib = unittest.skipIf(matplotlib is None, "matplotlib is missing: apt install python3-matplotlib (deploy/install-deps does)")
PAGE = pathlib.Path(SOURCE) / "docs" / "measuring.md"
REPEATS = 4
COMMAND = ["measure", "cornell", "--size", "24x16", "--set", "integrator.max_bounces=1", "--reference-spp", "128", "--repeats", REPEATS, "--path-tracing", 4,
           "--series", "rays, few", "--with", "halt.spp=2", "--sweep", "shadows.ray_traced.samples=1,4", "--series", "in time", "--sweep", "halt.time_s=0.002,0.005"]
POINTS = {"rays, few": ["1", "4"], "in time": ["0.002", "0.005"], "path tracing": ["1", "2", "4"]}


def page_table(title):
    """First column of the table below a heading of docs/measuring.md."""
    text = PAGE.read_text(encoding="utf-8").split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    return re.findall(r"^\| `([\w.\[\]]+)` \|", text, re.MULTILINE)


class Measured(DaemonTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.printed = cls("cli").cli("--local", *COMMAND, "--csv", "m.csv", "--out", "m.json")
        with open(os.path.join(cls.folder, "m.json"), encoding="utf-8") as file:
            cls.document = json.load(file)
        with open(os.path.join(cls.folder, "m.csv"), newline="", encoding="utf-8") as file:
            cls.rows = list(csv.DictReader(file))

    def load(self, name="m.json"):
        return measurement.load(self.path(name))


class Data(Measured):
    def test_columns_are_those_of_the_page(self):
        documented = page_table("Columns")
        self.assertGreater(len(documented), 20)
        self.assertEqual(list(self.rows[0]), documented)
        self.assertEqual([c["name"] for c in self.document["columns"]], documented)
        self.assertEqual([list(r) for r in self.document["runs"][:1]], [documented])
        for column in self.document["columns"]:
            self.assertTrue(column["meaning"])
            self.assertEqual(column["unit"] == "", column["name"] in measurement.TEXT_COLUMNS, column)

    def test_fields_are_those_of_the_page(self):
        documented = page_table("Fields of the JSON")
        self.assertEqual([n for n in documented if "." not in n], list(self.document))
        for name in documented:
            at = self.document
            for part in name.split("."):
                at = at[part.removesuffix("[]")]
                at = at[0] if part.endswith("[]") else at
            self.assertIsNotNone(at, name)

    def test_both_files_have_the_same_rows(self):
        self.assertEqual(len(self.rows), REPEATS * sum(map(len, POINTS.values())))
        for text, row in zip(self.rows, self.document["runs"], strict=True):
            for column, value in row.items():
                self.assertEqual(float(text[column]) if isinstance(value, (int, float)) else text[column], value, column)
        seen = {}
        for row in self.rows:
            seen.setdefault(row["series"], {}).setdefault(row["value"], []).append(int(row["repeat"]))
        self.assertEqual({s: list(v) for s, v in seen.items()}, POINTS)
        for values in seen.values():
            self.assertEqual(list(values.values()), [list(range(REPEATS))] * len(values))

    def test_repeats_interleave(self):
        ordered = sorted(self.rows, key=lambda r: int(r["run_order"]))
        self.assertEqual([int(r["run_order"]) for r in ordered], list(range(len(ordered))))
        count = len(ordered) // REPEATS
        rounds = [[(r["series"], r["value"]) for r in ordered[i:i + count]] for i in range(0, len(ordered), count)]
        for i, one in enumerate(rounds):
            self.assertEqual(len(set(one)), count)                        # each point once a round
            self.assertEqual(one, rounds[0] if i % 2 == 0 else rounds[0][::-1])
            self.assertEqual({int(r["repeat"]) for r in ordered[i * count:(i + 1) * count]}, {i})
        for a, b in itertools.pairwise(rounds[0][:6]):                    # neighbours are of different series while all have points
            self.assertNotEqual(a[0], b[0])
        self.assertEqual({r["reused_nodes"] for r in self.rows}, {"0"})   # --local is cold

    def test_equal_requests_are_equal_pictures(self):
        for series in self.document["series"]:
            for point in series["points"]:
                rows = [r for r in self.document["runs"] if (r["series"], r["value"]) == (series["name"], point["value"])]
                self.assertEqual({r["request_hash"] for r in rows if series["path"] != "halt.time_s"} - {point["request_hash"]}, set())
                if series["path"] != "halt.time_s":
                    self.assertEqual(len({r["picture_digest"] for r in rows}), 1)
                    self.assertEqual(len({r["rmse"] for r in rows}), 1)

    def test_where_it_is_from(self):
        d = self.document
        self.assertEqual((d["format"], d["format_version"], d["output"], d["cold"], d["repeats"]), ("gobo measure", 1, "beauty", True, REPEATS))
        self.assertRegex(d["date_utc"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
        self.assertTrue(d["machine"]["cpu"])
        self.assertEqual(d["machine"]["logical_cores"], os.cpu_count())
        self.assertGreaterEqual(d["machine"]["threads"], 1)
        self.assertEqual(d["scene"]["hash"], self.client.scenes.open("cornell", "same").hash)
        self.assertEqual(d["command"].split(" ", 3)[:3], ["gobo", "measure", "--local"])
        for word in ("--csv m.csv", "--out m.json", "'rays, few'", f"--repeats {REPEATS}"):
            self.assertIn(word, d["command"])
        point = d["series"][0]["points"][1]
        self.assertEqual(point["resolved"]["shadows"]["ray_traced"]["samples"], 4)
        self.assertEqual(point["resolved"]["halt"]["spp"], 2)
        self.assertIn("visibility", {n["node"] for n in point["nodes"]})
        again = self.client.render(request=point["resolved"])            # the resolved request gives the same bits
        self.assertEqual(again.request_hash, point["request_hash"])
        halves = d["reference"]["halves"]
        self.assertEqual(d["reference"]["samples_per_pixel"], 128)
        self.assertNotEqual(halves[0]["seed"], halves[1]["seed"])
        self.assertEqual(halves[0]["resolved"]["shadows"], {"path_traced": {}})

    def test_errors_fall_with_samples(self):
        plain = self.document["series"][-1]
        self.assertEqual((plain["name"], plain["kind"]), ("path tracing", "path tracing"))
        mse = [p["mse"]["estimate"] for p in plain["points"]]
        self.assertGreater(mse[0], mse[2])
        self.assertEqual([p["samples_per_pixel"] for p in plain["points"]], [1, 2, 4])

    def test_no_folder_of_this_machine(self):
        self.cli("--local", "measure", "cornell", "--size", "16x12", "--path-tracing", 1, "--reference-spp", 2, "--out", self.path("deep.json"),
                 "--csv", self.path("deep.csv"))
        self.assertNotIn(self.folder, pathlib.Path(self.path("deep.json")).read_text(encoding="utf-8"))
        self.assertEqual([n for n in os.listdir(self.folder) if "tmp" in n], [])

    def test_printed(self):
        for words in ("rays, few", "shadows.ray_traced.samples=4", "path tracing", "95 %"):
            self.assertIn(words, self.printed.stdout)
        done = self.cli("--local", "--json", "measure", "cornell", "--size", "16x12", "--path-tracing", 2, "--reference-spp", 2)
        self.assertEqual([p["value"] for p in json.loads(done.stdout)["series"][0]["points"]], ["1", "2"])

    def test_a_picture_for_the_truth_and_other_outputs(self):
        self.cli("render", "cornell", "--size", "16x12", "--spp", 64, "-o", "truth.exr", "-q")
        self.cli("measure", "cornell", "--size", "16x12", "--spp", 64, "--sweep", "seed=0,1", "--reference", self.path("truth.exr"), "--out", "t.json")
        d = json.loads(pathlib.Path(self.path("t.json")).read_text(encoding="utf-8"))
        self.assertEqual(d["reference"]["file"], "truth.exr")
        self.assertEqual(d["series"][0]["points"][0]["rmse"], {"estimate": 0, "low": 0, "high": 0})
        self.assertGreater(d["series"][0]["points"][1]["rmse"]["estimate"], 0)
        self.cli("measure", "cornell", "--size", "16x12", "--output", "visibility:light", "--path-tracing", 16, "--reference-spp", 512, "--cold", "--out", "v.json")
        d = json.loads(pathlib.Path(self.path("v.json")).read_text(encoding="utf-8"))
        mse = [p["mse"]["estimate"] for p in d["series"][0]["points"]]
        self.assertEqual((d["series"][0]["name"], d["error_unit"], len(mse)), ("shadow rays", "1", 5))
        self.assertGreater(mse[0], 4 * abs(mse[-1]))
        self.assertEqual(d["reference"]["halves"][0]["resolved"]["shadows"]["ray_traced"]["samples"], 256)

    def test_a_server_that_keeps_results_is_warned_of(self):
        row = ["measure", "cornell", "--size", "16x12", "--sweep", "halt.spp=2", "--reference-spp", 2, "--repeats", 2]
        self.assertIn("--cold drops the caches", self.cli(*row).stdout)
        self.assertNotIn("--cold drops the caches", self.cli(*row, "--cold").stdout)

    def test_refusals(self):
        for words, code, args in (("no field 'nosuch'", 2, ["--sweep", "nosuch.path=1"]),
                                  ("--series A: is empty", 2, ["--series", "A"]),
                                  ("--sweep seed=1,,2: an empty value", 2, ["--sweep", "seed=1,,2"]),
                                  ("two series are named \"A\"", 2, ["--series", "A", "--sweep", "seed=1", "--series", "A", "--sweep", "seed=2"]),
                                  ("has two sweeps", 2, ["--series", "A", "--sweep", "seed=1", "--sweep", "halt.spp=2"]),
                                  ("--with seed=1: comes after", 2, ["--with", "seed=1", "--sweep", "seed=2"]),
                                  ("Value 0 not in range 1 to 1000", 2, ["--sweep", "seed=1", "--repeats", 0]),
                                  ("no output 'nosuch'", 2, ["--sweep", "seed=1", "--output", "nosuch"]),
                                  ("no light 'nosuch'", 3, ["--sweep", "seed=1", "--output", "visibility:nosuch"]),
                                  ("--output depth: paths or shadow rays give no truth of it", 2, ["--sweep", "seed=1", "--output", "depth"]),
                                  ("a series must not change what the picture is of", 2, ["--sweep", "lights.light.gain=1,1,1;2,2,2"]),
                                  ("request.halt.spp = 0: must be at least 1", 2, ["--sweep", "halt.spp=4,0"]),
                                  ("nothing to measure", 2, []),
                                  ("--out m.txt: must end in .json", 2, ["--sweep", "seed=1", "--out", "m.txt"]),
                                  ("no such folder: \"no\"", 3, ["--sweep", "seed=1", "--out", "no/m.json"]),
                                  ("at most 4096 rays", 2, ["--path-tracing", 5000, "--output", "visibility:light"])):
            with self.subTest(words=words):
                done = self.cli("measure", "cornell", "--size", "16x12", *args, code=code)
                self.assertIn(words, done.stderr)
                self.assertNotIn("reference,", done.stderr)                # nothing was rendered for it


class Figures(Measured):
    def test_python_says_what_the_command_says(self):
        """Two programs work out what the rows of a point say together."""
        for name in ("m.json", "m.csv"):
            loaded = {s.name: s for s in self.load(name).series}
            self.assertEqual({n: [p.value for p in s.points] for n, s in loaded.items()}, POINTS)
            for series in self.document["series"]:
                for said, point in zip(series["points"], loaded[series["name"]].points, strict=True):
                    t, e = said["time_ms"], said["rmse"]
                    for ours, theirs in ((point.time_ms.median, t["median"]), (point.time_ms.lower_quartile, t["lower_quartile"]),
                                         (point.time_ms.upper_quartile, t["upper_quartile"]), (point.time_ms.low, t["median_interval"]["low"]),
                                         (point.time_ms.high, t["median_interval"]["high"]), (point.time_ms.confidence, t["median_interval"]["confidence"]),
                                         (point.rmse.estimate, e["estimate"]), (point.rmse.low, e["low"]), (point.rmse.high, e["high"]),
                                         (point.mse.estimate, said["mse"]["estimate"]), (point.rel_mse, said["rel_mse"]["estimate"]), (point.rays, said["rays"])):
                        self.assertAlmostEqual(ours, theirs, delta=1e-9 * (1 + abs(theirs)), msg=f"{series['name']} {said['value']}")
        self.assertEqual(self.load("m.csv").provenance, {})

    def test_interval_of_the_median(self):
        for n in range(1, 40):
            k, confidence = measurement.median_interval(n)
            tail = lambda k: 2 * sum(math.comb(n, i) for i in range(k)) / 2 ** n
            self.assertAlmostEqual(confidence, max(0, 1 - tail(k)))
            if n >= 6:
                self.assertGreaterEqual(confidence, 0.95)
                self.assertLess(1 - tail(k + 1), 0.95)

    def test_data_that_are_none(self):
        def refused(text, words, error=gobo.InvalidArgument, name="bad.json"):
            path = pathlib.Path(self.path(name))
            path.write_text(text, encoding="utf-8")
            with self.assertRaises(error) as caught:
                measurement.load(path)
            self.assertIn(words, str(caught.exception))
            path.unlink()
        refused("{", "bad.json: ")
        refused("{}", "is not of gobo measure (format = None)")
        refused(json.dumps({**self.document, "format_version": 2}), "format_version = 2: this package reads 1")
        refused(json.dumps({**self.document, "runs": []}), "has no runs")
        refused("a,b\r\n1,2\r\n", "row 1 has no column series", name="bad.csv")
        refused("", "has no runs", name="bad.csv")
        text = pathlib.Path(self.path("m.csv")).read_text(encoding="utf-8").splitlines()
        at = text[0].split(",").index("time_ms")
        row = next(csv.reader([text[1]]))
        for value, words in (("soon", "row 1, column time_ms = soon: must be a number"), ("-1", "row 1, column time_ms = -1: must be a number, at least 0"),
                             ("", "row 1, column time_ms = : must be")):
            quoted = ",".join(f'"{v}"' for v in [*row[:at], value, *row[at + 1:]])
            refused(f"{text[0]}\r\n{quoted}\r\n", words, name="bad.csv")
        with self.assertRaises(gobo.NotFound):
            measurement.load(self.path("nosuch.json"))

    def test_colours(self):
        self.assertEqual(report.colour_of("axis aligned"), report.colour_of("Axis-Aligned"))
        self.assertEqual(report.colour_of("path tracing"), report.PLAIN_COLOUR)
        known = [report.colour_of(n) for n in ("ray_traced", "axis_aligned", "exponential", "shadow_map", "percentage_closer", "variance", "convolution")]
        self.assertEqual(len(set(known)), 7)
        names = [f"technique {i}" for i in range(40)]
        styles = report._styles(names, {})
        self.assertEqual({n: s["color"] for n, s in styles.items()}, {n: report.colour_of(n) for n in names})   # whatever else is in the figure
        self.assertEqual(len({(s["color"], s["marker"]) for s in styles.values()}), 40)                       # told apart all the same
        self.assertEqual(report._styles(["a"], {"a": "#123456"})["a"]["color"], "#123456")

    def test_palette_is_for_all_eyes(self):
        machado = np.array([np.eye(3),   # Machado, Oliveira, Fernandes 2009, severity 1: protan, deutan, tritan
                            [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
                            [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
                            [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]])
        xyz = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]])

        def lab(linear):
            t = xyz @ linear / xyz.sum(1)
            f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
            return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])

        def linear(colour):
            c = np.array([int(colour[i:i + 2], 16) for i in (1, 3, 5)]) / 255
            return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
        colours = [*report.PALETTE, report.PLAIN_COLOUR]
        for a, b in itertools.combinations(colours, 2):
            for eyes in machado:
                distance = np.linalg.norm(lab(np.clip(eyes @ linear(a), 0, 1)) - lab(np.clip(eyes @ linear(b), 0, 1)))
                self.assertGreater(distance, 20, (a, b))
        for colour in colours:
            self.assertGreater(1.05 / (xyz[1] @ linear(colour) + 0.05), 2, colour)

    @needs_matplotlib
    def test_figures_are_of_equal_bytes(self):
        made = {}
        for folder in ("one", "two"):
            # another process with other hashes, another matplotlibrc and another clock
            pathlib.Path(self.path("matplotlibrc")).write_text("font.size: 20\naxes.facecolor: red\n" if folder == "two" else "", encoding="utf-8")
            done = subprocess.run([sys.executable, "-m", "gobo.report", "m.json", "-o", folder], cwd=self.folder, capture_output=True, text=True, timeout=120,
                                  env={**os.environ, "PYTHONHASHSEED": "1" if folder == "one" else "2", "TZ": "UTC" if folder == "one" else "Asia/Tokyo"})
            self.assertEqual(done.returncode, 0, done.stderr)
            made[folder] = {p.name: p.read_bytes() for p in pathlib.Path(self.path(folder)).iterdir()}
            self.assertEqual(sorted(done.stdout.split()), sorted(f"{folder}/{n}" for n in made[folder]))
        figures = [f"m.{f}.{k}" for f in ("error_over_time", "error_over_rays", "nodes") for k in ("svg", "pdf", "png")]
        self.assertEqual(sorted(made["one"]), sorted([*figures, "m.html"]))
        self.assertEqual(made["one"], made["two"])
        for name, data in made["one"].items():
            self.assertTrue(data.startswith({".svg": b"<?xml", ".pdf": b"%PDF", ".png": b"\x89PNG", ".html": b"<!doctype html>"}[os.path.splitext(name)[1]]), name)
            for word in (b"dc:date", b"CreationDate", b"Matplotlib v"):
                self.assertNotIn(word, data, name)

    @needs_matplotlib
    def test_figure_shows_what_the_data_say(self):
        m = self.load()
        axes, = report.error_figure(m).axes
        self.assertEqual((axes.get_xscale(), axes.get_yscale(), axes.get_xlabel(), axes.get_ylabel()),
                         ("log", "log", "time [ms]", "RMSE of beauty [scene-linear radiance]"))
        lines = {line.get_label(): line for line in axes.get_lines() if not line.get_label().startswith("_")}
        self.assertEqual(set(lines), set(POINTS))
        for s in m.series:
            np.testing.assert_allclose(lines[s.name].get_xdata(), [p.time_ms.median for p in s.points])
            np.testing.assert_allclose(lines[s.name].get_ydata(), [p.rmse.estimate for p in s.points])
            self.assertEqual(lines[s.name].get_color(), report.colour_of(s.name))
        self.assertEqual(sorted(t.get_text() for t in axes.texts), sorted(v for values in POINTS.values() for v in values))
        self.assertEqual(report.error_figure(m, "rays").axes[0].get_xlabel(), "rays")
        self.assertEqual({t.get_text() for t in report.node_figure(m).axes[0].get_yticklabels()}, {f"{s}, {v}" for s, values in POINTS.items() for v in values})
        self.assertIsNone(report.node_figure(self.load("m.csv")))
        with self.assertRaises(gobo.InvalidArgument):
            report.error_figure(m, "luck")

    @needs_matplotlib
    def test_bounds_where_the_reference_cannot_tell(self):
        rows = [{**r, "mse": -1e-6, "mse_low": 0.0, "mse_high": 4e-4} if r["series"] == "path tracing" else r for r in self.document["runs"]]
        m = measurement._build("x.json", rows, {})
        axes, = report.error_figure(m).axes
        bound, = (line for line in axes.get_lines() if line.get_label() == "path tracing (upper bound)")
        np.testing.assert_allclose(bound.get_ydata(), 0.02)
        nothing = measurement._build("x.json", [{**r, "mse": 0.0, "mse_low": 0.0, "mse_high": 0.0} for r in self.document["runs"]], {})
        for kind in report.FORMATS:
            self.assertGreater(len(report.figure_bytes(report.error_figure(nothing), kind)), 1000)

    @needs_matplotlib
    def test_page_is_whole(self):
        report.write(self.load(), self.path("page"), ["png"])
        self.assertEqual([n for n in os.listdir(self.path("page")) if n.endswith(".svg")], [])
        page = pathlib.Path(self.path("page", "m.html")).read_text(encoding="utf-8")
        self.assertNotRegex(page, r"(src|href)=\"(?!data:)|<script|@import|url\(")
        pictures = re.findall(r"data:image/svg\+xml;base64,([\w+/=]+)", page)
        self.assertEqual(len(pictures), 3)
        for picture in pictures:
            self.assertTrue(base64.b64decode(picture, validate=True).startswith(b"<?xml"))
        for words in (self.document["machine"]["cpu"], self.document["scene"]["hash"], self.document["build"]["server"], self.document["date_utc"], "rays, few",
                      self.document["series"][1]["points"][0]["request_hash"], "--repeats 4"):
            self.assertIn(words, page)
        rows = [{**r, "series": "<b>&\"" if r["series"] == "in time" else r["series"]} for r in self.document["runs"]]
        report.write(measurement._build("odd.json", rows, {}), self.path("page"), [])
        self.assertNotIn("<b>", pathlib.Path(self.path("page", "odd.html")).read_text(encoding="utf-8"))

    @needs_matplotlib
    def test_equal_error_factor(self):
        m = self.load()
        plain = m.series[-1]
        for p in plain.points:
            self.assertAlmostEqual(report.equal_error_factor(m, p), 1)
        between = math.sqrt(plain.points[0].rmse.estimate * plain.points[1].rmse.estimate)
        halfway = math.sqrt(plain.points[0].time_ms.median * plain.points[1].time_ms.median)
        made = measurement.Point(0, "x", "y", measurement.times_of([halfway / 3]), 1, measurement.Estimate(between, 0, 1), measurement.Estimate(0, 0, 0), 0, ())
        errors = sorted(p.rmse.estimate for p in plain.points)
        if errors == [p.rmse.estimate for p in plain.points][::-1]:
            self.assertAlmostEqual(report.equal_error_factor(m, made), 3)
        far = measurement.Point(0, "x", "y", made.time_ms, 1, measurement.Estimate(errors[-1] * 1.01, 0, 1), made.mse, 0, ())
        self.assertTrue(math.isnan(report.equal_error_factor(m, far)))

    def test_command_refuses(self):
        for code, words, args in ((3, "no such file", ["nosuch.json"]), (2, "format = jpeg: must be one of", ["m.json", "--formats", "jpeg"]),
                                  (2, "--colour red: must be NAME=#RRGGBB", ["m.json", "--colour", "red"]),
                                  (2, "colour of a = red: must be #RRGGBB", ["m.json", "--colour", "a=red"]), (2, "two files are named m", ["m.json", "m.csv"])):
            done = subprocess.run([sys.executable, "-m", "gobo.report", *args, "-o", "refused"], cwd=self.folder, capture_output=True, text=True, timeout=60)
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertIn(words, done.stderr)
            self.assertFalse(os.path.exists(self.path("refused")))

    def test_without_matplotlib(self):
        with mock.patch.dict(sys.modules, {"matplotlib": None}):
            with self.assertRaises(gobo.FailedPrecondition) as caught:
                report.error_figure(self.load())
        self.assertIn("apt install python3-matplotlib", str(caught.exception))


if __name__ == "__main__":
    unittest.main()
