"""Dependencies between parts of the package: they are acyclic, and each part may import only the parts listed."""

import ast
import subprocess
import sys
from functools import cache

from tests.paths import ROOT

PACKAGE = ROOT / "seaclutter_cli"
MOST_MODULES = 105

BASE = {
    "arrays",
    "text",
    "errors",
    "buckets",
    "parts",
    "paths",
    "urls",
    "options",
    "limits",
    "threads",
    "documents",
    "records",
    "cloud",
    "frame",
    "truth",
    "interfaces",
    "params",
    "registry",
    "given",
}
CORE = (
    BASE
    | {"messages", "sensors", "sources", "sinks", "labels", "filters", "evaluation", "clustering", "tracking", "water"}
    | {
        "selection",
        "reading",
        "pipeline",
    }
)
ALLOWED = {
    "arrays": set(),
    "text": set(),
    "errors": set(),
    "documents": {"errors", "paths"},
    "parts": set(),
    "paths": {"limits"},
    "urls": {"errors"},
    "storage": {"errors", "parts", "threads", "urls"},
    "buckets": {"errors", "options", "storage", "urls"},
    "options": {"text", "errors", "registry", "urls"},
    "records": {"text"},
    "limits": {"errors"},
    "threads": {"errors"},
    "interrupts": set(),
    "jobs": {"errors", "interrupts", "registry", "threads"},
    "cloud": {"text", "errors", "records"},
    "frame": {"text", "errors", "records", "cloud"},
    "truth": {"errors"},
    "registry": {"errors"},
    "given": {"errors", "frame", "interfaces", "paths"},
    "interfaces": BASE - {"given"},
    "params": set(),
    "validation": {"text", "errors", "documents", "params", "paths"},
    "messages": BASE,
    "sensors": BASE,
    "sources": BASE | {"messages", "sensors"},
    "tracking": BASE | {"clustering", "neighbors", "water"},
    "sinks": BASE | {"messages", "tracking"},
    "labels": BASE,
    "clustering": BASE,
    "neighbors": {"threads"},
    "grids": BASE,
    "airborne": BASE | {"clustering", "grids", "validation"},
    "evaluation": BASE | {"clustering"},
    "scenes": BASE | {"evaluation"},
    "water": BASE,
    "structure": BASE | {"water"},
    "suspects": BASE | {"clustering", "filters", "tracking", "water"},
    "filters": BASE | {"clustering", "grids", "neighbors", "scenes", "structure", "water"},
    "selection": BASE | {"messages"},
    "reading": BASE | {"messages", "selection"},
    "pipeline": BASE | {"reading", "selection"},
    "calibration": BASE | {"filters"},
    "config": BASE | {"filters", "evaluation", "validation"},
    "simulation": BASE | {"validation", "messages", "sensors", "sinks"},
    "reporting": BASE | {"evaluation", "messages", "reading", "selection", "tracking"},
    "plots": BASE | {"evaluation", "calibration", "reporting", "structure"},
    "viewing": BASE | {"evaluation", "messages", "reporting"},
    "runs": CORE
    | {"airborne", "grids", "calibration", "config", "jobs", "plots", "reporting", "scenes", "simulation", "structure"}
    | {"suspects", "validation", "viewing"},
    "api": BASE | {"config", "messages", "pipeline", "reading", "runs", "selection"},
    "commands": BASE | {"config", "interrupts", "runs", "selection", "sensors"},
}
"""Parts of the package and the other parts that each may import."""


def part_of(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


FILES = [path for path in sorted(PACKAGE.rglob("*.py")) if part_of(path) not in ("__init__", "__main__")]


def imported_modules(tree):
    """Yield the modules that a file imports, with the names taken from the package itself."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            if node.module == "seaclutter_cli":
                yield from (f"seaclutter_cli.{alias.name}" for alias in node.names)
            else:
                yield node.module
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            assert not any(name.startswith("seaclutter_cli") for name in names), "import names from modules"
            yield from names


@cache
def modules_of(path):
    return frozenset(imported_modules(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def calls_of(path):
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return frozenset(ast.unparse(node.func) for node in nodes if isinstance(node, ast.Call))


def parts_in(modules):
    return {module.split(".")[1] for module in modules if module.startswith("seaclutter_cli.")} - {"__version__"}


def test_a_module_imports_only_what_its_part_may():
    for path in FILES:
        part = part_of(path)
        assert part in ALLOWED, f"{part} has no entry in ALLOWED"
        assert parts_in(modules_of(path)) - {part} <= ALLOWED[part], path


def test_all_parts_with_a_rule_exist():
    assert set(ALLOWED) <= {part_of(path) for path in FILES}


def test_imports_are_acyclic():
    """Neither parts nor modules import each other in a cycle."""
    graph = {}
    for path in FILES:
        name = "seaclutter_cli." + ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        graph[name.removesuffix(".__init__")] = modules_of(path)
    parts = {part: set(ALLOWED[part]) - {part} for part in ALLOWED}
    used = {part: set() for part in ALLOWED}
    for name, modules in graph.items():
        used[name.split(".")[1]] |= (parts_in(modules) & set(parts)) - {name.split(".")[1]}
    assert not cycles(used)
    assert not cycles({name: modules & set(graph) - {name} for name, modules in graph.items()})


def cycles(graph):
    """Return the nodes that remain after repeatedly removing nodes without remaining dependencies."""
    remaining = dict(graph)
    while free := [name for name, used in remaining.items() if not used & set(remaining)]:
        for name in free:
            del remaining[name]
    return sorted(remaining)


def test_only_commands_print_or_import_click():
    for path in FILES:
        if part_of(path) != "commands":
            assert "click" not in {module.split(".")[0] for module in modules_of(path)}, path
            printing = {"print", "sys.exit", "exit", "quit", "sys.stdout.write", "sys.stderr.write"}
            assert not calls_of(path) & printing, path


def test_only_the_printer_prints():
    """Text from outside reaches the terminal in one place only, which escapes and cuts it."""
    for path in (PACKAGE / "commands").rglob("*.py"):
        printing = {"print", "click.echo", "click.secho", "sys.stdout.write", "sys.stderr.write"}
        assert path.name == "printer.py" or not calls_of(path) & printing, path


def test_only_documents_parse_yaml_and_json():
    """Files from outside go through the limits of one loader."""
    parsing = {"yaml.load", "yaml.safe_load", "yaml.parse", "yaml.compose", "json.load", "json.loads"}
    for path in FILES:
        assert part_of(path) == "documents" or not calls_of(path) & parsing, path


def test_nothing_imports_the_commands():
    for path in FILES:
        if part_of(path) != "commands":
            assert "commands" not in parts_in(modules_of(path))


def test_filtering_a_local_log_loads_few_modules(tmp_path):
    """A run does not load worlds that it does not need, such as airborne tiles, object storage and other methods."""
    arguments = ["filter", str(ROOT / "samples" / "sea.mcap"), "-n", "3", "-q", "-o", str(tmp_path / "out.mcap")]
    run = f"from seaclutter_cli.commands import cli; cli({arguments!r}, standalone_mode=False)"
    code = f"import sys; {run}; print(*(name for name in sys.modules if name.startswith('seaclutter_cli')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert len(loaded) <= MOST_MODULES
    assert not parts_in(loaded - {"seaclutter_cli"}) & {"airborne", "grids", "plots", "simulation", "storage", "water"}
