"""Keeps standing robots standing: stability margins, placements, motions and proofs.

A support in a few lines::

    from ocptip import Load, Support, UnilateralContact, solve

    corners = [0.4, 0, 0], [-0.2, 0.3, 0], [-0.2, -0.3, 0]
    feet = [UnilateralContact(position=p, friction=0.5) for p in corners]
    support = Support(feet, mass=60.0, center_of_mass=[0, 0, 0.6])
    print(solve(support, support.wrench([Load(force=[100, 0, 0], point=[0, 0, 1])])).persistent)

A motion in a few more::

    plan = ocptip.plan("A", starts=4)  # a published case, or the path of a task file
    print(plan)
    plan.save("plan-A")

The names below are imported on first use, so that `import ocptip` (and `ocptip --help`) is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ocptip.api.certify import Certified, certify
    from ocptip.api.chart import chart
    from ocptip.api.check import Check, check
    from ocptip.api.compare import compare
    from ocptip.api.drive import drive
    from ocptip.api.export import export
    from ocptip.api.identify import identify
    from ocptip.api.place import place
    from ocptip.api.plan import NoPlanError, plan
    from ocptip.api.rate import rate, rate_along, rate_workspace
    from ocptip.api.report import report
    from ocptip.api.results.plan import Plan
    from ocptip.api.retime import RetimedPlan, retime
    from ocptip.api.simulate import simulate
    from ocptip.api.stand import stand
    from ocptip.api.studio import studio
    from ocptip.api.tasks import load_task
    from ocptip.api.view import view
    from ocptip.basics.errors import InputError, OcptipError
    from ocptip.contact import (
        Load,
        Support,
        UnilateralContact,
        solve,
        solve_many,
        stability,
    )
    from ocptip.robots.base_motion import BaseMotion
    from ocptip.standing.arm import Robot
    from ocptip.standing.limits import Limits
    from ocptip.standing.objects import Object
    from ocptip.standing.tolerance import Uncertainty
    from ocptip.task_files.scene import read_scene
    from ocptip.trajectories.drive_profile import load_drive_profile
    from ocptip.trajectories.trajectory import Trajectory

    __version__: str

_HOME = {
    "BaseMotion": "ocptip.robots.base_motion",
    "Certified": "ocptip.api.certify",
    "Check": "ocptip.api.check",
    "InputError": "ocptip.basics.errors",
    "Limits": "ocptip.standing.limits",
    "Load": "ocptip.contact",
    "NoPlanError": "ocptip.api.plan",
    "Object": "ocptip.standing.objects",
    "OcptipError": "ocptip.basics.errors",
    "Plan": "ocptip.api.results.plan",
    "RetimedPlan": "ocptip.api.retime",
    "Robot": "ocptip.standing.arm",
    "Support": "ocptip.contact",
    "Trajectory": "ocptip.trajectories.trajectory",
    "Uncertainty": "ocptip.standing.tolerance",
    "UnilateralContact": "ocptip.contact",
    "__version__": "ocptip.basics.version",
    "certify": "ocptip.api.certify",
    "chart": "ocptip.api.chart",
    "check": "ocptip.api.check",
    "compare": "ocptip.api.compare",
    "drive": "ocptip.api.drive",
    "export": "ocptip.api.export",
    "identify": "ocptip.api.identify",
    "load_drive_profile": "ocptip.trajectories.drive_profile",
    "load_task": "ocptip.api.tasks",
    "place": "ocptip.api.place",
    "plan": "ocptip.api.plan",
    "rate": "ocptip.api.rate",
    "rate_along": "ocptip.api.rate",
    "rate_workspace": "ocptip.api.rate",
    "read_scene": "ocptip.task_files.scene",
    "report": "ocptip.api.report",
    "retime": "ocptip.api.retime",
    "simulate": "ocptip.api.simulate",
    "solve": "ocptip.contact",
    "solve_many": "ocptip.contact",
    "stability": "ocptip.contact",
    "stand": "ocptip.api.stand",
    "studio": "ocptip.api.studio",
    "view": "ocptip.api.view",
}

__all__ = [
    "BaseMotion",
    "Certified",
    "Check",
    "InputError",
    "Limits",
    "Load",
    "NoPlanError",
    "Object",
    "OcptipError",
    "Plan",
    "RetimedPlan",
    "Robot",
    "Support",
    "Trajectory",
    "Uncertainty",
    "UnilateralContact",
    "__version__",
    "certify",
    "chart",
    "check",
    "compare",
    "drive",
    "export",
    "identify",
    "load_drive_profile",
    "load_task",
    "place",
    "plan",
    "rate",
    "rate_along",
    "rate_workspace",
    "read_scene",
    "report",
    "retime",
    "simulate",
    "solve",
    "solve_many",
    "stability",
    "stand",
    "studio",
    "view",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'ocptip' has no attribute {name!r}")
    globals()[name] = value = getattr(importlib.import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
