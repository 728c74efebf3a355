"""Mutations of bytes, texts and documents; each depends on a random generator only."""

import json
import re
from copy import deepcopy

import yaml

FIRST_BYTES = 600
WIDTHS = (1, 2, 4, 8)
MOST_BYTES = 2**20 - 2**16
"""Size of the largest input."""

EVIL_NUMBERS = (
    *(
        "0",
        "-0",
        "-1",
        "1",
        "2",
        "3",
        "255",
        "65536",
        "1e3",
        "1e6",
        "1e9",
        "1e18",
        "1e308",
        "1e-308",
        "1e400",
        "-1e400",
    ),
    *("2147483647", "2147483648", "4294967295", "-2147483649", "9223372036854775807", "18446744073709551616"),
    *("nan", "NaN", ".nan", "inf", "-inf", ".inf", "Infinity", "0x7f", "1_000", "01", "1.", ".", "9" * 400),
)
EVIL_WORDS = (
    *(
        "",
        " ",
        "null",
        "none",
        "true",
        "[]",
        "{}",
        "[",
        "]",
        "{",
        "}",
        '"',
        "'",
        ",",
        ":",
        "\\",
        "\0",
        "\n",
        "\r",
        "\t",
    ),
    *("\x1b[31m", "\u202e", "\ufeff", "\udcff", "é", "x" * 5000, "[" * 3000, "%s", "{0}", "../../x", "/", "C:\\x", "~"),
)
EVIL_VALUES = (
    *(None, True, False, 0, 1, -1, 2, 0.5, 1e-300, 1e9, 1e18, 1e300, 2**31, 2**53, 2**63, -(2**63), 10**30),
    *(float("nan"), float("inf"), float("-inf"), "", "x", "none", "nan", "1", "é\x1b[31m", "x" * 5000),
    *([], {}, [[]], [None], [1, 2], [1] * 3000, {"x": 1}, {"": None}, [[[[[[[]]]]]]]),
)


def flip(data, random, _):
    """Change one to four bits."""
    changed = bytearray(data)
    for _ in range(random.randint(1, 4)):
        changed[_place(data, random)] ^= 1 << random.randrange(8)
    return bytes(changed)


def number(data, random, _, places=None):
    """Replace a whole number, in either byte order, by one at a boundary."""
    width = random.choice(WIDTHS)
    at = random.choice(places) if places else _place(data, random) // width * width
    at = max(min(at, len(data) - width), 0)
    order, top = random.choice(("little", "big")), 256**width
    old = int.from_bytes(data[at : at + width], order)
    boundaries = (0, 1, 2, top - 1, top - 2, top // 2, top // 2 - 1, old + 1, old - 1, 2 * old, old // 2, -old)
    sizes = (len(data), len(data) - at, len(data) - at - width, len(data) + 1, *(1 << bits for bits in range(4, 40, 4)))
    return data[:at] + (random.choice(boundaries + sizes) % top).to_bytes(width, order) + data[at + width :]


def cut(data, random, _):
    """Leave out the end."""
    return data[: random.randrange(len(data))]


def drop(data, random, _):
    """Leave out a part."""
    at, size = _place(data, random), _size(random)
    return data[:at] + data[at + size :]


def double(data, random, _):
    """Repeat a part."""
    at, size = _place(data, random), _size(random)
    return data[: at + size] + data[at : at + size] * random.choice((1, 1, 2, 20)) + data[at + size :]


def insert(data, random, _):
    """Insert a run of equal bytes, or of random ones."""
    at, size = _place(data, random), _size(random)
    run = random.choice((bytes(size), b"\xff" * size, bytes([random.randrange(256)]) * size, random.randbytes(size)))
    return data[:at] + run + data[at:]


def overwrite(data, random, _):
    """Replace a part by a run of equal bytes, or by random ones."""
    at, size = _place(data, random), min(_size(random), len(data))
    run = random.choice((bytes(size), b"\xff" * size, random.randbytes(size)))
    return (data[:at] + run + data[at + size :])[: len(data)]


def splice(data, random, others):
    """Continue with a part of another input, or of the same."""
    other = random.choice([*others, data])
    return data[: _place(data, random)] + other[random.randrange(len(other) + 1) :]


BYTES = (flip, number, number, cut, drop, double, insert, overwrite, splice)
"""Mutations of any data."""


def token(data, random, _):
    """Replace, double, swap or leave out a token of a text, or of the text at the beginning of data."""
    text = data.decode("latin-1")
    found = list(re.finditer(r"-?\w[\w.+-]*|[^\w\s]", text[: max(FIRST_BYTES, random.choice((0, len(text))))]))
    if not found:
        return data
    one, other = random.choice(found), random.choice(found)
    change = random.randrange(5)
    if change < 2:
        new = random.choice(EVIL_NUMBERS if change and one[0][-1:].isdigit() else EVIL_NUMBERS + EVIL_WORDS)
    else:
        new = (other[0], "", one[0] * random.choice((2, 3, 500)))[change - 2]
    return data[: one.start()] + new.encode("utf-8", "surrogateescape") + data[one.end() :]


def line(data, random, _):
    """Leave out, repeat or move a line."""
    lines = data.split(b"\n")
    at, to = random.randrange(len(lines)), random.randrange(len(lines))
    lines[to:to] = [lines[at]] * random.choice((0, 0, 1, 1, 2, 300))
    if random.random() < 0.5:
        lines.pop(at)
    return b"\n".join(lines)


TEXT = (token, token, token, line, flip, cut, drop, double, insert, splice)


def document(data, random, _):
    """Replace, leave out, nest or move a value of a JSON or YAML document."""
    try:
        content = [yaml.safe_load(data)]
    except (yaml.YAMLError, ValueError, RecursionError):
        return token(data, random, _)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        places = list(_places(content))
        box, key = random.choice(places)
        change = random.randrange(7)
        if change < 3:
            box[key] = deepcopy(random.choice(EVIL_VALUES))
        elif change == 3:
            source, name = random.choice(places)
            box[key] = json.loads(json.dumps(source[name], default=str))  # a copy: no circles
        elif change == 4 and box is not content:
            del box[key]
        elif change == 5 and isinstance(box, dict):
            box[random.choice((f"{key}x", "", "x", 1, None, str(key).upper()))] = deepcopy(box[key])
        else:
            for _ in range(random.choice((1, 2, 60))):
                box[key] = [box[key]]
    if data.lstrip()[:1] in (b"{", b"["):
        return json.dumps(content[0], default=str).encode()
    return yaml.safe_dump(content[0], allow_unicode=True).encode("utf-8", "surrogateescape")


DOCUMENT = (document, document, document, document, *TEXT)
"""Mutations of JSON and YAML."""


def _places(content):
    """Yield every list or mapping of a document with each of its keys."""
    waiting = [content]
    while waiting:
        one = waiting.pop()
        for key in range(len(one)) if isinstance(one, list) else list(one):
            yield one, key
            if isinstance(one[key], list | dict):
                waiting.append(one[key])


def _place(data, random):
    """Return an offset, often near the beginning."""
    return random.randrange(min(len(data), FIRST_BYTES) if random.random() < 0.4 else len(data))


def _size(random):
    """Return a number of bytes, usually a small one."""
    return max(1, int(2 ** random.uniform(0, random.choice((3, 6, 12, 16)))))
