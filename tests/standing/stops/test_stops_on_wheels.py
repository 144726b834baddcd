"""Stops of a slider on two wheels amid casters: equally compliant wheels have a third of the friction."""

import numpy as np
import pytest

from ocptip.cli.motion_summary import cancel_lines
from ocptip.motion.check import check_motion
from ocptip.motion.stops.cancels import safe_decelerations
from ocptip.motion.stops.check import _contact_text, check_stops
from ocptip.motion.stops.rules import StopRules
from ocptip.standing.arm import Robot
from ocptip.standing.limits import Limits
from ocptip.standing.stops.along_path import PathStops
from ocptip.standing.stops.by_brakes import Brakes
from ocptip.standing.stops.by_cancel import Cancel
from ocptip.standing.tolerance import NONE, Uncertainty
from ocptip.standing.within.in_motion import ALIKE
from ocptip.trajectories.trajectory import Trajectory
from tests.standing.at_rest.test_alike_friction import FRICTION, on_wheels

BASE, SLIDER, GRAVITY = 49.0, 10.0, 9.81
FRICTION_FORCE = FRICTION * (BASE + SLIDER) * GRAVITY / 3  # N, of the wheels that bear a third of the weight
URDF = """<robot name="slider"><link name="base"><inertial><mass value="49"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="slide"><inertial><mass value="10"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="along" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-0.2" upper="0.2" velocity="1" effort="400"/></joint></robot>"""


@pytest.fixture(scope="module")
def slider() -> Robot:
    robot = Robot.from_urdf(URDF, contacts=on_wheels(0.0).contacts, floor=False)
    return robot.varied(arm=robot.arm.with_limits(acceleration=np.array([20.0])))


def slow(end: float = 0.5) -> Trajectory:
    """The slider moves a little, at 0.02 m/s in the middle."""
    times = np.linspace(0, end, 11)
    return Trajectory.from_points(times, 0.01 * np.sin(np.pi * times / end / 2)[:, None] ** 2)


@pytest.mark.parametrize(("deceleration", "slips"), [(5.0, False), (15.0, True)])
@pytest.mark.parametrize("tolerance", [NONE, Uncertainty(friction=0.2)])
def test_a_cancelled_slider_pulls_with_its_mass_times_its_deceleration(
    slider, deceleration, slips, tolerance
):
    limits = Limits(GT=0.99, tolerance=tolerance)
    found = safe_decelerations(slider, slow(), limits, Cancel((deceleration,), GT=0.99))
    use = SLIDER * deceleration / FRICTION_FORCE / (1 - tolerance.friction)
    assert found.hardest.friction_if_feet_give_alike == pytest.approx(use, rel=1e-2)
    assert found.maximum == pytest.approx(1 / use if slips else 1.0, abs=0.01)
    assert found.alike == pytest.approx(found.maximum * use, rel=1e-2)
    assert not found.slips_alike
    end = f"at 100 % equally compliant feet use {100 * use:.0f} % of the friction. Set that in the controller"
    assert (end in found.text) is slips


def test_where_only_the_best_sharing_holds_no_deceleration_is_recommended(slider):
    """Wheels of which even the gentlest stop takes all the friction that equal compliance leaves them."""
    full = Cancel((21 * FRICTION_FORCE / SLIDER,), GT=0.99)
    slippery = slider.varied(support=slider.support.varied(on_wheels(0.0).contacts))
    found = safe_decelerations(slippery, slow(), Limits(GT=0.99), full, close=1.0)
    assert found.slips_alike
    assert found.minimum is found.maximum is None
    assert found.best_sharing == pytest.approx((0.05, 0.1), abs=0.051)
    assert found.alike == pytest.approx(1.05, rel=1e-2)
    assert (found.yaml, found.to_dict()["maximum_safe_share"]) == ("", None)
    assert max(map(len, cancel_lines(found, yaml=True))) <= 80
    assert (
        "% only the best sharing of the load holds: equally compliant feet use at least 105 %" in found.text
    )
    assert "Set that" not in found.text
    assert found.text.endswith("What helps: more friction, or `stiffness` of the contacts where known")


def test_stops_name_what_equally_compliant_wheels_use(slider):
    motion, brakes = slow(), Brakes((150.0,), (150.0,), GT=0.99)
    limits = Limits(GT=0.99, stops=PathStops(GT=0.99), brakes=brakes)
    stops = check_stops(slider, motion, limits, StopRules(), check_motion(slider, motion, limits), "both")
    assert stops.worst["brakes"][ALIKE] == pytest.approx(150 / FRICTION_FORCE, rel=1e-2)
    assert stops.worst["path"][ALIKE] == pytest.approx(SLIDER * 20 / FRICTION_FORCE, rel=1e-2)
    assert "equally compliant feet use at least 130 % of the friction" in _contact_text(stops.worst["brakes"])
    assert stops.verified
    assert stops.slips_alike
