"""Maps of separated tiles and surveys: water with its level and waves, land, objects, shoreline."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LAND, OBJECT, SHORE = "#D9CBA3", "#D55E00", "#3B2F1E"
_NARROWEST_M = 0.1


@dataclass(frozen=True)
class MapPart:
    """Part of a map.

    Parameters
    ----------
    low, high : (float, float)
        Its corners in metres.
    level_m : ndarray, shape (I, J), float32
        Elevation of the water; NaN elsewhere.
    is_land, is_object : ndarray, shape (I, J), bool
        What is land, and what is an object.
    shoreline : sequence of ndarray, shape (N, 2), float64
        Lines between water and land in metres.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    level_m: NDArray[np.float32]
    is_land: NDArray[np.bool_]
    is_object: NDArray[np.bool_]
    shoreline: Sequence[NDArray[np.float64]]


def aspect_of(parts: Sequence[MapPart]) -> float:
    """Return the ratio of height to width of a figure with a map and its legends."""
    low, high = _corners(parts)
    width, height = high - low
    return float(np.clip(0.28 + 0.67 * height / max(width, 1e-9), 0.55, 1.6))


def _corners(parts: Sequence[MapPart]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.min([part.low for part in parts], axis=0), np.max([part.high for part in parts], axis=0)


def draw_map(figure: "Figure", parts: Sequence[MapPart], title: str) -> None:
    """Draw the map of a tile, or of the tiles of a survey, in top view.

    Parameters
    ----------
    figure : Figure
        Empty figure.
    parts : sequence of MapPart
        The tiles.
    title : str
        Line about the waves.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes = figure.add_subplot()
    low, high = _corners(parts)
    known = np.concatenate([part.level_m[np.isfinite(part.level_m)] for part in parts])
    bounds = np.quantile(known, (0.01, 0.99)) if len(known) else np.zeros(2)
    middle, half = bounds.mean(), max(float(np.ptp(bounds)), _NARROWEST_M) / 2
    colors = ListedColormap(colormaps["GnBu_r"](np.linspace(0, 0.75, 256)))  # beyond, it is as white as no data
    image = None
    for part in parts:
        (west, south), (east, north) = np.array(part.low) - low, np.array(part.high) - low
        place: Any = {"extent": (west, east, south, north), "origin": "lower", "interpolation": "nearest"}
        image = axes.imshow(part.level_m.T, cmap=colors, vmin=middle - half, vmax=middle + half, **place)
        for mask, color in ((part.is_land, LAND), (part.is_object, OBJECT)):
            shown = np.where(mask, 1.0, np.nan)
            axes.imshow(shown.T, cmap=ListedColormap([color]), vmin=0, vmax=1, **place)
        for line in part.shoreline:
            axes.plot(*(line - low).T, color=SHORE, linewidth=0.6)
    axes.set_xlim(0, high[0] - low[0])
    axes.set_ylim(0, high[1] - low[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title, fontsize=7)
    if image is not None and len(known):
        figure.colorbar(image, ax=axes, label="Elevation of the water (m)", shrink=0.8, aspect=30)
    handles: list[Patch | Line2D] = []
    if any(part.is_land.any() for part in parts):
        handles.append(Patch(color=LAND, label="Land"))
    if any(part.is_object.any() for part in parts):
        handles.append(Patch(color=OBJECT, label="Objects"))
    if any(part.shoreline for part in parts):
        handles.append(Line2D([], [], color=SHORE, linewidth=0.6, label="Shoreline"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.2)
