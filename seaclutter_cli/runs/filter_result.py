"""Results of filtering, as text and as data."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from seaclutter_cli.frame import Reason
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.log_work import LogOutcome, LogSummary
from seaclutter_cli.text import count, data_size, indented, printable, share, table

_MOST = 0.5


@dataclass(kw_only=True)
class FilterOutcome(LogOutcome):
    """Outcome of filtering one recording.

    ``edges`` are those of the range rings of the method in metres, if it has any; ``has_water`` is whether it estimates
    the water; ``rows`` are those of the table of frames, compressed, on their way from another process.
    """

    edges: Sequence[float]
    has_water: bool = False
    rows: bytes = field(default=b"", repr=False)

    @property
    def points_out(self) -> int:
        """Number of points kept."""
        return sum(int(tally.counts[Reason.KEPT]) for tally in self.topics.values())

    def amounts(self) -> str:
        """Return frames and the share of the points that were kept."""
        return f"{count(self.frames, 'frame')}, {share(self.points_out, self.points_in)} of the points kept"

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as JSON-compatible data."""
        return {
            "recording": self.recording,
            "status": self.status,
            "output": None if self.error else str(self.output),
            "error": self.error,
            "damage": [str(item) for item in self.damage],
            "seconds": round(self.seconds, 3),
            "topics": {
                topic: _as_dict(tally, self.edges, has_water=self.has_water) for topic, tally in self.topics.items()
            },
        }

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        pace = f" ({self.frames / self.seconds:.0f} frames/s)" if self.frames and not self.skipped else ""
        last = self.figures() if self.skipped else f"{count(self.frames, 'frame')} in {self.seconds:.1f} s{pace}"
        topics = [_as_text(topic, tally, self.edges, has_water=self.has_water) for topic, tally in self.topics.items()]
        return "\n".join((printable(f"{self.recording} -> {self.output}"), *topics, last))


def _as_dict(tally: TopicTally, edges: Sequence[float], *, has_water: bool) -> dict[str, Any]:
    water = tally.mean_water
    reasons = [reason for reason in Reason if reason != Reason.UNCONFIRMED or has_water]
    return {
        "frames": tally.frames,
        "points_in": tally.points_in,
        "points_out": int(tally.counts[Reason.KEPT]),
        **{reason.name.lower(): int(tally.counts[reason]) for reason in reasons if reason},
        **({"water_frames": tally.water_frames} if has_water else {}),
        **({"water": {name: round(value, 4) for name, value in asdict(water).items()}} if water else {}),
        "rings": _rings(tally, edges),
        **({"beyond": _beyond(tally, edges)} if tally.rings else {}),
        **({"scenes": dict(sorted(tally.scenes.items()))} if tally.scenes else {}),
        "filter_ms": round(1000 * tally.filter_s / max(tally.frames, 1), 3),
    }


def _rings(tally: TopicTally, edges: Sequence[float]) -> list[dict[str, float]]:
    """Return a row for each range ring; thresholds are means over the frames."""
    if tally.rings is None:
        return []
    columns = zip(
        edges[:-1],
        edges[1:],
        tally.rings.points.tolist(),
        tally.rings.low_intensity.tolist(),
        tally.rings.outliers.tolist(),
        (tally.rings.thresholds / tally.frames).round(6).tolist(),
        strict=True,
    )
    names = ("start_m", "end_m", "points", "low_intensity", "outliers", "mean_threshold")
    return [dict(zip(names, row, strict=True)) for row in columns]


def _beyond(tally: TopicTally, edges: Sequence[float]) -> dict[str, float]:
    """Return counts of the points beyond the range rings."""
    points, kept = tally.rings.beyond.tolist() if tally.rings else (0, 0)
    return {"start_m": edges[-1], "points": points, "kept": kept}


def _as_text(topic: str, tally: TopicTally, edges: Sequence[float], *, has_water: bool) -> str:
    kept = int(tally.counts[Reason.KEPT])
    size = tally.points_in
    frames = count(tally.frames, "frame")
    blocks = [f"{printable(topic)}: {frames}, {count(size, 'point')} in, {kept:,} out ({share(kept, size)})"]
    names = reason_names(edges)
    removed = [(names[r], int(tally.counts[r])) for r in Reason if r and tally.counts[r]]
    if removed:
        rows = [(name, f"{points:,}", share(points, size)) for name, points in removed]
        blocks.append(table(("reason", "removed", "share"), rows))
    if tally.counts[Reason.NEAR] > _MOST * size:
        blocks.append("Most points are nearer; if own ship ends sooner, lower filter.start_m.")
    if tally.rings is not None:
        head = ("range ring", "points", "low intensity", "outliers", "kept", "mean threshold")
        blocks.append(table(head, [*map(_ring_row, _rings(tally, edges)), _beyond_row(_beyond(tally, edges))]))
    if has_water:
        blocks.append(_water_text(tally))
    if tally.scenes:
        scenes = (f"{printable(name)} {number:,}" for name, number in tally.scenes.items())
        blocks.append(f"frames by scene: {', '.join(scenes)}")
    return indented("\n".join(blocks))


def _water_text(tally: TopicTally) -> str:
    water, without = tally.mean_water, tally.frames - tally.water_frames
    if water is None:
        return "no water seen"
    height = f"significant wave height {water.significant_wave_height_m:.2f} m"
    missing = f"; none in {count(without, 'frame')}" if without else ""
    return f"water {-water.level_m:.2f} m below the lidar, {height} (means){missing}"


def _beyond_row(beyond: Mapping[str, float]) -> tuple[str, ...]:
    return (
        f"{beyond['start_m']:g} m on",
        f"{beyond['points']:,}",
        "-",
        "-",
        share(beyond["kept"], beyond["points"]),
        "-",
    )


def _ring_row(ring: Mapping[str, float]) -> tuple[str, ...]:
    kept = ring["points"] - ring["low_intensity"] - ring["outliers"]
    counts = (f"{ring[name]:,}" for name in ("points", "low_intensity", "outliers"))
    span = f"{ring['start_m']:g} to {ring['end_m']:g} m"
    return (span, *counts, share(kept, ring["points"]), f"{ring['mean_threshold']:.2f}")


class FilterSummary(LogSummary[FilterOutcome]):
    """Outcomes of filtering several recordings."""

    def totals(self) -> str:
        """Return how the recordings ended, sizes, and pace."""
        read = sum(one.bytes_in for one in self.outcomes)
        return super().totals() + (f"; {data_size(read / self.seconds * 60)}/min" if self.seconds else "")
