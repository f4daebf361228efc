"""With what episodes are run here, and how that differs from elsewhere."""

import numpy as np
import osqp

from eigenfail.processes import COMMON_PROCESSOR, find_processor
from eigenfail.versions import differences, read_version, versions, with_plugins


def test_it_names_what_digests_depend_on():
    told = versions()
    assert told["numpy"] == np.__version__
    assert told["osqp"] == osqp.__version__
    assert {"python", "machine", "eigenfail", "highway-env"} <= told.keys()
    assert all(told.values()) or not find_processor()


def test_packages_with_plugins_are_among_them():
    assert "eigenfail" in with_plugins()


def test_what_is_not_there_has_no_version():
    assert read_version("no-such-package") == ""


def test_processors_that_compute_alike_are_one_kind(tmp_path):
    facts = tmp_path / "cpuinfo"
    assert find_processor(facts) == ""
    facts.write_text("cpu\t: 1\nmodel name\t: Some Chip 3\nflags\t\t: sse2 avx\n")
    assert find_processor(facts) == "Some Chip 3"
    facts.write_text("cpu\t: 1\nmodel name\t: Chip 4\nflags\t\t: fma sse2 avx avx2 avx512f\n")
    assert find_processor(facts) == COMMON_PROCESSOR


def test_what_differs_is_told_with_both_sides():
    then = {"numpy": "2.4.5", "osqp": "1.1.3", "gone": "1"}
    now = {"numpy": "2.4.6", "osqp": "1.1.3", "new": "2"}
    assert differences(then, now) == (
        "gone 1 then, none now",
        "new none then, 2 now",
        "numpy 2.4.5 then, 2.4.6 now",
    )
    assert differences(now, now) == ()
