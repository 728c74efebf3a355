"""Small ONNX files, written byte by byte from the published format, without the package ``onnx``."""

import json
import struct

FLOAT, UINT8, INT64, BOOL = 1, 2, 7, 9
CLASSES = ("open", "confined")


def _varint(value):
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _number(field, value):
    return _varint(field << 3) + _varint(value)


def _part(field, data):
    data = data.encode() if isinstance(data, str) else data
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _value(name, kind, shape):
    dims = b"".join(_part(1, _part(2, size) if isinstance(size, str) else _number(1, size)) for size in shape)
    return _part(1, name) + _part(2, _part(1, _number(1, kind) + _part(2, dims)))


def _weights(name, shape, values):
    dims = b"".join(_number(1, size) for size in shape)
    return dims + _number(2, FLOAT) + _part(8, name) + _part(9, struct.pack(f"<{len(values)}f", *values))


def _node(kind, inputs, output, **attributes):
    parts = [_part(1, name) for name in inputs] + [_part(2, output), _part(4, kind)]
    parts += [_part(5, _part(1, name) + _number(3, value) + _number(20, 2)) for name, value in attributes.items()]
    return b"".join(parts)


def _endless(before, after):
    """Return a node that repeats doing nothing as long as a constant is true, and the constant."""
    body = b"".join(
        (
            *(_part(1, _node("Identity", [f"{name} in"], name)) for name in ("go on", "value")),
            _part(2, "body"),
            *(
                _part(11, _value(name, kind, shape))
                for name, kind, shape in (("number", INT64, ()), ("go on in", BOOL, ()), ("value in", FLOAT, "abcd"))
            ),
            *(
                _part(12, _value(name, kind, shape))
                for name, kind, shape in (("go on", BOOL, ()), ("value", FLOAT, "abcd"))
            ),
        )
    )
    node = _node("Loop", ["", "yes", before], after) + _part(5, _part(1, "body") + _part(6, body) + _number(20, 5))
    return node, _number(2, BOOL) + _part(8, "yes") + _part(9, b"\1")


def model_bytes(
    classes=CLASSES,
    extent_m=60.0,
    *,
    shape=("N", 1, 224, 224),
    kind=UINT8,
    outputs=2,
    last="Softmax",
    metadata=None,
    threshold=0.02,
    endless=False,
    huge=False,
):
    """Return a classifier that predicts the second class if more than ``threshold`` of the cells contain a point.

    The other keywords make a file that is not a scene classifier: input, number of outputs, last layer, metadata.
    """
    scale = [-500.0, 500.0, *([0.0] * outputs)][:outputs]
    bias = [500.0 * threshold, -500.0 * threshold, *([0.0] * outputs)][:outputs]
    loop, yes = _endless("share", "looped")
    size = _number(1, 4) + _number(2, INT64) + _part(8, "size") + _part(9, struct.pack("<4q", 1, 1, 16384, 16384))
    nodes = [
        _node("Cast", ["image"], "maps", to=FLOAT),
        _node("GlobalAveragePool", ["maps"], "share"),
        *([loop] if endless else []),
        *([_node("Expand", ["share", "size"], "huge"), _node("GlobalAveragePool", ["huge"], "again")] if huge else []),
        _node("Flatten", ["looped" if endless else "again" if huge else "share"], "flat"),
        _node("Gemm", ["flat", "scale", "bias"], "scores"),
        _node(last, ["scores"], "probability", **({"axis": 1} if last == "Softmax" else {})),
    ]
    graph = b"".join(
        (
            *(_part(1, node) for node in nodes),
            _part(2, "by hand"),
            _part(5, _weights("scale", (1, outputs), scale)),
            _part(5, _weights("bias", (outputs,), bias)),
            *([_part(5, yes)] if endless else []),
            *([_part(5, size)] if huge else []),
            _part(11, _value("image", kind, shape)),
            _part(12, _value("probability", FLOAT, ("N", outputs))),
        )
    )
    if metadata is None:
        metadata = {"seaclutter.classes": json.dumps(classes), "seaclutter.extent_m": str(extent_m)}
    properties = b"".join(_part(14, _part(1, key) + _part(2, value)) for key, value in metadata.items())
    return _number(1, 8) + _part(7, graph) + _part(8, _part(1, "") + _number(2, 17)) + properties
