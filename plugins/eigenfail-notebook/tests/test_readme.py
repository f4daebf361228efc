"""The plug-in's page: what it shows runs, and its links lead somewhere."""

import re
from pathlib import Path

from matplotlib import pyplot as plt
from store_checks.examples import deliver, result, running

import eigenfail
from eigenfail.testing.examples import collision

FOLDER = Path(__file__).parents[1]
PAGE = (FOLDER / "README.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]+)")


def test_every_block_runs(client, store, monkeypatch, tmp_path):
    made = running(store, episodes=40, name="first")
    deliver(store, made, *(collision(n) if n % 4 == 0 else result(n) for n in range(10)))
    monkeypatch.setattr(eigenfail, "Client", lambda: client, raising=False)
    monkeypatch.chdir(tmp_path)
    plt.switch_backend("Agg")
    seen = {}
    for block in BLOCKS:
        exec(compile(block, "README.md", "exec"), seen)
    plt.close("all")
    assert len(seen["frame"]) == len(seen["severities"]) == 3
    assert (tmp_path / "course.svg").stat().st_size


def test_links_lead_to_files():
    links = LINK.findall(PAGE)
    assert len(links) > 5
    assert [link for link in links if not (FOLDER / link).exists()] == []
