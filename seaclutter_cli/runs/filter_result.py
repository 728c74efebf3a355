"""Results of filtering, as text and as data."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from seaclutter_cli.frame import Reason, Rings
from seaclutter_cli.pipeline import TopicTally
from seaclutter_cli.reporting.palette import reason_names
from seaclutter_cli.runs.log_work import LogOutcome, LogSummary
from seaclutter_cli.text import count, data_size, indented, printable, share, table

_MOST = 0.5


@dataclass(kw_only=True)
class FilterOutcome(LogOutcome):
    """Outcome of filtering one recording.

    ``edges`` are those of the range rings of the method in metres, if it has any; ``has_water`` is whether it estimates
    the water; ``rows`` are those of the table of frames, compressed, unless they are written as they come.
    """

    data = f"{LogOutcome.data} topics=sums"

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

    @property
    def sums(self) -> dict[str, dict[str, Any]]:
        """Sums of each topic as JSON-compatible data."""
        return {topic: self._sums(tally) for topic, tally in self.topics.items()}

    def as_text(self) -> str:
        """Return the outcome as human-readable text."""
        pace = f" ({self.frames / self.seconds:.0f} frames/s)" if self.frames and not self.skipped else ""
        last = self.figures() if self.skipped else f"{count(self.frames, 'frame')} in {self.seconds:.1f} s{pace}"
        topics = [self._topic_text(topic, tally) for topic, tally in self.topics.items()]
        return "\n".join((printable(f"{self.recording} -> {self.output}"), *topics, last))

    def _sums(self, tally: TopicTally) -> dict[str, Any]:
        """Return the sums of a topic as JSON-compatible data; thresholds of range rings are means over the frames."""
        water, rings = tally.mean_water, tally.rings
        reasons = [reason for reason in Reason if reason and (reason != Reason.UNCONFIRMED or self.has_water)]
        points, kept = rings.beyond.tolist() if rings else (0, 0)
        return {
            "frames": tally.frames,
            "points_in": tally.points_in,
            "points_out": int(tally.counts[Reason.KEPT]),
            **{reason.name.lower(): int(tally.counts[reason]) for reason in reasons},
            **({"water_frames": tally.water_frames} if self.has_water else {}),
            **({"water": {name: round(value, 4) for name, value in asdict(water).items()}} if water else {}),
            "rings": self._rings(rings, tally.frames) if rings else [],
            **({"beyond": {"start_m": self.edges[-1], "points": points, "kept": kept}} if rings else {}),
            **({"scenes": dict(sorted(tally.scenes.items()))} if tally.scenes else {}),
            "filter_ms": round(1000 * tally.filter_s / max(tally.frames, 1), 3),
        }

    def _rings(self, rings: Rings, frames: int) -> list[dict[str, float]]:
        counts = {name: getattr(rings, name).tolist() for name in ("points", "low_intensity", "outliers")}
        thresholds = (rings.thresholds / frames).round(6).tolist()
        columns = {"start_m": self.edges[:-1], "end_m": self.edges[1:], **counts, "mean_threshold": thresholds}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    def _topic_text(self, topic: str, tally: TopicTally) -> str:
        sums, names, size = self._sums(tally), reason_names(self.edges), tally.points_in
        kept = f"{sums['points_out']:,} out ({share(sums['points_out'], size)})"
        blocks = [f"{printable(topic)}: {count(tally.frames, 'frame')}, {count(size, 'point')} in, {kept}"]
        removed = {reason: int(tally.counts[reason]) for reason in Reason if reason and tally.counts[reason]}
        if removed:
            rows = [(names[reason], f"{points:,}", share(points, size)) for reason, points in removed.items()]
            blocks.append(table(("reason", "removed", "share"), rows))
        if tally.counts[Reason.NEAR] > _MOST * size:
            blocks.append("Most points are nearer; if own ship ends sooner, lower filter.start_m.")
        if sums["rings"]:
            blocks.append(_ring_table(sums["rings"], sums["beyond"]))
        if self.has_water:
            blocks.append(_water_text(tally))
        if tally.scenes:
            scenes = (f"{printable(name)} {number:,}" for name, number in tally.scenes.items())
            blocks.append(f"frames by scene: {', '.join(scenes)}")
        return indented("\n".join(blocks))


def _ring_table(rings: Sequence[Mapping[str, float]], beyond: Mapping[str, float]) -> str:
    rows = []
    for ring in rings:
        points, low, outliers = (ring[name] for name in ("points", "low_intensity", "outliers"))
        span, kept = f"{ring['start_m']:g} to {ring['end_m']:g} m", share(points - low - outliers, points)
        rows.append((span, f"{points:,}", f"{low:,}", f"{outliers:,}", kept, f"{ring['mean_threshold']:.2f}"))
    start, points = f"{beyond['start_m']:g} m on", beyond["points"]
    rows.append((start, f"{points:,}", "-", "-", share(beyond["kept"], points), "-"))
    return table(("range ring", "points", "low intensity", "outliers", "kept", "mean threshold"), rows)


def _water_text(tally: TopicTally) -> str:
    water, without = tally.mean_water, tally.frames - tally.water_frames
    if water is None:
        return "no water seen"
    height = f"significant wave height {water.significant_wave_height_m:.2f} m"
    missing = f"; none in {count(without, 'frame')}" if without else ""
    return f"water {-water.level_m:.2f} m below the lidar, {height} (means){missing}"


class FilterSummary(LogSummary[FilterOutcome]):
    """Outcomes of filtering several recordings."""

    def totals(self) -> str:
        """Return how the recordings ended, sizes, and pace."""
        read = sum(one.bytes_in for one in self.outcomes)
        return super().totals() + (f"; {data_size(read / self.seconds * 60)}/min" if self.seconds else "")
