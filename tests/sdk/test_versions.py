"""With what episodes are run here, and how that differs from elsewhere."""

import numpy as np
import osqp

from eigenfail import versions as module
from eigenfail.versions import differences, processor, read_version, versions, with_plugins


def test_it_names_what_digests_depend_on():
    told = versions()
    assert told["numpy"] == np.__version__
    assert told["osqp"] == osqp.__version__
    assert {"python", "machine", "eigenfail", "highway-env"} <= told.keys()
    assert all(told.values()) or not processor()


def test_packages_with_plugins_are_among_them():
    assert "eigenfail" in with_plugins()


def test_what_is_not_there_has_no_version(monkeypatch, tmp_path):
    assert read_version("no-such-package") == ""
    monkeypatch.setattr(module, "PROCESSORS", tmp_path / "none")
    assert processor() == ""
    (tmp_path / "none").write_text("cpu\t: 1\nmodel name\t: Some Chip 3\nmodel name\t: other\n")
    assert processor() == "Some Chip 3"


def test_what_differs_is_told_with_both_sides():
    then = {"numpy": "2.4.5", "osqp": "1.1.3", "gone": "1"}
    now = {"numpy": "2.4.6", "osqp": "1.1.3", "new": "2"}
    assert differences(then, now) == (
        "gone 1 then, none now",
        "new none then, 2 now",
        "numpy 2.4.5 then, 2.4.6 now",
    )
    assert differences(now, now) == ()
