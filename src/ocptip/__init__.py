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
    from ocptip.api.certify import Certified as Certified
    from ocptip.api.certify import certify as certify
    from ocptip.api.chart import chart as chart
    from ocptip.api.check import Check as Check
    from ocptip.api.check import check as check
    from ocptip.api.compare import compare as compare
    from ocptip.api.drive import drive as drive
    from ocptip.api.export import export as export
    from ocptip.api.identify import identify as identify
    from ocptip.api.place import place as place
    from ocptip.api.plan import NoPlanError as NoPlanError
    from ocptip.api.plan import plan as plan
    from ocptip.api.rate import rate as rate
    from ocptip.api.rate import rate_along as rate_along
    from ocptip.api.rate import rate_workspace as rate_workspace
    from ocptip.api.report import report as report
    from ocptip.api.results.plan import Plan as Plan
    from ocptip.api.retime import RetimedPlan as RetimedPlan
    from ocptip.api.retime import retime as retime
    from ocptip.api.simulate import simulate as simulate
    from ocptip.api.stand import stand as stand
    from ocptip.api.studio import studio as studio
    from ocptip.api.tasks import load_task as load_task
    from ocptip.api.view import view as view
    from ocptip.basics.errors import InputError as InputError
    from ocptip.basics.errors import OcptipError as OcptipError
    from ocptip.contact import Load as Load
    from ocptip.contact import Support as Support
    from ocptip.contact import UnilateralContact as UnilateralContact
    from ocptip.contact import solve as solve
    from ocptip.contact import solve_many as solve_many
    from ocptip.contact import stability as stability
    from ocptip.robots.base_motion import BaseMotion as BaseMotion
    from ocptip.standing.arm import Robot as Robot
    from ocptip.standing.limits import Limits as Limits
    from ocptip.standing.objects import Object as Object
    from ocptip.standing.tolerance import Uncertainty as Uncertainty
    from ocptip.task_files.scene import read_scene as read_scene
    from ocptip.trajectories.drive_profile import load_drive_profile as load_drive_profile
    from ocptip.trajectories.trajectory import Trajectory as Trajectory

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

__all__ = [*_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'ocptip' has no attribute {name!r}")
    globals()[name] = value = getattr(importlib.import_module(_HOME[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
