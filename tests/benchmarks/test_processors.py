"""Emulated types of processors: the same episodes and modes, bit for bit."""

import pytest
from benchmarks.truth.processors import SMALL, run_on

from eigenfail.processes import COMMON_PROCESSOR, NUMERIC_ENVIRONMENT, ONE_THREAD, find_processor

OLD = {"OPENBLAS_CORETYPE": "Sandybridge", "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"}
NEW = {"OPENBLAS_CORETYPE": "Haswell"}
METHODS = ("ast", "difs", "evaluate")

pytestmark = pytest.mark.skipif(
    find_processor() != COMMON_PROCESSOR, reason="there are no common kernels on this processor"
)


def test_campaigns_and_modes_are_the_same_on_processors_of_two_types():
    assert run_on(OLD, NUMERIC_ENVIRONMENT, METHODS) == run_on(NEW, NUMERIC_ENVIRONMENT, METHODS)


def test_without_the_environment_of_our_processes_learners_differ():
    """If this fails, the emulated types are no types any more, and the test above shows nothing."""

    old, new = (run_on(given, ONE_THREAD, ["ast"]) for given in (OLD, NEW))
    assert old["ast"] != new["ast"]


def test_each_method_has_a_campaign():
    from eigenfail import plugins

    assert set(SMALL) == set(plugins.names(plugins.METHODS))
