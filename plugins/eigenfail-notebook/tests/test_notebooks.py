"""The notebooks run from top to bottom, say what they promise, and leave nothing running."""

import os
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import deadlines
import nbformat
import psutil
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "examples"
WITHIN_S = deadlines.CAMPAIGN_S

LARGEST_BYTES = 40_000

PROMISED = {
    "first_failure": {
        0: ["http://127.0.0.1:"],
        1: ["60/60", "failures"],
        2: ["<th>USD/failure [95 %]</th>"],
        3: ["min_ttc_s"],
        4: ["longitudinal_sigma_m"],
        5: ["log p = -"],
    },
    "your_own_planner": {
        1: ["careful"],
        2: ["done"],
        3: ["differs in"],
        4: ["MinTTC"],
        5: ["Did you mean 'time_gap_s'?"],
    },
    "reading_eigenfailures": {
        1: ["120/120"],
        2: ["completed"],
        3: ["explain"],
        4: ["score_1"],
        5: ["<svg"],
        6: ["reproduced a failure"],
    },
}
"""What each shows, by the number of the code cell."""

MARK = "EIGENFAIL_NOTEBOOK"
"""A variable that every process of a notebook inherits."""


def read(name):
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def shown(notebook):
    """All that its cells put out, as text and HTML, by the number of the code cell."""
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return ["\n".join(map(said, cell.outputs)) for cell in cells]


def said(output):
    if output.output_type == "stream":
        return output.text
    data = output.get("data", {})
    return "\n".join(data.get(kind, "") for kind in ("text/html", "text/plain", "image/svg+xml"))


def complaints(notebook):
    """What its cells wrote to standard error, but for how long a slow machine has been busy."""
    outputs = (output for cell in notebook.cells for output in cell.get("outputs", ()))
    errors = [output.text for output in outputs if output.get("name") == "stderr"]
    return [text for text in errors if not text.strip().endswith("s so far.")]


def bearing(mark):
    """The command lines of the processes that were started with this mark."""
    found, named = set(), f"{MARK}={mark}".encode()
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if named in Path(f"/proc/{process.pid}/environ").read_bytes().split(b"\0"):
                found.add(" ".join(process.cmdline()))
    return found


def test_these_are_all_notebooks():
    assert {file.stem for file in FOLDER.glob("*.ipynb")} == set(PROMISED)


@pytest.mark.parametrize("name", PROMISED)
def test_a_notebook_is_stored_small_and_in_form(name):
    notebook = read(name)
    nbformat.validate(notebook)
    assert (FOLDER / f"{name}.ipynb").stat().st_size < LARGEST_BYTES
    assert notebook.cells[0].source.startswith("# ")
    assert notebook.cells[-1].source == "service.stop()"


@pytest.mark.service
@pytest.mark.timeout(WITHIN_S)
@pytest.mark.parametrize("name", PROMISED)
def test_a_notebook_keeps_its_promises_quietly_and_leaves_nothing(name, tmp_path):
    notebook, mark = read(name), str(uuid4())
    seen = set()
    client = NotebookClient(
        notebook,
        timeout=WITHIN_S,
        resources={"metadata": {"path": str(tmp_path)}},
        on_cell_complete=lambda **_: seen.update(bearing(mark)),
    )
    client.execute(env=os.environ | {MARK: mark})
    found = shown(notebook)
    for cell, words in PROMISED[name].items():
        assert [each for each in words if each not in found[cell]] == [], found[cell]
    assert complaints(notebook) == []
    assert any("eigenfail_services" in command for command in seen)
    assert bearing(mark) == set()
