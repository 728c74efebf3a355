"""Share of points whose class differs where a tile is cut into quarters, which are separated as one survey.

Run as ``python benchmarks/seams.py FOLDER SEED [TILE]...``. Simulated tiles ``mixed`` of three seas, and tiles (LAS or
LAZ), are written to FOLDER and separated as a whole, in quarters without a margin from the neighbours, and in quarters
with the margin of 100 m. The table goes to standard output.
"""

import sys
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray
from seas import SEAS, with_sea

from seaclutter_cli.runs.classify.separate import separate_tiles
from seaclutter_cli.simulation.airborne.recording import record_tile
from seaclutter_cli.simulation.airborne.scene import load_tile_scene

CHOSEN = ("calm", "wind sea 1.1 m", "both: 1.0 and 1.1 m")
MARGINS_M = (0.0, 100.0)


def quarters(tile: Path, folder: Path) -> dict[str, NDArray[np.bool_]]:
    """Write the quarters of a tile to a folder; return by name which points are in them."""
    las = laspy.read(tile)
    middle = (las.header.mins + las.header.maxs) / 2
    east, north = np.asarray(las.x) >= middle[0], np.asarray(las.y) >= middle[1]
    folder.mkdir(exist_ok=True)
    inside = {f"{i}{j}.laz": (east == i) & (north == j) for i, j in np.ndindex(2, 2)}
    for name, own in inside.items():
        part = laspy.LasData(las.header, las.points[own])
        part.write(folder / name)
    return inside


def classes(path: Path) -> NDArray[Any]:
    return np.asarray(laspy.read(path).classification)


def differing(tile: Path, folder: Path) -> list[float]:
    """Return the share of points whose class differs from that in the whole tile, for each margin."""
    whole = folder / f"{tile.stem}-whole.laz"
    separate_tiles(tile, whole, force=True)
    expected = classes(whole)
    inside = quarters(tile, folder / tile.stem)
    shares = []
    for margin_m in MARGINS_M:
        output = folder / f"{tile.stem}-{margin_m:g}"
        separate_tiles(folder / tile.stem, f"{output}/", margin_m=margin_m, force=True)
        found = np.zeros_like(expected)
        for name, own in inside.items():
            found[own] = classes(output / name)
        shares.append(float((found != expected).mean()))
    return shares


def main() -> None:
    folder, seed, others = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]
    folder.mkdir(parents=True, exist_ok=True)
    tiles = {}
    for number, sea in enumerate(CHOSEN):
        tiles[sea] = folder / f"sea{number}.laz"
        record_tile(with_sea(load_tile_scene("mixed").with_tile(seed=seed), SEAS[sea]), tiles[sea])
    tiles |= {Path(path).name: Path(path) for path in others}
    print("| tile | without margin | with 100 m |\n| --- | ---: | ---: |")
    for name, tile in tiles.items():
        print(f"| {name} |", " | ".join(f"{100 * share:.3f} %" for share in differing(tile, folder)), "|", flush=True)


if __name__ == "__main__":
    main()
