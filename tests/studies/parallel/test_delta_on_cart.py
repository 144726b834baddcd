"""The study of the Delta on a cart: what it compares with is allowed."""

from __future__ import annotations

from types import SimpleNamespace

from studies.parallel import delta_on_cart


def test_the_cheapest_is_one_of_the_allowed_motions(monkeypatch):
    robot = SimpleNamespace(energy=lambda motion: 10.0 - motion.end)  # the slower, the cheaper
    task = SimpleNamespace(robot=robot, limits=None)

    def motion_of(_, duration):
        return SimpleNamespace(end=duration)

    monkeypatch.setattr(delta_on_cart, "shortest", lambda *_: motion_of(task, 1.0))
    monkeypatch.setattr(
        delta_on_cart, "check_motion", lambda _, motion, __: SimpleNamespace(verified=motion.end < 2.5)
    )
    found = delta_on_cart.cheapest(task, motion_of)
    assert 2.3 < found.end < 2.5
