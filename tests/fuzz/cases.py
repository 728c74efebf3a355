"""Every failure that a campaign ever found, as a builder of a small input: files and the command line that failed."""

import sqlite3
import struct
from functools import partial
from random import Random

from tests.fuzz import layers, seeds
from tests.fuzz.formats import FORMATS
from tests.scenes.onnx_files import model_bytes


def metadata_that_is_not_text():
    """Return a classifier whose metadata are not UTF-8; reading them raised UnicodeDecodeError."""
    files = seeds.tree(seeds.classifier)
    files["model.onnx"] = model_bytes().replace(b"seaclutter.extent_m", b"seaclutter.extent\xff\xff")
    return files, FORMATS["model onnx"].commands[0]


def description_that_is_not_ascii():
    """Return a tile with a record whose description is not ASCII, as in some real ones; it could not be copied."""
    files = seeds.tree(seeds.tile)
    assert files["tile.las"].count(b"one key, and room") == 1
    files["tile.las"] = files["tile.las"].replace(b"one key, and room", b"ein Schl\xfcssel und")
    return files, FORMATS["tile las"].commands[0]


def scattered_points():
    """Return a small tile whose points lie far apart; each cost a block of the grid, in total 2 GB."""
    files = seeds.tree(seeds.tile)
    data = bytearray(files["tile.las"])
    start, size = struct.unpack_from("<I", data, 96)[0], struct.unpack_from("<H", data, 105)[0]
    for number in range(400):
        struct.pack_into("<ii", data, start + number * size, number % 20 * 300_000, number // 20 * 300_000)
    files["tile.las"] = bytes(data)
    return files, FORMATS["tile las"].commands[0]


def a_frame_without_labels():
    """Return a log of which one frame has no labels; the error did not name the log."""
    files = seeds.tree(partial(seeds.labelled, form="cloud"))
    renamed = partial(layers.mcap_message, random=Random(1), change=lambda data: data.replace(b"label", b"labex"))
    files["log.mcap"] = renamed(files["log.mcap"])
    return files, FORMATS["labels in cloud"].commands[0]


def coordinates_beyond_all_scales():
    """Return a tile whose scale is damaged; squares of its coordinates overflowed in the search for neighbours."""
    files = seeds.tree(seeds.labelled_tiles)
    data = bytearray(files["tile.las"])
    struct.pack_into("<d", data, 131, 1e200)
    files["tile.las"] = bytes(data)
    return files, FORMATS["training tile"].commands[0]


def a_tree_without_an_attribute():
    """Return a model in which a tree lacks an attribute; it was noticed only by the first prediction."""
    files = seeds.tree(seeds.forest)

    def rename_last(schema):
        at = schema.rindex(b'"n_outputs_"')
        return schema[:at] + b'"n_outputs!"' + schema[at + 12 :]

    random = Random(1)  # chooses the schema
    files["model.skops"] = layers.member(files["model.skops"], random, rename_last)
    return files, FORMATS["model skops"].commands[0]


def an_endless_ship():
    """Return a scene of a tile with a ship of 2 million kilometres, whose simulation did not end."""
    text = seeds.TILE_SCENE.replace("size_m: [16, 4.5, 6]", "size_m: [16, 4.5, 2147483647]")
    return seeds.tree(partial(seeds.scene, text=text)), FORMATS["tile scene"].commands[0]


def a_topic_without_a_name():
    """Return a recording whose topic has an empty name; readers refused the bag that it was converted to."""
    files = seeds.tree(seeds.rosbag2)
    (name,) = (name for name in files if name.endswith(".db3"))
    database = sqlite3.connect(":memory:")
    database.deserialize(files[name])
    database.execute("UPDATE topics SET name = ''")
    database.commit()
    files[name] = database.serialize()
    form = FORMATS["rosbag2 db3"]
    return files, next(command for command in form.commands if ".bag" in command and "convert" in command)


CASES = {
    "metadata of a model that are not text": (metadata_that_is_not_text, 1, "its metadata are not valid text"),
    "a description that is not ASCII": (description_that_is_not_ascii, 0, ""),
    "coordinates beyond all scales": (coordinates_beyond_all_scales, 1, "no points with finite coordinates"),
    "a tree without an attribute": (a_tree_without_an_attribute, 1, "not a seaclutter model"),
    "a frame without labels": (a_frame_without_labels, 1, "log.mcap: frame "),
    "a topic without a name": (a_topic_without_a_name, 0, ""),
    "an endless ship": (an_endless_ship, 2, "size_m"),
    "scattered points": (scattered_points, 1, "are scattered over more than"),
}
"""Builder, exit status, and words of the error."""
