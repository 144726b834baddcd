"""Tables, sentences and figure of the time scaling."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ocptip.contact.bindings.pyramid import radius_error
from studies.common import software, table
from studies.time_scaling.losses import CELL, TOLERANCE
from studies.time_scaling.trends import CHANGED, DURATION_TRENDS, HEIGHT_TRENDS, SHORTER, sources

FASTEST, SLOWEST = 0.90, 1.10
FACETS = 12  # of the friction pyramids
LIMIT = 0.9  # of GN and GT in the plans
KINDS = {"ours": "ours", "printed": "printed motion"}
SHOWN = (0.90, 0.92, 0.94, 0.95, 0.96, 0.98, 1.00, 1.02, 1.05, 1.10)  # columns of the tables
COLORS, TOP = {"ours": "#0072b2", "printed": "#d55e00"}, 1.55  # of the figure
INTERRUPTION = 0.030  # s: longest interruption of a contact that the source saw at tau = 1 (figure 7.8)


def markdown(data: dict) -> str:
    """Tables and sentences."""
    rows = data["rows"]
    lines = ["# Time scaling: faster and slower motions", "", *NOTES.splitlines(), ""]
    for base in data["options"]["bases"]:
        mine = [r for r in rows if r["base"] == base]
        lines += [f"## First loss of a contact, {base} base", "", *table(*_losses(mine)), ""]
        lines += [f"## Worst GN / GT against tau, {base} base", "", *table(*_reserves(mine)), ""]
    lines += ["## What the experiment saw (7.4)", "", *_experiment(rows), ""]
    lines += ["## Trends of the source's plans (5.9)", "", *_trends(data), ""]
    return "\n".join([*lines, f"{software(data['versions'])}; {data['machine']['architecture']}."]) + "\n"


NOTES = f"""\
- *tau*: factor of all times, below 1 is faster. *tau\\**: the fastest that keeps all contacts, within
  {TOLERANCE:g}; *first loss*: what happens just below it, at contacts K1 to K3.
- *lost at 0.95, 0.90*: longest time without a break in which the contacts cannot hold the base at rest; what
  the base does then is not computed. Cells of {1000 * CELL:g} ms; "<" means less than one cell.
- *drives*: the smallest tau at which speeds and accelerations are within the drives' limits. Anything faster
  exists in computation only.
- GN and GT are the worst of the exact motion; above 1 they contain the acceleration of a contact. GT refers
  to the friction cones; slip begins at the edge of pyramids of {FACETS} facets, at a GT between
  {1 - radius_error(FACETS):.3f} and {1 + radius_error(FACETS):.3f}."""


def _losses(rows: Sequence[dict]) -> tuple[list[str], list[list[str]]]:
    head = ["case", "arm", "triangle, clamp", "motion", "duration [s]", "GN", "GT", "tau\\*",
            "first loss", "lost at 0.95 [ms]", "lost at 0.90 [ms]", "drives"]  # fmt: skip
    lines = []
    for r in rows:
        loss, at = r["first_loss"], by_tau(r)
        star = "none" if loss is None else f"{r['tau_star']:.4f}"
        lines.append([
            r["case"], r["arm"], f"{1000 * r['triangle_m']:.0f} mm{', clamp' if r['clamp'] else ''}",
            KINDS[r["motion"]], f"{r['duration_s']:.3f}", f"{at[1.0]['GN']:.3f}", f"{at[1.0]['GT']:.3f}",
            star if r["monotone"] else f"{star} (not the only one)",
            "" if loss is None else f"{loss['kind']} {' '.join(f'K{k}' for k in loss['contacts'])}",
            *(_milliseconds(at[tau], at[tau]["longest_s"]) for tau in (0.95, 0.90)),
            f"{r['tau_drives']:.3f}",
        ])  # fmt: skip
    return head, lines


def by_tau(row: dict) -> dict[float, dict]:
    """The results of a row by tau."""
    return {one["tau"]: one for one in row["taus"]}


def _milliseconds(one: dict, seconds: float) -> str:
    if one["stands"] or seconds:
        return f"{1000 * seconds:.1f}" if seconds else "0"
    return f"< {1000 * CELL:g}"


def _reserves(rows: Sequence[dict]) -> tuple[list[str], list[list[str]]]:
    taus = [tau for tau in by_tau(rows[0]) if tau in SHOWN]
    lines = []
    for r in rows:
        texts = [f"{one['GN']:.2f} / {one['GT']:.2f}" for tau, one in by_tau(r).items() if tau in taus]
        lines.append([f"{r['case']}, {KINDS[r['motion']]}", *texts])
    return ["case, motion", *(f"{tau:.2f}" for tau in taus)], lines


def _experiment(rows: Sequence[dict]) -> Iterator[str]:
    """Does every motion stand at tau = 1, and do 5 % less time separate contacts in B and C?"""
    yield (
        f"The source saw no contact open for more than {1000 * INTERRUPTION:.0f} ms at tau = 1 in any case, "
        "and called the contacts of B and C separated at tau = 0.95."
    )
    yield ""
    falling = [f"{r['case']} ({who(r)})" for r in rows if not by_tau(r)[1.0]["stands"]]
    yield f"At tau = 1 contacts are lost here in: {', '.join(falling) or 'none'}."
    if any(r["case"] in "BC" for r in rows):
        yield f"Longest lift-off of a contact; *found*: above {1000 * INTERRUPTION:.0f} ms at 0.95."
        yield ""
        lines = []
        for r in rows:
            if r["case"] in "BC":
                lifted = [max(by_tau(r)[tau]["lifted_s"]) for tau in (1.0, 0.95, 0.90)]
                found = "yes" if lifted[1] > INTERRUPTION else "shorter" if lifted[1] else "no"
                lines.append([r["case"], who(r), *(f"{1000 * x:.1f}" for x in lifted), found])
        yield from table(
            ["case", "motion", *(f"at {tau} [ms]" for tau in ("1.00", "0.95", "0.90")), "found"], lines
        )
    several = [f"{r['case']} ({who(r)})" for r in rows if not r["monotone"]]
    unsolved = sum(one["unsolved"] for r in rows for one in r["taus"])
    unable = [f"{r['case']} ({who(r)})" for r in rows if not r["rests_anywhere"]]
    yield ""
    yield (
        "Motions that lose a contact at some tau and keep all at a smaller one: "
        f"{', '.join(several) or 'none'}. "
        f"Paths on which the arm cannot rest everywhere: {', '.join(unable) or 'none'}. "
        f"Instants without a verified contact state: {unsolved}."
    )


def who(r: dict) -> str:
    """Whose motion, and on which base if that matters; of a row or a trend."""
    return KINDS[r["motion"]] + (f", {r['base']} base" if r["base"] else "")


def _trends(data: dict) -> Iterator[str]:
    """Per statement a line for each source of motions; then durations and heights."""
    for key, (text, _) in (DURATION_TRENDS | HEIGHT_TRENDS).items():
        mine = [t for t in data["trends"] if t["trend"] == key and t["values"]]
        yield from [f"*{text}*", ""] if mine else []
        for t in mine:
            words = {"found": t["found"], "not found": t["not_found"]}
            texts = {k: ", ".join(f"{x} ({_value(t['values'][x])})" for x in xs) for k, xs in words.items()}
            said = "; ".join(f"{k} in {text}" for k, text in texts.items() if text)
            yield f"- {who(t)}: {said}."
        yield from [""] if mine else []
    yield (
        f"In brackets ratios of durations (found: below {1 - SHORTER:g}), or by how many millimetres the "
        "centre of mass is raised and lowered against the straight line of the joint angles, at the same "
        f"angle of joint 1 (found: by {1000 * CHANGED:.0f} mm or more, and more than the other way)."
    )
    yield ""
    wanted = sources(data["rows"])
    chosen = sorted((r for r in data["rows"] if (r["motion"], r["base"]) in wanted), key=lambda r: r["case"])
    head = ["case", "motion", "duration [s]", "energy [J]", "raised [mm]", "at [%]", "lowered [mm]", "at [%]",
            "lowered [J]", "link end raised [mm]", "lowered [mm]"]  # fmt: skip
    lines = []
    for r in chosen:
        ways = [(1000 * r[f"{way}_m"], 100 * r[f"{way}_at"]) for way in ("raised", "lowered")]
        lines.append([
            r["case"], who(r if r["motion"] == "ours" else {**r, "base": None}),
            f"{r['duration_s']:.3f}", f"{r['energy_J']:.1f}",
            *(f"{x:.0f}" for way in ways for x in way), f"{r['lowered_J']:.1f}",
            f"{1000 * r['link_raised_m']:.0f}", f"{1000 * r['link_lowered_m']:.0f}",
        ])  # fmt: skip
    yield from table(head, lines)
    yield ""
    yield (
        "*at*: share of the duration at which it is so. *link*: the one that joint 2, of W1P1P2W2 joint 3, "
        "turns, about which the source saw the arms rise."
    )


def _value(value: float | Sequence[float]) -> str:
    """A ratio, or heights in mm."""
    if isinstance(value, float):
        return f"{value:.3f}"
    up, down = (f"{1000 * x:.0f}" for x in value)
    return f"+{up} -{down}"


def draw(data: dict) -> bytes:
    """PNG: worst GN and GT against tau, one panel per base and case."""
    cases, bases = data["options"]["cases"], data["options"]["bases"]
    columns = min(4, len(cases))
    per_base = -(-len(cases) // columns)
    figure = Figure(figsize=(1.0 + 3.1 * columns, 0.9 + 2.6 * per_base * len(bases)), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(per_base * len(bases), columns, squeeze=False, sharex=True, sharey=True)
    for b, base in enumerate(bases):
        block = axes[b * per_base : (b + 1) * per_base].ravel()
        for axis, case in zip(block, cases, strict=False):
            mine = [r for r in data["rows"] if (r["base"], r["case"]) == (base, case)]
            _panel(axis, f"{case}, {base} base", mine)
        for axis in block[len(cases) :]:
            axis.set_visible(False)
    figure.supxlabel("time scaling tau (below 1: faster)")
    figure.supylabel("worst GN, GT of the motion")
    style = {"color": "#444444", "lw": 1.6}
    handles = [Line2D([], [], color=COLORS[kind], lw=2.5, label=name) for kind, name in KINDS.items()]
    handles += [Line2D([], [], ls=ls, label=name, **style) for name, ls in (("GN", "-"), ("GT", "--"))]
    handles += [
        Line2D([], [], ls="", marker="v", color="#444444", label="tau*: first loss of a contact"),
        Line2D([], [], color="#8b0000", lw=0.9, label="1: loss"),
        Line2D([], [], color="#888888", lw=0.9, ls=":", label=f"{LIMIT}: limit of the plans"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=columns, frameon=False)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def _panel(axis: Axes, title: str, rows: Sequence[dict]) -> None:
    axis.set_title(title, fontsize=10)
    axis.axhspan(1, TOP, color="#f3e1e1", lw=0)
    axis.axhline(1, color="#8b0000", lw=0.9)
    axis.axhline(LIMIT, color="#888888", lw=0.9, ls=":")
    axis.axvline(1, color="#cccccc", lw=0.8)
    for height, r in zip((1.42, 1.26), sorted(rows, key=lambda r: r["motion"]), strict=False):
        color, taus = COLORS[r["motion"]], [one["tau"] for one in r["taus"]]
        for name, ls in (("GN", "-"), ("GT", "--")):
            axis.plot(taus, [one[name] for one in r["taus"]], ls, color=color, lw=1.6)
        star = r["tau_star"]
        if star and taus[0] <= star <= taus[-1]:
            axis.plot([star], [1], "v", color=color, ms=7, zorder=4)
        text = "none" if star is None else f"{star:.4f}"
        axis.text(SLOWEST - 0.004, height, f"tau* {text}", color=color, ha="right", va="center", fontsize=9)
    axis.set_xlim(FASTEST, SLOWEST)
    axis.set_ylim(0, TOP)
    axis.set_xticks([0.95, 1.0, 1.05])
    axis.set_yticks([0, 0.3, 0.6, 0.9, 1.0, 1.5], ["0", "0.3", "0.6", "0.9", "", "1.5"])
