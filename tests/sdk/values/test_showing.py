"""How values show themselves: short, and as HTML only where a plug-in writes it."""

import msgspec
import pytest

from eigenfail import plugins
from eigenfail.errors import InvalidValue
from eigenfail.testing.examples import analysis_result
from eigenfail.values.rows import Rows

MOST_REPR = 6_000


@pytest.fixture
def shown_by(monkeypatch):
    """Registers what writes the HTML of values; nothing does unless it is called."""
    writers = {}
    monkeypatch.setattr(plugins, "names", lambda group: sorted(writers))
    monkeypatch.setattr(plugins, "load", lambda group, name: writers[name])
    return lambda write: writers.update(html=write)


def test_a_value_is_html_where_a_plug_in_writes_it_and_its_repr_elsewhere(shown_by):
    rows = Rows(lambda: iter(()))
    assert rows._repr_html_() is None
    shown_by(lambda value: f"<p>{type(value).__name__}</p>")
    assert rows._repr_html_() == "<p>Rows</p>"


def test_a_plug_in_that_cannot_be_loaded_leaves_the_repr_and_one_warning(monkeypatch):
    def refuse(group, name):
        raise InvalidValue(group, f"'{name}' cannot be loaded: no pandas.", "Install it.")

    monkeypatch.setattr(plugins, "names", lambda group: ["html"])
    monkeypatch.setattr(plugins, "load", refuse)
    with pytest.warns(UserWarning, match="without tables.*no pandas"):
        assert Rows(lambda: iter(()))._repr_html_() is None


def test_a_repr_is_short_however_much_a_value_holds():
    result = analysis_result()
    many = msgspec.structs.replace(result, episodes=tuple(range(1000)))
    said = repr(many)
    assert said.startswith("AnalysisResult(episodes=(0, 1, 2, 3, 4, 5, … 1000 in all), explained=")
    assert f"components=<float32 {result.components.shape}>" in said
    long = msgspec.structs.replace(result, labels=("b" * 1_000,) * 5_000)
    assert "5000 in all" in repr(long)
    assert len(repr(long)) < MOST_REPR
