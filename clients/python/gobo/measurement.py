# SPDX-License-Identifier: Apache-2.0
"""What `gobo measure` wrote, read without a server: its JSON (rows, points, where they come from) or its CSV (rows alone).

    m = gobo.measurement.load("m.json")
    for s in m.series:
        for p in s.points:
            print(s.name, p.value, p.time_ms.median, p.rmse.estimate)

What the runs of a point say together is worked out here from the rows, as the command does it (docs/measuring.md): the two check each other.
"""
from __future__ import annotations

import csv
import io
import json
import math
import os
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from .errors import InvalidArgument, NotFound

#: Columns of the CSV and keys of the JSON's rows that are text; the rest are numbers.
TEXT_COLUMNS = ("series", "path", "value", "output", "picture_digest", "request_hash")
#: Columns that a reader cannot do without.
NEEDED_COLUMNS = ("series", "path", "value", "point", "repeat", "run_order", "output", "time_ms", "rays", "mse", "mse_standard_error", "mse_low", "mse_high",
                  "rel_mse")
_FORMAT_VERSION = 1
#: Names of series that `gobo measure --path-tracing` adds.
PLAIN = ("path tracing", "shadow rays")


@dataclass(frozen=True)
class Times:
    """Milliseconds of a point's runs. low, high: interval of the median by order statistics, which covers it with `confidence` (0 of one run)."""
    median: float
    lower_quartile: float
    upper_quartile: float
    low: float
    high: float
    confidence: float


@dataclass(frozen=True)
class Estimate:
    """With a 95 % interval."""
    estimate: float
    low: float
    high: float


@dataclass(frozen=True)
class Point:
    index: int
    path: str
    value: str
    time_ms: Times
    rays: float
    rmse: Estimate
    mse: Estimate
    rel_mse: float
    runs: "Tuple[Mapping[str, Any], ...]" = field(repr=False)                 # rows, by repeat
    nodes: "Tuple[Tuple[str, float], ...]" = ()                              # kind of node, median ms; none from a CSV
    details: "Mapping[str, Any]" = field(default_factory=dict, repr=False)    # of the JSON: resolved request, warnings, ...


@dataclass(frozen=True)
class Series:
    name: str
    path: str
    points: "Tuple[Point, ...]"
    fixed: "Tuple[str, ...]" = ()

    @property
    def plain(self) -> bool:
        """What --path-tracing added."""
        return self.name in PLAIN


@dataclass(frozen=True)
class Measurement:
    """`provenance` is the JSON without rows and series; empty from a CSV. `error_unit` is "" where it is not known."""
    name: str
    output: str
    error_unit: str
    series: "Tuple[Series, ...]"
    provenance: "Mapping[str, Any]" = field(default_factory=dict, repr=False)


def median_interval(count: int) -> Tuple[int, float]:
    """(k, confidence): the k-th smallest and the k-th largest of `count` runs, the narrowest that cover the median of all such runs with 95 %, or k = 1."""
    best, below = (1, max(0.0, 1 - 2 * 0.5 ** count)), 1
    for k in range(2, count // 2 + 1):
        below += math.comb(count, k - 1)
        if 1 - 2 * below / 2 ** count < 0.95:
            break
        best = (k, 1 - 2 * below / 2 ** count)
    return best


def times_of(ms: "Sequence[float]") -> Times:
    """Of at least one run."""
    ordered = np.sort(np.asarray(ms, np.float64))
    k, confidence = median_interval(len(ordered))
    q = np.quantile(ordered, [0.5, 0.25, 0.75])
    return Times(float(q[0]), float(q[1]), float(q[2]), float(ordered[k - 1]), float(ordered[-k]), confidence)


def _student(degrees: int) -> float:
    """0.975 quantile of Student's t: a table, then Hill's series in 1 / degrees."""
    if degrees < 3:
        return (12.706204736432095, 4.302652729911275)[degrees - 1]
    q, d = 1.959963984540054, float(degrees)
    return (q + (q ** 3 + q) / (4 * d) + (5 * q ** 5 + 16 * q ** 3 + 3 * q) / (96 * d ** 2)
            + (3 * q ** 7 + 19 * q ** 5 + 17 * q ** 3 - 15 * q) / (384 * d ** 3))


def mse_of(rows: "Sequence[Mapping[str, Any]]") -> Estimate:
    """Of a point's runs: equal pictures say no more than one; what pictures differ by widens the interval."""
    mse = np.array([r["mse"] for r in rows], np.float64)
    mean = float(mse.mean())
    down = float(np.mean([max(0.0, r["mse"] - r["mse_low"]) for r in rows]))
    up = float(np.mean([max(0.0, r["mse_high"] - r["mse"]) for r in rows]))
    if len(rows) > 1:
        between = _student(len(rows) - 1) * float(mse.std(ddof=1)) / math.sqrt(len(rows))
        down, up = math.hypot(down, between), math.hypot(up, between)
    return Estimate(mean, max(0.0, mean - down), max(0.0, mean + up))


def _point(rows: "List[Dict[str, Any]]", details: "Mapping[str, Any]") -> Point:
    rows = sorted(rows, key=lambda r: int(r["repeat"]))
    mse, first = mse_of(rows), rows[0]
    rmse = Estimate(*(math.sqrt(max(0.0, v)) for v in (mse.estimate, mse.low, mse.high)))
    nodes = tuple((str(n["node"]), float(n["time_ms"]["median"] or 0)) for n in details.get("nodes", ()))
    return Point(int(first["point"]), first["path"], first["value"], times_of([r["time_ms"] for r in rows]), float(np.median([r["rays"] for r in rows])), rmse, mse,
                 float(np.mean([r["rel_mse"] for r in rows])), tuple(rows), nodes, details)


def _build(name: str, rows: "List[Dict[str, Any]]", document: "Mapping[str, Any]") -> Measurement:
    if not rows:
        raise InvalidArgument(f"{name}: has no runs", place=name)
    found: "Dict[str, Dict[int, List[Dict[str, Any]]]]" = {}
    for row in rows:
        found.setdefault(row["series"], {}).setdefault(int(row["point"]), []).append(row)
    listed = {s["name"]: s for s in document.get("series", ())}
    series = []
    for title, points in found.items():
        about = listed.get(title, {})
        details = {int(p["point"]): p for p in about.get("points", ())}
        made = tuple(_point(runs, details.get(index, {})) for index, runs in sorted(points.items()))
        series.append(Series(title, made[0].path, made, tuple(about.get("fixed", ()))))
    provenance = {k: v for k, v in document.items() if k not in ("series", "runs")}
    return Measurement(name, rows[0]["output"], str(document.get("error_unit", "")), tuple(series), provenance)


def _number(text: Any, column: str, name: str, line: int) -> float:
    if text is None or text == "":
        return math.nan
    try:
        return float(text)
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name}: row {line}, column {column} = {text}: must be a number", place=name, value=str(text)) from None


def _rows(name: str, raw: "Sequence[Mapping[str, Any]]") -> "List[Dict[str, Any]]":
    rows = []
    for line, given in enumerate(raw, 1):
        missing = [c for c in NEEDED_COLUMNS if c not in given]
        if missing:
            raise InvalidArgument(f"{name}: row {line} has no column {missing[0]}: is it of gobo measure?", place=name)
        row: "Dict[str, Any]" = {str(c): str(v) if c in TEXT_COLUMNS else _number(v, str(c), name, line) for c, v in given.items() if c is not None}
        for column in ("point", "repeat", "run_order", "time_ms"):
            if not math.isfinite(row[column]) or row[column] < 0:
                raise InvalidArgument(f"{name}: row {line}, column {column} = {given[column]}: must be a number, at least 0", place=name)
        rows.append(row)
    return rows


def load(path: "str | os.PathLike[str]") -> Measurement:
    """Reads what `gobo measure` wrote with --out (JSON) or --csv.

    Raises: gobo.NotFound: no such file; gobo.InvalidArgument: neither of the two, or of a later version.
    """
    name = os.path.basename(os.fspath(path))
    try:
        with open(path, encoding="utf-8", newline="") as file:
            text = file.read()
    except FileNotFoundError:
        raise NotFound(f"no such file: \"{os.fspath(path)}\"", place=os.fspath(path)) from None
    except (IsADirectoryError, UnicodeDecodeError) as error:
        raise InvalidArgument(f"{name}: {error}", place=name) from None
    if not text.lstrip().startswith("{"):
        return _build(name, _rows(name, list(csv.DictReader(io.StringIO(text)))), {})
    try:
        document: Any = json.loads(text)
    except json.JSONDecodeError as error:
        raise InvalidArgument(f"{name}: {error}", place=name) from None
    if document.get("format") != "gobo measure":
        raise InvalidArgument(f"{name}: is not of gobo measure (format = {document.get('format')})", place=name)
    version: Optional[Any] = document.get("format_version")
    if version != _FORMAT_VERSION:
        raise InvalidArgument(f"{name}: format_version = {version}: this package reads {_FORMAT_VERSION}", place=name, value=str(version))
    return _build(name, _rows(name, document.get("runs", ())), document)
