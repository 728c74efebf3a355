"""Own ship's structure: the directions that a mask covers, and where it lies around the lidar."""

from typing import TYPE_CHECKING

import numpy as np

from seaclutter_cli.structure.mask import StructureMask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLORS = "viridis_r"


def draw_mask(figure: "Figure", *, mask: StructureMask, reach_m: float) -> None:
    """Draw a mask, searched up to a range, by azimuth and elevation and, below it, from above with the bow up."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle, Wedge

    upper, lower = figure.subplots(2, 1, height_ratios=(1, 1.9))
    sectors = sorted(mask.sectors, key=lambda one: -one.range_min_m)  # near ones lie above
    ranges = np.array([one.range_min_m for one in sectors])
    boxes = [
        Rectangle(
            (-one.azimuth_max_deg, one.elevation_min_deg),
            one.azimuth_max_deg - one.azimuth_min_deg,
            one.elevation_max_deg - one.elevation_min_deg,
        )
        for one in sectors
    ]
    # Turned by 90°, x points up and y to the left, as on a chart with the bow up.
    flat = np.cos(np.radians([(one.elevation_min_deg + one.elevation_max_deg) / 2 for one in sectors]))
    wedges = [
        Wedge(
            (0, 0),
            one.range_max_m * share,
            one.azimuth_min_deg + 90,
            one.azimuth_max_deg + 90,
            width=(one.range_max_m - one.range_min_m) * share,
        )
        for one, share in zip(sectors, flat, strict=True)
    ]
    for axes, patches in ((upper, boxes), (lower, wedges)):
        drawn = PatchCollection(patches, cmap=_COLORS, linewidth=0)
        drawn.set_array(ranges)
        drawn.set_clim(0, reach_m)
        axes.add_collection(drawn)
        axes.spines[["top", "right"]].set_visible(False)
    low = min((one.elevation_min_deg for one in sectors), default=-20.0)
    high = max((one.elevation_max_deg for one in sectors), default=10.0)
    upper.set(xlim=(-180, 180), ylim=(low - 2, high + 2), xlabel="Azimuth (°)", ylabel="Elevation (°)")
    ticks = np.arange(-180, 181, 90)
    upper.set_xticks(ticks, [f"{0 - tick:g}" for tick in ticks])
    far = max((one.range_max_m for one in sectors), default=reach_m) * 1.1
    lower.set(xlim=(-far, far), ylim=(-far, far), xlabel="y to port (m)", ylabel="x forward (m)", aspect="equal")
    lower.xaxis.set_major_formatter(lambda value, _: f"{0 - value:g}")
    lower.plot(0, 0, "+", color="0.2", markersize=8)
    lower.annotate("lidar", (0, 0), xytext=(6, 4), textcoords="offset points", fontsize=6.5)
    if sectors:
        bar = figure.colorbar(drawn, ax=lower, shrink=0.7)
        bar.set_label("Nearest masked range (m)")
    else:
        upper.set_title("No own structure found", fontsize=8)
