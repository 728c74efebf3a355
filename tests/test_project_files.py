"""Citation, workflow, hooks and container are valid and name what exists."""

import importlib.util
import re
import tomllib

import pytest
import yaml

from seaclutter_cli import __version__
from tests import command_lines
from tests.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PYTHONS = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)}
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
SYSTEMS = {"ubuntu-latest", "macos-latest", "windows-latest"}


def load(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_the_citation_has_the_software_and_its_papers():
    citation = load(ROOT / "CITATION.cff")
    assert {"cff-version", "message", "title", "authors", "license"} <= set(citation)
    assert citation["type"] == "software"
    assert citation["version"] == __version__
    assert citation["license"] == PROJECT["license"]
    papers = citation["references"]
    assert len(papers) == 3
    assert all(paper["type"] == "article" and paper["title"] and paper["journal"] for paper in papers)
    assert all(author["family-names"] and author["given-names"] for paper in papers for author in paper["authors"])
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    assert all(paper["title"] in glossary for paper in papers)
    assert all(f"doi:{paper['doi']} " in glossary for paper in papers if "doi" in paper)


def test_pythons_start_with_the_required_one():
    assert PROJECT["requires-python"] == f">={min(PYTHONS, key=lambda text: int(text[2:]))}"


JOBS = {f"{path.stem}-{name}": job for path in WORKFLOWS for name, job in load(path)["jobs"].items()}


@pytest.mark.parametrize("job", JOBS.values(), ids=JOBS)
def test_a_job_names_what_exists(job):
    matrix = job.get("strategy", {}).get("matrix", {})
    assert set(matrix.get("os", ())) <= SYSTEMS
    assert {*matrix.get("python", ())} <= PYTHONS
    assert job["runs-on"] in SYSTEMS | {"${{ matrix.os }}"}
    for step in job["steps"]:
        assert ("uses" in step) != ("run" in step)
        assert re.search(r"@(v\d+|release/v\d+)$", step.get("uses", "@v1"))
        wanted = step.get("with", {})
        assert wanted.get("python-version", "3.13") in PYTHONS | {"${{ matrix.python }}"}
        for key in ("sparse-checkout", "cache-dependency-path"):
            assert (ROOT / wanted.get(key, ".")).exists()
        script = step.get("run", "")
        for module in re.findall(r"python -m (\w+)", script):
            assert module in ("build", "twine") or importlib.util.find_spec(module)
        for arguments in command_lines.in_script(script):
            command_lines.check(arguments)


def test_the_workflow_tests_every_python_on_every_system():
    matrix = load(ROOT / ".github" / "workflows" / "ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    assert set(matrix["os"]) == SYSTEMS
    assert set(matrix["python"]) == PYTHONS


def test_jobs_need_jobs():
    for path in WORKFLOWS:
        all_jobs = load(path)["jobs"]
        for job in all_jobs.values():
            needed = job.get("needs", [])
            assert set([needed] if isinstance(needed, str) else needed) <= set(all_jobs)


def test_hooks_run_what_is_installed():
    for repository in load(ROOT / ".pre-commit-config.yaml")["repos"]:
        assert repository["repo"] == "local"
        for hook in repository["hooks"]:
            python, flag, module, *arguments = hook["entry"].split()
            assert (python, flag) == ("python", "-m")
            assert importlib.util.find_spec(module)
            assert all((ROOT / word).exists() for word in arguments if "/" in word)


def test_the_container_copies_what_exists():
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    copies = [line.split()[1:-1] for line in lines if line.startswith("COPY") and "--from" not in line]
    sources = [source for copy in copies for source in copy]
    assert sources
    sent = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    for source in sources:
        assert (ROOT / source).exists()
        assert f"!{source}" in sent
    extras = next(line for line in lines if line.startswith("ARG EXTRAS=")).partition("=")[2]
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    images = {line.split()[1] for line in lines if line.startswith("FROM")}
    assert images <= {f"python:{version}-slim" for version in PYTHONS}


def test_the_wheel_gets_what_exists():
    with (ROOT / "pyproject.toml").open("rb") as stream:
        wheel = tomllib.load(stream)["tool"]["hatch"]["build"]["targets"]["wheel"]
    for folder in (*wheel["packages"], *wheel["force-include"]):
        assert (ROOT / folder).is_dir()
    for package in wheel["packages"]:
        assert (ROOT / package / "py.typed").exists()


def test_the_table_of_additions_names_what_exists():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    names = re.findall(r"`([^`]+)`", text.partition("\n## To add one thing\n")[2].partition("\nA method's `Params`")[0])
    code = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "seaclutter_cli").rglob("*.py"))
    for name in names:
        if "/" in name:
            pattern = re.sub(r"<\w+>", "*", name).rstrip("/")
            assert any(any(folder.glob(pattern)) for folder in (ROOT, ROOT / "seaclutter_cli")), name
        elif name.isupper():
            assert re.search(rf"^{name}\b", code, re.MULTILINE), name
