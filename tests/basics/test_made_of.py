"""Pickled, copied and varied by arguments, given by place or by name."""

import copy
import pickle

import pytest

from ocptip.basics.frozen import MadeOf


class Lamp(MadeOf):
    def __init__(self, watts, *, colour="white"):
        self.watts, self.colour = watts, colour
        self.light = lambda: watts  # cannot be pickled


@pytest.mark.parametrize("again", [lambda lamp: pickle.loads(pickle.dumps(lamp)), copy.deepcopy])
def test_made_again_of_the_same(again):
    for lamp in (Lamp(5, colour="red"), Lamp(watts=5, colour="red")):
        other = again(lamp)
        assert (other.watts, other.colour, other.light()) == (5, "red", 5)


def test_what_a_process_has_is_not_made_twice():
    lamp = Lamp(5)
    pickled = pickle.dumps(lamp)
    assert pickle.loads(pickled) is lamp
    del lamp
    other = pickle.loads(pickled)
    assert other.watts == 5
    assert pickle.loads(pickle.dumps([other, other])) == [other, other]


def test_varied_in_one_argument():
    lamp = Lamp(5, colour="red").varied(watts=7)
    assert (lamp.watts, lamp.colour, lamp.light()) == (7, "red", 7)
    assert lamp.varied().watts == 7


def test_wrong_arguments_are_type_errors():
    with pytest.raises(TypeError, match="watts"):
        Lamp()
    with pytest.raises(TypeError, match="smell"):
        Lamp(5).varied(smell="none")
