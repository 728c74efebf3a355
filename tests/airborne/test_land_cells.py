"""Land cells as text."""

import json

import numpy as np
import pytest

from seaclutter_cli.grids.elevation import LandCells


def test_text_keeps_all_cells():
    rng = np.random.default_rng(1)
    blocks = {(-2, 5): rng.random((256, 256)) < 0.5, (0, 0): np.ones((256, 256), np.bool_)}
    found = LandCells.from_text(LandCells(0.5, blocks).as_text())
    assert found.cell_m == 0.5
    assert list(found.blocks) == list(blocks)
    for at, cells in blocks.items():
        np.testing.assert_array_equal(found.blocks[at], cells)
    assert not LandCells.from_text(LandCells().as_text()).blocks


def changed(**keys):
    text = LandCells(1.0, {(0, 0): np.eye(256, dtype=np.bool_)}).as_text()
    return json.dumps(json.loads(text) | keys)


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", changed(land=""), changed(land="AAAA"), changed(blocks=[[0, 0], [0, 1]]), changed(blocks=[[0]])],
)
def test_damaged_texts_are_errors(text):
    with pytest.raises(ValueError, match="damaged record of the land"):
        LandCells.from_text(text)


def test_no_more_is_decompressed_than_the_blocks_need():
    large = LandCells(1.0, {(i, 0): np.zeros((256, 256), np.bool_) for i in range(1000)}).as_text()
    with pytest.raises(ValueError, match="damaged"):
        LandCells.from_text(json.dumps(json.loads(large) | {"blocks": [[0, 0]]}))
