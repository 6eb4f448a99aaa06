"""Anderson's extrapolation: exact on affine maps, safe where a step makes things worse."""

import numpy as np

from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration


def contraction(rng: np.random.Generator, size: int) -> tuple[np.ndarray, np.ndarray]:
    basis = np.linalg.qr(rng.normal(size=(size, size)))[0]
    return basis * np.linspace(-0.5, 0.99, size) @ basis.T, rng.normal(size=size)


def test_an_affine_map_of_n_dimensions_is_solved_in_about_n_steps(rng):
    matrix, shift = contraction(rng, 6)
    fixed = np.linalg.solve(np.eye(6) - matrix, shift)
    state, memory = np.zeros((2, 3)), AndersonAcceleration(6, 6)
    for _ in range(12):
        state = memory.next_state(state, (matrix @ state.ravel() + shift).reshape(2, 3))
    np.testing.assert_allclose(state.ravel(), fixed, rtol=1e-3)
    plain = np.zeros(6)
    for _ in range(12):
        plain = matrix @ plain + shift
    assert np.linalg.norm(plain - fixed) > 100 * np.linalg.norm(state.ravel() - fixed)


def test_no_memory_is_the_plain_iteration(rng):
    image = rng.normal(size=4)
    assert AndersonAcceleration(0, 4).next_state(np.zeros(4), image) is image


def test_a_step_that_doubles_the_residual_is_taken_back(rng):
    memory = AndersonAcceleration(3, 2)
    image = np.array([1.0, 1.0])
    state = memory.next_state(np.zeros(2), image)
    np.testing.assert_array_equal(state, image)
    back = memory.next_state(state, state + 10.0)
    np.testing.assert_array_equal(back, image)
    assert memory.restarts == 1
    onward = memory.next_state(back, back + 0.5)
    np.testing.assert_array_equal(onward, back + 0.5)
