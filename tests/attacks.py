"""Texts that make a careless reader of YAML or JSON fail, hang or fill the memory."""

_BOMB = "\n".join(["a0: &a0 [x, x]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 12))])

YAML_DOCUMENTS = {
    "aliases of aliases": _BOMB,
    "an alias in a key": "&a x: {*a : 1}",
    "an unfinished list": "filter: [",
    "two documents": "a: 1\n---\nb: 1",
    "a terminal sequence": "filter: \x1b[31m",
    "many brackets without an end": "filter: " + "[" * 100_000,
    "many values": "filter: [" + "1," * 300_000 + "]",
    "many characters": "filter: " + "x" * 5_000_000,
    "many keys": "filter: {" + ", ".join(f"{n}: 1" for n in range(20_000)) + "}",
}
"""Documents that are refused wherever YAML is read."""

YAML_VALUES = {
    "a tag with another value, int": "!!int x",
    "a tag without a value": "!!int ''",
    "a tag with another value, bool": "!!bool x",
    "a tag of a list": "!!bool [1]",
    "a tag of a mapping": "!!map [1]",
    "a tag of Python": "!!python/object/apply:os.getcwd []",
    "a number without digits": "0x_",
    "an alias of itself": "&a [*a]",
    "3,000 brackets": "[" * 3000 + "]" * 3000,
    "a long number": "9" * 5000,
    "a number of 65 bits": "9223372036854775808",
    "a long hexadecimal number": "0x" + "f" * 5000,
    "a long number to base 60": "1:" * 3000 + "1",
    "a list as a key": "{[1]: 2}",
    "a key that is a mapping": "{{a: 1}: 2}",
}
"""Values that are refused wherever YAML is read, also on the command line."""

JSON_DOCUMENTS = {
    "nothing after a bracket": "[",
    "3,000 brackets": "[" * 3000 + "]" * 3000,
    "100,000 brackets": "[" * 100_000,
    "a long number": "[" + "9" * 5000 + "]",
    "not text": "[\udcff]",
}
"""Documents that are refused wherever JSON is read; encode them with ``surrogateescape``."""
