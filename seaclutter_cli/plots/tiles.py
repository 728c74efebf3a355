"""Top views and maps of tiles and surveys, and confusion matrices of classifiers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.arrays import Floats, Ints, Mask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLORS: Mapping[str, str] = {
    "ship": "#0072B2",
    "reef": "#8C510A",
    "shoal": "#E69F00",
    "aquaculture": "#D55E00",
    "seaweed": "#009E73",
    "island": "#4D4D4D",
    "fishing fence": "#CC79A7",
    "garbage patch": "#000000",
}
"""Colours of the classes, most of them distinguishable by colour-blind readers; boxes are also labelled."""

LEFT_OUT = "left out"
"""Name of the points, drawn in grey, of clusters that are too uncertain to be objects."""

_MAX_SEA_POINTS = 40_000
Box = tuple[str, Floats]
LAND, _OBJECT, _SHORE = "#D9CBA3", "#D55E00", "#3B2F1E"
_NARROWEST_M = 0.1


def draw_tile(figure: "Figure", sea: Floats, points: Mapping[str, Floats], boxes: Sequence[Box]) -> None:
    """Draw a tile in top view, points coloured by class and objects in boxes ([Shi2022], Fig. 3).

    A subset of the sea, shape (2, N), is drawn; the points, shape (2, M) each, have the name of their class or
    `LEFT_OUT`.
    """
    axes = figure.add_subplot()
    corner = np.concatenate((sea, *points.values()), axis=1).min(axis=1, initial=np.inf)
    some = sea[:, :: max(1, sea.shape[1] // _MAX_SEA_POINTS)] - corner[:, None]
    axes.scatter(some[0], some[1], s=0.2, color="#C6DBEF", linewidths=0, rasterized=True)
    for name, positions in points.items():
        color = "#969696" if name == LEFT_OUT else COLORS.get(name, "red")
        x, y = positions - corner[:, None]
        axes.scatter(x, y, s=0.5, color=color, linewidths=0, rasterized=True)
        axes.scatter([], [], s=10, color=color, label=name)
    for name, corners in boxes:
        color, ring = COLORS.get(name, "red"), corners - corner
        axes.plot(*np.vstack((ring, ring[:1])).T, color=color, linewidth=0.4)
        top = ring[:, 0].mean(), ring[:, 1].max()
        axes.annotate(name, top, (0, 1.5), textcoords="offset points", fontsize=5, ha="center", color=color)
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    if points:
        figure.legend(loc="outside upper center", ncols=min(4, len(points)), handletextpad=0.2, columnspacing=1.0)


def draw_confusion(figure: "Figure", names: Sequence[str], matrix: Ints) -> None:
    """Draw a confusion matrix, true class by predicted class, with the shares of each row in percent."""
    axes = figure.add_subplot()
    share = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    image = axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    for row, column in np.ndindex(*matrix.shape):
        if matrix[row, column]:
            color = "white" if share[row, column] > 0.6 else "black"
            text = f"{100 * share[row, column]:.0f}" if share[row, column] >= 0.005 else "<1"
            axes.text(column, row, text, ha="center", va="center", fontsize=6, color=color)
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="Predicted class", ylabel="True class")
    figure.colorbar(image, ax=axes, label="Share of the true class (%)", format=lambda value, _: f"{100 * value:.0f}")


@dataclass(frozen=True)
class MapPart:
    """Part of a map from one corner to the other, with I columns from west to east and J rows from south to north.

    The elevation of the water, shape (I, J), is NaN elsewhere; shorelines have shape (N, 2). All are in metres.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    level_m: NDArray[np.float32]
    is_land: Mask
    is_object: Mask
    shoreline: Sequence[Floats]


def aspect_of(parts: Sequence[MapPart]) -> float:
    """Return the ratio of height to width of a figure with a map and its legends."""
    low, high = _corners(parts)
    width, height = high - low
    return float(np.clip(0.28 + 0.67 * height / max(width, 1e-9), 0.55, 1.6))


def _corners(parts: Sequence[MapPart]) -> tuple[Floats, Floats]:
    return np.min([part.low for part in parts], axis=0), np.max([part.high for part in parts], axis=0)


def draw_map(figure: "Figure", parts: Sequence[MapPart], title: str) -> None:
    """Draw the map of a tile, or of the tiles of a survey, in top view; its title is a line about the waves."""
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
        for mask, color in ((part.is_land, LAND), (part.is_object, _OBJECT)):
            shown = np.where(mask, 1.0, np.nan)
            axes.imshow(shown.T, cmap=ListedColormap([color]), vmin=0, vmax=1, **place)
        for line in part.shoreline:
            axes.plot(*(line - low).T, color=_SHORE, linewidth=0.6)
    axes.set(xlim=(0, high[0] - low[0]), ylim=(0, high[1] - low[1]), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.set_title(title, fontsize=7)
    if image is not None and len(known):
        figure.colorbar(image, ax=axes, label="Elevation of the water (m)", shrink=0.8, aspect=30)
    handles: list[Patch | Line2D] = []
    if any(part.is_land.any() for part in parts):
        handles.append(Patch(color=LAND, label="Land"))
    if any(part.is_object.any() for part in parts):
        handles.append(Patch(color=_OBJECT, label="Objects"))
    if any(part.shoreline for part in parts):
        handles.append(Line2D([], [], color=_SHORE, linewidth=0.6, label="Shoreline"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=3, handlelength=1.2)
