import numpy as np

from mocapclean.simulate import hide, perform
from mocapclean.solvers.kriging import Params
from mocapclean.solvers.kriging.take_state import TakeState


def test_only_short_gaps_are_known_from_the_beginning():
    truth = perform("walk", 1.0, 120.0).markers
    hidden = np.zeros_like(truth.trusted)
    hidden[50:53, 0] = hidden[50:80, 1] = True
    state = TakeState(hide(truth, hidden), Params())
    short = hidden & (np.arange(hidden.shape[1]) == 0)
    assert np.array_equal(state.known, ~hidden | short)
    assert np.array_equal(np.isfinite(state.sd), short)
    assert np.array_equal(state.missing, ~state.known)
