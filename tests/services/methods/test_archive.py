import msgspec
import numpy as np
import pytest

from eigenfail.errors import ProtocolError
from eigenfail_services.methods import archive


class Facts(msgspec.Struct, frozen=True):
    count: int


ARRAYS = {
    "weights": np.arange(6, dtype=np.float32).reshape(2, 3),
    "steps": np.array([1, 2**40], np.int64),
    "empty": np.zeros((0, 4), np.float64),
}


def test_what_is_written_is_read_again_and_can_be_written_to():
    facts, arrays = archive.read("toy", archive.write("toy", Facts(3), ARRAYS), Facts)
    assert facts == Facts(3)
    assert arrays.keys() == ARRAYS.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, ARRAYS[name], strict=True)
        assert array.flags.writeable


def test_a_state_of_another_kind_is_refused_by_name():
    with pytest.raises(ProtocolError, match=r"not a state of toy .* they are other version 1"):
        archive.read("toy", archive.write("other", Facts(3), {}), Facts)


@pytest.mark.fault("damaged checkpoint")
def test_every_flipped_byte_is_noticed():
    data = archive.write("toy", Facts(3), {"a": np.ones(2, np.float32)})
    for i in range(len(data)):
        damaged = bytearray(data)
        damaged[i] ^= 0x40
        with pytest.raises(ProtocolError):
            archive.read("toy", bytes(damaged), Facts)


def test_facts_of_another_shape_are_refused():
    class Others(msgspec.Struct):
        name: str

    with pytest.raises(ProtocolError):
        archive.read("toy", archive.write("toy", Facts(3), {}), Others)


def test_an_object_array_is_not_written():
    with pytest.raises(msgspec.ValidationError):
        archive.write("toy", Facts(3), {"a": np.array([object()])})


def test_take_says_what_is_there():
    with pytest.raises(ValueError, match=r"'weights' should have shape \(3, 2\).*\(2, 3\)"):
        archive.take(ARRAYS, "weights", (3, 2))
    with pytest.raises(ValueError, match="there is nothing"):
        archive.take(ARRAYS, "biases", (3, 2))
