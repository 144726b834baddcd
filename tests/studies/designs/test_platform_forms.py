import math

import casadi as cs
import numpy as np
import pytest
from hypothesis import given
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from ocptip.basics.errors import InputError
from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import control_number, platform_conditioning
from ocptip.indices.platforms.platform import PlanarPlatformPose, StewartPlatform
from ocptip.indices.platforms.reviewed import best_complex, manipulability
from studies.indices.designs.encodings import ratio_constraint
from studies.indices.designs.flight_simulator import FlightSimulator
from studies.indices.designs.optimal_planar import optimal_planar_pose
from studies.indices.designs.platform_forms import SymbolicPlatform, planar_forms, roll_pitch_yaw
from tests.indices.sample_platforms import SEEDS, random_ellipsoid, random_pose
from tests.quick import examples

QUIET = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 600}}


def symbolic(platform, kind=cs.SX):
    pose = kind.sym("pose", 6)
    return pose, SymbolicPlatform(platform, pose[:3], roll_pitch_yaw(pose[3:]))


def rotation(angles):
    return Rotation.from_euler("xyz", angles).as_matrix()


def random_platform(seed, n=6):
    rng = np.random.default_rng(seed)
    pose = random_pose(rng, n)
    return rng, StewartPlatform(pose.base, pose.platform)


@examples(20)
@given(SEEDS)
def test_forms_have_the_eigenvalues_of_the_numeric_ones(seed):
    rng, platform = random_platform(seed, 7)
    pose, model = symbolic(platform)
    oe = random_ellipsoid(rng)
    x = rng.normal(size=6) * 0.5
    R = rotation(x[3:])
    forms = cs.Function("f", [pose], [model.N, model.Z, model.W(oe), model.manipulability])
    N, Z, W, volume = (np.array(v) for v in forms(x))
    here = platform.at(x[:3], R)
    values = eigh(N, Z, eigvals_only=True)
    control = control_number(here)
    assert math.sqrt(values[0] / values[-1]) == pytest.approx(control.value, rel=1e-5)
    expected = control.lambdas * model.extent**2
    np.testing.assert_allclose(1 / values[::-1][:3], expected[:3], rtol=1e-6)
    values = eigh(N, W, eigvals_only=True)
    conditioning = platform_conditioning(here, oe.W(R, x[:3])).value
    assert math.sqrt(values[0] / values[-1]) == pytest.approx(conditioning, rel=1e-5)
    assert float(volume[0, 0]) == pytest.approx(manipulability(here), rel=1e-6)


@examples(20)
@given(SEEDS)
def test_determinant_of_six_legs(seed):
    rng, platform = random_platform(seed)
    pose, model = symbolic(platform, cs.MX)
    x = rng.normal(size=6) * 0.3
    volume = float(cs.Function("f", [pose], [model.manipulability])(x))
    assert abs(volume) == pytest.approx(manipulability(platform.at(x[:3], rotation(x[3:]))), rel=1e-7)


@examples(15)
@given(SEEDS)
def test_sigmas_are_where_their_matrices_stop_being_positive(seed):
    rng, platform = random_platform(seed)
    pose, model = symbolic(platform)
    x = rng.normal(size=6) * 0.3
    best = best_complex(platform.at(x[:3], rotation(x[3:])))
    for make, value in ((model.sigma_r, best.sigma_r), (model.sigma_s, best.sigma_s)):
        for factor, holds in ((0.99, True), (1.01, False)):
            block = make(factor * value, method="ldl")
            pivots = np.array(cs.Function("g", [pose], [block.g])(x)).ravel()
            assert (pivots.min() > 0) == holds


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "p", "upper"),
    [("lifted", 8, 0.3001), ("ldl", 8, 0.3001), ("trace", 4, 0.33), ("trace", 8, 0.31)],
)
def test_closest_pose_with_a_control_number(method, p, upper):
    """Six pose variables, target with CTN 0.17, bound 0.3."""
    design = FlightSimulator.optimal()
    target = np.array([0.35, 0.1, 0.6, 0.6, 0.25, 0.6])

    def value(x):
        return control_number(design.platform.at(x[:3], rotation(x[3:]))).value

    assert value(target) == pytest.approx(0.171, abs=1e-3)
    pose, model = symbolic(design.platform)
    block = model.control_number(0.3, method=method, p=p)
    forms = cs.Function("f", [pose], [model.N, model.Z])
    start = np.concatenate([design.position, [0.05, 0.0, 0.1]])
    guess = block.guess(*[np.array(m) for m in forms(start)])
    solver = cs.nlpsol(
        "s",
        "ipopt",
        {"x": cs.vertcat(pose, block.variables), "f": cs.sumsqr(pose - target), "g": block.g},
        QUIET,
    )
    solution = solver(x0=np.concatenate([start, guess]), lbg=block.lower, ubg=block.upper)
    assert solver.stats()["success"]
    reached = np.array(solution["x"]).ravel()[:6]
    assert 0.3 - 1e-6 <= value(reached) <= upper
    assert np.linalg.norm(reached - target) < np.linalg.norm(start - target)


def test_best_pose_by_the_surrogate():
    """From a bad pose the smooth objective climbs near the optimum, where four eigenvalues meet."""
    design = FlightSimulator.optimal()
    pose, model = symbolic(design.platform)
    solver = cs.nlpsol("s", "ipopt", {"x": pose, "f": -cs.log(model.control_surrogate(8))}, QUIET)
    solution = solver(x0=[0.2, 0.1, 0.6, 0.2, 0.1, 0.1], lbx=[-0.6] * 6, ubx=[1.0] * 6)
    x = np.array(solution["x"]).ravel()
    assert solver.stats()["success"]
    assert control_number(design.platform.at(x[:3], rotation(x[3:]))).value > 0.67


def test_conditioning_as_constraint():
    design, oe = FlightSimulator.optimal(), OperationEllipsoid.sphere(1.0, [0, 0, 0.1])
    pose, model = symbolic(design.platform)
    block = model.conditioning(oe, 0.49)
    forms = cs.Function("f", [pose], [model.N, model.W(oe)])
    start = np.concatenate([design.position, np.zeros(3)])

    def value(x):
        R = rotation(x[3:])
        return platform_conditioning(design.platform.at(x[:3], R), oe.W(R, x[:3])).value

    assert value(start) < 0.48
    guess = block.guess(*[np.array(m) for m in forms(start)])
    solver = cs.nlpsol(
        "s",
        "ipopt",
        {"x": cs.vertcat(pose, block.variables), "f": cs.sumsqr(pose - start), "g": block.g},
        QUIET,
    )
    solution = solver(x0=np.concatenate([start, guess]), lbg=block.lower, ubg=block.upper)
    assert solver.stats()["success"]
    reached = np.array(solution["x"]).ravel()[:6]
    assert value(reached) == pytest.approx(0.49, abs=1e-5)
    surrogate = cs.Function("f", [pose], [model.conditioning_surrogate(oe)])
    assert value(reached) <= float(surrogate(reached)) <= 6 ** (1 / 8) * value(reached)


def test_planar_forms_and_constraint():
    design = optimal_planar_pose(1.2, "+", 4)
    pose = cs.SX.sym("pose", 3)
    J, N, Z = planar_forms(design.base, design.platform, pose)
    assert J.shape == (4, 3)
    x = np.array([0.3, -0.2, 0.4])
    c, s = math.cos(x[2]), math.sin(x[2])
    here = PlanarPlatformPose(design.base, design.platform @ [[c, s], [-s, c]] + x[:2])
    values = eigh(*[np.array(m) for m in cs.Function("f", [pose], [N, Z])(x)], eigvals_only=True)
    assert math.sqrt(values[0] / values[-1]) == pytest.approx(control_number(here).value, rel=1e-8)
    block = ratio_constraint(N, Z, 0.9)
    guess = block.guess(*[np.array(m) for m in cs.Function("f", [pose], [N, Z])(np.zeros(3))])
    solver = cs.nlpsol(
        "s", "ipopt", {"x": cs.vertcat(pose, block.variables), "f": cs.sumsqr(pose - x), "g": block.g}, QUIET
    )
    solution = solver(x0=np.concatenate([np.zeros(3), guess]), lbg=block.lower, ubg=block.upper)
    reached = np.array(solution["x"]).ravel()[:3]
    c, s = math.cos(reached[2]), math.sin(reached[2])
    here = PlanarPlatformPose(design.base, design.platform @ [[c, s], [-s, c]] + reached[:2])
    assert control_number(here).value == pytest.approx(0.9, abs=1e-5)


def test_bad_arguments_are_refused():
    _, platform = random_platform(0)
    _, model = symbolic(platform)
    with pytest.raises(InputError, match="position: expected an SX or MX expression of shape"):
        SymbolicPlatform(platform, np.zeros(3), cs.SX.eye(3))
    with pytest.raises(InputError, match="rotation: expected an SX or MX expression of shape"):
        SymbolicPlatform(platform, cs.SX.sym("t", 3), cs.SX.eye(2))
    with pytest.raises(InputError, match="the same kind of expression"):
        SymbolicPlatform(platform, cs.SX.sym("t", 3), cs.MX.eye(3))
    with pytest.raises(InputError, match="sigma_R takes 'ldl' or 'lifted'"):
        model.sigma_r(0.1, method="trace")
    with pytest.raises(InputError, match="bound: must be > 0"):
        model.sigma_s(0.0)
