import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space

from ocptip.reserves import fractional
from ocptip.reserves.fractional import largest_usage, minimise_fraction
from ocptip.reserves.optimality import ForceRange, RefinedPoint, forces_of, refined
from tests.quick import examples, some


def problem(rng, count, n, k, radius=0.0, upper=10.0):
    """Contacts with forces of about 1, held by six random equations (n (k + 1) > 6)."""
    basis = np.array([null_space(rng.normal(size=(6, n * (k + 1)))) for _ in range(count)])
    basis = basis.reshape(count, n, k + 1, -1)
    shape = (count, n)
    forces = ForceRange(
        normal=rng.uniform(0.2, 1.0, shape),
        per_z=basis[:, :, 0],
        radius=np.full(shape, radius),
        slope=rng.uniform(0.2, 0.8, shape),
        lower=np.zeros(shape),
        upper=np.full(shape, upper),
    )
    return 0.2 * rng.normal(size=(count, n, k)), basis[:, :, 1:], forces


def usage_at(q, Q, forces, z):
    return largest_usage(q + forces_of(Q, z), forces.limits(z))


@pytest.mark.parametrize(("n", "k"), some(2, [(3, 2), (4, 2), (6, 2), (5, 1)]))
def test_derivatives_of_the_optimum(n, k):
    rng = np.random.default_rng(n)
    q, Q, forces = problem(rng, 25, n, k, radius=0.3, upper=2.0)
    optimum = minimise_fraction(q, Q, forces)
    assert np.max(optimum.gap) < 1e-9
    np.testing.assert_allclose(usage_at(q, Q, forces, optimum.z), optimum.usage, rtol=1e-9)
    dq, dp, h = rng.normal(size=q.shape), rng.normal(size=q.shape[:2]), 1e-5
    values = []
    for s in (1, -1):
        moved = ForceRange(**{**vars(forces), "normal": forces.normal + s * h * dp})
        values.append(minimise_fraction(q + s * h * dq, Q, moved).usage)
    predicted = np.einsum("sik,sik->s", optimum.pull, dq) + np.einsum("si,si->s", optimum.normal_pull, dp)
    errors = np.abs((values[0] - values[1]) / (2 * h) - predicted) / (np.abs(predicted) + 1e-3)
    assert np.quantile(errors, 0.8) < 1e-6  # the others are near a change of the active contacts
    assert np.max(errors) < 0.05


@examples(25)
@given(seed=st.integers(0, 10**6), n=st.integers(3, 7), radius=st.sampled_from([0.0, 0.3]))
def test_no_other_forces_are_better(seed, n, radius):
    rng = np.random.default_rng(seed)
    q, Q, forces = problem(rng, 3, n, 2, radius)
    optimum = minimise_fraction(q, Q, forces)
    assert np.max(optimum.gap) < 1e-6
    assert np.all(optimum.usage <= usage_at(q, Q, forces, np.zeros_like(optimum.z)))
    for size in (1e-3, 1e-2, 0.1):
        for _ in range(30):
            z = optimum.z + size * rng.normal(size=optimum.z.shape)
            raw = forces.normal + np.einsum("siz,sz->si", forces.per_z, z)
            allowed = np.all((raw >= forces.lower) & (raw <= forces.upper), axis=1)
            assert np.all(usage_at(q, Q, forces, z)[allowed] >= optimum.usage[allowed] - 1e-6)


def test_fixed_limits_give_the_tangential_optimum():
    from ocptip.reserves.minimax import minimise_usage

    rng = np.random.default_rng(3)
    Q = np.array([null_space(rng.normal(size=(3, 8))).reshape(4, 2, -1) for _ in range(5)])
    q, limits = rng.normal(size=(5, 4, 2)), rng.uniform(0.3, 1, (5, 4))
    flat = np.zeros((5, 4))
    forces = ForceRange(limits, np.zeros((5, 4, Q.shape[3])), flat, flat + 1.0, flat, flat + 5.0)
    np.testing.assert_allclose(
        minimise_fraction(q, Q, forces).usage, minimise_usage(q, Q, limits).usage, rtol=1e-8
    )


def test_newton_steps_agree_with_the_iteration_alone(monkeypatch):
    q, Q, forces = problem(np.random.default_rng(7), 20, 5, 2)
    exact = minimise_fraction(q, Q, forces)

    def never(q, Q, forces, z, t, pull, normal_pull):
        no = np.zeros(len(q), dtype=bool)
        return RefinedPoint(t, z, pull, normal_pull, np.full(len(q), np.inf), no)

    monkeypatch.setattr(fractional, "refined", never)
    plain = minimise_fraction(q, Q, forces)
    np.testing.assert_allclose(plain.usage, exact.usage, rtol=1e-6)
    np.testing.assert_allclose(plain.pull, exact.pull, atol=1e-3)
    assert np.all(plain.iterations >= exact.iterations)


def test_many_states_are_mostly_solved_from_their_neighbours():
    rng = np.random.default_rng(5)
    q, Q, forces = (
        np.repeat(x, 60, axis=0) if isinstance(x, np.ndarray) else x for x in problem(rng, 1, 4, 2)
    )
    forces = forces.take(np.zeros(60, dtype=int))
    q += 0.001 * rng.normal(size=q.shape)
    found, alone = minimise_fraction(q, Q, forces), fractional._one_by_one(q, Q, forces)
    np.testing.assert_allclose(found.usage, alone.usage, rtol=0, atol=1e-11)
    assert np.max(found.gap) < 1e-9
    assert np.mean(found.iterations == 0) > 0.4


def test_a_point_that_is_not_optimal_is_not_proven():
    q, Q, forces = problem(np.random.default_rng(7), 10, 5, 2)
    optimum = minimise_fraction(q, Q, forces)
    start = optimum.z, optimum.usage, optimum.pull, optimum.normal_pull
    again = refined(q, Q, forces, *start)
    assert np.all(again.proven)
    np.testing.assert_allclose(again.t, optimum.usage, rtol=1e-10)
    wrong = refined(q, Q, forces, np.zeros_like(optimum.z), optimum.usage * 2, -optimum.pull, start[3])
    accepted = wrong.proven
    np.testing.assert_allclose(wrong.t[accepted], optimum.usage[accepted], rtol=1e-8)


def test_negligible_limits_do_not_count():
    tangential = np.array([[[3.0, 4.0], [1e-3, 0.0]]])
    assert largest_usage(tangential, np.array([[10.0, 1e-8]]))[0] == 0.5
