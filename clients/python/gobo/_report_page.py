# SPDX-License-Identifier: Apache-2.0
"""The page of gobo.report: one static file with its figures in it; it loads nothing and has no script."""
from __future__ import annotations

import base64
import html
import json
import math
from typing import Any, List, Mapping, Tuple

from .measurement import Estimate, Measurement

_STYLE = """
body{font:14px/1.45 system-ui,sans-serif;margin:2em auto;max-width:64em;padding:0 1em;color:#222;background:#fff}
table{border-collapse:collapse;margin:1em 0}td,th{padding:.2em .6em;text-align:right;border-bottom:1px solid #ddd;white-space:nowrap}
td.text,th.text{text-align:left}img{max-width:100%;display:block}figure{margin:1.5em 0}figcaption{color:#555}
code,pre{font-size:12px}pre{overflow:auto;background:#f6f6f6;padding:.6em}code{word-break:break-all}summary{cursor:pointer}
"""

_CAPTIONS = {
    "error_over_time": "Error against time. Bars and bands: 95 % interval of the error; of time the interval of the median by order statistics. "
                       "A hollow triangle is an upper bound: the error is below what the reference can tell.",
    "error_over_rays": "Error against rays traced, which do not depend on the machine.",
    "nodes": "Where the time goes: medians by kind of node.",
}


def _text(value: Any) -> str:
    return html.escape(str(value))


def _number(v: float, digits: int = 4) -> str:
    return f"{v:.{digits}g}" if math.isfinite(v) else "–"


def _interval(e: Estimate) -> str:
    return f"{_number(e.low, 3)} – {_number(e.high, 3)}"


def _table(head: "List[Tuple[str, bool]]", rows: "List[List[str]]") -> str:
    def line(tag: str, cells: "List[str]") -> str:
        return "<tr>" + "".join(f"<{tag}{' class=text' if left else ''}>{c}</{tag}>" for c, (_, left) in zip(cells, head)) + "</tr>\n"
    return "<table>\n" + line("th", [_text(h) for h, _ in head]) + "".join(line("td", r) for r in rows) + "</table>\n"


def _points(m: Measurement, factors: "Mapping[Tuple[str, int], float]") -> str:
    unit = f" [{m.error_unit}]" if m.error_unit not in ("", "1") else ""
    head = [("series", True), ("point", True), ("runs", False), ("median ms", False), ("quartiles", False), ("rays", False), (f"RMSE{unit}", False), ("95 %", False),
            ("relMSE", False), ("plain takes", False)]
    rows = []
    for s in m.series:
        for p in s.points:
            factor = factors.get((s.name, p.index), math.nan)
            rows.append([_text(s.name), f"<code>{_text(p.path)}={_text(p.value)}</code>", str(len(p.runs)), _number(p.time_ms.median),
                         f"{_number(p.time_ms.lower_quartile, 3)} – {_number(p.time_ms.upper_quartile, 3)}", f"{p.rays:.0f}", _number(p.rmse.estimate),
                         _interval(p.rmse), _number(p.rel_mse), "×" + _number(factor, 3) if math.isfinite(factor) else "–"])
    return _table(head, rows) + "<p>plain takes: how many times longer the series of --path-tracing takes for the same RMSE, between its points.</p>\n"


def _provenance(m: Measurement) -> str:
    p = m.provenance
    if not p:
        return "<p>The data are a CSV: where they come from stands in the JSON of <code>gobo measure --out</code>.</p>\n"
    machine, scene, reference, build = (p.get(k) or {} for k in ("machine", "scene", "reference", "build"))
    facts = [("command", f"<code>{_text(p.get('command', ''))}</code>"), ("date (UTC)", _text(p.get("date_utc", ""))),
             ("build", _text(build.get("server", "")) + ("" if build.get("server") == build.get("client") else f" (client {_text(build.get('client', ''))})")),
             ("machine", f"{_text(machine.get('cpu') or 'not known')}, {_text(machine.get('cores') or '?')} cores, {_text(machine.get('logical_cores') or '?')} logical, "
                         f"{_text(machine.get('threads') or '?')} render threads"),
             ("scene", f"{_text(scene.get('id', ''))}, {_text(scene.get('triangles', ''))} triangles, hash <code>{_text(scene.get('hash', ''))}</code>"),
             ("reference", _text(reference.get("file") or f"{reference.get('kind', '')}, {reference.get('samples_per_pixel', '')} samples a pixel in two halves")),
             ("caches", "dropped before each run" if p.get("cold") else "as they were"), ("repeats", _text(p.get("repeats", "")) + ", interleaved")]
    return _table([("", True), ("", True)], [[_text(k), v] for k, v in facts])


def _requests(m: Measurement) -> str:
    out = []
    for s in m.series:
        for p in s.points:
            if not p.details.get("resolved"):
                continue
            warnings = "".join(f"<p>warning: {_text(w)}</p>" for w in p.details.get("warnings", ()))
            out.append(f"<details><summary>{_text(s.name)}, {_text(p.path)}={_text(p.value)}: <code>{_text(p.details.get('request_hash', ''))}</code></summary>{warnings}"
                       f"<pre>{_text(json.dumps(p.details['resolved'], indent=1, ensure_ascii=False))}</pre></details>\n")
    return "<h2>Requests</h2>\n" + "".join(out) if out else ""


def page(m: Measurement, figures: "Mapping[str, bytes]", factors: "Mapping[Tuple[str, int], float]") -> str:
    """`figures`: SVG by the name of its caption."""
    title = f"{_text((m.provenance.get('scene') or {}).get('id') or m.name)}: error of {_text(m.output)} against time"
    drawn = "".join(f"<figure><img alt=\"{_text(_CAPTIONS[name])}\" src=\"data:image/svg+xml;base64,{base64.b64encode(data).decode()}\">"
                    f"<figcaption>{_text(_CAPTIONS[name])}</figcaption></figure>\n" for name, data in figures.items())
    return (f"<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title><style>{_STYLE}</style></head><body>\n<h1>{title}</h1>\n{drawn}"
            f"<h2>Points</h2>\n{_points(m, factors)}<h2>Where they come from</h2>\n{_provenance(m)}{_requests(m)}</body></html>\n")
