"""Cells of land of a tile, for maps."""

import bz2
import json
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from seaclutter_cli.arrays import Floats, Mask
from seaclutter_cli.documents import load_json
from seaclutter_cli.grids.elevation import BLOCK

_BLOCK_BYTES = BLOCK * BLOCK // 8


@dataclass(frozen=True)
class LandCells:
    """Cells of the grid that are land or a ditch. Points there that are not water belong to the land, not to objects.

    ``cell_m``: width of a cell; ``blocks``, shape (256, 256): the cells, in the blocks that contain any.
    """

    cell_m: float = 1.0
    blocks: Mapping[tuple[int, int], Mask] = field(default_factory=dict)

    def contain(self, xy: Floats) -> Mask:
        """Return whether positions in metres, shape (2, N), are on land."""
        column, row = np.floor(xy / self.cell_m).astype(np.int64)
        found = np.zeros(xy.shape[1], np.bool_)
        for block, land in self.blocks.items():
            inside = np.flatnonzero((column // BLOCK == block[0]) & (row // BLOCK == block[1]))
            found[inside] = land[column[inside] % BLOCK, row[inside] % BLOCK]
        return found

    def as_text(self) -> str:
        """Return the cells as JSON."""
        bits = b"".join(np.packbits(land).tobytes() for land in self.blocks.values())
        # bzip2 gives the same bytes in every version, deflate does not
        packed = b64encode(bz2.compress(bits)).decode() if bits else ""
        return json.dumps({"cell_m": self.cell_m, "blocks": [list(map(int, at)) for at in self.blocks], "land": packed})

    @classmethod
    def from_text(cls, text: str) -> "LandCells":
        """Return the cells that `as_text` described; raise `ValueError` if the text is damaged."""
        try:
            stored: Any = load_json(text)
            cell_m, places = float(stored["cell_m"]), [(int(i), int(j)) for i, j in stored["blocks"]]
            bits = b""
            if places:
                size = len(places) * _BLOCK_BYTES
                bits = bz2.BZ2Decompressor().decompress(b64decode(stored["land"]), size + 1)
            land = np.unpackbits(np.frombuffer(bits, np.uint8)).reshape(len(places), BLOCK, BLOCK).astype(np.bool_)
        except (KeyError, TypeError, ValueError, OSError, EOFError) as error:
            raise ValueError(f"damaged record of the land ({error!r})") from error
        return cls(cell_m, dict(zip(places, land, strict=True)))
