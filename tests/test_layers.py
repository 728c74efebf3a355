"""Who may import whom: data goes one way, and each part can be read knowing only those below it."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "seaclutter_cli"

BASE = {"text", "errors", "records", "cloud", "frame", "truth", "interfaces"}
ALLOWED = {
    "text": set(),
    "errors": set(),
    "records": {"text"},
    "cloud": {"errors", "records"},
    "frame": {"text", "errors", "records", "cloud"},
    "truth": {"errors"},
    "interfaces": BASE,
    "messages": BASE,
    "sensors": BASE,
    "clustering": BASE,
    "airborne": BASE | {"clustering", "validation"},
    "filters": BASE | {"airborne", "scenes"},
    "sources": BASE | {"messages", "sensors"},
    "sinks": BASE | {"messages"},
    "labels": BASE,
    "evaluation": BASE | {"clustering"},
    "pipeline": BASE | {"messages"},
    "survey": BASE | {"sensors"},
    "calibration": BASE | {"filters", "pipeline"},
    "scenes": BASE | {"evaluation"},
    "plots": BASE | {"evaluation", "calibration", "reporting"},
    "viewing": BASE | {"evaluation", "messages", "reporting"},
    "reporting": BASE | {"evaluation", "messages", "pipeline"},
    "simulation": BASE | {"validation", "messages", "sensors", "sinks"},
    "validation": {"errors"},
    "config": BASE | {"filters", "evaluation", "validation"},
    "commands": None,
}
"""Parts of the package, and the other parts each may import; None: all."""


def part_of(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_parts(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            if node.module == "seaclutter_cli":
                yield from (alias.name for alias in node.names)
            else:
                names = [node.module]
                yield from (name.split(".")[1] for name in names if name.startswith("seaclutter_cli."))
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            assert not any(name.startswith("seaclutter_cli") for name in names), "import names from modules"


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_only_what_its_part_may(path):
    part = part_of(path)
    if part in ("__init__", "__main__"):
        return
    assert part in ALLOWED, f"{part} has no rule: add one"
    allowed = ALLOWED[part]
    found = set(imported_parts(ast.parse(path.read_text()))) - {part, "__version__"}
    assert allowed is None or found <= allowed


def test_the_rule_has_no_part_that_is_gone():
    parts = {part_of(path) for path in PACKAGE.rglob("*.py")}
    assert set(ALLOWED) <= parts


def test_nothing_imports_the_commands():
    for path in PACKAGE.rglob("*.py"):
        if part_of(path) not in ("commands", "__main__"):
            assert "commands" not in set(imported_parts(ast.parse(path.read_text())))
