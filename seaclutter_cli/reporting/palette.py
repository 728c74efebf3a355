"""Colours of reports, told apart by colour-blind readers and seen on white; checked in the tests."""

from collections.abc import Mapping

from seaclutter_cli.frame import Reason

REASONS: Mapping[Reason, str] = {
    Reason.KEPT: "#14213d",
    Reason.LOW_INTENSITY: "#3f95e8",
    Reason.OUTLIER: "#d1661a",
    Reason.NEAR: "#8b8f94",
    Reason.FAR: "#0b6b50",
    Reason.EXCLUDED: "#8a2bb0",
    Reason.INVALID: "#e6d07a",
}
"""Colour of each reason, in the order in which tables and legends name them."""

TRUTH = {"unknown": "#8b8f94", "clutter": "#3f95e8", "target": "#14213d", "ignored": "#9a7400"}
"""Colours of what points truly are."""

STATES = {"fine": "#d5dde3", "found": "#0b6b50", "false alarm": "#c2410c", "omitted alarm": "#1d4ed8"}
"""Colours of frames in the timeline of alarms, and of the boxes that caused them."""

LINES = ("#14213d", "#d1661a", "#0b6b50", "#8a2bb0", "#2f7fd0", "#8a6d00")
"""Colours of curves that are told apart by dashes as well; more of them share a ramp."""

RAMP = ("#14213d", "#1d5f9e", "#3f95e8")
"""Ends and middle of the ramp for many rings, from the nearest to the farthest."""

INK = {
    "ink": "#16202b",
    "muted": "#52606d",
    "paper": "#ffffff",
    "wash": "#f3f6f8",
    "line": "#d5dde3",
    "link": "#0b57a4",
    "bad": "#9f2f08",
}
"""Colours of the page itself."""
