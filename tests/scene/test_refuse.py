import numpy as np
import pytest

from tensegrity_codegen.scene.refuse import refuse
from tensegrity_codegen.system.errors import InvalidValueError

NAMES = tuple("abcdefgh")


def test_no_bad_row_is_no_error():
    refuse(np.zeros(8, dtype=bool), InvalidValueError, "bad", section="nodes", names=NAMES, where="f")


def test_the_first_bad_row_is_named_and_the_others_are_counted():
    bad = np.ones(8, dtype=bool)
    bad[0] = False
    with pytest.raises(InvalidValueError) as caught:
        refuse(
            bad,
            InvalidValueError,
            "bad",
            section="nodes",
            names=NAMES,
            where="f",
            key="mass",
            given=np.arange(8.0),
            allowed="more",
            hint="less",
        )
    error = caught.value
    assert error.where == "f: nodes.b.mass"
    assert error.problem == "bad (also in c, d, e, f, g and 1 more)"
    assert error.given == 1.0
    assert type(error.given) is float
    assert (error.allowed, error.hint) == ("more", "less")


def test_given_may_be_vectors():
    with pytest.raises(InvalidValueError) as caught:
        refuse(
            np.array([True]),
            InvalidValueError,
            "bad",
            section="nodes",
            names=("a",),
            where="",
            given=np.ones((1, 3)),
        )
    assert caught.value.given == [1.0, 1.0, 1.0]
    assert caught.value.where == "nodes.a"
