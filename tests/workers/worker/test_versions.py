"""With what a worker says that it runs its episodes."""

import numpy as np
import osqp

from eigenfail_workers.worker import versions as module
from eigenfail_workers.worker.versions import pinned, processor, versions, with_plugins


def test_it_names_what_digests_depend_on():
    told = versions()
    assert told["numpy"] == np.__version__
    assert told["osqp"] == osqp.__version__
    assert {"python", "machine", "eigenfail", "highway-env"} <= told.keys()
    assert all(told.values()) or not processor()


def test_packages_with_plugins_are_among_them():
    assert "eigenfail" in with_plugins()


def test_what_is_not_there_has_no_version(monkeypatch, tmp_path):
    assert pinned("no-such-package") == ""
    monkeypatch.setattr(module, "PROCESSORS", tmp_path / "none")
    assert processor() == ""
    (tmp_path / "none").write_text("cpu\t: 1\nmodel name\t: Some Chip 3\nmodel name\t: other\n")
    assert processor() == "Some Chip 3"
