"""The sentence that bad input is answered with."""

import pickle

import pytest

from bhm_service.errors import BadInputError


@pytest.mark.parametrize("hint", [None, "allowed are 1 to 12"])
def test_it_comes_out_of_a_worker_as_it_was_said(hint):
    said = BadInputError("pack.toml", "series is 0", hint)
    heard = pickle.loads(pickle.dumps(said))
    assert isinstance(heard, BadInputError)
    assert (str(heard), heard.where, heard.problem, heard.hint) == (str(said), said.where, said.problem, hint)
