"""Principal components against numpy's own decomposition."""

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from eigenfail_services.analysis.components import fit_components, fix_signs

matrices = st_numpy.arrays(
    np.float32,
    st.tuples(st.integers(1, 8), st.integers(1, 6)),
    elements=st.floats(-5, 5, width=32) | st.integers(-2, 2).map(float),
).map(lambda data: data.astype(np.float64))


@pytest.mark.parametrize("shape", [(40, 12), (6, 30)])
def test_they_are_the_singular_vectors(shape: tuple[int, int]) -> None:
    data = np.random.default_rng(3).standard_normal(shape) + 1.5
    space = fit_components(data, 4)
    centred = data - data.mean(axis=0)
    _, singular, axes = np.linalg.svd(centred, full_matrices=False)
    turned = np.abs(np.sum(space.components * axes[:4], axis=1))
    assert turned == pytest.approx(np.ones(4))
    assert space.explained == pytest.approx(singular[:4] ** 2 / np.sum(singular**2))
    assert space.scores == pytest.approx(centred @ space.components.T)


def test_of_equal_entries_the_first_decides_whatever_their_rounding() -> None:
    tie = np.array([0.5, -0.5, 0.1])
    for rounding in (-1e-15, 1e-15):
        assert fix_signs(-tie[None] * [1.0, 1.0 + rounding, 1.0])[0, 0] > 0.0


@given(matrices, st.integers(1, 9))
@settings(max_examples=150, deadline=None)
def test_shares_fall_and_directions_are_orthonormal(data: np.ndarray, wanted: int) -> None:
    space = fit_components(data, wanted)
    count = len(space.explained)
    assert count <= min(wanted, max(len(data) - 1, 0), data.shape[1])
    assert space.scores.shape == (len(data), count)
    assert (np.diff(space.explained) <= 1e-12).all()
    assert (space.explained > 0.0).all()
    assert space.explained.sum() <= 1.0 + 1e-12
    assert space.components @ space.components.T == pytest.approx(np.eye(count), abs=1e-9)


@given(matrices)
@settings(max_examples=100, deadline=None)
def test_all_components_lead_back_to_the_data(data: np.ndarray) -> None:
    space = fit_components(data, 9)
    assert space.invert(space.scores) == pytest.approx(data, abs=1e-5)


@pytest.fixture
def endless(monkeypatch) -> list[str]:
    """LAPACK's routine for the decomposition says that it found no end; which one was asked."""
    real, asked = scipy.linalg.lapack.get_lapack_funcs, []

    def functions(names, *given, **options):
        decompose, lwork = real(names, *given, **options)

        def without_end(*arguments, **more):
            asked.append(names[0])
            *found, _ = decompose(*arguments, **more)
            return *found, 1

        return without_end, lwork

    monkeypatch.setattr("scipy.linalg._decomp_svd.get_lapack_funcs", functions)
    return asked


@pytest.mark.parametrize("twice", [False, True], ids=["any rows", "rows that come twice"])
def test_where_lapack_finds_no_end_the_directions_are_the_same(endless, twice) -> None:
    data = np.random.default_rng(4).standard_normal((30, 12)) * np.linspace(3.0, 1.0, 12)
    data = np.repeat(data[:8], 4, axis=0) if twice else data
    again = fit_components(data, 4)
    assert endless == ["gesdd"]
    with pytest.raises(np.linalg.LinAlgError):
        scipy.linalg.svd(data)
    centred = data - data.mean(axis=0)
    _, singular, vectors = np.linalg.svd(centred, full_matrices=False)
    assert again.components == pytest.approx(fix_signs(vectors[:4]), abs=1e-9)
    assert again.explained == pytest.approx((singular**2 / np.sum(singular**2))[:4], abs=1e-9)
    assert again.scores == pytest.approx(centred @ again.components.T, abs=1e-9)
