import math

import numpy as np
import pytest

from ocptip.indices.metric import OperationEllipsoid
from ocptip.indices.platforms.controllability import platform_conditioning
from ocptip.indices.platforms.platform import StewartPlatform
from ocptip.indices.platforms.reviewed import rate_platform
from studies.indices.designs.flight_simulator import FlightSimulator
from tests.indices.sample_platforms import flat_pose, random_pose

NAMES = [
    "ctn",
    "inv_cdn_oe",
    "inv_cdn_cl",
    "inv_cdn_points",
    "inv_cdn",
    "manipulability",
    "sigma_r",
    "sigma_s",
    "rigidity_rate",
]


def test_all_indices_within_their_bounds():
    rng = np.random.default_rng(0)
    for n in (6, 7):
        pose = random_pose(rng, n)
        entries = rate_platform(
            StewartPlatform(pose.base, pose.platform), ellipsoid=OperationEllipsoid.sphere(0.3, [0, 0, 0.1])
        )
        assert [entry.name for entry in entries] == NAMES
        for entry in entries:
            if n == 7 and entry.name == "rigidity_rate":
                assert math.isnan(entry.value)
                assert entry.status == "not rated: defined for six legs"
                continue
            assert entry.lower < entry.value <= entry.upper
            assert entry.status == "ok"
            assert entry.meaning


def test_ellipsoid_goes_with_the_platform():
    design = FlightSimulator.optimal()
    turn = np.diag([-1.0, -1.0, 1.0])
    oe = OperationEllipsoid([0.1, 0.0, 0.2], np.eye(3), [0.2, 0.3, 0.4])
    position = design.position + np.array([0.1, 0.05, 0.0])
    values = {e.name: e.value for e in rate_platform(design.platform, position, turn, oe)}
    pose = design.platform.at(position, turn)
    assert values["inv_cdn_oe"] == pytest.approx(platform_conditioning(pose, oe.W(turn, position)).value)
    sphere = OperationEllipsoid.sphere(0.25, [0.1, 0.0, 0.2])
    values = {e.name: e.value for e in rate_platform(design.platform, position, turn, sphere)}
    assert values["inv_cdn_cl"] == pytest.approx(values["inv_cdn_oe"])


def test_without_ellipsoid_and_in_a_singular_pose():
    pose = flat_pose(np.random.default_rng(1))
    entries = {e.name: e for e in rate_platform(StewartPlatform(pose.base, pose.platform))}
    assert math.isnan(entries["inv_cdn_oe"].value)
    assert entries["inv_cdn_oe"].status == "not rated: needs an operation ellipsoid"
    assert entries["ctn"].value == 0.0
    assert entries["ctn"].status == "singular pose"
    assert entries["rigidity_rate"].value == 0.0


def test_platform_anchors_on_one_line_have_no_point_index():
    rng = np.random.default_rng(2)
    line = np.outer(np.linspace(-1, 1, 6), [1.0, 0.2, 0.0]) + np.array([0, 0, 1.0])
    entries = {e.name: e for e in rate_platform(StewartPlatform(rng.normal(size=(6, 3)), line))}
    assert math.isnan(entries["inv_cdn_points"].value)
    assert entries["inv_cdn_points"].status == "not rated: platform anchors on one line"
    assert entries["ctn"].value == 0.0


def test_a_pose_is_rated_in_a_millisecond(benchmark):
    design, sphere = FlightSimulator.optimal(), OperationEllipsoid.sphere(0.3)
    benchmark(rate_platform, design.platform, design.position, None, sphere)
    assert benchmark.disabled or benchmark.stats.stats.min < 1e-3
