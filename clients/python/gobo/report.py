# SPDX-License-Identifier: Apache-2.0
"""Figures and a page of what `gobo measure` wrote, for papers. No server is needed; matplotlib is (Debian: python3-matplotlib).

    python3 -m gobo.report m.json -o figures          # m.error_over_time.svg .pdf .png, ..., m.html

    m = gobo.measurement.load("m.json")
    gobo.report.error_figure(m).savefig("error.pdf")

A technique has the same colour in every figure: it follows from its name alone. Equal data make equal bytes.
"""
from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import math
import os
import re
import sys
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from . import _report_page
from .errors import Error, FailedPrecondition, InvalidArgument, NotFound
from .exr import write_atomic
from .measurement import Estimate, Measurement, Point, Series, load
from .v1 import filters_pb2

#: Any two are at least 20 apart in CIELAB to normal eyes and to those without one kind of cones (Machado et al. 2009), and stand out from white by 2 : 1.
PALETTE = ("#332288", "#EE6677", "#117733", "#33BBEE", "#882255", "#999933", "#785EF0", "#CC79A7")
#: Of plain path tracing and shadow rays.
PLAIN_COLOUR = "#000000"
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
DASHES = ("-", (0, (5, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5)))
FORMATS = ("svg", "pdf", "png")
_RC = {"font.family": "DejaVu Sans", "font.size": 8, "axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.5, "axes.axisbelow": True,
       "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "gobo", "svg.fonttype": "path", "pdf.fonttype": 42, "figure.dpi": 100,
       "savefig.dpi": 200}


def _matplotlib() -> Any:
    try:
        import matplotlib
        from matplotlib.backends import backend_agg, backend_pdf, backend_svg  # noqa: F401  (what savefig takes)
        from matplotlib.figure import Figure  # noqa: F401
    except ImportError as error:
        raise FailedPrecondition(f"gobo.report draws with matplotlib, which cannot be imported ({error}): apt install python3-matplotlib") from None
    return matplotlib


@contextlib.contextmanager
def _settings() -> Iterator[Any]:
    """matplotlib as it comes, whatever a matplotlibrc says, and ours on top."""
    library = _matplotlib()
    with library.rc_context():
        library.rcdefaults()
        library.rcParams.update(_RC)
        yield library


def _hash(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode("utf-8")).digest()[:8], "big")


def _normal(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def colour_of(name: str) -> str:
    """Of a series: plain ones are black, shadow techniques of the schema ("axis_aligned", "Axis aligned") follow their field's number, others a hash of the name.
    Two names may share one: then marks or dashes differ."""
    normal = _normal(name)
    if normal in ("path_tracing", "shadow_rays"):
        return PLAIN_COLOUR
    known = filters_pb2.ShadowTechnique.DESCRIPTOR.fields_by_name.get(normal)
    return PALETTE[(known.number if known is not None else _hash(normal)) % len(PALETTE)]


def _styles(names: "Sequence[str]", colours: "Mapping[str, str]") -> "Dict[str, Dict[str, Any]]":
    """Colour by name; marks by name too, and the next free one or dashes where two of a figure would look alike."""
    taken: "set[Tuple[str, str]]" = set()
    shared: "Dict[str, int]" = {}
    out: "Dict[str, Dict[str, Any]]" = {}
    for name in sorted(names):
        colour = colours.get(name, colour_of(name))
        first = (_hash(_normal(name)) >> 8) % len(MARKERS)
        marks = [MARKERS[(first + i) % len(MARKERS)] for i in range(len(MARKERS))]
        mark = next((m for m in marks if (colour, m) not in taken), marks[0])
        taken.add((colour, mark))
        out[name] = {"color": colour, "marker": mark, "linestyle": DASHES[shared.get(colour, 0) % len(DASHES)]}
        shared[colour] = shared.get(colour, 0) + 1
    return out


def _error_label(m: Measurement) -> str:
    unit = {"": "", "1": ""}.get(m.error_unit, f" [{m.error_unit}]")
    return f"RMSE of {m.output}{unit}"


def _abscissa(p: Point, against: str) -> Estimate:
    return Estimate(p.time_ms.median, p.time_ms.low, p.time_ms.high) if against == "time" else Estimate(p.rays, p.rays, p.rays)


def _floor(m: Measurement) -> float:
    """Where the axis of errors ends: bars that go down to 0 leave it."""
    ends = [v for s in m.series for p in s.points for v in [next((v for v in (p.rmse.low, p.rmse.estimate / 2, p.rmse.high) if v > 0), 0.0)] if v > 0]
    return min(ends, default=1.0) / 1.5


def _label_ticks(axis: Any) -> None:
    """Of a short logarithmic axis also 2 and 5 have numbers: powers of ten alone would be one or two."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
    low, high = axis.get_view_interval()
    if 0 < low < high < 1000 * low:
        axis.set_major_locator(LogLocator(base=10, subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:.6g}"))
        axis.set_minor_formatter(NullFormatter())


def _draw_series(axes: Any, series: Series, against: str, style: "Mapping[str, Any]", floor: float) -> None:
    shown = [p for p in series.points if _abscissa(p, against).estimate > 0]
    xs = [_abscissa(p, against) for p in shown]
    seen = [(x, p) for x, p in zip(xs, shown) if p.rmse.estimate > 0]
    bounds = [(x, p) for x, p in zip(xs, shown) if not p.rmse.estimate > 0 and p.rmse.high > 0]   # nothing but an upper bound is known
    colour = style["color"]
    if seen:
        x, y = [a.estimate for a, _ in seen], [p.rmse.estimate for _, p in seen]
        low, high = [max(p.rmse.low, floor / 1e3) for _, p in seen], [p.rmse.high for _, p in seen]
        order, rows = np.argsort(x, kind="stable"), np.argsort(y, kind="stable")
        axes.fill_between(np.array(x)[order], np.array(low)[order], np.array(high)[order], color=colour, alpha=0.12, linewidth=0)
        axes.fill_betweenx(np.array(y)[rows], np.array([a.low for a, _ in seen])[rows], np.array([a.high for a, _ in seen])[rows], color=colour, alpha=0.12, linewidth=0)
        axes.errorbar(x, y, xerr=[[a.estimate - a.low for a, _ in seen], [a.high - a.estimate for a, _ in seen]],
                      yerr=[[b - a for a, b in zip(low, y)], [a - b for a, b in zip(high, y)]], fmt="none", ecolor=colour, elinewidth=0.7, capsize=1.5, alpha=0.8)
        axes.plot(x, y, label=series.name, linewidth=1.2, markersize=4, **style)
    if bounds:
        axes.plot([a.estimate for a, _ in bounds], [p.rmse.high for _, p in bounds], linestyle="none", marker="v", markerfacecolor="white", markeredgecolor=colour,
                  label=None if seen else f"{series.name} (upper bound)")
    for a, p in seen + bounds:
        axes.annotate(p.value, (a.estimate, p.rmse.estimate if p.rmse.estimate > 0 else p.rmse.high), xytext=(3, 3), textcoords="offset points", fontsize=6,
                      color=colour)


def error_figure(m: Measurement, against: str = "time", colours: "Optional[Mapping[str, str]]" = None) -> Any:
    """A matplotlib Figure: RMSE over time (`against` "time") or rays ("rays"), logarithmic. Crosses and bands: 95 % of the error (the pixels' noise and the
    reference's); of time the interval of the median (all runs, where they are fewer than 6).

    Raises: gobo.FailedPrecondition: no matplotlib; gobo.InvalidArgument: no such `against`.
    """
    if against not in ("time", "rays"):
        raise InvalidArgument(f"against = {against}: must be time or rays", field="against", value=against)
    with _settings():
        from matplotlib.figure import Figure
        figure = Figure(figsize=(5, 3.6), layout="constrained")
        axes = figure.add_subplot()
        floor = _floor(m)
        styles = _styles([s.name for s in m.series], colours or {})
        for series in m.series:
            _draw_series(axes, series, against, styles[series.name], floor)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(bottom=floor)
        axes.set_xlabel("time [ms]" if against == "time" else "rays")
        axes.set_ylabel(_error_label(m))
        for axis in (axes.xaxis, axes.yaxis):
            _label_ticks(axis)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=7, frameon=False)
        return figure


def node_figure(m: Measurement) -> Any:
    """A matplotlib Figure: where the time of each point goes, by kind of node; None where the data have no nodes (a CSV)."""
    points = [(s, p) for s in m.series for p in s.points if p.nodes]
    if not points:
        return None
    total: "Dict[str, float]" = {}
    for _, p in points:
        for node, ms in p.nodes:
            total[node] = total.get(node, 0) + ms
    most = sorted(total, key=lambda n: (-total[n], n))[:len(PALETTE)]
    with _settings():
        from matplotlib.figure import Figure
        figure = Figure(figsize=(5, 0.8 + 0.22 * len(points)), layout="constrained")
        axes = figure.add_subplot()
        places = np.arange(len(points))[::-1]
        left = np.zeros(len(points))
        for i, node in enumerate([*most, None]):
            width = np.array([sum(ms for n, ms in p.nodes if n == node or (node is None and n not in most)) for _, p in points])
            if width.any():
                axes.barh(places, width, left=left, height=0.7, color=PALETTE[i] if node is not None else "#bbbbbb", label=node or "others")
            left += width
        axes.set_yticks(places, [f"{s.name}, {p.value}" for s, p in points])
        axes.set_xlabel("median time of nodes, added up [ms]")
        axes.grid(axis="y", visible=False)
        axes.legend(fontsize=6, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
        return figure


def figure_bytes(figure: Any, format: str) -> bytes:
    """"svg", "pdf" or "png" without dates, names of programs or random ids: equal figures are equal bytes (with one version of matplotlib)."""
    if format not in FORMATS:
        raise InvalidArgument(f"format = {format}: must be one of {', '.join(FORMATS)}", field="format", value=format)
    metadata: "Dict[str, Any]" = {"svg": {"Date": None, "Creator": None}, "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
                                  "png": {"Software": None}}[format]
    out = io.BytesIO()
    with _settings():
        figure.savefig(out, format=format, metadata=metadata)
    return out.getvalue()


def equal_error_factor(m: Measurement, p: Point) -> float:
    """How many times longer the plain series (--path-tracing) takes for the same RMSE, between its points in logarithms; NaN beyond them or without it."""
    plain = [(q.rmse.estimate, q.time_ms.median) for s in m.series if s.plain for q in s.points if q.rmse.estimate > 0 and q.time_ms.median > 0]
    errors = sorted(plain)
    if not errors or not errors[0][0] <= p.rmse.estimate <= errors[-1][0] or not p.time_ms.median > 0:
        return math.nan
    time = np.interp(math.log(p.rmse.estimate), [math.log(e) for e, _ in errors], [math.log(t) for _, t in errors])
    return float(math.exp(time) / p.time_ms.median)


def write(m: Measurement, folder: "str | os.PathLike[str]", formats: "Sequence[str]" = FORMATS, colours: "Optional[Mapping[str, str]]" = None) -> "List[str]":
    """Figures and page as NAME.error_over_time.svg, NAME.error_over_rays.svg, NAME.nodes.svg (and the other formats) and NAME.html, NAME being the data file's
    without its extension. Makes the folder; returns the files.

    Raises: gobo.FailedPrecondition: no matplotlib; gobo.InvalidArgument: a format or colour that is none.
    """
    for name, colour in (colours or {}).items():
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
            raise InvalidArgument(f"colour of {name} = {colour}: must be #RRGGBB", field="colours", value=colour)
    figures = {"error_over_time": error_figure(m, "time", colours), "error_over_rays": error_figure(m, "rays", colours), "nodes": node_figure(m)}
    drawn = {(name, kind): figure_bytes(figure, kind) for name, figure in figures.items() if figure is not None for kind in dict.fromkeys((*formats, "svg"))}
    os.makedirs(folder, exist_ok=True)
    stem = os.path.join(os.fspath(folder), os.path.splitext(m.name)[0])
    files = []
    for (name, kind), data in drawn.items():
        if kind in formats:
            files.append(f"{stem}.{name}.{kind}")
            write_atomic(files[-1], data)
    factors = {(s.name, p.index): equal_error_factor(m, p) for s in m.series for p in s.points}
    page = _report_page.page(m, {name: data for (name, kind), data in drawn.items() if kind == "svg"}, factors)
    files.append(f"{stem}.html")
    write_atomic(files[-1], page.encode("utf-8"))
    return files


def main(arguments: "Optional[Sequence[str]]" = None) -> int:
    parser = argparse.ArgumentParser(prog="python3 -m gobo.report", description="figures and a page of what gobo measure wrote (docs/measuring.md)")
    parser.add_argument("data", nargs="+", metavar="DATA", help="JSON (gobo measure --out) or CSV (--csv)")
    parser.add_argument("-o", "--out", required=True, metavar="FOLDER", help="made if absent")
    parser.add_argument("--formats", default=",".join(FORMATS), metavar="LIST", help="of the figures, separated by commas: svg, pdf, png; default all")
    parser.add_argument("--colour", action="append", default=[], metavar="NAME=#RRGGBB", help="of a series, in place of the one by its name; repeat for several")
    given = parser.parse_args(arguments)
    try:
        colours = {}
        for text in given.colour:
            name, equals, colour = text.rpartition("=")
            if not equals:
                raise InvalidArgument(f"--colour {text}: must be NAME=#RRGGBB", field="colour", value=text)
            colours[name] = colour
        measurements = [load(path) for path in given.data]
        stems = [os.path.splitext(m.name)[0] for m in measurements]
        for stem in stems:
            if stems.count(stem) > 1:
                raise InvalidArgument(f"two files are named {stem}: their figures would be too", value=stem)
        for m in measurements:
            for path in write(m, given.out, [f for f in given.formats.split(",") if f], colours):
                print(path)
    except Error as error:
        print(f"gobo.report: {error}", file=sys.stderr)
        return 3 if isinstance(error, NotFound) else 2 if isinstance(error, InvalidArgument) else 1
    except OSError as error:
        print(f"gobo.report: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
