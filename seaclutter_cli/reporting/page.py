"""Self-contained HTML page: its data as JSON, with arrays as base64 of little-endian values, style and code."""

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli import __version__
from seaclutter_cli.arrays import Ints
from seaclutter_cli.frame import WATER_COLUMNS, Reason
from seaclutter_cli.reporting import palette
from seaclutter_cli.reporting.collector import Chosen, Collector, History, Method, bin_starts, binned, density_of
from seaclutter_cli.reporting.palette import INK

LABELLED, FALSE_ALARM, MISSED_TARGET = 1, 2, 4
"""Bits that describe a frame in the timeline."""

_STEPS = 32767
SCRIPTS = ("dom.js", "charts.js", "cloud.js", "tracks.js", "page.js")
"""JavaScript files of the page, in order of execution."""

_OTHER_SOURCES = "img-src data:; base-uri 'none'; form-action 'none'"


def report_data(
    collected: Collector, summaries: Mapping[str, Mapping[str, Any]], notes: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the data of the page, given rates and counts of each method by its name, and remarks for the reader."""
    starts = bin_starts(len(collected.timeline))
    recording, frame, seconds = np.array(collected.timeline, np.float64).reshape(-1, 3).T
    chosen = collected.chosen
    known = [one.item.intensity[np.isfinite(one.item.intensity)] for one in chosen]
    intensities = np.concatenate([*known, np.empty(0, np.float32)])
    top = float(np.quantile(intensities, 0.98)) if len(intensities) else 0.0  # of the colour scale
    return {
        "version": __version__,
        "recordings": collected.recordings,
        "labelled": collected.labelled,
        "notes": list(notes),
        "palette": _palette(collected.methods),
        "frames": {
            "count": len(collected.timeline),
            "recording": _packed(recording, "<u2"),
            "frame": _packed(frame, "<u4"),
            "seconds": _packed(seconds, "<f4"),
        },
        "bins": starts.tolist(),
        "methods": [
            _method(method, history, dict(summaries.get(method.name, {})), starts)
            | {"density": _density(collected, number, history)}
            for number, (method, history) in enumerate(zip(collected.methods, collected.histories, strict=True))
        ],
        "tracks": collected.tracks.found(),
        "samples": [_sample(one, top) for one in chosen],
        "intensity_top": top,
    }


def _palette(methods: Sequence[Method]) -> dict[str, Any]:
    edges = {tuple(method.edges) for method in methods if len(method.edges)}
    names = palette.reason_names(edges.pop() if len(edges) == 1 else ())  # other limits have other names
    return {
        "reasons": [palette.REASONS[reason] for reason in Reason],
        "order": [int(reason) for reason in palette.REASONS],
        "names": [names[reason] for reason in Reason],
        "truth": list(palette.TRUTH.values()),
        "truth_names": list(palette.TRUTH),
        "states": palette.STATES,
        "lines": list(palette.LINES),
        "ramp": list(palette.RAMP),
        "heights": list(palette.HEIGHTS.items()),
    }


def _method(method: Method, history: History, summary: dict[str, Any], starts: Ints) -> dict[str, Any]:
    counts, _, _ = binned(history["counts"], starts)
    thresholds = zip(("", "_low", "_high"), binned(history["thresholds"], starts), strict=True)
    corrections, _, _ = binned(history["corrections"], starts)
    alarms, missed = history["false_alarms"], history["missed"] > 0
    water: dict[str, list[str]] | None = None
    if np.isfinite(history["water"]).any():
        series, columns = binned(history["water"], starts), ("water_level_m", "significant_wave_height_m")
        water = {name: [_packed(one[:, WATER_COLUMNS.index(name)], "<f4") for one in series] for name in columns}
    return {
        "name": method.name,
        "edges": list(method.edges),
        "config": method.config,
        "summary": summary,
        "totals": np.nansum(history["counts"], axis=0, dtype=np.float64).astype(int).tolist(),
        "mean_thresholds": mean_thresholds(history),
        "counts": _packed(counts.T, "<f4"),
        **{f"thresholds{end}": _packed(one.T, "<f4") for end, one in thresholds},
        "corrections": _packed(corrections.T, "<f4"),
        "water": water,
        "scenes": {name: _packed(frames, "u1") for name, frames in history.scenes.items()},
        "alarms": _packed(LABELLED * np.isfinite(alarms) + FALSE_ALARM * (alarms > 0) + MISSED_TARGET * missed, "u1"),
        "false_alarms": _packed(np.nan_to_num(alarms).clip(0, 255), "u1"),
        "missed": _packed(np.nan_to_num(history["missed"]).clip(0, 255), "u1"),
    }


def mean_thresholds(history: History) -> list[float]:
    """Return the threshold of each range ring, averaged over the frames where it is known."""
    values = history["thresholds"]
    known = np.isfinite(values)
    total = np.where(known, values, 0).sum(axis=0, dtype=np.float64)
    return [float(mean) for mean in total / np.maximum(known.sum(axis=0), 1)]


def _density(collected: Collector, number: int, history: History) -> dict[str, Any] | None:
    method = collected.methods[number]
    top = float(np.nanmax(history["thresholds"], initial=0)) if len(method.edges) else 0.0
    if (found := density_of(collected.spread, number, method.edges, top)) is None:
        return None
    reach_m, low, high, counts = found
    return {
        "reach": reach_m,
        "low": low,
        "high": high,
        "rows": counts.shape[1],
        "columns": counts.shape[2],
        "counts": {str(int(one)): _packed(counts[one], "<f4") for one in Reason if counts[one].any()},
        "frames": len(collected.spread),
    }


def _sample(one: Chosen, top: float) -> dict[str, Any]:
    sample = one.item
    reach = float(np.abs(sample.xyz).max(initial=0.01))
    scale = reach / _STEPS
    plane = (water := sample.water) and {  # the mean plane, z = level + slope_x x + slope_y y
        "level": water.level_m,
        "slope_x": math.tan(math.radians(water.pitch_deg)),
        "slope_y": -math.tan(math.radians(water.roll_deg)),
        "wave_height": water.significant_wave_height_m,
    }
    return {
        "row": one.row,
        "why": one.why,
        "size": sample.size,
        "valid": sample.valid,
        "shown": len(sample.xyz),
        "scale": scale,
        "xyz": _packed(np.round(sample.xyz / scale), "<i2"),
        "intensity": _packed(np.nan_to_num(sample.intensity / (top or 1.0) * 255).clip(0, 255), "u1"),
        "truth": _packed(sample.truth, "u1"),
        "reasons": [_packed(reasons, "u1") for reasons in sample.reasons],
        "boxes": sample.boxes,
        "clusters": sample.clusters,
        "water": plane,
    }


def _packed(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, np.dtype(dtype)).tobytes()).decode()


def render_page(data: Mapping[str, Any]) -> bytes:
    """Return the HTML page for the data of a report, as UTF-8.

    Names in logs are untrusted. All data are in one JSON block without any ``<``, so no name can end the block or start
    another element, and the page's code inserts names as text only. In addition, the content security policy allows
    only this style and this code, identified by their hashes, and no loading of resources.
    """
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    style = _read("page.css") + ":root{" + "".join(f"--{name}:{color};" for name, color in INK.items()) + "}"
    script = "\n".join(_read(name) for name in SCRIPTS)
    digests = (base64.b64encode(hashlib.sha256(part.encode()).digest()).decode() for part in (style, script))
    policy = "default-src 'none'; style-src 'sha256-{}'; script-src 'sha256-{}'; ".format(*digests) + _OTHER_SOURCES
    parts = {"POLICY": policy, "STYLE": style, "SCRIPT": script, "DATA": text}
    page = _read("page.html")
    for name, part in parts.items():
        page = page.replace(f"%{name}%", part, 1)
    return page.encode()


def _read(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")
