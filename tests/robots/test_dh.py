"""Tables of Denavit and Hartenberg's parameters against products of their four motions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ocptip.basics.errors import InputError
from ocptip.basics.toml import Table
from ocptip.robots.dh import DHRow, arm_from_dh
from ocptip.robots.dynamics import evaluate_dynamics
from ocptip.robots.kinematics import gripper_batch
from ocptip.task_files.motion import TASK
from ocptip.task_files.tables.arm import arm_of_file, read_arm

STEP = 1e-4


def motion(axis, angle, length):
    """4 x 4: turn about x or z (0, 2), and along it."""
    c, s, T = np.cos(angle), np.sin(angle), np.eye(4)
    i, k = (axis + 1) % 3, (axis + 2) % 3
    T[i, i], T[i, k], T[k, i], T[k, k], T[axis, 3] = c, -s, s, c, length
    return T


def frames(rows, convention, q):
    """All frames i in frame 0."""
    T, found = np.eye(4), []
    for row, x in zip(rows, q, strict=True):
        theta, d = (row.theta, row.d + x) if row.slides else (row.theta + x, row.d)
        about_x, about_z = motion(0, row.alpha, row.a), motion(2, theta, d)
        T = T @ (about_z @ about_x if convention == "standard" else about_x @ about_z)
        found.append(T)
    return found


def random_rows(rng, n):
    rows = []
    for _ in range(n):
        a, b, c = rng.uniform(0.01, 0.05, 3)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        inertia = turn @ np.diag([a + b, b + c, a + c]) @ turn.T
        rows.append(
            DHRow(
                *rng.uniform(-1, 1, 4),
                bool(rng.random() < 0.3),
                rng.uniform(0.5, 3),
                rng.normal(size=3),
                inertia,
            )
        )
    return rows


@given(st.integers(0, 10**6), st.sampled_from(["standard", "modified"]), st.integers(1, 7))
def test_gripper_and_its_axes_are_those_of_the_last_frame(seed, convention, n):
    rng = np.random.default_rng(seed)
    rows, q = random_rows(rng, n), rng.uniform(-2, 2, n)
    position, rotation, *_ = (x[0] for x in gripper_batch(arm_from_dh("arm", rows, convention))(q[None]))
    last = frames(rows, convention, q)[-1]
    assert np.allclose(position, last[:3, 3], atol=1e-12)
    assert np.allclose(rotation.reshape(3, 3), last[:3, :3], atol=1e-12)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_gravity_torques_are_slopes_of_the_potential_energy(convention):
    """By finite differences over the frames: a mass or centre in a wrong frame shows."""
    rng = np.random.default_rng(4)
    rows, q, g = random_rows(rng, 5), rng.uniform(-2, 2, 5), np.array([1.0, -2.0, -9.0])
    arm, still = arm_from_dh("arm", rows, convention), np.zeros((1, 5))

    def energy(q):
        places = [
            T[:3, :3] @ row.center_of_mass + T[:3, 3]
            for T, row in zip(frames(rows, convention, q), rows, strict=True)
        ]
        return -sum(row.mass * g @ p for row, p in zip(rows, places, strict=True))

    slopes = [(energy(q + STEP * e) - energy(q - STEP * e)) / (2 * STEP) for e in np.eye(5)]
    assert np.allclose(evaluate_dynamics(arm, q[None], still, still, gravity=g).torque[0], slopes, atol=1e-6)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_inertia_is_that_of_the_moving_frames(convention):
    """Twice the kinetic energy, by finite differences of the frames, is qd' M qd."""
    rng = np.random.default_rng(5)
    rows, q, qd = random_rows(rng, 5), rng.uniform(-2, 2, 5), rng.normal(size=5)
    arm, still = arm_from_dh("arm", rows, convention), np.zeros((1, 5))
    ahead, behind = (frames(rows, convention, q + s * STEP * qd) for s in (1, -1))
    twice = 0.0
    for T, A, B, row in zip(frames(rows, convention, q), ahead, behind, rows, strict=True):
        rate = (A - B) / (2 * STEP)
        speed = rate[:3, :3] @ row.center_of_mass + rate[:3, 3]
        turning = T[:3, :3].T @ rate[:3, :3]
        w = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
        twice += row.mass * speed @ speed + w @ row.inertia @ w
    needed = evaluate_dynamics(arm, q[None], still, qd[None], gravity=np.zeros(3)).torque[0]
    assert qd @ needed == pytest.approx(twice, rel=1e-6)


TABLE = """
[arm]
dh = "standard"
[[arm.joint]]
d = 0.0892
alpha_deg = 90
[[arm.joint]]
a = -0.425
[[arm.joint]]
a = -0.39243
"""


def test_a_file_without_masses_can_be_rated_but_not_stand(tmp_path):
    (tmp_path / "ur.toml").write_text(TABLE)
    arm = arm_of_file(tmp_path / "ur.toml")
    assert (arm.name, arm.joint_names) == ("ur", ("joint 1", "joint 2", "joint 3"))
    place = gripper_batch(arm)(np.array([[0.0, 0.0, 0.0]]))[0][0]
    assert np.allclose(place, [-0.425 - 0.39243, 0, 0.0892])
    data = Table.read(tmp_path / "ur.toml", TASK)
    with pytest.raises(InputError, match=r"arm.*mass: missing"), data:
        read_arm(data.table("arm"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[arm]\ndh = "craig"\n', "standard"),
        ('[arm]\ndh = "modified"\n', r"at least one \[\[arm.joint\]\]"),
        ('[arm]\ndh = "modified"\n[[arm.joint]]\nalpha = 3\n', r"joint\[1\].alpha: unknown"),
        ('[arm]\ndh = "modified"\n[[arm.joint]]\ninertia = [1, 2]\n', r"joint\[1\].inertia"),
    ],
)
def test_bad_tables_are_refused_by_name(tmp_path, text, words):
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        arm_of_file(tmp_path / "bad.toml")
