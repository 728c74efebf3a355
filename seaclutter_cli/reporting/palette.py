"""Colours and names in reports; colours are distinguishable by colour-blind readers, as checked in the tests."""

from collections.abc import Mapping, Sequence

from seaclutter_cli.frame import Reason

_REASONS = {
    Reason.KEPT: ("#14213d", "kept"),
    Reason.LOW_INTENSITY: ("#3f95e8", "low intensity"),
    Reason.OUTLIER: ("#d1661a", "outlier"),
    Reason.NEAR: ("#8b8f94", "nearer than start_m"),
    Reason.FAR: ("#0b6b50", "far (beyond end_m)"),
    Reason.EXCLUDED: ("#8a2bb0", "excluded (own structure)"),
    Reason.INVALID: ("#e6d07a", "invalid"),
    Reason.UNCONFIRMED: ("#870f1e", "unconfirmed"),
    Reason.MIRRORED: ("#876996", "mirrored below the water"),
}
REASONS: Mapping[Reason, str] = {reason: color for reason, (color, _) in _REASONS.items()}
"""Colour of each reason, in the order of tables and legends."""
REASON_NAMES: Mapping[Reason, str] = {reason: name for reason, (_, name) in _REASONS.items()}
"""Name of each reason in figures."""


def reason_names(edges: Sequence[float]) -> dict[Reason, str]:
    """Return the name of each reason for a method with these edges of range rings; empty if it has none."""
    if not len(edges):
        return dict(REASON_NAMES)
    near = f"nearer than {edges[0]:g} m" if edges[0] else "own ship"
    near, far = f"{near} (filter.start_m)", f"from {edges[-1]:g} m on (filter.end_m)"
    return {**REASON_NAMES, Reason.NEAR: near, Reason.FAR: far}


TRUTH = {"unknown": "#8b8f94", "clutter": "#3f95e8", "target": "#14213d", "ignored": "#9a7400"}
"""Colours of points by ground truth."""

STATES = {"correct": "#d5dde3", "detected": "#0b6b50", "false alarm": "#c2410c", "missed target": "#1d4ed8"}
"""Colours of frames in the timeline, and of boxes and clusters."""

LINES = ("#14213d", "#d1661a", "#0b6b50", "#8a2bb0", "#2f7fd0", "#8a6d00")
"""Colours of up to six curves, which also differ in their dashes; more curves use `RAMP`."""

RAMP = ("#14213d", "#1d5f9e", "#3f95e8")
"""Start, middle and end of the colour ramp for many range rings, from the nearest to the farthest."""

HEIGHTS = {0.0: "#3f95e8", 0.5: "#b45a9a", 1.0: "#b3203f", 2.0: "#6e0f14", 3.0: "#1c0608"}
"""Colours of points by their height above the water in metres; between these heights they are mixed."""

INK = {
    "ink": "#16202b",
    "muted": "#52606d",
    "paper": "#ffffff",
    "wash": "#f3f6f8",
    "line": "#d5dde3",
    "link": "#0b57a4",
    "bad": "#9f2f08",
}
"""Colours of text, background and lines of the page."""
