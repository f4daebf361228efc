"""What methods declare of themselves, and what is taken of methods that declare nothing."""

import pytest

from eigenfail import plugins
from eigenfail.contracts import MethodTraits, Reference
from eigenfail.methods import UNDECLARED, describe_method, traits_of

BUILT_IN = [
    name for name in plugins.names(plugins.METHODS) if plugins.is_built_in(plugins.METHODS, name)
]


@pytest.mark.parametrize("name", BUILT_IN)
def test_references_are_settings_of_the_method(name: str) -> None:
    method = describe_method(name)
    assert isinstance(method.plugin.traits, MethodTraits)
    assert set(method.traits.references) <= set(method.settings_type.__struct_fields__)


def test_no_two_methods_have_one_place_in_charts() -> None:
    marks = [traits_of(name).chart_mark for name in plugins.names(plugins.METHODS)]
    assert None not in marks
    assert len(set(marks)) == len(marks)


def test_a_method_that_is_not_installed_or_declares_nothing_has_the_defaults(monkeypatch) -> None:
    class Strange:
        class Settings:
            pass

        traits = "of another kind"

    assert traits_of("gone") == UNDECLARED
    monkeypatch.setattr(plugins, "load", lambda *_: Strange)
    found = describe_method("strange")
    assert found.traits == UNDECLARED
    assert {found.estimates, found.weighs, found.exploits} == {False}
    assert found.traits.references["data_from"] is Reference.EPISODES


def test_of_the_learners_of_a_function_nothing_is_known(monkeypatch) -> None:
    monkeypatch.setattr(plugins, "load", lambda *_: lambda context, settings: None)
    assert describe_method("strange").exploits
