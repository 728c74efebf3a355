"""The notebook runs on the sample and gives the documented results."""

import nbformat
from nbclient import NotebookClient

from tests.paths import ROOT

NOTEBOOK = ROOT / "docs" / "first_steps.ipynb"


def test_the_notebook_runs():
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") for cell in notebook.cells), "outputs are not kept in the repository"
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(NOTEBOOK.parent)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    assert not any(output.output_type == "stream" and output.name == "stderr" for output in outputs)
    last = outputs[-1]["data"]["text/plain"]
    assert last == "{'joint': (14, 8), 'ring_intensity': (32, 0), 'none': (60, 0), 'ideal': (0, 0)}"
