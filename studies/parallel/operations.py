"""Operation counts and run times of generated inverse dynamics, compared with a published table.

    python -m studies.parallel.operations --out DIR [--repeats 5]

Five robots with symbolic geometry, base angles and gravity; inputs are Euler rates and accelerations.
Weighted operations by the rule of `ocptip.parallel.code.leg_plans` (sums and products 1, divisions 4, sines
and cosines 10, assignments 1). Times are those of compiled C (fastest of chunks of 1000 calls, data in
the cache), of CasADi's virtual machine through a buffer, and of generating the code.
Writes parallel_operations.json, .md and .png.
"""

from __future__ import annotations

import argparse
import platform
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from ocptip.basics.errors import InputError
from ocptip.basics.write import versions, write_json, write_text
from ocptip.parallel.code.codegen import write_c
from ocptip.parallel.code.lean import LeanFunction, lean_function
from ocptip.parallel.description.ready_made import READY_MADE
from ocptip.parallel.kinematics.platform import Kinematics
from studies.common import software, table

matplotlib.use("Agg")
import matplotlib.pyplot as plt

METHODS = ("openSYMORO", "Abdellatif", "ParaDyn")
# +-, x, /, sin and cos, := of table 5.7 in the order of METHODS (DynPar 2, 3, 3).
TABLE = {
    "3RPR tau_a": ((189, 246, 12, 35, 176), (181, 302, 6, 8, 124), (169, 275, 6, 8, 136)),
    "3RRR tau_a": ((251, 308, 0, 53, 199), (233, 432, 8, 20, 206), (209, 321, 8, 20, 193)),
    "Delta tau_a": ((890, 1094, 32, 193, 592), (415, 901, 22, 30, 368), (427, 730, 22, 24, 420)),
    "4PRRR tau_a": ((628, 642, 0, 79, 358), (293, 543, 9, 26, 253), (266, 409, 7, 18, 249)),
    "6UPS tau_s": ((1579, 1904, 30, 41, 1046), (1472, 2478, 12, 42, 811), (1194, 1864, 14, 42, 942)),
    "6UPS J_a": ((205, 930, 30, 505, 465), (150, 318, 0, 42, 172), (120, 312, 0, 42, 245)),
    "6UPS tau_a": None,
}
WEIGHTS = np.array([1, 1, 4, 10, 1])

_DRIVER = """
#include <stdio.h>
#include <time.h>
#include "robot.h"
static double in[{inputs}] = {{{values}}};
static double out[{outputs}];
static double w[{work} + 1];
static casadi_int iw[{integers} + 1];
int main(void) {{
  const double* arg[{args} + 1];
  double* res[{results} + 1];
  struct timespec a, b;
  double sum = 0, time, best = 1e30;
  int chunk, k;
  {pointers}
  for (chunk = 0; chunk < {chunks}; ++chunk) {{
    clock_gettime(CLOCK_MONOTONIC, &a);
    for (k = 0; k < {calls}; ++k) {{
      in[0] += 1e-12;
      robot(arg, res, iw, w, 0);
      sum += out[0];
    }}
    clock_gettime(CLOCK_MONOTONIC, &b);
    time = ((b.tv_sec - a.tv_sec) * 1e9 + (b.tv_nsec - a.tv_nsec)) / {calls};
    best = time < best ? time : best;
  }}
  printf("%.9g %.9g\\n", best, sum);
  return 0;
}}
"""


def generate(row: str, dynpar: int) -> tuple[LeanFunction, float]:
    """The function of a row of the table, and the seconds it took."""
    kind, what = row.split()
    robot = READY_MADE[kind]()
    start = time.perf_counter()
    if what == "J_a":
        function = lean_function(robot, ("J_a",), form="S", dynpar=dynpar, name="robot")
    elif what == "tau_s":
        function = lean_function(robot, form="X", dynpar=dynpar, name="robot")
    else:
        function = lean_function(robot, form="A", euler=True, dynpar=dynpar, name="robot")
    return function, time.perf_counter() - start


def inputs_of(row: str, function: LeanFunction) -> list[np.ndarray]:
    """A state near the home pose."""
    robot = READY_MADE[row.split()[0]]()
    rng = np.random.default_rng(0)
    z = robot.home + rng.uniform(-0.02, 0.02, robot.m)
    rates, accelerations = rng.uniform(-1, 1, (2, robot.m))
    q = np.column_stack(Kinematics(robot).point_joints(z).q)
    return [z, rates, accelerations, q, function.geometry, function.inertia, function.gravity]


def compiled_time(function: LeanFunction, inputs: list[np.ndarray], flag: str, repeats: int) -> float | None:
    """Nanoseconds per call of the compiled code, the best of some runs; None without a compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return None
    plain = function.function
    sizes = [value.size for value in inputs]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    results = [plain.numel_out(k) for k in range(plain.n_out())]
    ends = np.concatenate([[0], np.cumsum(results)]).astype(int)
    pointers = [f"arg[{k}] = in + {starts[k]};" for k in range(len(inputs))]
    pointers += [f"res[{k}] = out + {ends[k]};" for k in range(len(results))]
    driver = _DRIVER.format(
        inputs=starts[-1],
        values=", ".join(repr(float(v)) for value in inputs for v in value.ravel("F")),
        outputs=ends[-1],
        work=plain.sz_w(),
        integers=plain.sz_iw(),
        args=plain.sz_arg(),
        results=plain.sz_res(),
        pointers="\n  ".join(pointers),
        chunks=300,
        calls=1000,
    )
    with tempfile.TemporaryDirectory() as folder:
        files = write_c(function, Path(folder) / "robot.c")
        main = Path(folder) / "driver.c"
        main.write_text(driver)
        program = Path(folder) / "driver"
        command = [compiler, flag, str(files.source), str(main), "-o", str(program), "-lm"]
        subprocess.run(command, check=True, capture_output=True)
        times = []
        for _ in range(repeats):
            done = subprocess.run([str(program)], check=True, capture_output=True, text=True)
            times.append(float(done.stdout.split()[0]))
    return min(times)


def buffered_time(function: LeanFunction, inputs: list[np.ndarray], repeats: int) -> float:
    """Nanoseconds per call of the virtual machine through a buffer, the best of some runs."""
    buffer, evaluate = function.function.buffer()
    for k, value in enumerate(inputs):
        buffer.set_arg(k, memoryview(np.ascontiguousarray(value.ravel("F"), dtype=float)))
    results = [np.zeros(function.function.numel_out(k)) for k in range(function.function.n_out())]
    for k, result in enumerate(results):
        buffer.set_res(k, memoryview(result))
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(5000):
            evaluate()
        times.append((time.perf_counter() - start) / 5000 * 1e9)
    return min(times)


def study(repeats: int, flag: str) -> dict[str, Any]:
    """All rows."""
    rows = []
    for row, published in TABLE.items():
        counts, seconds = {}, {}
        for dynpar in (1, 2, 3):
            function, seconds[dynpar] = generate(row, dynpar)
            counts[dynpar] = function.count.to_dict()
        inputs = inputs_of(row, function)
        sums = {}
        if published:
            sums = {m: int(WEIGHTS @ p) for m, p in zip(METHODS, published, strict=True)}
        rows.append(
            {
                "function": row,
                "published": sums,
                "operations": {f"DynPar {d}": c for d, c in counts.items()},
                "generation_s": seconds[3],
                "compiled_ns": compiled_time(function, inputs, flag, repeats),
                "virtual_machine_ns": buffered_time(function, inputs, repeats),
            }
        )
        print(_line(rows[-1]), flush=True)
    return {"rows": rows, "environment": environment(flag), "repeats": repeats}


def environment(flag: str) -> dict[str, str]:
    """Versions and machine."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    version = ""
    if compiler is not None:
        done = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False)
        version = done.stdout.splitlines()[0]
    return {
        **versions(("casadi",)),
        "machine": platform.machine(),
        "compiler": f"{version} {flag}",
    }


def _line(row: dict[str, Any]) -> str:
    best = min(row["published"].values()) if row["published"] else None
    ours = row["operations"]["DynPar 3"]
    saved = f"{1 - ours['weighted'] / best:5.0%}" if best else "    -"
    compiled = f"{row['compiled_ns'] / 1e3:8.2f}" if row["compiled_ns"] is not None else "       -"
    return (
        f"{row['function']:12} {best or '-':>6} {ours['weighted']:6} {saved} "
        f"{compiled} {row['virtual_machine_ns'] / 1e3:8.2f} {row['generation_s']:7.2f}"
    )


def markdown(result: dict[str, Any]) -> str:
    """The tables for people."""
    lines = [
        "# Generated inverse dynamics: operations and times",
        "",
        "Weighted operations (sums, products, assignments 1, divisions 4, sines and cosines 10), Euler",
        "inputs, symbolic geometry, gravity and parameters; DynPar 1 about the centre of mass, 2 about the",
        "frames' origins, 3 base parameters. Published: table 5.7. The Delta is the real one (tilted base",
        "frames); the published Delta has vertical axes, which are cheaper.",
        "",
    ]
    rows = []
    for row in result["rows"]:
        published = [str(row["published"].get(m, "-")) for m in METHODS]
        ours = [row["operations"][f"DynPar {d}"]["weighted"] for d in (1, 2, 3)]
        saved = f"{1 - ours[2] / min(row['published'].values()):.0%}" if row["published"] else "-"
        rows.append([row["function"], *published, *map(str, ours), saved])
    head = ["function", *METHODS, *(f"DynPar {d}" for d in (1, 2, 3)), "below the best"]
    lines += [*table(head, rows), ""]
    rows = []
    names = ("additions", "multiplications", "divisions", "trigonometric", "assignments", "arithmetic")
    for row in result["rows"]:
        numbers = [str(row["operations"]["DynPar 3"][name]) for name in names]
        operations = row["operations"]["DynPar 3"]
        numbers.append(str(operations["arithmetic"] + sum(operations[name] for name in names[:4])))
        compiled = "-" if row["compiled_ns"] is None else f"{row['compiled_ns'] / 1e3:.2f}"
        times = [compiled, f"{row['virtual_machine_ns'] / 1e3:.2f}", f"{row['generation_s']:.2f}"]
        rows.append([row["function"], *numbers, *times])
    head = ["function (DynPar 3)", "+-", "x", "/", "sin cos", ":=", "without :=", "all :="]
    head += ["compiled, us", "virtual machine, us", "generated in, s"]
    lines += [
        *table(head, rows),
        "",
        "*Without :=*: arithmetic only. *All :=*: the least favourable reading, every operation assigned.",
    ]
    lines += ["", f"Best of {result['repeats']} runs. {software(result['environment'])}.", ""]
    return "\n".join(lines)


def plot(result: dict[str, Any], target: Path) -> None:
    """Bars: published methods and ours."""
    rows = [row for row in result["rows"] if row["published"]]
    fig, axes = plt.subplots(figsize=(9, 4), layout="constrained")
    series = {m: [row["published"][m] for row in rows] for m in METHODS}
    for dynpar in (2, 3):
        series[f"ocptip, DynPar {dynpar}"] = [
            row["operations"][f"DynPar {dynpar}"]["weighted"] for row in rows
        ]
    colors = ("#bbbbbb", "#999999", "#666666", "#7fb2dd", "#1f5f99")
    width = 0.8 / len(series)
    for k, ((name, values), color) in enumerate(zip(series.items(), colors, strict=True)):
        axes.bar(np.arange(len(rows)) + (k - 2) * width, values, width, label=name, color=color)
    axes.set_xticks(range(len(rows)), [row["function"] for row in rows])
    axes.set_ylabel("weighted operations")
    axes.set_axisbelow(True)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(frameon=False)
    fig.savefig(target, dpi=150)
    plt.close(fig)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the results")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--flag", default="-O2", help="of the C compiler")
    options = parser.parse_args()
    if options.repeats < 1:
        raise InputError(f"--repeats: must be >= 1, got {options.repeats}")
    options.out.mkdir(parents=True, exist_ok=True)
    print("function       best   ours  less compiled  machine generated  (us, us, s)")
    result = study(options.repeats, options.flag)
    write_json(options.out / "parallel_operations.json", result, indent=1)
    write_text(options.out / "parallel_operations.md", markdown(result))
    plot(result, options.out / "parallel_operations.png")
    print(f"wrote parallel_operations.json, .md and .png to {options.out}")


if __name__ == "__main__":
    main()
