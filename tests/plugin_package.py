"""The example of a package with plug-ins, installed in a folder as pip does it."""

import shutil
import tomllib

from tests.paths import ROOT

EXAMPLE = ROOT / "examples" / "plugin"


def install(folder, *, version="1.0", groups=None, source=EXAMPLE / "src"):
    """Install a package, by default the example, and return the folder; ``groups`` are other entry points."""
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    if source is not None:
        shutil.copytree(source, folder, dirs_exist_ok=True)
    info = folder / f"{project['name'].replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n")
    lines = []
    for group, points in (groups or project["entry-points"]).items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in points.items()), ""]
    (info / "entry_points.txt").write_text("\n".join(lines))
    return folder
